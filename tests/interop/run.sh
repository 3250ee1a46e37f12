#!/bin/sh
# Missions exchanged with software that nobody here wrote: MAVSDK, pymavlink, MAVProxy; live data read by Foxglove's client. Needs Python 3.10 or
# later with venv, node 20 and npm, and package indexes; arguments choose tests (test_mavsdk, test_files.MavsdkReads, …).
set -eu
cd "$(dirname "$0")/../.."
# With the example, as for the browser: without development dependencies the program would be compiled once more.
cargo build --quiet --locked --bin gaware --example web_fixture
target="${CARGO_TARGET_DIR:-$PWD/target}"
GAWARE="$target/debug/gaware"
export GAWARE
venv="$target/interop-venv"
wanted=$(cksum <tests/interop/requirements.txt)
if [ "$(cat "$venv/ready" 2>/dev/null)" != "$wanted" ]; then
    rm -rf "$venv"
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check --no-deps -r tests/interop/requirements.txt
    printf '%s\n' "$wanted" >"$venv/ready"
fi
cd tests/interop
if [ $# -eq 0 ]; then
    set -- $(for file in test_*.py; do sed -n "s/^class \([A-Za-z0-9]*\)(.*Case):.*/${file%.py}.\1/p" "$file"; done)
fi
export MAVLINK20=1 PYTHONDONTWRITEBYTECODE=1
# Three at a time, a process each: they wait more than they compute.
logs=$(mktemp -d)
trap 'rm -rf "$logs"' EXIT
export logs venv
printf '%s\n' "$@" | xargs -P 3 -I '{}' sh -c '
    "$venv/bin/python" -m unittest -v {} >"$logs/{}" 2>&1
    status=$?
    cat "$logs/{}"
    exit $status'
