"""MAVProxy as ground station beside the companion, and as reader of mission files."""

import re
import shutil
import subprocess
import sys

from hub import Hub
from support import DATA, GAWARE, Case, items_of_plan, items_of_waypoints

MAVPROXY = shutil.which("mavproxy.py", path=f"{sys.prefix}/bin")


class Beside(Case):
    """A simulated vehicle, MAVProxy and the companion on one hub."""

    def begin(self, *scenario, station=()):
        sim = self.start(GAWARE, "sim", "--listen", "tcpin:127.0.0.1:0", "--scenario", *scenario)
        port = re.search(r"tcpout:127\.0\.0\.1:(\d+)", sim.wait_for("tcpout:")).group(1)
        hub = Hub(int(port))
        self.addCleanup(hub.close)
        self.link = f"tcpout:127.0.0.1:{hub.port}"
        self.station = self.start(
            sys.executable,
            MAVPROXY,
            f"--master=tcp:127.0.0.1:{hub.port}",
            f"--state-basedir={self.folder}",
            "--default-modules=link,wp,misc,output,signing,param",
            "--nowait",
            *station,
            stdin=subprocess.PIPE,
        )
        self.station.wait_for("Detected vehicle 1:1 ")

    def read_by_station(self, name):
        """The mission on board without home as MAVProxy saves it."""
        path = self.folder / name
        self.station.say(f"wp save {path}")
        # It saves parameters too.
        self.station.wait_for(f" to {path}")
        return items_of_waypoints(path)

    def test_the_station_shows_what_the_companion_says(self):
        # Left to itself MAVProxy shows the texts of the autopilot's component alone.
        self.begin("fixed_wing", "--speed", 8, station=["--target-system=1", "--target-component=0"])
        self.start(GAWARE, "run", "--connect", self.link, "--no-record", "--headless", "--airframe", "small_fixed_wing")
        line = self.station.wait_for("Fly: ")
        # Longer than one STATUSTEXT: put together from its parts, to the full stop.
        self.assertGreater(len(line), 60)
        self.assertTrue(line.endswith("."), line)

    def test_the_station_sees_the_mission_that_the_companion_uploads(self):
        self.begin("mission_fixed_wing")
        plan = self.planned("plan.plan")
        self.transfer("upload", self.link, plan, backup=self.folder / "before.plan")
        # MAVProxy writes six decimals.
        self.assert_same_items(items_of_plan(plan), self.read_by_station("on-board.txt"), place_deg=1e-6)

    def test_the_companion_reads_the_mission_that_the_station_uploads(self):
        """`wp load` takes the file that the planner writes, and the companion finds it on board."""
        self.begin("mission_fixed_wing")
        for file in (self.planned("plan.waypoints"), DATA / "mission_planner.waypoints"):
            self.station.say(f"wp load {file}")
            # Read from the file, then sent.
            count = len(items_of_waypoints(file)) + 1
            self.station.wait_for(f"Loaded {count} waypoints from {file}")
            self.station.wait_for(f"Loaded {count} waypoints in")
            read = self.folder / f"read-{file.stem}.waypoints"
            self.transfer("download", self.link, read)
            self.assert_same_items(items_of_waypoints(file), items_of_waypoints(read))
