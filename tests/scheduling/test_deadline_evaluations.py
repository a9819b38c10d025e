"""Looks at what is due: as good as a look at everything, in time, and never too many at once."""

import math

import numpy as np
import pytest

from armguard.pairs.evaluate import evaluate
from armguard.robot.stop_time import compute_stop_time
from armguard.scheduling.deadline_evaluations import CROWD, time_to_spare
from armguard.scheduling.timing_wheel import take_out
from armguard.verdict import Level, ReasonKind
from support.panda_monitor import HOME, PERIOD, STILL, make_monitor, panda, see, steps

HORIZON = PERIOD + 0.002 + 0.02


def scatter(rng, count, nearest=0.9, farthest=4.0):
    """Places around the arm."""
    place = rng.normal(size=(count, 3))
    place /= np.linalg.norm(place, axis=1)[:, None]
    return place * rng.uniform(nearest, farthest, (count, 1)) + (0.0, 0.0, 0.4)


def test_a_fresh_look_finds_what_a_look_at_every_pair_finds():
    rng, links = np.random.default_rng(1), len(panda().links)
    for _ in range(5):
        obstacles, monitor = make_monitor("deadline")
        names = [f"b{k}" for k in range(40)]
        see(obstacles, 0.0, scatter(rng, 40), names, velocity=rng.uniform(-1, 1, (40, 3)))
        # Some are seen elsewhere meanwhile: they may be at either place.
        see(obstacles, 0.5 * PERIOD, scatter(rng, 10), names[:10])
        assert obstacles.table.refused.sum() == 10
        v = rng.uniform(-0.3, 0.3, 7) * panda().velocity_limit
        verdict = monitor.step(PERIOD, HOME, v)
        watch = monitor._watch
        state, book = watch.arm.state, watch.book
        state.begin(PERIOD, 0.0, verdict.stop_time + 10.0)
        state.prepare_arm(HOME, v)
        pairs = np.arange(40 * links)
        times, nodes = np.zeros(len(pairs)), np.zeros(len(pairs), dtype=np.int64)
        evaluate(state, pairs, times, nodes, np.zeros(len(pairs), dtype=np.int8))
        soonest = times.reshape(40, links).min(axis=1)
        half = len(book.soonest) // 2
        expiry = book.soonest[half : half + 40]
        # A closer look may find later times, never earlier ones; near ones are looked at closely.
        assert (expiry <= soonest + 1e-9).all()
        assert verdict.contact_time == pytest.approx(expiry.min(), abs=1e-12)
        assert verdict.contact_time >= 0.9 * soonest.min() - 1e-9


def test_certificates_hold_until_the_next_look():
    """What was proved before is never later than what is proved anew, but for looser bounds."""
    rng = np.random.default_rng(2)
    max_staleness = 0.25
    obstacles, monitor = make_monitor("deadline", max_staleness=max_staleness, source_timeout=10.0)
    names = [f"b{k}" for k in range(60)]
    see(obstacles, 0.0, scatter(rng, 60, 1.5, 6.0), names)
    book = None
    for k in range(300):
        steps(monitor, k, 1)
        book, time = monitor._watch.book, k * PERIOD
        half = len(book.soonest) // 2
        found = book.soonest[half : half + 60] - book.evaluated_at[:60]
        age = time - book.evaluated_at[:60]
        assert (age <= np.maximum(max_staleness * found, PERIOD) + PERIOD).all()
    assert monitor._watch.stale_looks == 0


def test_time_to_spare_is_time_in_which_nothing_matters():
    rng, robot = np.random.default_rng(3), panda()
    obstacles, monitor = make_monitor("deadline")
    see(obstacles, 0.0, [3.0, 0.0, 0.5])
    steps(monitor, 0, 1)
    scene = monitor._watch.arm.state.scene
    limits = robot.velocity_limit, robot.acceleration_limit, robot.braking_deceleration
    some = 0
    for _ in range(2000):
        v = rng.uniform(-1.0, 1.0, 7) * robot.velocity_limit * rng.choice([0.0, 0.3, 1.0])
        tau, age = rng.uniform(0.0, 3.0), rng.choice([0.0, 0.005, 0.02])
        spare = float(time_to_spare(scene, v, tau, age, HORIZON))
        if not spare > 0.0:
            continue
        some += 1
        # The worst arm: faster and faster until then.
        wait = spare * rng.uniform(0.0, 1.0)
        faster = np.minimum(
            np.abs(v) + robot.velocity_error + robot.acceleration_limit * (wait + age), limits[0]
        )
        stop = compute_stop_time(faster, robot.velocity_error, *limits, 0.0, HORIZON - 0.02, 0.02)
        assert stop <= tau - wait + 1e-9
    assert some > 500


