"""Who is touched, as is permitted, stops the arm until they leave; what moves a joint is told."""

import numpy as np
import pytest

from armguard.bounds import Plan
from armguard.settings.contact_limits import ContactLimit, ContactLimits
from armguard.verdict import Effect, Level, ReasonKind
from support.panda_monitor import HOME, PERIOD, kinds, panda, subjects
from support.permitted_contact import LIMITS, Encounter, go_straight
from support.plan_cases import Hermite

IN_CONTACT, MOVED = ReasonKind.IN_CONTACT, ReasonKind.MOVED_BY_CONTACT
JUMPED, BROKEN = ReasonKind.JOINT_STATE_JUMPED, ReasonKind.BOUND_BROKEN
CREEP = 0.0009  # [m] in a tick: a hand that comes at 0.9 m/s


def approach(encounter, until=-0.01):
    """Let the hand come as fast as it may until it is so far into the arm; the last verdict."""
    away = encounter.away
    verdict = encounter.go(2)
    while away > until:
        away -= CREEP
        encounter.see(away=away)
        verdict = encounter.step(encounter.q + PERIOD * encounter.v)
    encounter.away = away
    return verdict


@pytest.fixture
def touched():
    """A hand that has come up to the arm and stays there; the arm must have come to rest."""
    encounter = Encounter(0.02, reaction_time=0.002)
    verdict = approach(encounter)
    assert IN_CONTACT in kinds(verdict)
    for _ in range(int(verdict.stop_time / PERIOD) + 3):
        encounter.see(away=encounter.away)
        verdict = encounter.step()
    assert verdict.level is Level.STOP
    return encounter


@pytest.mark.hazard("H-13")
def test_a_touch_is_a_stop_from_its_first_tick_on_until_the_hand_leaves():
    encounter = Encounter(0.02)
    before = encounter.go(2)
    assert before.level > Level.STOP
    assert IN_CONTACT not in kinds(before)
    verdict = approach(encounter)
    assert verdict.level is Level.STOP
    (subject,) = subjects(verdict, IN_CONTACT)
    assert subject.endswith("and p/hand")
    while encounter.away < 0.02:
        encounter.away += CREEP
        encounter.see(away=encounter.away)
        verdict = encounter.step()
    assert IN_CONTACT not in kinds(verdict)
    assert verdict.level > Level.STOP
    assert ReasonKind.BOUND_BROKEN not in kinds(verdict)
    assert not encounter.obstacles.table.touched[encounter.row()]


@pytest.mark.parametrize("has_rested", [False, True])
def test_an_arm_that_the_hand_pushes_back_may_not_go_on(has_rested):
    """By what is measured it recedes, and told to go on its loop would press the hand."""
    encounter = Encounter(0.02, reaction_time=0.002)
    approach(encounter)
    for _ in range(100 if has_rested else 0):
        encounter.see(away=encounter.away)
        encounter.step()
    for k in range(100):
        encounter.see(away=encounter.away)
        encounter.v = go_straight((-0.0008 * k, 0.0, 0.0))
        verdict = encounter.step(encounter.q + PERIOD * encounter.v)
        assert verdict.level is Level.STOP
        assert IN_CONTACT in kinds(verdict)


def test_after_a_reset_nothing_counts_as_touched_until_it_touches(touched):
    row = touched.row()
    assert touched.obstacles.table.touched[row]
    touched.monitor.reset()
    assert not touched.obstacles.table.touched[row]
    touched.tick += 300
    touched.see(away=0.2)
    touched.step()
    assert not touched.obstacles.table.touched[row]


def test_an_arm_that_still_brakes_is_not_said_to_be_moved():
    encounter = Encounter(0.02, reaction_time=0.03)
    encounter.v[6] = 0.3
    verdict = approach(encounter)
    start = encounter.q.copy()
    for _ in range(20):
        encounter.see(away=encounter.away)
        verdict = encounter.step(encounter.q + PERIOD * encounter.v)
        assert IN_CONTACT in kinds(verdict)
        assert MOVED not in kinds(verdict)
    assert encounter.q[6] - start[6] > 2.0 * panda().position_error[6]


def test_a_stop_by_touch_is_held_for_the_rise_delay():
    encounter = Encounter(0.02, rise_delay=0.05)
    approach(encounter)
    encounter.obstacles.remove(["p/hand"])
    verdict = encounter.step()
    assert IN_CONTACT not in kinds(verdict)
    assert verdict.level is Level.STOP
    assert verdict.held is not None
    for _ in range(50):
        verdict = encounter.step()
    assert verdict.level is Level.CLEAR


