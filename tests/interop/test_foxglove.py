"""Live data for Foxglove, read by Foxglove's own client: every message by its schema, and the same as in the recording of the run."""

import json
import pathlib
import signal
import subprocess
import unittest

import jsonschema
import mcap.reader

from support import GAWARE, PATIENCE, Case, free_udp_port

FOLDER = pathlib.Path(__file__).parent / "foxglove"
TOPICS = ["/attitude_autopilot", "/fix", "/imu", "/log", "/pose", "/position", "/snapshot", "/states", "/tf"]


class Live(Case):
    @classmethod
    def setUpClass(cls):
        subprocess.run(["npm", "ci", "--no-audit", "--no-fund", "--loglevel=error"], cwd=FOLDER, check=True)

    def served(self, *args):
        """A program with its viewer."""
        program = self.start(GAWARE, *args, "--headless", "--foxglove", "127.0.0.1:0")
        url = program.wait_for("Foxglove: ws://").split()[-1]
        return program, self.start("node", FOLDER / "viewer.mjs", url)

    def read(self, viewer, enough, patience=4 * PATIENCE):
        """What the viewer prints until it has seen enough."""
        seen = []
        while not enough(seen):
            line = json.loads(viewer.wait_for("{", patience=patience))
            self.assertNotIn("error", line)
            self.assertNotIn("status", line)
            seen.append(line)
        return seen

    def check(self, seen):
        """Every message against the schema that was advertised for its topic, and Foxglove's own types against the published schemas."""
        official, checks, schemas = {}, {}, {}
        for line in seen:
            official.update(line.get("official", {}))
            for channel in line.get("advertise", []):
                self.assertEqual(channel["encoding"], "json")
                schemas[channel["topic"]] = channel["schema"]
                all_of = [json.loads(channel["schema"] or "{}")]
                if channel["schemaName"].startswith("foxglove."):
                    all_of.append(official[channel["schemaName"]])
                for schema in all_of:
                    jsonschema.Draft7Validator.check_schema(schema)
                checks[channel["topic"]] = [jsonschema.Draft7Validator(schema) for schema in all_of]
            if "topic" in line:
                message = json.loads(line["text"])
                for check in checks[line["topic"]]:
                    check.validate(message)
        return schemas

    def test_a_run_is_seen_as_it_is_recorded(self):
        port, file = free_udp_port(), self.folder / "flight.mcap"
        program, viewer = self.served("run", "--connect", f"udpin:127.0.0.1:{port}", "--record", file)
        seen = self.read(viewer, lambda lines: any("advertise" in line for line in lines))
        self.start(GAWARE, "sim", "--scenario", "fixed_wing", "--listen", f"udpout:127.0.0.1:{port}", "--speed", "4")

        def enough(lines):
            topics = [line["topic"] for line in lines if "topic" in line]
            return set(TOPICS) <= set(topics) and len(topics) > 2000

        seen += self.read(viewer, enough)
        program.process.send_signal(signal.SIGINT)
        seen += self.read(viewer, lambda lines: lines and "closed" in lines[-1])
        self.assertEqual(program.process.wait(), 0)
        schemas = self.check(seen)
        self.assertEqual(set(schemas), set(TOPICS))
        self.assertEqual(self.compare([line for line in seen if "topic" in line], file), schemas)

    def compare(self, live, file):
        """Of each topic the recording holds every live message, byte for byte; from the first to the last one none is missing."""
        recorded, schemas = {}, {}
        with open(file, "rb") as stream:
            for schema, channel, message in mcap.reader.make_reader(stream).iter_messages():
                recorded.setdefault(channel.topic, []).append((message.log_time, message.data.decode(errors="replace")))
                schemas[channel.topic] = schema.data.decode() if schema else ""
        for topic in [topic for topic in recorded if topic.startswith("/mavlink")]:
            del recorded[topic], schemas[topic]
        self.assertEqual(set(recorded), set(TOPICS))
        for topic in TOPICS:
            own = [(int(line["t_ns"]), line["text"]) for line in live if line["topic"] == topic]
            self.assertTrue(own, topic)
            start = recorded[topic].index(own[0])
            self.assertEqual(own, recorded[topic][start : start + len(own)], topic)
        return schemas

    def test_a_demonstration_is_seen_with_every_topic_by_its_schema(self):
        program, viewer = self.served("demo", "--no-web", "--report", self.folder / "report.html")
        seen = self.read(viewer, lambda lines: set(TOPICS) <= {line.get("topic") for line in lines})
        self.assertEqual(set(self.check(seen)), set(TOPICS))
        self.assertEqual(next(line["info"] for line in seen if "info" in line)["capabilities"], [])
        times = [int(line["t_ns"]) for line in seen if line.get("topic") == "/imu"]
        self.assertEqual(times, sorted(times))
        self.assertGreater(times[0], 1_700_000_000 * 10**9)
        program.process.send_signal(signal.SIGINT)
        self.read(viewer, lambda lines: lines and "closed" in lines[-1])


if __name__ == "__main__":
    unittest.main()
