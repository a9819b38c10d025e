"""Tables of braking joints against joints that brake anyhow within what is stated of them.

ARMGUARD_MOTIONS sets how many motions are tried; 1000000 for a long run.
"""

import os

import numpy as np

from armguard.bounds.displacement import fill_displacements
from armguard.robot.stop_time import compute_stop_time
from support.braking_motions import draw_joints, move

MOTIONS = int(os.environ.get("ARMGUARD_MOTIONS", "20000"))
BATCH = 2000


def test_joints_that_brake_anyhow_never_leave_their_table():
    random, tried, closest, at_rest = np.random.default_rng(11), 0, 0.0, 0
    while tried < MOTIONS:
        joints = draw_joints(random, BATCH)
        limits, count = joints.limits, BATCH
        age, horizon = random.choice([0.0, 0.01]), random.choice([0.0, 0.02, 0.1])
        free = age + horizon
        end = compute_stop_time(
            joints.v, limits.velocity_error, limits.operating_velocity, limits.acceleration,
            limits.brakes, age, horizon, 0.0, limits.operating_acceleration,
        )  # fmt: skip
        time = np.sort(random.uniform(0.0, 1.5 * end, 12))
        high, low = np.zeros((2, 12, count))
        highest, lowest = np.zeros((2, count))
        fill_displacements(joints.q, joints.v, age, free, limits, time, high, low, highest, lowest)
        for _ in range(5):
            places = move(random, joints, free, age + time)
            slack = 1e-11 * (1.0 + np.abs(places))
            assert (places <= high + slack).all()
            assert (places >= low - slack).all()
            reached = places > 0.01
            closest = max(closest, (places[reached] / high[reached]).max())
            at_rest += int((np.diff(places[-2:], axis=0) == 0.0).sum())
        tried += 5 * count
    # They are hostile: bounds are reached.
    assert closest > 0.999
    assert at_rest > 0
