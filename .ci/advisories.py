#!/usr/bin/env python3
"""Known advisories about what is in Cargo.lock, by .ci/advisories.csv: crate, id, versions that are free of it, kind.

    .ci/advisories.py                 fails where a version in Cargo.lock is none of those
    .ci/advisories.py --renew FOLDER  writes the table anew from a checkout of the RustSec advisory database

CI has no network but for packages, so the table is as old as its last renewal; its first line says when that was."""

import csv
import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TABLE = ROOT / ".ci/advisories.csv"
# What stays all the same, with the reason.
EXCEPTIONS = {
    "RUSTSEC-2024-0436": "paste has no maintainer; macros of mcap and pulp use it at compile time alone, it reads no input",
}


def locked():
    out = {}
    for package in tomllib.loads((ROOT / "Cargo.lock").read_text())["package"]:
        out.setdefault(package["name"], []).append(package["version"])
    return out


def numbers(version):
    """1.2.3-rc.1+x: a release comes after its candidates."""
    main, _, pre = version.split("+")[0].partition("-")
    parts = [int(p) for p in main.split(".")]
    return (*parts, *[0] * (3 - len(parts)), pre == "", pre)


def satisfies(version, requirement):
    have = numbers(version)
    for part in requirement.split(","):
        operator, wanted = re.fullmatch(r"\s*(>=|<=|>|<|=|\^)?\s*(\S+)\s*", part).groups()
        want = numbers(wanted)
        if operator == "^":
            first = next((k for k in range(3) if want[k] > 0), 2)
            good = have >= want and have[: first + 1] == want[: first + 1]
        else:
            good = {">=": have >= want, "<=": have <= want, ">": have > want, "<": have < want}.get(operator or "=", have[:3] == want[:3])
        if not good:
            return False
    return True


def renew(folder):
    rows, crates = [], locked()
    for path in sorted(Path(folder).glob("crates/*/RUSTSEC-*.md")):
        front = re.match(r"```toml\n(.*?)```", path.read_text(), re.S)
        entry = tomllib.loads(front[1])
        advisory, versions = entry["advisory"], entry.get("versions", {})
        if path.parent.name in crates and "withdrawn" not in advisory:
            free = versions.get("patched", []) + versions.get("unaffected", [])
            rows.append([path.parent.name, advisory["id"], "; ".join(free), advisory.get("informational", "vulnerability")])
    date = subprocess.check_output(["git", "-C", folder, "log", "-1", "--format=%cs"], text=True).strip()
    with TABLE.open("w", newline="") as file:
        file.write(f"# RustSec advisories about crates of Cargo.lock, as of {date}\n")
        csv.writer(file, lineterminator="\n").writerows(rows)


def check():
    lines = TABLE.read_text().splitlines()
    crates, found, used = locked(), [], set()
    for crate, advisory, free, kind in csv.reader(lines[1:]):
        for version in crates.get(crate, []):
            if any(satisfies(version, r) for r in free.split("; ") if r):
                continue
            used.add(advisory)
            if advisory not in EXCEPTIONS:
                found.append(f"{crate} {version}: {advisory} ({kind}), free of it are {free or 'none'}")
    found += [f"the exception {a} is not needed any more" for a in EXCEPTIONS if a not in used]
    if found:
        sys.exit("\n".join(found))
    print(f"advisories ok: {len(lines) - 1} about {len(crates)} crates; {lines[0].lstrip('# ')}")


if len(sys.argv) > 2 and sys.argv[1] == "--renew":
    renew(sys.argv[2])
check()