def test_how_long_a_contact_has_lasted_is_told_by_no_clock():
    """At any time of the monitor's clock alike."""
    for start in (0, 10**6):
        encounter = Encounter(0.02, reaction_time=0.002)
        encounter.tick += start
        approach(encounter)
        told = []
        for _ in range(250):
            encounter.see(away=encounter.away)
            verdict = encounter.step()
            told += [one.detail for one in verdict.reasons if one.kind is IN_CONTACT]
        assert told[0] == ""
        assert told[-1] == "for 0.3 s"
        assert list(dict.fromkeys(told)) == ["", "for 0.1 s", "for 0.2 s", "for 0.3 s"]


def test_a_joint_that_is_moved_at_rest_by_more_than_errors_is_told_and_does_not_latch(touched):
    error = panda().position_error[0]
    off = np.zeros(len(HOME))
    off[0] = 1.9 * error
    verdict = touched.step(HOME + off)
    assert kinds(verdict) >= {IN_CONTACT}
    assert MOVED not in kinds(verdict)
    off[0] = 2.1 * error
    touched.see(away=touched.away)
    verdict = touched.step(HOME + off)
    assert MOVED in kinds(verdict)
    assert verdict.level is Level.STOP
    assert not touched.monitor._rule.latched
    assert subjects(verdict, MOVED) == {panda().joints[0]}
    touched.obstacles.remove(["p/hand"])
    assert touched.step().level is Level.CLEAR


def test_a_joint_that_jumps_while_a_hand_is_touched_is_told_and_does_not_latch(touched):
    verdict = touched.step(HOME + 0.3)
    assert MOVED in kinds(verdict)
    assert JUMPED not in kinds(verdict)
    assert verdict.level is Level.STOP
    touched.obstacles.remove(["p/hand"])
    assert touched.step().level is Level.CLEAR


def test_a_joint_that_jumps_while_a_permitted_contact_is_possible_does_not_latch():
    encounter = Encounter(0.005)
    verdict = encounter.go(2)
    assert ReasonKind.CONTACT_ALLOWED in kinds(verdict)
    while verdict.contact_time > 0.0:
        verdict = encounter.step()  # the hand may come meanwhile
    assert IN_CONTACT not in kinds(verdict)
    verdict = encounter.step(HOME + 0.3)
    assert MOVED in kinds(verdict)
    assert not encounter.monitor._rule.latched


@pytest.mark.parametrize("limits", [None, LIMITS], ids=["without limits", "beside a head"])
def test_a_joint_that_jumps_while_no_permitted_contact_is_possible_latches(limits):
    encounter = Encounter(0.005, limits=limits)
    verdict = encounter.go(2, region="head")
    while verdict.contact_time > 0.0:
        verdict = encounter.step()
    verdict = encounter.step(HOME + 0.3)
    assert JUMPED in kinds(verdict)
    assert JUMPED.effect is Effect.LATCHED
    assert encounter.step().level is Level.STOP


def test_a_joint_that_jumps_after_a_tick_that_was_refused_latches():
    """All certificates were invalid then, but no hand is near."""
    encounter = Encounter(3.0)
    encounter.go(2)
    encounter.monitor.step(encounter.tick * PERIOD, HOME[:3], HOME[:3], encounter.tick * PERIOD)
    verdict = encounter.step(HOME + 0.3)
    assert JUMPED in kinds(verdict)
    assert encounter.monitor._rule.latched


def test_bounds_that_a_touched_body_breaks_are_not_told(touched):
    """The arm would have pushed it: two metres a second, which no bound allows."""
    away = touched.away
    seen = set()
    for _ in range(6):
        away -= 0.0011
        touched.see(away=away)
        seen |= kinds(touched.step())
    assert IN_CONTACT in seen
    assert BROKEN not in seen
    assert touched.obstacles.table.accepted.speed[touched.row()] == 1.0


@pytest.mark.hazard("H-13")
def test_a_head_is_no_contact_but_a_stop():
    limits = ContactLimits({"hand": ContactLimit(speed=0.8, source="test")})
    encounter = Encounter(0.02, limits=limits)
    encounter.go(2, region="head")
    away = encounter.away
    while away > -0.01:
        away -= CREEP
        encounter.see(away=away, region="head")
        verdict = encounter.step()
    assert verdict.level is Level.STOP
    assert IN_CONTACT not in kinds(verdict)


def make_retreat(encounter, velocity):
    """A piece from the present time on that moves the last link so, in [m]/[s], and stops."""
    rates = go_straight(velocity)
    times = np.linspace(0.0, 0.3, 31)
    along = 0.3 * np.sin(0.5 * np.pi * times / 0.3) ** 2
    pace = 0.5 * np.pi * np.sin(np.pi * times / 0.3)
    error = np.full(len(HOME), 1e-4)
    plan = Plan(
        encounter.tick * PERIOD, times, encounter.q + along[:, None] * rates,
        pace[:, None] * rates, error, error,
    )  # fmt: skip
    return encounter.monitor.with_stop(plan)


