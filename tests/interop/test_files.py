"""Mission files of the planner, read by others (MAVProxy's `wp load`: see test_mavproxy)."""

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.mission_raw.mission_raw import MissionRaw

from support import Case, items_of_plan, items_of_waypoints
from vehicle import ArduPilot, Px4


class MavsdkReads(Case):
    """MAVSDK's readers of both formats need a system to belong to: a vehicle that sends heartbeats."""

    def reader(self, kind):
        vehicle = kind((47.397, 8.545, 441.0))
        vehicle.start()
        self.addCleanup(vehicle.stop)
        station = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
        self.addCleanup(station.destroy)
        station.add_any_connection(vehicle.address.replace("udpout:", "udpout://"))
        system = station.first_autopilot(timeout_s=30.0)
        self.assertIsNotNone(system)
        return MissionRaw(system)

    def items(self, imported):
        return [
            (i.command, [i.param1, i.param2, i.param3, i.param4], i.x * 1e-7, i.y * 1e-7, i.z)
            for i in imported.mission_items
        ]

    def test_plan(self):
        for airframe in ("small_fixed_wing", "quadrotor"):
            path = self.planned(f"{airframe}.plan", airframe)
            got = self.items(self.reader(Px4).import_qgroundcontrol_mission(str(path)))
            self.assert_same_items(items_of_plan(path), got)

    def test_waypoints(self):
        path = self.planned("plan.waypoints")
        got = self.items(self.reader(ArduPilot).import_mission_planner_mission(str(path)))
        # For an ArduPilot it puts a home of its own before that of the file.
        self.assert_same_items(items_of_waypoints(path), got[2:])
