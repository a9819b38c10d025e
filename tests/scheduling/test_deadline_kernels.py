"""Looks at what is due: as good as a look at everything, in time, and never too many at once."""

import math

import numpy as np
import pytest

from armguard.contact import earliest_contact_pair
from armguard.lab.extremes.arms import make_arm
from armguard.pairs.evaluate import evaluate, find_unsafe_pair
from armguard.pairs.scene import REACH
from armguard.robot.joint_acceptance import accept_at
from armguard.robot.stop_time import compute_stop_time
from armguard.scheduling import deadline_kernels
from armguard.scheduling.certificates import PROVED, set_ends, stop_place, withdraw_permissions
from armguard.scheduling.deadline_kernels import (
    CROWD,
    MOST_READ_AHEAD,
    time_to_spare,
)
from armguard.scheduling.scheduler import Tick
from armguard.scheduling.timing_wheel import NOBODY, take_out
from armguard.scheduling.tournament import entries_of, set_value
from armguard.verdict import Level, ReasonKind
from support.panda_monitor import HOME, PERIOD, STILL, kinds, make_monitor, panda, see, steps
from support.permitted_contact import Encounter
from support.tick_states import begin_tick

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
        scheduler = monitor._scheduler
        state, certificates = scheduler.arm.state, scheduler.certificates
        begin_tick(state, PERIOD, 0.0, verdict.stop_time + 10.0)
        state.prepare_arm(HOME, v)
        pairs = np.arange(40 * links)
        times, nodes = np.zeros(len(pairs)), np.zeros(len(pairs), dtype=np.int64)
        evaluate(state, pairs, times, nodes, np.zeros(len(pairs), dtype=np.int8))
        soonest = times.reshape(40, links).min(axis=1)
        expiry = entries_of(certificates.expiry_tree)[:40]
        # A closer look may find later times, never earlier ones; near ones are looked at closely.
        assert (expiry <= soonest + 1e-9).all()
        assert verdict.contact_time == pytest.approx(expiry.min(), abs=1e-12)
        assert verdict.contact_time >= 0.9 * soonest.min() - 1e-9


@pytest.mark.parametrize("place", [(0.9, 0.0, 0.5), (-0.6, 0.0, 0.3), (0.0, 0.0, 1.6)])
def test_no_sphere_is_asked_of_links_that_reach_says_come_later(place):
    """They do not decide, so none costs a second evaluation."""
    obstacles, monitor = make_monitor()
    see(obstacles, 0.0, place, velocity=np.zeros((1, 3)), speed=2.0, accel=10.0)
    (verdict,) = steps(monitor, 0, 1)
    scheduler, row = monitor._scheduler, obstacles.row("ball")
    expiry, bound = (
        array[row]
        for array in (scheduler.certificates.pair_expiry, scheduler.certificates.pair_bound)
    )
    reach = np.array(
        [
            earliest_contact_pair(
                p1=ball[:3], v1=np.zeros(3), a1=0.0, s1=0.0,
                p2=np.array(place), v2=np.zeros(3), a2=10.0, s2=2.0,
                contact_distance=ball[3] + obstacles.table.accepted.radius[row],
            )
            for ball in scheduler.arm.motion.reach.link_balls
        ]
    )  # fmt: skip
    later = reach > 1.05 * verdict.contact_time
    assert 0 < later.sum() < len(later)
    assert (bound[later] == REACH).all()
    assert expiry[later] == pytest.approx(reach[later], rel=1e-2)
    assert (expiry[~later] >= verdict.contact_time).all()


def test_certificates_hold_until_the_next_look():
    """What was proved before is never later than what is proved anew, but for looser bounds."""
    rng = np.random.default_rng(2)
    max_staleness = 0.25
    obstacles, monitor = make_monitor("deadline", max_staleness=max_staleness, source_timeout=10.0)
    names = [f"b{k}" for k in range(60)]
    see(obstacles, 0.0, scatter(rng, 60, 1.5, 6.0), names)
    certificates = None
    for k in range(300):
        steps(monitor, k, 1)
        certificates, time = monitor._scheduler.certificates, k * PERIOD
        found = entries_of(certificates.expiry_tree)[:60] - certificates.evaluated_at[:60]
        age = time - certificates.evaluated_at[:60]
        assert (age <= np.maximum(max_staleness * found, PERIOD) + PERIOD).all()
        assert monitor._scheduler.waiting == 0


