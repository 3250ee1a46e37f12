"""Many flights: the same content from the program, from local processes and from a cluster, also where workers are killed."""

import os
import signal
from pathlib import Path

import fsspec
import gaware
import pytest

NAMES = "{unit}/{firmware}_*.*"


def content(folder):
    """Name and bytes of every file below, whatever an ended process left half."""
    files = [path for path in Path(folder).rglob("*") if path.is_file() and path.suffix != ".part"]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def kill_once(log, marker):
    """A worker that is killed in the middle of the first log that it gets."""
    try:
        Path(marker).touch(exist_ok=False)
    except FileExistsError:
        return
    os.kill(os.getpid(), signal.SIGKILL)


def killed_in_the_middle(log, options):
    kill_once(log, options["marker"])
    options = {k: v for k, v in options.items() if k != "marker"}
    return ORIGINAL(log, options)


ORIGINAL = gaware.fleet._analyse


@pytest.fixture
def by_the_program(archive, program, tmp_path):
    out = tmp_path / "program"
    program("fleet", archive, "--out", out, "--no-explain", "--names", NAMES)
    return out


def test_local_processes_give_the_content_of_the_program(archive, by_the_program, tmp_path):
    seen = []
    fleet = gaware.fleet.run(
        gaware.fleet.find([archive]),
        jobs=2,
        explain=False,
        names=NAMES,
        out=tmp_path / "python",
        progress=lambda done, of, log: seen.append((done, of)),
    )
    assert content(tmp_path / "python") == content(by_the_program)
    assert seen == [(k, 5) for k in range(1, 6)]
    assert [Path(log).name for log in fleet.failed] == ["4.6_broken.ulg"]
    assert fleet.flights.to_polars().height == 5
    report = gaware.fleet.report(tmp_path / "python")
    assert report["units"] == ["u1", "u2"]


def test_a_cluster_with_a_killed_worker_gives_the_same_content(archive, by_the_program, tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")
    import cloudpickle
    import sys

    # The workers have no module of this name: what kills them goes over by value.
    cloudpickle.register_pickle_by_value(sys.modules[__name__])
    real = gaware.fleet._options
    monkeypatch.setattr(gaware.fleet, "_analyse", killed_in_the_middle)
    monkeypatch.setattr(
        gaware.fleet, "_options", lambda *a, **k: real(*a, **k) | {"marker": str(tmp_path / "killed")}
    )
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster, distributed.Client(cluster) as client:
        fleet = gaware.fleet.run(
            gaware.fleet.find([archive]), client=client, explain=False, names=NAMES, out=tmp_path / "cluster"
        )
    assert (tmp_path / "killed").exists()
    assert content(tmp_path / "cluster") == content(by_the_program)
    assert len(fleet.results) == 5


def test_a_killed_local_process_costs_no_flight(archive, by_the_program, tmp_path, monkeypatch):
    real = gaware.fleet._options
    monkeypatch.setattr(gaware.fleet, "_analyse", killed_in_the_middle)
    monkeypatch.setattr(
        gaware.fleet, "_options", lambda *a, **k: real(*a, **k) | {"marker": str(tmp_path / "killed")}
    )
    monkeypatch.setenv("PYTHONPATH", os.path.dirname(__file__))
    gaware.fleet.run(gaware.fleet.find([archive]), jobs=2, explain=False, names=NAMES, out=tmp_path / "python")
    assert (tmp_path / "killed").exists()
    assert content(tmp_path / "python") == content(by_the_program)


def test_logs_of_an_object_store_are_read(log, program, tmp_path):
    with fsspec.open("memory://flights/u1.tlog", "wb") as target:
        target.write(log.read_bytes())
    address = "memory://flights/u1.tlog"
    # What is in the memory of this process is known to it alone.
    entry = gaware.fleet.analyse(address, explain=False)
    assert entry["flight"]["summary"]["imu"] == program("replay", log, "--json")["imu"]
    assert entry == gaware.fleet.analyse(log, explain=False)
    with pytest.raises(gaware.GawareError, match="none.tlog"):
        gaware.fleet.analyse("memory://flights/none.tlog")


def test_a_log_that_is_not_there_is_a_row_with_the_reason(log, tmp_path):
    fleet = gaware.fleet.run([log, tmp_path / "gone.tlog"], jobs=1, explain=False)
    assert list(fleet.failed) == [str(tmp_path / "gone.tlog")]
    assert "No such file" in fleet.failed[str(tmp_path / "gone.tlog")]
    assert fleet.flights.to_polars()["failed"].to_list().count("") == 1
