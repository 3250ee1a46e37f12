#!/usr/bin/env python3
"""Write the bill of materials of the `gaware` program as CycloneDX 1.6 JSON, from `cargo metadata` and Cargo.lock.

    .ci/sbom.py FILE [TARGET [TEXTS]]

It names what is linked into the program for one target (default: this machine's): normal dependencies and those of
build scripts and macros, no test tools. TEXTS is a file for the texts of their licences. Checksums are those of Cargo.lock. The serial number follows from the content, so that the same
sources give the same file.
"""

import hashlib
import json
import re
import subprocess
import sys
import tomllib
import uuid
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PROGRAM = "gaware"
NOTICE = re.compile(r"(licen[cs]e|copying|copyright|notice|unlicense)", re.IGNORECASE)


def host():
    lines = subprocess.run(["rustc", "-vV"], capture_output=True, text=True, check=True).stdout.splitlines()
    return next(line.removeprefix("host: ") for line in lines if line.startswith("host: "))


def metadata(target):
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--filter-platform", target]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout)


def linked(data):
    """Ids of the program's package and all that it needs, with the ids that each of them needs."""
    nodes = {node["id"]: node for node in data["resolve"]["nodes"]}
    needs = {}
    to_do = [p["id"] for p in data["packages"] if p["name"] == PROGRAM and p["source"] is None]
    while to_do:
        here = to_do.pop()
        if here in needs:
            continue
        kinds = lambda dep: {kind["kind"] for kind in dep["dep_kinds"]}
        needs[here] = sorted(dep["pkg"] for dep in nodes[here]["deps"] if kinds(dep) != {"dev"})
        to_do += needs[here]
    return needs


def reference(package):
    return f"pkg:cargo/{package['name']}@{package['version']}"


def component(package, checksums):
    # The way in which some crates still write OR.
    licence = (package["license"] or "").replace("/", " OR ").replace("  ", " ")
    own = package["source"] is None
    entry = {
        "type": "application" if package["name"] == PROGRAM else "library",
        "bom-ref": reference(package),
        "name": package["name"],
        "version": package["version"],
        "licenses": [{"expression": licence}],
        "purl": reference(package),
    }
    checksum = checksums.get((package["name"], package["version"]))
    if checksum:
        entry["hashes"] = [{"alg": "SHA-256", "content": checksum}]
    if package.get("repository") and not own:
        entry["externalReferences"] = [{"type": "vcs", "url": package["repository"]}]
    return entry


def texts(parts):
    """The licences that come in the packages of others, each text once under the names of all that have it."""
    found = {}
    for part in parts:
        name = f"{part['name']} {part['version']} ({part['license']})"
        files = [f for f in Path(part["manifest_path"]).parent.iterdir() if f.is_file() and NOTICE.match(f.name)]
        for text in sorted({f.read_text(errors="replace").strip() for f in files}) or ["No text in the package."]:
            found.setdefault(text, []).append(name)
    return "\n\n".join("\n".join([*names, "", text, "", "-" * 80]) for text, names in found.items()) + "\n"


def main():
    if not 2 <= len(sys.argv) <= 4:
        sys.exit("usage: sbom.py FILE [TARGET [TEXTS]]")
    target = sys.argv[2] if len(sys.argv) > 2 else host()
    data = metadata(target)
    needs = linked(data)
    packages = {p["id"]: p for p in data["packages"]}
    lock = tomllib.loads((ROOT / "Cargo.lock").read_text())
    checksums = {(p["name"], p["version"]): p["checksum"] for p in lock["package"] if "checksum" in p}
    parts = sorted((packages[i] for i in needs), key=reference)
    without = [reference(p) for p in parts if p["source"] and not checksums.get((p["name"], p["version"]))]
    if without:
        sys.exit(f"no checksum in Cargo.lock: {', '.join(without)}")
    main_part = next(p for p in parts if p["name"] == PROGRAM)
    bill = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "component": component(main_part, checksums),
            "properties": [{"name": "gaware:target", "value": target}],
        },
        "components": [component(p, checksums) for p in parts if p is not main_part],
        "dependencies": [
            {"ref": reference(packages[i]), "dependsOn": sorted(reference(packages[d]) for d in needs[i])}
            for i in sorted(needs, key=lambda i: reference(packages[i]))
        ],
    }
    digest = hashlib.sha256(json.dumps(bill, sort_keys=True).encode()).digest()
    bill["serialNumber"] = f"urn:uuid:{uuid.UUID(bytes=digest[:16], version=4)}"
    Path(sys.argv[1]).write_text(json.dumps(bill, indent=1) + "\n")
    if len(sys.argv) == 4:
        Path(sys.argv[3]).write_text(texts([p for p in parts if p["source"]]))
    print(f"{len(bill['components'])} components for {target}")


main()
