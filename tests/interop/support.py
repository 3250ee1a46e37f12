"""What the tests share: processes whose output is waited for, folders, missions."""

import json
import math
import os
import pathlib
import queue
import re
import socket
import subprocess
import sys
import tempfile
import threading
import time
import unittest

from pymavlink import mavwp

GAWARE = os.environ["GAWARE"]
DATA = pathlib.Path(__file__).parent / "data"
AIRFRAMES = pathlib.Path(__file__).parents[2] / "mission" / "airframes"
HOME = (47.397, 8.545, 441.0)
#: Longer than anything here takes on a busy machine.
PATIENCE = 60.0
#: Text of planned missions by airframe and kind of file.
PLANNED = {}


class Process:
    """A process with its output, line by line; ended at the end of the test."""

    def __init__(self, args, stdin=None):
        env = dict(os.environ, PYTHONUNBUFFERED="1")
        self.args = [str(a) for a in args]
        self.process = subprocess.Popen(
            self.args, stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=env
        )
        self.seen = []
        self._lines = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self.process.stdout:
            self._lines.put(line.decode(errors="replace").rstrip())
        self._lines.put(None)

    def wait_for(self, *texts, patience=PATIENCE):
        """The first line, of those not waited for before, that holds one of these texts."""
        end = time.monotonic() + patience
        while True:
            try:
                line = self._lines.get(timeout=max(0.0, end - time.monotonic()))
            except queue.Empty:
                line = None
            if line is None:
                heard = "\n".join(self.seen[-60:])
                raise AssertionError(f"{self.args[0]}: none of {texts} in time, but:\n{heard}")
            self.seen.append(line)
            if any(text in line for text in texts):
                return line

    def say(self, line):
        self.process.stdin.write(f"{line}\n".encode())
        self.process.stdin.flush()

    def end(self):
        self.process.kill()
        self.process.wait()
        self._reader.join()
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe:
                pipe.close()


class Case(unittest.TestCase):
    """A test with a folder of its own."""

    maxDiff = None

    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="gaware-interop-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def start(self, *args, **kwargs):
        process = Process(args, **kwargs)
        self.addCleanup(process.end)
        return process

    def gaware(self, *args, status=0):
        """Runs the program to its end; its stdout and stderr."""
        done = subprocess.run(
            [GAWARE, *map(str, args)], capture_output=True, text=True, timeout=3 * PATIENCE, check=False
        )
        self.assertEqual(done.returncode, status, f"gaware {args}:\n{done.stdout}{done.stderr}")
        return done.stdout, done.stderr

    def transfer(self, action, link, file, status=0, backup=None):
        """`gaware mission …`; what it said."""
        more = ["--backup", backup] if backup else []
        out, err = self.gaware("mission", action, "--connect", link, *more, file, status=status)
        return out + err

    def planned(self, name, airframe="small_fixed_wing", autopilot="ardupilot"):
        """An excitation mission of the planner in a new file of this name; planned once for all tests."""
        path = self.folder / name
        kind = (airframe, autopilot, path.suffix)
        if kind not in PLANNED:
            place = ",".join(map(str, HOME))
            text = (AIRFRAMES / f"{airframe}.toml").read_text()
            airframe = self.folder / f"{airframe}.toml"
            airframe.write_text(re.sub('^autopilot = ".*"', f'autopilot = "{autopilot}"', text, flags=re.M))
            self.gaware("plan", "--airframe", airframe, "--home", place, "--budget", 120, "--out", path)
            PLANNED[kind] = path.read_text()
        path.write_text(PLANNED[kind])
        return path

    def assert_same_items(self, expected, found, place_deg=2e-7):
        """Missions as lists of (command, params 1 to 4, latitude, longitude, altitude), within their rounding."""
        self.assertEqual([item[0] for item in expected], [item[0] for item in found])
        for number, (want, got) in enumerate(zip(expected, found)):
            for a, b in zip(map(set_or_zero, want[1]), map(set_or_zero, got[1])):
                self.assertAlmostEqual(a, b, delta=1e-3, msg=f"item {number}: {want} {got}")
            self.assertAlmostEqual(want[2], got[2], delta=place_deg, msg=f"item {number}: {want} {got}")
            self.assertAlmostEqual(want[3], got[3], delta=place_deg, msg=f"item {number}: {want} {got}")
            self.assertAlmostEqual(want[4], got[4], delta=0.02, msg=f"item {number}: {want} {got}")


def free_udp_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def set_or_zero(value):
    """What is not set is null in a file and NaN on the wire; vehicles keep it as zero."""
    return 0.0 if value is None or math.isnan(value) else value


def items_of_plan(path):
    """The simple items of a `.plan`, read as plain JSON."""
    items = json.loads(pathlib.Path(path).read_text())["mission"]["items"]
    return [
        (i["command"], i["params"][:4], i["params"][4] or 0.0, i["params"][5] or 0.0, i["params"][6] or 0.0)
        for i in items
    ]


def items_of_waypoints(path):
    """Items without home, read by pymavlink."""
    loader = mavwp.MAVWPLoader()
    count = loader.load(str(path))
    wps = [loader.wp(k) for k in range(1, count)]
    return [(w.command, [w.param1, w.param2, w.param3, w.param4], w.x, w.y, w.z) for w in wps]


if sys.version_info < (3, 10):
    raise SystemExit("Python 3.10 or later is needed")
