#!/bin/bash
# Runs inside of the root that check-bare-root.sh boots: the service as systemd runs it, against the simulated autopilot on a
# pseudo-terminal that takes the place of a serial port.
set -euo pipefail
port=18080
recordings=/var/lib/private/gaware

fail() {
    echo "NOT $1"
    journalctl -u gaware --no-pager | tail -20
    systemctl show gaware -p ActiveState,SubState,Result,NRestarts
    exit 1
}

# wait_for WHAT SECONDS COMMAND…: until the command succeeds.
wait_for() {
    local what="$1" patience="$2" start=$EPOCHREALTIME
    shift 2
    until "$@"; do
        [ "$(elapsed "$start" | cut -d. -f1)" -lt "$patience" ] || fail "$what within $patience s"
        sleep 0.2
    done
    echo "ok: $what ($(elapsed "$start") s)"
}

elapsed() { awk -v from="$1" -v to="$EPOCHREALTIME" 'BEGIN { printf "%.1f", to - from }'; }

# The page's status, or the part of it that a regular expression names.
status() {
    exec 3<>"/dev/tcp/127.0.0.1/$port" || return 1
    printf 'GET /api/v1/status HTTP/1.1\r\nHost: 127.0.0.1:%s\r\nConnection: close\r\n\r\n' "$port" >&3
    cat <&3 | tr -d '\n' | grep -oE "$1"
}

property() { systemctl show gaware -p "$1" --value; }
samples() { status '"samples": ?[0-9]+' | grep -oE '[0-9]+$'; }
recorded() { cat "$recordings"/*.mcap | wc -c; }
estimating() { [ -n "$(status '"phase": ?"running"' 2>/dev/null)" ]; }
recording_grows() { [ "$(recorded)" -gt "$1" ]; }
more_samples_than() { [ "$(samples 2>/dev/null || echo 0)" -gt "$1" ]; }
restarted() { [ "$(property NRestarts)" = 1 ] && [ "$(property ActiveState)" = active ]; }

autopilot() {
    : >/run/autopilot.log
    gaware sim --scenario fixed_wing --listen pty --no-wait >/run/autopilot.log 2>&1 &
    simulated=$!
    wait_for "simulated autopilot" 20 grep -q 'serial:/dev/pts/' /run/autopilot.log
    local pts
    pts="$(grep -oE '/dev/pts/[0-9]+' /run/autopilot.log | head -1)"
    chgrp dialout "$pts"
    chmod 660 "$pts"
    ln -sf "$pts" /dev/ttyAMA0
}

rm -rf "${recordings:?}"/*
autopilot
sed -i "s/^web = .*/web = \"127.0.0.1:$port\"/" /etc/gaware.toml
gaware config check
start=$EPOCHREALTIME
systemctl start gaware || fail "started"
echo "ok: systemd says started ($(elapsed "$start") s)"
[ "$(stat -c %u "/proc/$(property MainPID)")" -gt 0 ] || fail "a user of its own"
wait_for "estimates on the page" 60 estimating
wait_for "recording grows" 20 recording_grows "$(recorded)"

kill -9 "$simulated"
sleep 6
before="$(samples)"
sleep 2
{ [ "$(samples)" = "$before" ] && [ "$(property NRestarts)" = 0 ]; } || fail "waiting for the port that vanished"
echo "ok: the port vanished, the service waits"
autopilot
wait_for "samples again" 60 more_samples_than $((before + 200))

# A program that hangs is ended by the watchdog and started again.
kill -STOP "$(property MainPID)"
wait_for "started again by the watchdog" 90 restarted
# A pseudo-terminal, unlike a port, keeps the exclusive access of a program that was killed until its other end closes.
kill -9 "$simulated"
autopilot
wait_for "estimates on the page" 60 estimating

start=$EPOCHREALTIME
systemctl stop gaware
[ "$(property Result)" = success ] || fail "stopped cleanly"
echo "ok: stopped cleanly ($(elapsed "$start") s)"
for file in "$recordings"/*.mcap; do
    gaware replay --json "$file" | tr -d '\n' | grep -oE '"samples": ?[0-9]+' | head -1 | sed "s|^|ok: $(basename "$file") replays, |"
done
journalctl -u gaware --no-pager -o cat | grep -qi 'link' || fail "lines in the journal"
systemctl start gaware || fail "started"
DEBIAN_FRONTEND=noninteractive apt-get -qq remove -y gaware >/dev/null
[ "$(property ActiveState)" != active ] || fail "ended when the package is removed"
[ ! -e /usr/bin/gaware ] || fail "removed"
[ -n "$(ls "$recordings"/*.mcap)" ] || fail "recordings kept"
echo "ok: removed, recordings kept"
