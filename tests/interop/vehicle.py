"""A vehicle made of pymavlink alone, with the mission habits of ArduPilot or of PX4."""

import threading
import time

from pymavlink import mavutil

mavlink = mavutil.mavlink
MISSION = mavlink.MAV_MISSION_TYPE_MISSION
FENCE = mavlink.MAV_MISSION_TYPE_FENCE


class Vehicle(threading.Thread):
    """Answers on a UDP port of its own until `stop`."""

    def __init__(self, home, ask_s, give_up_s):
        super().__init__(daemon=True)
        self.link = mavutil.mavlink_connection("udpin:127.0.0.1:0", source_system=1, source_component=1)
        self.address = f"udpout:127.0.0.1:{self.link.port.getsockname()[1]}"
        self.home = home
        #: What is on board by mission type.
        self.lists = {MISSION: [], FENCE: []}
        #: Items for which this says true are lost on their way here.
        self.loses = lambda item: False
        self.heard_items = 0
        #: The index of the current item. An upload leaves it where it was, on both firmwares.
        self.current = 0
        self.acks = []
        self.upload = None
        self.ask_s, self.give_up_s = ask_s, give_up_s
        self.uploads = 0
        #: Released once per download that the other side has ended well.
        self.was_read = threading.Semaphore(0)
        #: Set once somebody who has heard this vehicle asks it for something.
        self.known = threading.Event()
        self.ending = threading.Event()

    def stop(self):
        self.ending.set()
        self.join()
        self.link.close()

    def run(self):
        next_heartbeat, next_current = 0.0, 0.0
        while not self.ending.is_set():
            message = self.link.recv_match(blocking=True, timeout=0.02)
            if message is not None and message.get_type() != "BAD_DATA":
                self.peer = (message.get_srcSystem(), message.get_srcComponent())
                handler = getattr(self, f"on_{message.get_type().lower()}", None)
                if handler:
                    handler(message)
            now = time.monotonic()
            if now >= next_heartbeat:
                next_heartbeat = now + 0.5
                self.heartbeat()
            if now >= next_current:
                next_current = now + 1.0
                self.report_current()
            self.tick(now)

    def tick(self, now):
        if self.upload is None:
            return
        if now - self.upload["heard"] >= self.give_up_s:
            kind, self.upload = self.upload["type"], None
            self.ack(mavlink.MAV_MISSION_OPERATION_CANCELLED, kind)
        elif now - self.upload["asked"] >= self.ask_s:
            self.ask()

    @property
    def items(self):
        return self.lists[MISSION]

    def ack(self, result, kind=None):
        if kind is None:
            kind = self.upload["type"] if self.upload else MISSION
        if kind == MISSION:
            self.acks.append(result)
        self.link.mav.mission_ack_send(*self.peer, result, kind, self.opaque_id(kind))

    def knows(self, kind):
        if kind not in self.lists:
            self.link.mav.mission_ack_send(*self.peer, mavlink.MAV_MISSION_UNSUPPORTED, kind)
        return kind in self.lists

    def ask(self):
        self.upload["asked"] = time.monotonic()
        self.request(self.upload["next"], self.upload["type"])

    def on_command_long(self, m):
        self.known.set()

    def report_current(self):
        self.link.mav.mission_current_send(self.current)

    def on_mission_set_current(self, m):
        # One that does not exist is refused: by silence here, as the message has no answer of that kind.
        if m.seq < len(self.items):
            self.current = m.seq
            self.current_was_set()

    def on_mission_request_list(self, m):
        if self.knows(m.mission_type):
            count = len(self.lists[m.mission_type])
            self.link.mav.mission_count_send(*self.peer, count, m.mission_type, self.opaque_id(m.mission_type))

    def on_mission_request_int(self, m):
        if not self.knows(m.mission_type):
            return
        if m.seq >= len(self.lists[m.mission_type]):
            self.ack(mavlink.MAV_MISSION_INVALID_SEQUENCE, m.mission_type)
            return
        i = self.lists[m.mission_type][m.seq]
        self.link.mav.mission_item_int_send(
            *self.peer, m.seq, i["frame"], i["command"], 0, i["autocontinue"], *i["params"], i["x"], i["y"], i["z"],
            m.mission_type,
        )

    def on_mission_clear_all(self, m):
        if self.knows(m.mission_type):
            self.lists[m.mission_type] = []
            self.ack(mavlink.MAV_MISSION_ACCEPTED, m.mission_type)

    def on_mission_count(self, m):
        if not self.knows(m.mission_type):
            return
        now = time.monotonic()
        self.uploads += self.upload is None and m.mission_type == MISSION
        self.upload = {"type": m.mission_type, "count": m.count, "next": 0, "asked": now, "heard": now, "staged": []}
        self.begin(m.count)
        self.ask()

    def on_mission_ack(self, m):
        if m.type != mavlink.MAV_MISSION_ACCEPTED:
            self.upload = None
        elif m.mission_type == MISSION:
            self.was_read.release()

    def on_mission_item_int(self, m):
        self.heard_items += 1
        if self.loses(m):
            return
        if self.upload is None or m.seq != self.upload["next"]:
            self.unexpected(m)
            return
        item = {
            "frame": m.frame, "command": m.command, "autocontinue": m.autocontinue,
            "params": [m.param1, m.param2, m.param3, m.param4], "x": m.x, "y": m.y, "z": m.z,
        }
        self.keep(m.seq, item)
        self.upload["heard"] = time.monotonic()
        self.upload["next"] += 1
        if self.upload["next"] < self.upload["count"]:
            self.ask()
            return
        self.finish()
        kind, self.upload = self.upload["type"], None
        self.ack(mavlink.MAV_MISSION_ACCEPTED, kind)

    def mission(self):
        """What is on board without home, as the tests compare it."""
        return [
            (i["command"], i["params"], i["x"] * 1e-7, i["y"] * 1e-7, i["z"]) for i in self.items[self.first_item:]
        ]


