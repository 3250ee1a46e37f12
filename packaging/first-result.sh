#!/bin/sh
# From nothing to a report of one's own log, by each way to install; prints the seconds of each step.
#
#     sudo packaging/first-result.sh apt LOG FOLDER target/debian/gaware_*_amd64.deb
#     packaging/first-result.sh pip LOG FOLDER target/python/wheels/gaware-*.whl
#     packaging/first-result.sh cargo LOG FOLDER
#
# FOLDER is made and must not exist. apt: a bare Debian root by debootstrap; pip: a new environment; cargo: an empty CARGO_HOME, and the
# toolchain that is there. Needs the network for what is downloaded.
set -eu
cd "$(dirname "$0")/.."
way="$1" log="$(realpath "$2")" folder="$(realpath -m "$3")" package="${4:-}"
[ ! -e "$folder" ] || { echo "$folder exists: the way starts from nothing" >&2; exit 2; }
mkdir -p "$folder"
name="$(basename "$log")"

step() {
    what="$1" start="$(date +%s.%N)"
    shift
    "$@" >"$folder/last.log" 2>&1 || { cat "$folder/last.log" >&2; exit 1; }
    awk -v what="$what" -v from="$start" -v to="$(date +%s.%N)" 'BEGIN { printf "%8.1f s  %s\n", to - from, what }'
}

case "$way" in
apt)
    root="$folder/root"
    step "bare system" debootstrap --variant=minbase bookworm "$root"
    cp "$package" "$root/root/gaware.deb"
    cp "$log" "$root/root/$name"
    step "apt install" chroot "$root" apt-get -qq -o Dpkg::Use-Pty=0 install -y ./root/gaware.deb
    step "gaware report" chroot "$root" gaware report "/root/$name" --out /root/report.html
    report="$root/root/report.html"
    ;;
pip)
    step "environment" python3 -m venv "$folder/venv"
    step "pip install" "$folder/venv/bin/pip" install --no-cache-dir --disable-pip-version-check "$package"
    step "gaware.explain" "$folder/venv/bin/python" -c 'import gaware, sys; gaware.explain([sys.argv[1]]).write(sys.argv[2])' "$log" "$folder/explained"
    report="$folder/explained/report.html"
    ;;
cargo)
    step "cargo install" env CARGO_HOME="$folder/cargo" CARGO_TARGET_DIR="$folder/target" cargo install --locked --path .
    step "gaware report" "$folder/cargo/bin/gaware" report "$log" --out "$folder/report.html"
    report="$folder/report.html"
    ;;
*)
    echo "apt, pip or cargo, not $way" >&2
    exit 2
    ;;
esac
ls -l "$report"
