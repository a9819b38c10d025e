import math

import pytest

from armguard.obstacles import Obstacles
from support.panda_monitor import HOME, PERIOD, STILL, make_monitor, panda, see

LATENCY, AGE, SPEED, COVER = range(4)
PLACE, PACE = [1.2, 0.0, 0.6], [-0.5, 0.0, 0.0]
MILLISECOND = MILLIMETRE = 1e-3
ERROR = {"joint": 4e-3, "isotropic": 2e-5}
"""Of differences of contact times, in [s]: joint bounds are taken on a grid of times."""


def look(*, place=PLACE, age=0.0, speed=2.0, latency=0.002, q=HOME, v=STILL, **settings):
    """A monitor after a tick in which it saw a ball, and the verdict."""
    obstacles, monitor = make_monitor(
        obstacles=Obstacles(speed=speed), latency=latency, aware_margin=5.0, **settings
    )
    see(obstacles, -age, place, velocity=[PACE])
    return monitor, monitor.step(0.0, q, v)


@pytest.mark.parametrize("motion", ["joint", "isotropic"])
@pytest.mark.parametrize("schedule", ["deadline", "full"])
def test_it_tells_what_the_verdict_rests_on(schedule, motion):
    obstacles, monitor = make_monitor(schedule, motion=motion)
    see(obstacles, 0.0, [PLACE, [2.5, 0.0, 0.5]], ("near", "far"), velocity=[PACE, PACE])
    for tick in range(8):
        verdict = monitor.step(tick * PERIOD, HOME, STILL)
        why = monitor.explain()
        assert (why.link, why.obstacle) == (verdict.link, verdict.obstacle)
        assert why.contact_time == verdict.contact_time
        assert why.stop_time == verdict.stop_time
        assert why.obstacle_age == pytest.approx(verdict.stamp)
        assert why.arm_age == 0.0
    assert why.obstacle == "near"
    assert why.bound == monitor.pairs(1)[0].bound
    # What it knows is a look back then; a look now is no less sure and no more stale.
    assert 0.0 <= why.look_age <= verdict.stamp + 1e-12
    assert why.fresh_contact_time >= why.contact_time - 1e-12
    text = str(why)
    assert f"{why.link} and near" in text
    assert why.bound in text
    assert all(gain.what in text for gain in why.gains)


def test_ages_are_those_of_what_was_handed_in():
    obstacles, monitor = make_monitor()
    see(obstacles, 0.0, PLACE)
    monitor.step(0.030, HOME, STILL, now=0.034)
    why = monitor.explain()
    assert why.obstacle_age == pytest.approx(0.034)
    assert why.arm_age == pytest.approx(0.004)
    assert why.look_age == 0.0


@pytest.mark.parametrize("schedule", ["deadline", "full"])
def test_an_obstacle_that_was_removed_since_is_not_explained(schedule):
    obstacles, monitor = make_monitor(schedule)
    see(obstacles, 0.0, PLACE, ("gone",))
    monitor.step(0.0, HOME, STILL)
    obstacles.remove(["gone"])
    assert monitor.explain() is None
    # Another one that takes its row is not what decided.
    see(obstacles, 0.0, PLACE, ("other",))
    assert monitor.explain() is None
    monitor.step(PERIOD, HOME, STILL)
    assert monitor.explain().obstacle == "other"


def test_where_no_pair_decides_there_is_nothing_to_explain():
    obstacles, monitor = make_monitor()
    assert monitor.explain() is None
    monitor.step(0.0, HOME, STILL)
    assert monitor.explain() is None
    see(obstacles, PERIOD, PLACE)
    monitor.step(PERIOD, HOME, STILL)
    assert monitor.explain() is not None


@pytest.mark.parametrize("pace", [0.0, 1.0])
def test_a_millisecond_less_of_latency_rests_the_arm_as_much_earlier(pace):
    """At full speed a joint has nothing to speed up to: it brakes a millisecond earlier."""
    v = pace * panda().velocity_limit
    q = HOME.copy()
    monitor, slow = look(q=q, v=v, latency=0.004)
    _, fast = look(q=q, v=v, latency=0.003)
    gain = monitor.explain().gains[LATENCY]
    assert gain.what == "1 ms less latency"
    assert gain.seconds == pytest.approx(slow.stop_time - fast.stop_time, rel=1e-9)
    assert gain.seconds == pytest.approx(MILLISECOND) if pace else gain.seconds > MILLISECOND


