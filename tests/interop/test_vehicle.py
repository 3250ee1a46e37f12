"""Transfers with a vehicle made of pymavlink alone."""

import random

from support import DATA, HOME, Case, items_of_plan, items_of_waypoints
from vehicle import MISSION, ArduPilot, Px4, mavlink

#: As QGroundControl's format writes them, and as a vehicle keeps them.
QGC = DATA / "qgroundcontrol.plan"
MISSION_PLANNER = DATA / "mission_planner.waypoints"


class Transfers:
    """The same for both kinds."""

    def setUp(self):
        super().setUp()
        self.vehicle = self.kind(HOME)
        self.vehicle.start()
        self.addCleanup(self.vehicle.stop)

    def planned(self, name):
        return super().planned(name, autopilot=self.autopilot)

    def test_upload_download_and_restore(self):
        first, second = self.planned("first.plan"), MISSION_PLANNER
        said = self.transfer("upload", self.vehicle.address, first, backup=self.folder / "b0.plan")
        self.assertIn("read back and compared", said)
        self.assert_same_items(items_of_plan(first), self.vehicle.mission())
        backup = self.folder / "before.waypoints"
        self.transfer("upload", self.vehicle.address, second, backup=backup)
        self.assert_same_items(items_of_waypoints(second), self.vehicle.mission())
        self.transfer("restore", self.vehicle.address, backup, backup=self.folder / "b1.plan")
        self.assert_same_items(items_of_plan(first), self.vehicle.mission())
        read = self.folder / "read.plan"
        self.transfer("download", self.vehicle.address, read)
        self.assert_same_items(items_of_plan(first), items_of_plan(read))

    def test_items_are_lost_and_asked_for_again(self):
        plan, dice = self.planned("plan.plan"), random.Random(7)
        self.vehicle.loses = lambda item: dice.random() < 0.2
        self.transfer("upload", self.vehicle.address, plan, backup=self.folder / "before.plan")
        self.assert_same_items(items_of_plan(plan), self.vehicle.mission())
        self.assertGreater(self.vehicle.heard_items, len(items_of_plan(plan)), "some were asked for twice")

    def test_a_transfer_that_the_vehicle_gives_up_leaves_the_previous_mission(self):
        self.transfer("upload", self.vehicle.address, MISSION_PLANNER, backup=self.folder / "b0.plan")
        before = self.vehicle.mission()
        plan = self.planned("plan.plan")
        # The last item of the new mission never arrives, how often it is asked for; those of the old one do.
        (_, _, lat, lon, _) = items_of_plan(plan)[-1]
        place = (round(lat * 1e7), round(lon * 1e7))
        self.vehicle.loses = lambda item: item.mission_type == MISSION and (item.x, item.y) == place
        said = self.transfer("upload", self.vehicle.address, plan, status=1, backup=self.folder / "b1.plan")
        self.assertIn("the previous mission is on the vehicle", said)
        self.assert_same_items(before, self.vehicle.mission())
        self.assertIn(mavlink.MAV_MISSION_OPERATION_CANCELLED, self.vehicle.acks)


class ArduPilotHabits(Transfers, Case):
    kind, autopilot = ArduPilot, "ardupilot"

    def test_invalid_sequence_in_passing_ends_nothing(self):
        plan, vehicle = self.planned("plan.plan"), self.vehicle

        def complains(item):
            if item.seq % 3 == 1:
                vehicle.ack(mavlink.MAV_MISSION_INVALID_SEQUENCE)
            return False

        vehicle.loses = complains
        self.transfer("upload", vehicle.address, plan, backup=self.folder / "before.plan")
        self.assert_same_items(items_of_plan(plan), vehicle.mission())
        self.assertIn(mavlink.MAV_MISSION_INVALID_SEQUENCE, vehicle.acks)


class Px4Habits(Transfers, Case):
    kind, autopilot = Px4, "px4"

    def test_a_lost_ack_is_sent_again(self):
        vehicle, plan = self.vehicle, self.planned("plan.plan")
        send, lost = vehicle.link.mav.mission_ack_send, []

        def first_is_lost(*args):
            if not lost:
                lost.append(args)
                return
            send(*args)

        vehicle.link.mav.mission_ack_send = first_is_lost
        self.transfer("upload", vehicle.address, plan, backup=self.folder / "before.plan")
        self.assertTrue(lost)
        self.assert_same_items(items_of_plan(plan), vehicle.mission())


class FilesOfOthers(Case):
    """Files as QGroundControl and Mission Planner write them arrive on the vehicle as they are meant."""

    def setUp(self):
        super().setUp()
        self.vehicle = Px4(HOME)
        self.vehicle.start()
        self.addCleanup(self.vehicle.stop)

    def test_qgroundcontrol(self):
        self.transfer("upload", self.vehicle.address, QGC, backup=self.folder / "b.plan")
        expected = [
            (22, [15, 0, 0, 0], 47.3977418, 8.5455938, 50),
            (178, [0, 18, -1, 0], 0, 0, 0),
            (16, [0, 0, 0, 0], 47.398, 8.546, 60),
            (16, [0, 0, 0, 0], 47.399, 8.547, 60),
            (31, [0, -80, 0, 1], 47.3985, 8.5475, 90),
            (16, [0, 5, 0, 0], 47.3995, 8.5455, 520),
            # The file counts from 1, PX4 from 0.
            (177, [2, 2, 0, 0], 0, 0, 0),
            (20, [0, 0, 0, 0], 0, 0, 0),
        ]
        self.assert_same_items(expected, self.vehicle.mission())
        frames = [i["frame"] for i in self.vehicle.items]
        self.assertEqual((frames[0], frames[1], frames[5]), (6, 2, 5), "above home, none, above the sea")

    def test_mission_planner(self):
        self.transfer("upload", self.vehicle.address, MISSION_PLANNER, backup=self.folder / "b.plan")
        self.assert_same_items(items_of_waypoints(MISSION_PLANNER), self.vehicle.mission())
        self.assertEqual(self.vehicle.mission()[0][0], 22)


del Transfers
