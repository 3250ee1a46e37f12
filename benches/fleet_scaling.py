#!/usr/bin/env python3
"""How a fleet scales with processors, and that a killed run loses nothing.

    cargo build --release
    benches/fleet_scaling.py target/release/gaware FOLDER [--flights 400] [--explain]

Flies the flights with `gaware sim` and `gaware run` (once: those in FOLDER/logs are kept), analyses them with one job and with two, then
kills a third run several times with every process of it, lets a last one finish, and compares all results byte for byte. Elapsed time means
something on a quiet machine alone; processor time per flight does on any. The exit status is 1 where content differs, or an entry was
lost or made twice."""
import argparse
import concurrent.futures
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import time

DURATION_S = 150
SPEED = 100  # virtual seconds per second: the station has asked for its rates before the flight has begun
UNITS = 12
FIRMWARES = ("4.4", "4.5", "4.6")
NAMES = "{unit}/{firmware}_*.tlog"
KILLS = 4


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=pathlib.Path, help="the program, built with --release")
    parser.add_argument("folder", type=pathlib.Path, help="folder for flights and results")
    parser.add_argument("--flights", type=int, default=400)
    parser.add_argument("--explain", action="store_true", help="identify unmodelled effects as well")
    return parser.parse_args()


def fly(program, log, seed):
    """One flight of a simulated ArduPilot, recorded as a .tlog. A part of a flight never has the name of a whole one."""
    if log.exists():
        return
    log.parent.mkdir(parents=True, exist_ok=True)
    part = log.with_suffix(".part")
    sim = [program, "sim", "--scenario", "fixed_wing", "--listen", "tcpin:127.0.0.1:0", "--speed", str(SPEED)]
    sim += ["--until", str(DURATION_S), "--seed", str(seed), "--record", part]
    vehicle = subprocess.Popen(sim, stderr=subprocess.PIPE, text=True)
    address = vehicle.stderr.readline().strip()
    run = [program, "run", "--connect", address, "--headless", "--no-record"]
    station = subprocess.Popen(run, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        vehicle.communicate(timeout=600)
    finally:
        station.terminate()
        station.wait()
    if vehicle.returncode:
        sys.exit(f"gaware sim ended with {vehicle.returncode}")
    part.rename(log)


def make(program, logs, count):
    paths = [logs / f"u{k % UNITS:02}" / f"{FIRMWARES[k % 3]}_{k:04}.tlog" for k in range(count)]
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda k: fly(program, paths[k], k + 1), range(count)))
    return paths


def command(args, out, jobs):
    words = [args.program, "fleet", args.folder / "logs", "--out", out, "--jobs", str(jobs), "--names", NAMES, "--json"]
    return words if args.explain else words + ["--no-explain"]


def measured(words):
    """Result, wall time and processor time of a run with its processes, s."""
    began = time.monotonic()
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    text = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(f"gaware fleet ended with {process.returncode}")
    return json.loads(text), time.monotonic() - began, usage.ru_utime, usage.ru_stime


def content(out):
    """Every result and table."""
    files = [p for p in out.rglob("*") if p.is_file() and p.suffix in (".json", ".parquet")]
    return {str(p.relative_to(out)): p.read_bytes() for p in files}


def entries(out):
    """Results of single logs and when they were written."""
    return {p.name: p.stat().st_mtime_ns for p in (out / "results").glob("*.json")}


def scaling(args, count):
    wall = {}
    for jobs in (1, 2):
        out = args.folder / f"jobs-{jobs}"
        shutil.rmtree(out, ignore_errors=True)
        result, wall_s, user_s, system_s = measured(command(args, out, jobs))
        assert result["analysed"] == count, result["failed"][:3]
        wall[jobs] = wall_s
        print(
            f"{jobs} job(s): {count} flights in {wall_s:.1f} s; per flight {wall_s / count * 1e3:.1f} ms of elapsed time, "
            f"{user_s / count * 1e3:.1f} ms user and {system_s / count * 1e3:.1f} ms system; "
            f"{(user_s + system_s) / wall_s:.2f} processors used",
            flush=True,
        )
    print(f"two jobs are {wall[1] / wall[2]:.2f} times as fast as one (load of the machine {os.getloadavg()[0]:.1f})")


def killed(args, count):
    """Kills all processes of a run at several places; returns whether each entry was made once."""
    out = args.folder / "killed"
    shutil.rmtree(out, ignore_errors=True)
    once, before, kept = True, {}, 0
    for kill in range(1, KILLS + 1):
        process = subprocess.Popen(
            command(args, out, 2), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        goal = count * kill // (KILLS + 1) - kept
        for line in process.stderr:
            done = re.match(r".*?(\d+) of \d+ logs, about", line)
            if done and int(done[1]) >= goal:
                break
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        now = entries(out)
        once &= all(now.get(name) == written for name, written in before.items())
        before, kept = now, len(now)
        print(f"killed with {kept} of {count} results written")
    result, *_ = measured(command(args, out, 2))
    now = entries(out)
    once &= all(now.get(name) == written for name, written in before.items())
    once &= result["resumed"] == kept and len(now) == count and result["analysed"] == count
    print(f"resumed: {result['resumed']} of {count} were there, {len(now) - kept} were made; {len(now)} results")
    return once


def main():
    args = arguments()
    args.program = args.program.resolve()
    count = len(make(args.program, args.folder / "logs", args.flights))
    scaling(args, count)
    once = killed(args, count)
    one, *others = (content(args.folder / name) for name in ("jobs-1", "jobs-2", "killed"))
    same = all(one == other for other in others)
    print(f"every result kept and made once: {'yes' if once else 'NO'}")
    print(f"content of all three runs the same byte for byte: {'yes' if same else 'NO'} ({len(one)} files)")
    sys.exit(0 if once and same else 1)


main()