@pytest.mark.parametrize("motion", ["joint", "isotropic"])
def test_less_assumed_speed_is_worth_what_a_slower_obstacle_is(motion):
    monitor, usual = look(motion=motion)
    _, slower = look(motion=motion, speed=1.0)
    gain = monitor.explain().gains[SPEED]
    assert gain.what == "1 m/s less assumed speed"
    later = slower.contact_time - usual.contact_time
    assert gain.seconds == pytest.approx(later, abs=ERROR[motion])
    assert gain.seconds > 0.0
    # With so much less speed it could be as much nearer, for about the same contact time.
    nearer = [PLACE[0] - gain.metres, *PLACE[1:]]
    _, near = look(motion=motion, speed=1.0, place=nearer)
    assert near.contact_time == pytest.approx(usual.contact_time, rel=0.2)


@pytest.mark.parametrize(("motion", "age"), [("joint", 0.02), ("isotropic", 0.002)])
def test_younger_states_are_worth_what_they_are(motion, age):
    monitor, usual = look(motion=motion, age=age)
    gain = monitor.explain().gains[AGE]
    assert gain.what == "1 ms less age of the obstacle"
    _, younger = look(motion=motion, age=0.0)
    later = younger.contact_time - usual.contact_time
    assert age / MILLISECOND * gain.seconds == pytest.approx(later, abs=ERROR[motion])
    # Ageing both bodies' states costs as much as they age; ageing one, no more.
    assert 0.0 < gain.seconds <= MILLISECOND * 1.02


@pytest.mark.parametrize(("motion", "less"), [("joint", 0.04), ("isotropic", 0.001)])
def test_less_cover_is_worth_what_less_margin_is(motion, less):
    monitor, usual = look(motion=motion, margin=0.04)
    gain = monitor.explain().gains[COVER]
    assert gain.what == "1 mm less cover"
    assert gain.metres == pytest.approx(MILLIMETRE)
    _, tighter = look(motion=motion, margin=0.04 - less)
    later = tighter.contact_time - usual.contact_time
    assert less / MILLIMETRE * gain.seconds == pytest.approx(later, abs=ERROR[motion])
    assert gain.seconds > 0.0


@pytest.mark.parametrize(("pace", "age"), [(7.0, 0.02), (math.nan, math.nan)])
def test_of_a_body_that_was_never_believed_what_was_refused_has_an_age(pace, age):
    obstacles, monitor = make_monitor()
    see(obstacles, 5.0, PLACE, velocity=[[pace, 0.0, 0.0]])
    monitor.step(5.02, HOME, STILL)
    assert monitor.explain().obstacle_age == pytest.approx(age, nan_ok=True)


def test_what_has_no_part_in_it_buys_nothing():
    obstacles, monitor = make_monitor()
    obstacles.add_static("post", [0.9, 0.0, 0.5], 0.1)
    monitor.step(0.0, HOME, STILL)
    why = monitor.explain()
    assert (why.obstacle, why.obstacle_age) == ("post", 0.0)
    assert why.gains[AGE].seconds == why.gains[SPEED].seconds == 0.0
    assert why.gains[LATENCY].seconds > 0.0
    assert why.gains[COVER].seconds > 0.0


def test_where_nothing_can_touch_no_distance_makes_a_difference():
    obstacles, monitor = make_monitor()
    obstacles.add_static("post", [9.0, 0.0, 0.5], 0.1)
    verdict = monitor.step(0.0, HOME, STILL)
    why = monitor.explain()
    assert verdict.contact_time == why.contact_time == math.inf
    assert why.gains[COVER].seconds == 0.0
    assert all(math.isnan(gain.metres) for gain in why.gains)
    assert "inf" in str(why)