def test_time_to_spare_is_time_in_which_nothing_matters():
    rng, robot = np.random.default_rng(3), panda()
    obstacles, monitor = make_monitor("deadline")
    see(obstacles, 0.0, [3.0, 0.0, 0.5])
    steps(monitor, 0, 1)
    scene = monitor._scheduler.arm.state.scene
    limits = robot.velocity_limit, robot.acceleration_limit, robot.brakes.make_curves()
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
        stop = compute_stop_time(
            faster, robot.velocity_error, *limits, 0.0, HORIZON - 0.02, 0.02, limits[1]
        )[0]
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
    one_look = 2 * len(monitor._scheduler.arm.state.tree.radius) + 2 * len(panda().links) + 2
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
        certificates = monitor._scheduler.certificates
        if verdict.level > Level.STOP:
            assert np.isfinite(certificates.evaluated_at[certificates.watched.any(axis=1)]).all()


@pytest.mark.parametrize("others", [0, 5])
def test_one_that_nobody_would_look_at_is_overdue(others):
    """Whether there is anything else to look at in the tick or not."""
    obstacles, monitor = make_monitor("deadline", source_timeout=10.0)
    see(obstacles, 0.0, [9.0, 0.0, 0.5], ["lost"])
    assert all(one.level is Level.CLEAR for one in steps(monitor, 0, 5))
    take_out(monitor._scheduler.certificates.wheel, obstacles.row("lost"))
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


FAR, NEAR = [8.0, 0.0, 0.5], [0.9, 0.0, 0.5]


def prove_rest(pace):
    """A monitor that has proved that its arm rests in time if it is told to stop a little later.

    Args:
        pace: That joints keep to, as a fraction of their velocities; None: they keep to none.
    """
    obstacles, monitor = make_monitor("deadline")
    position = {"velocity": [[0.0, 0.0, 0.0]], "position_error": 0.01, "velocity_error": 0.1}

    def tell(tick):
        see(obstacles, tick * PERIOD, [1.2, 0.0, 0.6], **position)

    tell(0)
    steps(monitor, 0, 1)
    tick, scheduler = monitor._last[0], monitor._scheduler
    table = scheduler.arm.motion.braking.tabulate(HOME, STILL, 0.0, 0.02, pace=pace or 1.0)
    end = float(table.time[-1])
    # Without a certificate there is something to be proved.
    scheduler.certificates.pair_expiry[:] = tick.time
    set_value(scheduler.certificates.expiry_tree, obstacles.row("ball"), tick.time)
    since = None if pace is None else tick.time
    found = scheduler.find_unsafe(tick, end, lasting=0.015, until=0.0, kept_since=since)
    assert found.pair == NOBODY

    def recall(number, kept_since):
        """What is recalled in a later tick, in which the ball has been seen once more."""
        tell(number)
        now = number * PERIOD
        later = tick._replace(number=tick.number + number, now=now, time=now)
        return scheduler.recall_stops(later, end, 0.0, kept_since)

    def renew():
        """Prove the same once more, just before that proof ends; number of the tick after."""
        proofs = scheduler.certificates.proofs
        place = stop_place(obstacles.row("ball"), pace is not None)
        number = round(proofs.until[place] / PERIOD) - 1
        now = number * PERIOD
        later = tick._replace(number=tick.number + number, now=now, time=now)
        scheduler.find_unsafe(later, end, lasting=0.015, pause=PERIOD, kept_since=since)
        assert proofs.made_at[place] == now
        return number + 1

    return scheduler, recall, renew


