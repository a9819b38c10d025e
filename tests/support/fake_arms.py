"""Arms and streams that a test of a driver can hold in its hands."""

import time

from armguard.drivers.arm import ArmState, Program
from armguard.verdict import Level
from support.verdict_samples import verdict


class FakeClock:
    """Stands for `time` in a module: it goes on by what is slept."""

    def __init__(self):
        self.now = 100.0

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds


class FakeArm:
    """Does what it is told, at once, unless it is told to disobey."""

    comes_back = False

    def __init__(self):
        self.orders = []
        self.program, self.fraction, self.speed, self.trouble = Program.RUNNING, 1.0, 0.5, ""
        self.takes_slider = True
        self.is_silent = False

    def read(self):
        if self.is_silent:
            return None
        v = self.speed * self.fraction if self.program is Program.RUNNING else 0.0
        now = time.monotonic()
        return ArmState(now, [0.0] * 6, [v] * 6, self.program, self.trouble, self.fraction)

    def scale(self, fraction):
        if self.takes_slider:
            self.fraction = fraction

    def pause(self):
        self.orders.append("pause")
        self.program = Program.PAUSED

    def resume(self):
        self.orders.append("resume")
        self.program = Program.RUNNING

    def stop(self):
        self.orders.append("stop")
        self.program = Program.STOPPED
        return True

    def leave(self):
        self.orders.append("leave")


class FakeStreams:
    """A publisher and a reader in one."""

    def __init__(self):
        self.level, self.validity, self.sequence, self.published = Level.CLEAR, 1.0, 0, []
        self.scale, self.run, self.arm = 1.0, "first", ""
        self.command = self.newest = None
        self.is_silent = False

    def joints(self, stamp, names, q, v, arm):
        self.published.append((stamp, names, list(q), list(v), arm))

    def latest(self, timeout):
        time.sleep(0.0005)
        if self.is_silent:
            return self.newest
        if self.level is None:
            return None
        self.sequence += 1
        now = time.monotonic()
        self.newest = verdict(
            self.level,
            stamp=now,
            sequence=self.sequence,
            speed_scale=self.scale,
            valid_until=now + self.validity,
            run=self.run,
            arm=self.arm,
        )
        return self.newest


class FakeMotionArm(FakeArm):
    """Follows positions exactly, and brakes in no time."""

    def __init__(self, q):
        super().__init__()
        self.q, self.v, self.followed = list(q), [0.0] * 6, []
        self.is_braking = False

    def read(self):
        now = time.monotonic()
        return ArmState(now, self.q, self.v, self.program, self.trouble, 1.0)

    def follow(self, q):
        self.q = q
        self.followed.append(q)

    def hold(self):
        self.orders.append("hold")

    def brake(self):
        self.orders.append("brake")