class ArduPilot(Vehicle):
    """Asks with MISSION_REQUEST, writes into the mission on board, keeps home at 0, gives up after 8 s. Answers a new current item at once."""

    first_item = 1

    def __init__(self, home):
        super().__init__(home, ask_s=1.0, give_up_s=8.0)

    def opaque_id(self, kind):
        return 0

    def heartbeat(self):
        self.link.mav.heartbeat_send(
            mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
            mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, 0, mavlink.MAV_STATE_STANDBY,
        )

    def current_was_set(self):
        self.report_current()

    def request(self, seq, kind):
        self.link.mav.mission_request_send(*self.peer, seq, kind)

    def begin(self, count):
        kind = self.upload["type"]
        self.lists[kind] = self.lists[kind][:count]

    def keep(self, seq, item):
        kind = self.upload["type"]
        if kind != MISSION:
            pass
        elif seq == 0:
            lat, lon, alt = self.home
            item = {
                "frame": 0, "command": 16, "autocontinue": 1, "params": [0.0] * 4,
                "x": round(lat * 1e7), "y": round(lon * 1e7), "z": alt,
            }
        elif item["command"] in (177, 178, 115):
            item.update(frame=0, x=0, y=0, z=0.0)
        else:
            item["frame"] = {6: 3, 5: 0}.get(item["frame"], item["frame"])
        self.lists[kind][seq:seq + 1] = [item]

    def finish(self):
        pass

    def unexpected(self, m):
        """In passing: a transfer that goes on is not ended by it."""
        self.ack(mavlink.MAV_MISSION_INVALID_SEQUENCE if self.upload else mavlink.MAV_MISSION_ERROR)


class Px4(Vehicle):
    """Asks with MISSION_REQUEST_INT, four times a second if need be; all or nothing; knows its mission by a number."""

    first_item = 0

    def __init__(self, home):
        super().__init__(home, ask_s=0.25, give_up_s=5.0)

    def opaque_id(self, kind):
        return hash(str(self.lists[kind])) & 0xFFFFFFFF

    def heartbeat(self):
        self.link.mav.heartbeat_send(
            mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_PX4,
            mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, 4 << 16 | 3 << 24, mavlink.MAV_STATE_STANDBY,
        )

    def current_was_set(self):
        """PX4's report of once a second says it."""

    def request(self, seq, kind):
        self.link.mav.mission_request_int_send(*self.peer, seq, kind)

    def begin(self, count):
        pass

    def keep(self, seq, item):
        self.upload["staged"].append(item)

    def finish(self):
        self.lists[self.upload["type"]] = self.upload["staged"]

    def unexpected(self, m):
        if self.upload is None:
            # The ack was lost: PX4 sends it again for the last item, and an error for any other.
            again = m.seq + 1 == len(self.lists[m.mission_type])
            self.ack(mavlink.MAV_MISSION_ACCEPTED if again else mavlink.MAV_MISSION_ERROR, m.mission_type)
