"""One setting in the study: its own table and monitor, its verdicts and its costs.

Durations are processor time of this thread, which other load of the machine hardly changes. The
states are made before each timer starts.
"""

from __future__ import annotations

import copy
import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.cover.cover import Cover
from armguard.lab.tradeoff.ladder import Setting
from armguard.lab.tradeoff.scene import Scene, Site
from armguard.monitor.monitor import Monitor
from armguard.monitor.settings import read_settings
from armguard.scheduling.paper.daa import DaaSchedule
from armguard.settings.settings import Settings
from armguard.verdict import Level

Array = NDArray[np.float64]


class Track(NamedTuple):
    """Verdicts of a setting and their durations, tick by tick. All of shape (ticks,)."""

    time: Array
    """Of the ticks, in [s] of the scene."""
    spent: Array
    """On the step, in [s]."""
    evaluated: NDArray[np.int64]
    level: NDArray[np.int64]
    contact_time: Array
    """[s]."""
    pace: Array
    """At which an arm goes on that keeps to the speed scale, as a share of what it does here."""

    def until(self, end: float) -> Track:
        """The ticks before a time in [s]."""
        count = int(np.searchsorted(self.time, end - 1e-9))
        return Track._make(field[:count] for field in self)


class Contestant:
    """One setting.

    Args:
        setting: What it differs from the default in.
        site: Where, and by what arm.
        scene: What it is shown.
        cover: Of the arm.

    Attributes:
        setting: As given.
        rate: Of ticks, in [Hz].
        response: Until a STOP of the next tick takes effect, in [s].
        intake: What each message took, in [s].
        begun: Up to where it has been run, in [s] of the scene.

    Raises:
        ArmguardError: These settings do not go together.
    """

    def __init__(self, setting: Setting, site: Site, scene: Scene, cover: Cover) -> None:
        self.setting, self._site, self._scene = setting, site, scene
        self._robot = copy.copy(site.robot)
        self._robot.cover = cover
        settings = self._make_settings()
        self.rate = settings.rate
        self.obstacles = site.make_obstacles()
        self.monitor = Monitor(self._robot, self.obstacles, settings)
        self.response = settings.braking_delay
        self._speeds = settings.put_in_force(self._robot).velocity
        self.intake: list[float] = []
        self.begun = 0.0
        self._tick = self._message = 0
        self._ticks = round(scene.seconds * self.rate)
        self._numbers = np.zeros((self._ticks, len(Track._fields)))

    def _make_settings(self) -> Settings:
        """Of a monitor; the paper's schedule is made for their period."""
        keywords = self.setting.monitor(self._site.settings)
        schedule = keywords.get("schedule")
        if isinstance(schedule, tuple):
            del keywords["schedule"]
            period = read_settings(None, keywords).period
            keywords["schedule"] = DaaSchedule(period, schedule[1])
        return read_settings(None, keywords)

    def run(self, until: float) -> None:
        """Go on to a time of the scene, in [s]."""
        scene, monitor, clock = self._scene, self.monitor, time.thread_time_ns
        messages = scene.messages
        while self._tick < self._ticks and (now := self._tick / self.rate) < until - 1e-9:
            while self._message < len(messages) and messages[self._message].stamp <= now + 1e-12:
                begin = clock()
                self.obstacles.update(*messages[self._message])
                self.intake.append(1e-9 * (clock() - begin))
                self._message += 1
            q, v = scene.sample(now)
            begin = clock()
            verdict = monitor.step(now, q, v)
            spent = 1e-9 * (clock() - begin)
            pace = float(verdict.level is not Level.STOP) * verdict.speed_scale
            fastest = float(np.max(np.abs(v) / self._speeds))
            if fastest > 0.0:
                pace /= fastest
            self._numbers[self._tick] = (
                now, spent, verdict.evaluated, int(verdict.level), verdict.contact_time,
                min(pace, 1.0),
            )  # fmt: skip
            if not verdict.complete:
                # What is not known could be now.
                self._numbers[self._tick, 4] = 0.0
            self._tick += 1
        self.begun = max(self.begun, min(until, scene.seconds))

    @property
    def track(self) -> Track:
        """Verdicts so far, without the very first tick."""
        numbers = self._numbers[1 : self._tick].T
        fields = dict(zip(Track._fields, numbers, strict=True))
        return Track(**fields)._replace(
            evaluated=numbers[2].astype(np.int64), level=numbers[3].astype(np.int64)
        )
