"""Many flights: the worker of "gaware fleet" on local processes or on a Dask cluster.

The unit of work is one log (`analyse`). Its result holds nothing of the machine or the time, so that a run gives the same content wherever it
is computed, and as the program.
"""

import json
import os
import shutil
import tempfile
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context

from . import _gaware

__all__ = ["Fleet", "analyse", "find", "report", "run"]

#: How often a log is tried whose process ends without a result.
ATTEMPTS = 3


class Fleet:
    """The results of many logs."""

    def __init__(self, results, names=None):
        #: For each log: its path, its result as a dict, or None and the reason.
        self.results = [(log, text and json.loads(text), reason) for log, text, reason in results]
        self._texts = results
        self._names = names
        self._tables = None

    def _table(self, k):
        if self._tables is None:
            self._tables = _gaware.fleet_tables(self._texts, self._names)
        return self._tables[k]

    @property
    def flights(self):
        """A row for each log."""
        return self._table(0)

    @property
    def effects(self):
        """A row for each parameter of each effect of each flight."""
        return self._table(1)

    @property
    def failed(self):
        """Logs that could not be analysed, with the reason."""
        reasons = {log: result["failed"] if result else reason for log, result, reason in self.results}
        return {log: reason for log, reason in reasons.items() if reason}

    def write(self, out):
        """Write flights.parquet, effects.parquet and fleet.json, as "gaware fleet --out" does."""
        return _gaware.fleet_write(self._texts, os.fspath(out), self._names)

    def __repr__(self):
        return f"<gaware.fleet.Fleet: {len(self.results)} logs, {len(self.failed)} failed>"


def find(places):
    """All logs of files, folders (with what is below them) and patterns, in the order of their names."""
    return _gaware.fleet_find([os.fspath(place) for place in places])


@contextmanager
def _local(log, storage_options):
    """The log as a local file: one with a protocol (s3://, gs://, memory://) is copied through fsspec for the time of the work."""
    if "://" not in log:
        yield log
        return
    import fsspec

    with tempfile.TemporaryDirectory(prefix="gaware-") as folder:
        path = os.path.join(folder, os.path.basename(log.split("?", 1)[0]) or "log")
        with fsspec.open(log, "rb", **(storage_options or {})) as source, open(path, "wb") as target:
            shutil.copyfileobj(source, target, 1 << 20)
        yield path


def _analyse(log, options):
    """Log, result as JSON, reason: what a worker sends back."""
    model = options["model"] and _gaware.Model.from_toml(options["model"])
    try:
        with _local(log, options["storage_options"]) as path:
            text = _gaware.fleet_analyse(
                path,
                model,
                options["explain"],
                options["out"],
                options["source"],
                options["vehicle"],
                options["threads"],
            )
        return log, text, None
    except (_gaware.GawareError, OSError, ImportError, ValueError) as error:
        # One log that cannot be had does not stop the others.
        return log, None, f"{error}"


def _options(model, explain, out, storage_options, source, vehicle, threads=1):
    return {
        "model": model and model.to_toml(),
        "explain": explain,
        "out": None if out is None else os.fspath(out),
        "storage_options": storage_options,
        "source": source,
        "vehicle": vehicle,
        "threads": threads,
    }


def analyse(log, *, model=None, explain=True, out=None, storage_options=None, source=None, vehicle=None):
    """Replay and explain one log in this process; its result as a dict.

    Raises gaware.GawareError where the log cannot be had; a log that holds no flight has the reason under "failed".
    """
    options = _options(model, explain, out, storage_options, source, vehicle, threads=None)
    _, text, reason = _analyse(os.fspath(log), options)
    if text is None:
        raise _gaware.GawareError(reason)
    return json.loads(text)


def run(
    logs,
    *,
    client=None,
    jobs=None,
    model=None,
    explain=True,
    names=None,
    out=None,
    storage_options=None,
    source=None,
    vehicle=None,
    progress=None,
):
    """Replay and explain many logs.

    logs: paths, or addresses that fsspec opens ("s3://bucket/flight.bin").
    client: a dask.distributed.Client; without one the work is done by local processes, one for each processor or `jobs`.
    out: a folder that all workers see; results are kept there, a run that was interrupted goes on there, and the tables are written there.
    names: a rule for unit and firmware in paths, such as "{unit}/{firmware}_*.bin".
    progress: called with (done, all, log) after each log.

    A log whose process is killed is tried again on another, three times in all; one log that fails never stops the rest.
    """
    logs = sorted({os.fspath(log) for log in logs})
    options = _options(model, explain, out, storage_options, source, vehicle)
    done = {}

    def take(result):
        done[result[0]] = result
        if progress is not None:
            progress(len(done), len(logs), result[0])

    (_processes if client is None else _cluster)(logs, options, client or jobs, take)
    fleet = Fleet([done[log] for log in logs], names)
    if out is not None:
        fleet.write(out)
    return fleet


def _cluster(logs, options, client, take):
    from distributed import as_completed as completed

    # Not by content: the scheduler need not know what a result depends on.
    futures = {client.submit(_analyse, log, options, pure=False, retries=0): log for log in logs}
    for future in completed(futures):
        # The scheduler itself sends the work of a killed worker to another; after several it gives up.
        error = future.exception()
        take((futures[future], None, f"{error}") if error is not None else future.result())


def _processes(logs, options, jobs, take):
    # Not forked: the parent may have threads.
    context = get_context("spawn")
    left = {log: 0 for log in logs}
    while left:
        # A killed process breaks its whole pool; what was not done goes to a new one, at the end each alone.
        alone = any(left.values())
        batch = [max(left, key=left.get)] if alone else list(left)
        with ProcessPoolExecutor(max_workers=1 if alone else jobs, mp_context=context) as pool:
            futures = {pool.submit(_analyse, log, options): log for log in batch}
            for future in as_completed(futures):
                log = futures[future]
                try:
                    result = future.result()
                except BrokenProcessPool:
                    left[log] += 1
                    if left[log] < ATTEMPTS:
                        continue
                    result = log, None, f"{log}: its process ended without a result {ATTEMPTS} times"
                del left[log]
                take(result)


def report(out, names=None):
    """What the flights of each inertial unit have in common, of a folder with a fleet, as "gaware fleet report --json" prints it."""
    return _gaware.fleet_family(os.fspath(out), names)
