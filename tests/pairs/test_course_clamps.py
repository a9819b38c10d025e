"""What a link on a piece can press somebody against is named, and how fast it is."""

import numpy as np
import pytest

from armguard import ContactLimit, ContactLimits
from armguard.bounds import Plan, check_plan
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.pairs.course_clamps import NOTHING, find_obstacle_speeds
from support.panda_monitor import HOME, STILL, panda

FORCE = ContactLimit(force=100.0, stiffness=1e4, body_mass=1.0, gap=0.1, source="a test")


def speeds_beside(
    place, *, limit=FORCE, ids=("left_hand",), velocity=(0.0, 0.0, 0.0), table=None, margin=0.0
):
    """How fast what a first obstacle can be pressed against is at most, by link of the arm."""
    obstacles = Obstacles(accel=1.0, speed=0.5, regions={"*hand": "hand"})
    monitor = Monitor(
        panda(), obstacles, motion="planned", contact_limits=ContactLimits({"hand": limit}),
        margin=margin,
    )  # fmt: skip
    if table is not None:
        obstacles.add_static("table", table, 0.02)
    places = [place, *([np.add(place, [0.0, 0.0, 0.15])] * (len(ids) - 1))]
    obstacles.update(list(ids), 0.0, places, [velocity] * len(ids), radius=0.04)
    monitor.step(0.0, HOME, STILL)
    q = np.tile(HOME, (2, 1))
    plan = Plan(0.01, np.array([0.0, 0.1]), q, np.zeros_like(q), np.full(7, 1e-3))
    checked = check_plan(plan, panda(), 0.0, HOME, STILL, 0.0)
    arm = monitor._scheduler.arm
    course = arm.motion.planned.lay_out(checked, with_velocities=True)
    row, links = obstacles.row(ids[0]), len(arm.links)
    pairs = row * links + np.arange(links)
    return find_obstacle_speeds(arm.state.handle, course, pairs, 0.0)


TIP = [0.55, 0.0, 0.55]


def test_alone_nothing_is_pressed_against_an_obstacle():
    assert set(speeds_beside(TIP).tolist()) == {NOTHING}


def test_a_static_near_a_link_counts_with_no_speed():
    found = speeds_beside(TIP, table=[0.45, 0.05, 0.5])
    assert found.max() == 0.0


def test_a_static_far_off_does_not():
    assert set(speeds_beside(TIP, table=[3.0, 0.0, 0.0]).tolist()) == {NOTHING}


@pytest.mark.parametrize(
    ("ids", "counts"),
    [
        (("anna/left_hand", "anna/right_hand"), False),
        (("anna/left_hand", "ben/right_hand"), True),
        (("anna/left_hand", "right_hand"), True),
        (("left_hand", "right_hand"), True),
    ],
)
def test_another_part_counts_unless_it_is_the_same_persons(ids, counts):
    found = speeds_beside(TIP, ids=ids)
    assert (found.max() > 0.0) == counts


def test_what_may_never_be_pressed_or_touched_is_not_looked_up():
    by_speed = ContactLimit(speed=0.0, source="a test")
    assert set(speeds_beside(TIP, limit=by_speed, table=TIP).tolist()) == {NOTHING}


def test_the_margin_widens_the_gap():
    place = [1.3, 0.0, 0.5]
    assert speeds_beside(TIP, table=place).max() == NOTHING
    assert speeds_beside(TIP, table=place, margin=1.0).max() == 0.0