def test_what_was_proved_of_a_slow_arm_counts_while_it_was_no_faster():
    _, recall, _ = prove_rest(0.2)
    assert recall(1, 0.0) == PROVED
    # Since then it may have been faster; and of an arm at any speed nothing was proved.
    assert recall(2, math.nextafter(0.0, 1.0)) != PROVED
    assert recall(3, None) != PROVED


@pytest.mark.parametrize("pace", [None, 0.2])
def test_a_proof_outlasts_a_state_that_agrees_with_all_that_it_rests_on(pace):
    since = None if pace is None else 0.0
    _, recall, _ = prove_rest(pace)
    assert recall(1, since) == PROVED
    for is_reference in (False, True):
        scheduler, recall, _ = prove_rest(pace)
        proofs = scheduler.certificates.proofs
        # As if that had been another state, with which the next one does not agree.
        states = proofs.reference_states if is_reference else proofs.known.states
        states.points[:, :, 0] += 1.0
        assert recall(1, since) != PROVED


@pytest.mark.parametrize("pace", [None, 0.2])
def test_a_renewed_proof_rests_on_the_state_by_which_links_were_not_asked_then(pace):
    """What has been evaluated anew since the first proof has other certificates by then."""
    since = None if pace is None else 0.0
    _, recall, renew = prove_rest(pace)
    assert recall(renew(), since) == PROVED
    scheduler, recall, renew = prove_rest(pace)
    # As if they had been made for another state by then, with which the next one does not agree.
    points = scheduler.certificates.reference_states.points
    points[:, :, 0] += 1.0
    number = renew()
    points[:, :, 0] -= 1.0
    assert recall(number, since) != PROVED


def test_a_tick_with_more_due_than_is_read_ahead_evaluates_all():
    obstacles, monitor = make_monitor()
    count = MOST_READ_AHEAD + 50
    places = FAR + np.linspace(0.0, 10.0, count)[:, None] * [1.0, 0.0, 0.0]
    see(obstacles, 0.0, places, [f"b{k}" for k in range(count)])
    (verdict,) = steps(monitor, 0, 1)
    assert (verdict.evaluated, verdict.complete, verdict.obstacle) == (count, True, "b0")


def test_unsafe_pairs_are_those_that_brute_force_finds():
    rng, links = np.random.default_rng(4), len(panda().links)
    found = []
    for _ in range(30):
        obstacles, monitor = make_monitor("deadline")
        names = [f"b{k}" for k in range(25)]
        speeds = rng.uniform(0.1, 2.0, 25)
        nearest = rng.choice([0.9, 1.3])
        see(obstacles, 0.0, scatter(rng, 25, nearest, 3.0), names, speed=speeds)
        v = rng.uniform(-0.1, 0.1, 7) * panda().velocity_limit
        verdict = monitor.step(0.0, HOME, v)
        scheduler = monitor._scheduler
        table = scheduler.arm.motion.braking.tabulate(HOME, v, 0.0, PERIOD + 0.002)
        end = float(table.time[-1])
        tick = Tick(1, 0.0, 0.0, HOME, v, 0.0, verdict.stop_time, end)
        pair, spent, left = scheduler.find_unsafe(tick, end)
        assert spent >= 0
        assert left == 0
        truth, _ = find_unsafe_pair(scheduler.arm.state, np.arange(25 * links))
        if truth == NOBODY:
            assert pair == NOBODY
        elif pair == NOBODY:
            # Brute force knows nothing but braking; certificates may know better.
            row, link = divmod(truth, links)
            assert scheduler.certificates.pair_expiry[row, link] > end
        found.append(pair == NOBODY)
        assert (verdict.level is Level.STOP) == (pair != NOBODY)
    assert any(found)
    assert not all(found)


def stand_beside(copies, place, *, schedule="deadline", **settings):
    """Verdicts of an arm that stands still beside so many of one and the same thing."""
    obstacles, monitor = make_monitor(schedule, rise_delay=0.0, **settings)
    for k in range(copies):
        obstacles.add_static(f"post{k}", place, 0.05)
    return [monitor.step(tick * PERIOD, HOME, STILL) for tick in range(10)]


