"""Tables of `gaware replay --export`, read by pandas, pyarrow, DuckDB and the mcap library; documents against their JSON schemas."""

import json
import math
import pathlib
import subprocess
import tempfile
import unittest

import duckdb
import jsonschema
import mcap.reader
import pandas
import pyarrow.parquet

from support import GAWARE

ROOT = pathlib.Path(__file__).parents[2]
LOG = ROOT / "tests" / "data" / "small_gsens_typical_dither.tlog"
TABLES = ["autopilot_attitude", "events", "fixes", "imu", "states"]


def gaware(*args):
    done = subprocess.run([GAWARE, *map(str, args)], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


class Exported(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        cls.out = pathlib.Path(cls.folder.name)
        for target in ("tables", "states.csv", "states.parquet", "all.mcap"):
            cls.summary = gaware("replay", LOG, "--json", "--export", cls.out / target)

    def test_csv_and_parquet_are_the_same_table(self):
        csv = pandas.read_csv(self.out / "states.csv")
        parquet = pandas.read_parquet(self.out / "states.parquet")
        self.assertGreater(len(csv), 500)
        pandas.testing.assert_frame_equal(csv, parquet, check_dtype=False, check_exact=True)

    def test_values_are_those_of_the_summary(self):
        states = pandas.read_parquet(self.out / "states.parquet")
        g = self.summary["estimate"]["g_sensitivity_deg_per_h_per_g"]
        for row in range(3):
            for column in range(3):
                name = f"g{row + 1}{column + 1}"
                sigma = states[f"{name}_sigma_deg_per_h_per_g"].iloc[-1]
                self.assertAlmostEqual(sigma / g["sigma"][row][column], 1.0, delta=0.02)
                off = states[f"{name}_deg_per_h_per_g"].iloc[-1] - g["value"][row][column]
                self.assertLess(abs(off), 0.2 * sigma)
        # Null, not a number of its own, where there is no estimate yet.
        self.assertTrue(states["g11_deg_per_h_per_g"].iloc[:1].isna().all())
        self.assertEqual(states["phase"].iloc[-1], "running")

    def test_pyarrow_reads_types_and_meanings(self):
        file = pyarrow.parquet.ParquetFile(self.out / "tables" / "imu.parquet")
        self.assertEqual(file.metadata.num_rows, self.summary["imu"]["samples"])
        schema = file.schema_arrow
        self.assertEqual(str(schema.field("log").type), "string")
        self.assertEqual(str(schema.field("gyro_x_rad_per_s").type), "double")
        self.assertIn(b"rad/s", file.schema_arrow.metadata[b"gyro_x_rad_per_s"])
        flags = pyarrow.parquet.read_schema(self.out / "tables" / "states.parquet")
        self.assertEqual(str(flags.field("stationary").type), "bool")

    def test_duckdb_joins_the_tables(self):
        for name in TABLES:
            count = duckdb.sql(f"select count(*) from '{self.out}/tables/{name}.parquet'").fetchall()[0][0]
            self.assertGreater(count, 0, name)
        text, fixes = duckdb.sql(
            f"""select any_value(s.log), count(*) from '{self.out}/tables/fixes.parquet' f
                asof join '{self.out}/tables/states.parquet' s on f.log = s.log and f.elapsed_s >= s.elapsed_s
                where s.phase = 'running'"""
        ).fetchall()[0]
        self.assertEqual(text, LOG.name)
        self.assertGreater(fixes, 0.8 * self.summary["gnss"]["fixes"])

    def test_the_mcap_library_reads_every_message_in_order_and_by_its_schema(self):
        counts, last = {}, 0
        with open(self.out / "all.mcap", "rb") as file:
            for schema, channel, message in mcap.reader.make_reader(file).iter_messages():
                row = json.loads(message.data)
                wanted = json.loads(schema.data)
                if channel.topic not in counts:
                    jsonschema.Draft202012Validator.check_schema(wanted)
                    # Plots of Foxglove want plain numbers: no references, unions or lists.
                    self.assertTrue(all(p["type"] in ("number", "string", "boolean") for p in wanted["properties"].values()))
                    jsonschema.validate(row, wanted)
                    self.assertLessEqual(set(row), set(wanted["properties"]))
                self.assertTrue(all(not isinstance(v, float) or math.isfinite(v) for v in row.values()))
                self.assertGreaterEqual(message.log_time, last)
                last = message.log_time
                counts[channel.topic] = counts.get(channel.topic, 0) + 1
        self.assertEqual(sorted(counts), [f"/{name}" for name in TABLES])
        self.assertEqual(counts["/imu"], self.summary["imu"]["samples"])


class Schemas(unittest.TestCase):
    def check(self, document, name):
        schema = json.loads((ROOT / "docs" / f"{name}.schema.json").read_text())
        jsonschema.Draft202012Validator.check_schema(schema)
        jsonschema.validate(document, schema)

    def test_replay(self):
        self.check(gaware("replay", LOG, "--json"), "summary")
        self.check(gaware("replay", LOG, LOG, "--json"), "replay")

    def test_plan(self):
        self.check(gaware("plan", "--home", "47.397,8.545,441", "--budget", "120", "--json"), "plan")

    def test_explanation(self):
        with tempfile.TemporaryDirectory() as out:
            self.check(gaware("explain", LOG, "--json", "--out", out), "explanation")


if __name__ == "__main__":
    unittest.main()
