import numpy as np
import pytest

from armguard.monitor.what_if import UNCHANGED, Change, WhatIf
from armguard.obstacles import Obstacles
from support.panda_monitor import HOME, PERIOD, STILL, make_monitor, panda, see

NOW = 20 * PERIOD
PLACE, PACE = np.array([1.1, 0.2, 0.6]), np.array([-0.4, 0.1, 0.0])
CHANGES = [
    Change(distance=0.03),
    Change(distance=-0.03),
    Change(speed=-1.0),
    Change(speed=1.0),
    Change(age=0.01),
    Change(age=-0.01),
    Change(fresh=True),
    Change(distance=0.02, speed=0.5, fresh=True),
]


def ask(monitor, change=UNCHANGED, **options):
    """Contact times of all links with the ball, as of a monitor's last tick."""
    monitor._scheduler.prepare(monitor._last[0])
    row = monitor.obstacles.row("ball")
    return WhatIf(monitor._scheduler.arm.state, row).contact_times(change, **options)


def look(*, stamp=0.0, place=PLACE, speed=2.0, margin=0.0, motion="joint", **fields):
    """A monitor after one tick in which it saw a ball."""
    obstacles, monitor = make_monitor(
        "full", obstacles=Obstacles(speed=speed), margin=margin, motion=motion
    )
    see(obstacles, stamp, place, velocity=[PACE], **fields)
    return monitor, monitor.step(NOW, HOME, STILL)


def make_real(change, motion):
    """The monitor of a world in which the change is a fact."""
    stamp, place = -change.age, PLACE
    if change.fresh:
        stamp, place = NOW, PLACE + NOW * PACE
    return look(
        stamp=stamp, place=place, speed=2.0 + change.speed, margin=0.05 + change.distance,
        motion=motion,
    )  # fmt: skip


@pytest.mark.parametrize("motion", ["joint", "isotropic"])
def test_answers_are_those_of_a_world_that_is_so(motion):
    monitor, verdict = look(margin=0.05, motion=motion)
    assert verdict.contact_time == pytest.approx(ask(monitor).min(), abs=1e-12)
    for change in CHANGES:
        real, _ = make_real(change, motion)
        # An age counts from the tick, and stamps are rounded.
        np.testing.assert_allclose(ask(monitor, change), ask(real), rtol=1e-9, err_msg=str(change))


def test_answers_do_not_depend_on_what_was_asked_before_and_of_which_links():
    monitor, _ = look(margin=0.05)
    expected = {change: ask(monitor, change) for change in (UNCHANGED, *CHANGES)}
    state, row = monitor._scheduler.arm.state, monitor.obstacles.row("ball")
    links = np.array([2, 5])
    whole, some = WhatIf(state, row), WhatIf(state, row, links)
    for change in (*CHANGES, UNCHANGED, *CHANGES[::-1]):
        assert np.array_equal(whole.contact_times(change), expected[change]), change
        assert np.array_equal(some.contact_times(change), expected[change][links]), change


def test_nothing_that_is_asked_changes_the_monitor():
    asked, verdict = look()
    silent, same = look()
    assert verdict == same
    for change in CHANGES:
        ask(asked, change)
    for tick in range(1, 50):
        q = HOME + 0.002 * tick
        found, expected = (m.step(NOW + tick * PERIOD, q, STILL) for m in (asked, silent))
        assert found == expected
        ask(asked, CHANGES[tick % len(CHANGES)])


def test_what_is_worse_is_never_later():
    monitor, _ = look()
    for kind, values in {
        "distance": np.linspace(-0.05, 0.1, 7),
        "speed": np.linspace(-2.0, 2.0, 7),
        "age": np.linspace(0.0, 0.1, 7),
    }.items():
        times = np.array([ask(monitor, Change(**{kind: value})) for value in values])
        assert (np.diff(times, axis=0) <= 0.0).all(), kind


def test_a_coarser_look_is_no_later():
    monitor, _ = look()
    coarse, fine = (ask(monitor, refinement_threshold=time) for time in (0.0, np.inf))
    assert coarse.shape == fine.shape == (len(panda().links),)
    assert (coarse <= fine).all()
    assert (coarse < fine).any()


def test_bounds_do_not_fall_below_nothing():
    """A ball that cannot move at all is what is left when more speed is taken than it has."""
    monitor, _ = look(radius=0.02)
    assert np.array_equal(ask(monitor, Change(speed=-9.0)), ask(monitor, Change(speed=-2.0)))
    assert np.array_equal(ask(monitor, Change(distance=-9.0)), ask(monitor, Change(distance=-0.02)))


def test_what_stands_for_ever_has_no_age():
    obstacles, monitor = make_monitor()
    obstacles.add_static("ball", PLACE, 0.1)
    monitor.step(NOW, HOME, STILL)
    for change in (Change(age=0.01), Change(fresh=True), Change(speed=1.0)):
        assert np.array_equal(ask(monitor, change), ask(monitor)), change


def test_of_an_obstacle_whose_whereabouts_are_unknown_nothing_is_promised():
    obstacles, monitor = make_monitor()
    see(obstacles, 0.0, [np.nan, 0.0, 0.0])
    monitor.step(NOW, HOME, STILL)
    for change in (UNCHANGED, *CHANGES):
        assert np.array_equal(ask(monitor, change), np.zeros(len(panda().links)))
