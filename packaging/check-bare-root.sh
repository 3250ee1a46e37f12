#!/bin/sh
# The package in a bare Debian root under a systemd of its own: installed, verified, started against the simulated autopilot, removed.
#
#     sudo packaging/check-bare-root.sh target/debian/gaware_*_amd64.deb ROOT
#
# Needs root, debootstrap, systemd-container and a package mirror. ROOT is made if it does not exist. What is checked inside stands in
# check-service.sh; the exit status is that of the first check that fails.
set -eu
here="$(cd "$(dirname "$0")" && pwd)"
deb="$1" root="$2"
[ -d "$root" ] || debootstrap --variant=minbase --include=systemd,systemd-sysv,dbus,udev bookworm "$root" >/dev/null
cp "$deb" "$root/root/gaware.deb"
chroot "$root" sh -c 'DEBIAN_FRONTEND=noninteractive apt-get -qq -o Dpkg::Use-Pty=0 install -y --reinstall --no-install-recommends /root/gaware.deb' >/dev/null
systemd-analyze verify --root="$root" --man=no gaware.service
echo "ok: systemd-analyze verify"
systemd-analyze security --offline=true --root="$root" --no-pager gaware.service | tail -1

rm -f "$root/root/check-service.log"
install -m 755 "$here/check-service.sh" "$root/root/check-service.sh"
cat >"$root/etc/systemd/system/check-service.service" <<'UNIT'
[Unit]
After=multi-user.target
[Service]
Type=oneshot
StandardOutput=append:/root/check-service.log
StandardError=inherit
ExecStart=/bin/bash /root/check-service.sh
# The container ends with 0 where the checks did.
ExecStopPost=/bin/sh -c 'systemctl exit "$([ "$SERVICE_RESULT" = success ]; echo $?)"'
UNIT
install -d "$root/etc/systemd/system/multi-user.target.wants"
ln -sf ../check-service.service "$root/etc/systemd/system/multi-user.target.wants/check-service.service"
status=0
timeout 600 systemd-nspawn -q -D "$root" --boot --register=no --keep-unit --private-network --console=pipe \
    </dev/null >"$root/root/boot.log" 2>&1 || status=$?
cat "$root/root/check-service.log"
exit "$status"
