#!/usr/bin/env python3
"""The package in a bare Debian root: installed, its service's command started as systemd starts it, against the simulated autopilot.

    sudo packaging/check-bare-root.py target/debian/gaware_*_amd64.deb ROOT

Needs root, debootstrap, a package mirror, and the program of the same version in target/release. ROOT is made if it does not exist. No systemd runs in
it: this script does what the unit asks systemd for (state folder, credential, user and group, notification socket, signal to stop), nothing of
its hardening. It fails at the first thing that is not as it should be.
"""

import glob
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request

DEB, ROOT = sys.argv[1:3]
PROGRAM = os.path.join(os.path.dirname(__file__), "../target/release/gaware")
USER, DIALOUT = 61234, 20
PORT = 18080
STATUS = f"http://127.0.0.1:{PORT}/api/v1/status"


def run(*args):
    return subprocess.run(args, check=True, text=True, stdout=subprocess.PIPE).stdout


def wait(what, condition, patience_s=40.0):
    start = time.monotonic()
    while time.monotonic() - start < patience_s:
        try:
            if condition():
                print(f"{what}: {time.monotonic() - start:.1f} s")
                return
        except (OSError, KeyError, ValueError):
            pass
        time.sleep(0.2)
    sys.exit(f"NOT {what} within {patience_s} s")


class Autopilot:
    """The simulated autopilot on a pseudo-terminal, as /dev/ttyAMA0 of the root."""

    def __init__(self):
        self.log = open("/tmp/gaware-bare-sim.log", "w+")
        args = [PROGRAM, "sim", "--scenario", "fixed_wing", "--listen", "pty", "--no-wait"]
        self.process = subprocess.Popen(args, stdout=self.log, stderr=self.log)
        wait("simulated autopilot", self.port)
        os.chmod(self.port(), 0o660)
        os.chown(self.port(), 0, DIALOUT)
        link = ROOT + "/dev/ttyAMA0"
        if os.path.lexists(link):
            os.remove(link)
        os.symlink(self.port(), link)

    def port(self):
        found = re.search(r"serial:(/dev/pts/\d+)", open(self.log.name).read())
        return found and found.group(1)

    def vanish(self):
        self.process.kill()
        self.process.wait()


def install():
    start = time.monotonic()
    shutil.copy(DEB, ROOT + "/root/gaware.deb")
    install = "DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends /root/gaware.deb >/dev/null"
    run("chroot", ROOT, "sh", "-c", install)
    print(f"installed: {time.monotonic() - start:.1f} s, {run('chroot', ROOT, 'gaware', '--version').strip()}")
    config = ROOT + "/etc/gaware.toml"
    text = re.sub(r'web = "127.0.0.1:\d+"', f'web = "127.0.0.1:{PORT}"', open(config).read())
    open(config, "w").write(text)
    print(run("chroot", ROOT, "gaware", "config", "check").strip())


def start_service(notify):
    unit = open(ROOT + "/usr/lib/systemd/system/gaware.service").read()
    credential = "/run/gaware.toml"
    shutil.copy(ROOT + "/etc/gaware.toml", ROOT + credential)
    os.makedirs(ROOT + "/var/lib/gaware", exist_ok=True)
    for path in (credential, "/var/lib/gaware"):
        os.chown(ROOT + path, USER, USER)
    command = re.search(r"ExecStart=(.*)", unit).group(1).replace("%d/gaware.toml", credential)
    shell = f"cd /var/lib/gaware && umask 0027 && exec {command}"
    environment = {"NOTIFY_SOCKET": notify, "WATCHDOG_USEC": "30000000", "PATH": "/usr/sbin:/usr/bin:/sbin:/bin"}
    log = open("/tmp/gaware-bare-run.log", "w")
    identity = [f"--userspec={USER}:{USER}", f"--groups={DIALOUT}"]
    return subprocess.Popen(["chroot", *identity, ROOT, "sh", "-c", shell], env=environment, stdout=log, stderr=log)


def recordings():
    return glob.glob(ROOT + "/var/lib/gaware/**/*.mcap", recursive=True)


def state():
    return json.load(urllib.request.urlopen(STATUS, timeout=3))


def check():
    path = ROOT + "/run/notify"
    if os.path.exists(path):
        os.remove(path)
    manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    manager.bind(path)
    os.chmod(path, 0o777)
    manager.setblocking(False)
    heard = []

    def said(word):
        try:
            while True:
                heard.append(manager.recv(4096).decode())
        except BlockingIOError:
            return word in heard

    autopilot = Autopilot()
    service = start_service("/run/notify")
    try:
        wait("ready", lambda: said("READY=1"))
        wait("page", lambda: b"gaware" in urllib.request.urlopen(f"http://127.0.0.1:{PORT}/", timeout=3).read())
        wait("estimates", lambda: state()["phase"] == "running", 60)
        size = sum(map(os.path.getsize, recordings()))
        wait("recording grows", lambda: sum(map(os.path.getsize, recordings())) > size)
        autopilot.vanish()
        time.sleep(6)
        before = state()["imu"]["samples"]
        time.sleep(2)
        if state()["imu"]["samples"] != before or service.poll() is not None:
            sys.exit("NOT waiting for the port")
        autopilot = Autopilot()
        wait("samples again", lambda: state()["imu"]["samples"] > before + 200, 60)
        wait("watchdog", lambda: said("WATCHDOG=1"))
        service.send_signal(signal.SIGTERM)
        status = service.wait(60)
        if status != 0 or not said("STOPPING=1"):
            sys.exit(f"NOT stopped cleanly: status {status}")
        for recording in recordings():
            summary = json.loads(run("chroot", ROOT, "gaware", "replay", "--json", recording.removeprefix(ROOT)))
            print(f"{os.path.basename(recording)} replays: {summary['imu']['samples']} samples")
    finally:
        autopilot.vanish()
        if service.poll() is None:
            service.kill()


if not os.path.isdir(ROOT):
    run("debootstrap", "--variant=minbase", "bookworm", ROOT)
install()
os.makedirs(ROOT + "/dev/pts", exist_ok=True)
run("mount", "--bind", "/dev/pts", ROOT + "/dev/pts")
try:
    check()
finally:
    run("umount", ROOT + "/dev/pts")
