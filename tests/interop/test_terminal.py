"""The upload from the companion's screen: a real terminal, a vehicle made of pymavlink alone."""

import fcntl
import os
import pty
import re
import struct
import termios
import threading

from support import GAWARE, HOME, PATIENCE, Case, items_of_plan
from vehicle import ArduPilot


class Screen:
    """A program on a terminal of 100×30; what it has written so far."""

    def __init__(self, args):
        self.pid, self.fd = pty.fork()
        if self.pid == 0:
            os.environ.update(TERM="xterm-256color", LANG="C.UTF-8")
            os.execv(args[0], args)
        fcntl.ioctl(self.fd, termios.TIOCSWINSZ, struct.pack("HHHH", 30, 100, 0, 0))
        self.text, self.grown = "", threading.Condition()
        self.reader = threading.Thread(target=self.read, daemon=True)
        self.reader.start()

    def read(self):
        while True:
            try:
                more = os.read(self.fd, 65536)
            except OSError:
                more = b""
            if not more:
                return
            with self.grown:
                self.text += more.decode(errors="replace")
                self.grown.notify_all()

    def press(self, key):
        os.write(self.fd, key.encode())

    def wait_for(self, text):
        """Letters in order: gaps are jumped over, not drawn. Only words that are new: the screen sends what has changed."""
        letters = text.replace(" ", "")

        def drawn():
            return letters in re.sub(r"\x1b\[[0-9;?]*[A-Za-z]|\s", "", self.text)

        with self.grown:
            if not self.grown.wait_for(drawn, PATIENCE):
                raise AssertionError(f"{text!r} is not on the screen")

    def drawn(self):
        """What was written last, without the terminal's orders."""
        with self.grown:
            return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", " ", self.text)[-3000:]

    def ended(self):
        _, status = os.waitpid(self.pid, 0)
        self.reader.join()
        os.close(self.fd)
        return os.waitstatus_to_exitcode(status)


class FromTheTerminal(Case):
    def setUp(self):
        super().setUp()
        self.vehicle = ArduPilot(HOME)
        self.vehicle.start()
        self.addCleanup(self.vehicle.stop)
        self.plan = self.planned("excite.plan")
        link = ["--connect", self.vehicle.address, "--no-record"]
        self.screen = Screen([GAWARE, "run", *link, "--mission", str(self.plan)])
        self.screen.wait_for("u upload the mission")
        self.assertTrue(self.vehicle.known.wait(PATIENCE))

    def test_u_and_yes_upload_and_no_does_not(self):
        self.screen.press("u")
        self.screen.wait_for("Upload the planned mission?")
        self.screen.press("n")
        self.screen.press("y")
        self.screen.press("u")
        self.screen.press("y")
        # Read before and after.
        for _ in range(2):
            self.assertTrue(self.vehicle.was_read.acquire(timeout=PATIENCE), self.screen.drawn())
        self.assert_same_items(items_of_plan(self.plan), self.vehicle.mission())
        self.assertEqual(self.vehicle.uploads, 1)
        self.screen.press("q")
        # This vehicle sends no inertial data: a run that had nothing to estimate from is no success.
        self.assertEqual(self.screen.ended(), 1)