def places_near_the_hand(count):
    """Nearer and farther, from where there is no time to stop to where there is."""
    _, monitor = make_monitor()
    monitor.step(0.0, HOME, STILL)
    monitor._scheduler.prepare(monitor._last[0])
    hand = monitor._scheduler.arm.kinematics.centers[-1].copy()
    return [hand + np.array([away, 0.0, 0.1]) for away in np.linspace(0.1, 0.35, count)]


@pytest.mark.parametrize(("schedule", "copies"), [("deadline", 1500), ("daa", 160)])
def test_many_copies_of_one_thing_are_as_good_as_one(schedule, copies):
    """How many things are near is no reason for a STOP: nobody set a limit to that."""
    stops, settings = [], {"max_staleness": 0.0} if schedule == "deadline" else {}
    for place in places_near_the_hand(6):
        one = stand_beside(1, place, schedule=schedule, **settings)
        many = stand_beside(copies, place, schedule=schedule, **settings)
        assert [v.level is Level.STOP for v in many] == [v.level is Level.STOP for v in one]
        if schedule == "deadline":
            assert [v.level for v in many] == [v.level for v in one]
            assert [v.speed_scale for v in many] == [v.speed_scale for v in one]
        assert not any(ReasonKind.BUDGET_SPENT in kinds(v) for v in many)
        stops.append(one[-1].level is Level.STOP)
    assert stops[0]
    assert not stops[-1]


def test_a_budget_that_is_spent_is_told_with_its_numbers():
    """A look that was begun is finished; what follows may find too little left for its question."""
    told = set()
    for place in places_near_the_hand(8):
        free = stand_beside(1, place)
        for budget in (2, 4, 12, 10**6):
            for verdict, without in zip(stand_beside(1, place, budget=budget), free, strict=True):
                reasons = [r for r in verdict.reasons if r.kind is ReasonKind.BUDGET_SPENT]
                # Whether full speed is safe may be left open: then the level is SLOW, not AWARE.
                both = {verdict.level, without.level}
                is_told = reasons or not verdict.complete
                assert len(both) == 1 or both == {Level.SLOW, Level.AWARE} or is_told
                assert verdict.level <= without.level
                for reason in reasons:
                    told.add((budget, verdict.level))
                    assert reason.subject == f"budget={budget}"
                    assert (
                        reason.detail == f"1 obstacle not decided about after {budget} evaluations"
                    )
    assert {4, 12} <= {budget for budget, _ in told} <= {2, 4, 12}
    assert {level for _, level in told} >= {Level.STOP, Level.SLOW}


def test_an_arm_of_one_joint_needs_no_kernels_of_its_own():
    """Arrays of one column are laid out in both orders at once, and kernels know but one."""
    names = "advance", "evaluate_due", "find_unsafe", "recall_stops"
    entries = accept_at, *(getattr(deadline_kernels, name) for name in names)
    make_monitor("deadline")
    known = [set(entry.signatures) for entry in entries]
    assert all(known)
    make_monitor("deadline", robot=make_arm(1))
    assert [set(entry.signatures) for entry in entries] == known


def test_a_proof_rests_on_the_permission_of_links_that_need_not_be_asked():
    encounter = Encounter(0.002)
    encounter.go(3)
    scheduler, row = encounter.scheduler, encounter.row()
    certificates, (tick, _) = scheduler.certificates, encounter.monitor._last
    near = certificates.pair_expiry[row].argmin()
    assert near > 0
    # The near link may touch, but is slow; the base, which is out of reach, must be asked.
    certificates.proofs.until[:] = -np.inf
    certificates.pair_harm[row] = np.inf
    certificates.pair_harm[row, 0] = certificates.pair_expiry[row, 0] = tick.time
    set_ends(certificates, row, certificates.pair_expiry[row].min(), tick.time)
    scheduler.find_unsafe(tick, tick.stop_time, lasting=0.01)
    place = stop_place(row, False)
    assert certificates.proofs.until[place] > tick.time
    assert certificates.proofs.link[place] > 0
    withdraw_permissions(certificates)
    assert certificates.proofs.until[place] == -np.inf