@pytest.mark.parametrize("count", [1, 50, 3000])
def test_all_in_contact_at_once_is_a_stop_at_a_bounded_price(count):
    obstacles, monitor = make_monitor("deadline", source_timeout=10.0)
    names = [f"b{k}" for k in range(count)]
    at_hand = np.tile([0.3, 0.0, 0.6], (count, 1))
    most = 0
    for k in range(5):
        see(obstacles, k * PERIOD, at_hand, names)
        (verdict,) = steps(monitor, k, 1)
        assert (verdict.level, verdict.contact_time) == (Level.STOP, 0.0)
        assert ReasonKind.OVERDUE not in {reason.kind for reason in verdict.reasons}
        most = max(most, verdict.evaluated)
    one_look = 2 * len(monitor._watch.arm.state.tree.radius) + 2 * len(panda().links) + 2
    assert most <= CROWD + one_look
    # They leave, and all of them are looked at before the arm may go on.
    see(obstacles, 5 * PERIOD, [50.0, 0.0, 0.0], ["other"], snapshot=True)
    verdicts = steps(monitor, 5, 400)
    assert verdicts[-1].level is Level.CLEAR


def test_a_crowd_that_waits_is_looked_at_before_the_arm_may_go_on():
    """Contact with one is certain; the others wait, and one of them is as near."""
    obstacles, monitor = make_monitor("deadline", rise_delay=0.0)
    rng = np.random.default_rng(5)
    names = [f"b{k}" for k in range(500)]
    places = scatter(rng, 500, 1.5, 3.0)
    places[0] = places[250] = [0.3, 0.0, 0.6]
    see(obstacles, 0.0, places, names)
    (verdict,) = steps(monitor, 0, 1)
    assert verdict.level is Level.STOP
    obstacles.remove(["b0"])
    assert all(one.level is Level.STOP for one in steps(monitor, 1, 20))
    obstacles.remove(["b250"])
    see(obstacles, 0.021, [60.0, 0.0, 0.0], ["far"])
    for verdict in steps(monitor, 21, 20):
        book = monitor._watch.book
        if verdict.level > Level.STOP:
            assert np.isfinite(book.evaluated_at[book.watched.any(axis=1)]).all()


@pytest.mark.parametrize("others", [0, 5])
def test_one_that_nobody_would_look_at_is_overdue(others):
    """Whether there is anything else to look at in the tick or not."""
    obstacles, monitor = make_monitor("deadline", source_timeout=10.0)
    see(obstacles, 0.0, [9.0, 0.0, 0.5], ["lost"])
    assert all(one.level is Level.CLEAR for one in steps(monitor, 0, 5))
    take_out(monitor._watch.book.wheel, obstacles.row("lost"))
    for k in range(5, 10):
        if others:
            places = np.tile([12.0, 0.0, 0.5], (others, 1))
            see(obstacles, k * PERIOD, places, [f"b{k}-{i}" for i in range(others)])
        (verdict,) = steps(monitor, k, 1)
        assert (verdict.level, verdict.complete) == (Level.STOP, False)
        assert ReasonKind.OVERDUE in {reason.kind for reason in verdict.reasons}


def test_nothing_at_all_and_things_that_stand_still():
    obstacles, monitor = make_monitor("deadline")
    assert all(one.contact_time == math.inf for one in steps(monitor, 0, 3, HOME, STILL))
    for k in range(50):
        obstacles.add_static(f"post{k}", [4.0, 0.1 * k, 0.0], 0.1)
    (first,) = steps(monitor, 3, 1)
    later = steps(monitor, 4, 200)
    assert first.evaluated >= 50
    # What the arm cannot reach can never be touched: one look is enough for ever.
    assert first.contact_time == math.inf
    assert all((one.contact_time, one.level) == (math.inf, Level.CLEAR) for one in later)
    assert sum(one.evaluated for one in later) <= 2 * 50
    obstacles.add_static("near", [0.6, 0.3, 0.3], 0.05)
    verdicts = steps(monitor, 204, 100)
    assert all(0.0 <= one.contact_time < 2.0 and one.complete for one in verdicts)
    assert verdicts[0].obstacle == "near"
