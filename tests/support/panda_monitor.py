"""Panda among obstacles: what the tests of the monitor set up again and again."""

import functools

import numpy as np

from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot import Robot
from armguard.scheduling import DaaSchedule
from support.example_arms import hold_at_all_speeds

HOME = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8])
STILL = np.zeros(7)
PERIOD = 1e-3
FAR = [20.0, 0.0, 0.5]
DAA_LAWS = [(law, sort) for law in ("powers", "fibonacci") for sort in ("partial", "total")]
SCHEDULES = ["deadline", "full", *DAA_LAWS]


@functools.cache
def panda():
    """Panda, whose brakes hold at every speed what they do at low speed.

    How they depend on load and speed has tests of its own, on `ranged_panda`.
    """
    robot = Robot.load("panda")
    hold_at_all_speeds(robot)
    return robot


@functools.cache
def ranged_panda():
    """Panda as it comes, with brakes that are stated up to some loads and speeds."""
    return Robot.load("panda")


def make_monitor(schedule="deadline", *, obstacles=None, robot=None, **settings):
    """A table and a monitor on it; a pair of DAA's laws stands for that schedule."""
    obstacles = Obstacles(sources=[]) if obstacles is None else obstacles
    if isinstance(schedule, tuple):
        schedule = DaaSchedule(1.0 / settings.get("rate", 1000.0), *schedule)
    return obstacles, Monitor(robot or panda(), obstacles, schedule=schedule, **settings)


def see(obstacles, stamp, position, ids=("ball",), *, radius=0.1, **fields):
    """One message about balls."""
    positions = np.reshape(np.asarray(position, dtype=float), (len(ids), 3))
    obstacles.update(list(ids), stamp, positions, radius=radius, **fields)


def kinds(verdict):
    return {reason.kind for reason in verdict.reasons}


def subjects(verdict, kind):
    return {reason.subject for reason in verdict.reasons if reason.kind is kind}


def steps(monitor, start, count, q=HOME, v=STILL, *, period=PERIOD):
    """Verdicts of `count` ticks from tick number `start` on."""
    return [monitor.step((start + i) * period, q, v) for i in range(count)]


def keep(obstacles, monitor, start, count, q=HOME, v=STILL):
    """Ticks with a ball that is heard of in each."""
    verdicts = []
    for i in range(start, start + count):
        see(obstacles, i * PERIOD, FAR)
        verdicts.append(monitor.step(i * PERIOD, q, v))
    return verdicts
