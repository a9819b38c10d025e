"""A Panda at work under a real monitor, recorded while it is stopped a few times."""

import math

import numpy as np

from armguard import Monitor, Obstacles, Recorder, Robot
from armguard.verdict import Level
from support.commissioned_arms import FINE, Arm

READY = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
LATENCY = 0.04
VELOCITY = [0.5, 0.3, 0.5, 0.4, 0.02, 0.5, 0.6]  # the fifth joint hardly moves
ACCELERATION = [2.0, 1.5, 2.0, 2.0, 1.0, 2.5, 3.0]
BRAKING = [5.0, 3.0, 4.0, 5.0, 5.0, 8.0, 8.0]
SILENT = (0.45, 2.05)
"""When the source of obstacles keeps silent, in [s], for `SILENCE`."""
SILENCE = 0.55
RATE = 500.0
DURATION = 3.4


def make_monitor():
    obstacles = Obstacles(sources=["camera"])
    return Monitor(Robot.load("panda"), obstacles, rate=RATE, rise_delay=0.1), obstacles


def drive(monitor, obstacles, q, v):
    """Step through a course; times at which a STOP follows another level."""
    told, before = [], Level.STOP
    random = np.random.default_rng(4)
    for tick in range(round(DURATION * RATE)):
        now = tick / RATE
        if tick % 5 == 0 and not any(one <= now < one + SILENCE for one in SILENT):
            place = np.array([4.0, 3.0, 0.5]) + random.normal(0.0, 0.004, 3)
            obstacles.update(
                ["ball"], now, [place], None, 0.1, source="camera", position_error=0.02
            )
        k = round(now / FINE)
        level = monitor.step(now, READY + q[k], v[k]).level
        if level is Level.STOP and before is not Level.STOP:
            told.append(now)
        before = level
    return told


def record(path):
    """Write the recording; the STOPs in it, and the arm that obeyed them."""
    arm = Arm(VELOCITY, ACCELERATION, BRAKING, LATENCY, cruise=0.5)
    rest = np.zeros((math.ceil(DURATION / FINE) + 1, 7))
    monitor, obstacles = make_monitor()
    # When it will be stopped depends on the silence of the source alone.
    planned = drive(monitor, obstacles, rest, rest)
    _, q, v = arm.work(planned, DURATION + 0.1)
    monitor, obstacles = make_monitor()
    with Recorder(path, monitor) as recorder:
        told = drive(monitor, obstacles, q, v)
        assert recorder.close() == ""
    assert told == planned
    return told, arm
