"""The compiled tick must do what taking the state and then looking would do."""

import math

import numpy as np

from armguard.robot.joint_acceptance import BELIEVED
from armguard.scheduling.certificates import UNPLACED, UNSEEN
from support.panda_monitor import HOME, STILL, make_monitor, see, steps

FAR, NEAR = [8.0, 0.0, 0.5], [0.9, 0.0, 0.5]


def advance(monitor, number, q=HOME, v=STILL, *, now=None, may_look=True):
    stamp = number * 1e-3
    now = stamp if now is None else now
    return monitor._watch.advance(stamp, q, v, now, 0.0, number + 1, may_look)


def watched(position):
    obstacles, monitor = make_monitor()
    see(obstacles, 0.0, position)
    steps(monitor, 0, 1)
    return obstacles, monitor


def test_state_and_look_in_one_call():
    _, monitor = watched(FAR)
    verdict = monitor.step(1e-3, HOME, STILL)
    found, _, stop_time, late, opening, row, link, expiry, overdue, _, news = advance(monitor, 2)
    assert (found, overdue, news) == (BELIEVED, 0, 0)
    assert stop_time == verdict.stop_time
    assert stop_time < late < math.inf
    assert opening == (stop_time + 0.3) / 0.75
    assert monitor._watch.arm.names(row * len(monitor.robot.links) + link) == (
        verdict.link,
        verdict.obstacle,
    )
    assert abs(expiry - 1e-3 - verdict.contact_time) < 1e-9


def test_without_leave_it_does_not_look():
    _, monitor = watched(FAR)
    found, *_, row, _, _, _, _, _ = advance(monitor, 1, may_look=False)
    assert (found, row) == (BELIEVED, UNSEEN)


def test_a_refused_state_leaves_the_last_one_as_it_was():
    _, monitor = watched(FAR)
    for q, v, now in (
        (HOME + np.nan, STILL, None),
        (HOME, STILL + 99.0, None),
        (HOME, STILL, 9.0),
    ):
        seen = advance(monitor, 1, q, v, now=now)
        assert seen[0] < BELIEVED
        assert seen[5] == UNSEEN
        assert (monitor._states.q == HOME).all()
    assert advance(monitor, 1)[0] == BELIEVED


def test_doubt_waits_for_the_look_that_knows_of_it():
    _, monitor = watched(FAR)
    monitor._watch.doubt()
    assert advance(monitor, 1)[5] == UNSEEN


def test_where_the_arm_is_needed_it_says_so():
    obstacles, monitor = watched(FAR)
    see(obstacles, 1e-3, NEAR, ids=["near"])
    monitor._watch.follow()
    assert advance(monitor, 1)[5] == UNPLACED
