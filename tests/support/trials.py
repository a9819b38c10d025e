"""Short trials that settings are chosen by: Panda at work, and a ball that comes and goes."""

import copy
import functools

import numpy as np

from armguard.monitor import Monitor, TrialTick
from armguard.obstacles import Obstacles
from support.panda_monitor import HOME, panda

RATE = 200.0


def make_robot():
    """Panda of one's own: its cover may be cut."""
    return copy.copy(panda())


def make_trial(nearest=1.1, direction=0.3, seconds=1.5, *, farthest=3.0):
    """A ball that comes up to the arm and leaves again, while the arm sways from rest to rest.

    Args:
        nearest: Its least distance from the axis, in [m].
        direction: Where it comes from, about z from x, in [rad].
        seconds: How long it is all told.
        farthest: Where it comes from, in [m].
    """
    way = np.array([np.cos(direction), np.sin(direction), 0.0])
    ticks = []
    for number in range(round(seconds * RATE)):
        now = number / RATE
        phase = 2.0 * np.pi * now / seconds
        # Slower than 2 m/s and 10 m/s² for as long as this takes a second and a half.
        half = 0.25 * (farthest - nearest)
        distance = nearest + half * (1.0 + np.cos(phase))
        pace = -half * 2.0 * np.pi / seconds * np.sin(phase)
        sway = 0.1 * np.array([1.0, 0.5, -1.0, 0.5, 1.0, -0.5, 1.0])
        q = HOME + sway * (1.0 - np.cos(phase))
        v = sway * 2.0 * np.pi / seconds * np.sin(phase)
        place = distance * way + [0.0, 0.0, 0.5]
        tell = functools.partial(_see, now, place, pace * way) if number % 2 == 0 else None
        ticks.append(TrialTick(now, q, v, tell=tell))
    return ticks


def _see(now, place, pace, monitor):
    monitor.obstacles.update(["ball"], now, [place], [pace], radius=0.1)


def make_auto(trial=None, *, robot=None, obstacles=None, **settings):
    """A monitor that is chosen by a trial; what its controller keeps to is published."""
    settings = {"rate": RATE, "operating": "published", **settings}
    trial = make_trial() if trial is None else trial
    obstacles = Obstacles() if obstacles is None else obstacles
    return Monitor.auto(robot or make_robot(), obstacles, trial, **settings)


def lead(monitor, trial):
    """The verdicts of a monitor that is led through a trial."""
    verdicts = []
    for tick in trial:
        if tick.tell is not None:
            tick.tell(monitor)
        verdicts.append(monitor.step(tick.stamp, tick.q, tick.v, tick.now))
    return verdicts
