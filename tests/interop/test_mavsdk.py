"""Transfers with MAVSDK's mission server as the vehicle."""

import queue

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.mission_raw_server.mission_raw_server import MissionRawServer, MissionRawServerResult

from support import PATIENCE, Case, free_udp_port, items_of_plan

FENCE_COMMANDS = range(5000, 5005)


def as_items(items):
    return [(i.command, [i.param1, i.param2, i.param3, i.param4], i.x * 1e-7, i.y * 1e-7, i.z) for i in items]


class Server(Case):
    def setUp(self):
        super().setUp()
        configuration = Configuration.create_with_component_type(ComponentType.AUTOPILOT)
        configuration.system_id = 1
        self.vehicle = Mavsdk(configuration)
        self.addCleanup(self.vehicle.destroy)
        port = free_udp_port()
        self.link = f"udpin:127.0.0.1:{port}"
        self.vehicle.add_any_connection(f"udpout://127.0.0.1:{port}")
        # Kept: without a reference it is collected, and nobody answers.
        self.server = MissionRawServer(self.vehicle.server_component())
        self.missions = queue.Queue()
        self.server.subscribe_incoming_mission(self.arrived)

    def arrived(self, result, plan, _):
        """The server announces every list in the same way: the fence is none of ours here."""
        if not plan.mission_items or plan.mission_items[0].command not in FENCE_COMMANDS:
            self.missions.put((result, plan))

    def test_upload_download_and_restore(self):
        first = self.planned("first.plan", autopilot="px4")
        second = self.planned("second.plan", "quadrotor", "px4")
        for plan in (first, second):
            backup = self.folder / f"before-{plan.stem}.plan"
            self.assertIn("read back and compared", self.transfer("upload", self.link, plan, backup=backup))
            result, mission = self.missions.get(timeout=PATIENCE)
            self.assertEqual(result, MissionRawServerResult.SUCCESS)
            self.assert_same_items(items_of_plan(plan), as_items(mission.mission_items))
        self.assert_same_items(items_of_plan(first), items_of_plan(backup))
        self.transfer("restore", self.link, backup, backup=self.folder / "again.plan")
        _, mission = self.missions.get(timeout=PATIENCE)
        self.assert_same_items(items_of_plan(first), as_items(mission.mission_items))
        read = self.folder / "read.plan"
        self.transfer("download", self.link, read)
        self.assert_same_items(items_of_plan(first), items_of_plan(read))
