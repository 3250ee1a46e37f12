"""What the tests share: flights, and the program to compare with."""

import json
import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def program():
    """Runs the program; its JSON document. GAWARE names it."""
    binary = os.environ.get("GAWARE", ROOT / "target/release/gaware")

    def run(*args):
        done = subprocess.run([binary, *map(str, args)], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout) if done.stdout.startswith("{") else done.stdout

    return run


@pytest.fixture(scope="session")
def log():
    return ROOT / "tests/data/small_gsens_typical_dither.tlog"


@pytest.fixture(scope="session")
def clean():
    return ROOT / "tests/data/small_clean_dither.tlog"


@pytest.fixture
def archive(tmp_path, log):
    """Logs of two units, one of them twice, and a broken file."""
    content = log.read_bytes()
    for name, share in [("u1/4.5_a", 1.0), ("u1/4.6_b", 0.9), ("u2/4.5_c", 0.8), ("u2/4.6_d", 1.0)]:
        path = tmp_path / "logs" / f"{name}.tlog"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content[: int(share * len(content))])
    (tmp_path / "logs/u2/4.6_broken.ulg").write_text("no flight at all")
    return tmp_path / "logs"