@pytest.mark.hazard("H-13")
@pytest.mark.parametrize("leave", ["never", "any"])
def test_a_touched_arm_may_go_on_away_from_the_hand_and_nowhere_else(leave):
    encounter = Encounter(0.02, motion="planned", leave=leave)
    approach(encounter, until=-0.002)
    for _ in range(100):
        encounter.see(away=encounter.away)
        verdict = encounter.step()
    assert IN_CONTACT in kinds(verdict)
    for velocity in ((0.03, 0.0, 0.0), (0.0, 0.03, 0.0), (0.0, 0.0, -0.03)):
        answer = encounter.monitor.commit(make_retreat(encounter, velocity))
        assert not answer.safe
        assert "touches the arm" in str(answer.reasons[0])
    plan = make_retreat(encounter, (-0.03, 0.0, 0.0))
    answer = encounter.monitor.commit(plan)
    # Joints that may leave the piece one by one might press on.
    assert answer.safe == (leave == "never"), answer
    if leave == "any":
        return
    place, levels = encounter.place(encounter.away), []
    for _ in range(420):
        time = (encounter.tick + 1) * PERIOD - plan.stamp
        curve = Hermite(plan.times, plan.q, plan.v)
        encounter.see(position=place)
        encounter.v = curve(min(time, plan.times[-1]), 1)
        verdict = encounter.step(curve(min(time, plan.times[-1])))
        levels.append(verdict.level)
        assert verdict.level > Level.STOP or verdict.stop == "finish"
        assert ReasonKind.PLAN_VOID not in kinds(verdict)
    assert levels[0] is Level.STOP
    assert levels[-1] > Level.STOP
    assert IN_CONTACT not in kinds(verdict)


def test_a_touched_arm_may_not_go_on_towards_a_head():
    """What else is near is proved as ever."""
    encounter = Encounter(0.02, motion="planned")
    encounter.see("p/head", position=encounter.place(0.0) - [0.35, 0.0, 0.0], region="head")
    approach(encounter, until=-0.002)
    for _ in range(100):
        encounter.see(away=encounter.away)
        verdict = encounter.step()
    assert IN_CONTACT in kinds(verdict)
    answer = encounter.monitor.commit(make_retreat(encounter, (-0.03, 0.0, 0.0)))
    assert not answer.safe
    assert answer.obstacle == "p/head"


def test_an_arm_that_rests_anew_after_a_piece_was_not_moved_by_contact():
    """It is still touched at the end of the piece."""
    encounter = Encounter(0.02, motion="planned")
    approach(encounter, until=-0.006)
    for _ in range(100):
        encounter.see(away=encounter.away)
        encounter.step()
    plan = make_retreat(encounter, (-0.01, 0.0, 0.0))
    assert np.abs(plan.q[-1] - plan.q[0]).max() > 3.0 * panda().position_error[0]
    assert encounter.monitor.commit(plan).safe
    place, curve = encounter.place(encounter.away), Hermite(plan.times, plan.q, plan.v)
    for _ in range(800):
        time = min((encounter.tick + 1) * PERIOD - plan.stamp, plan.times[-1])
        encounter.see(position=place)
        encounter.v = curve(time, 1)
        verdict = encounter.step(curve(time))
        assert MOVED not in kinds(verdict)
    assert IN_CONTACT in kinds(verdict)
    encounter.monitor.payload = 0.5  # nothing counts as a piece any more
    for _ in range(100):
        encounter.see(position=place)
        verdict = encounter.step()
        assert kinds(verdict) >= {IN_CONTACT}
        assert MOVED not in kinds(verdict)
    assert not encounter.monitor._judge.pieces.is_proved


def test_an_arm_that_loses_its_piece_on_the_way_is_not_said_to_be_moved_while_it_brakes(touched):
    tick, watch = touched.monitor._last[0], touched.monitor._contact
    off = np.zeros(len(HOME))
    told = []
    for k, is_on_piece in enumerate((True, False, False, False)):
        off[0] = 3.0 * k * panda().position_error[0]
        later = tick._replace(now=tick.now + k * PERIOD, q=tick.q + off, stop_time=2.5 * PERIOD)
        told.append({one.kind for one in watch.update(later, 0.0, is_on_piece=is_on_piece)})
    assert all(told[k] == {IN_CONTACT} for k in range(4))
    later = later._replace(now=later.now + PERIOD, q=later.q + off)
    assert MOVED in {one.kind for one in watch.update(later, 0.0, is_on_piece=False)}
