"""Brakes by load and speed in the monitor: payload, range, verdict and scale."""

import math

import numpy as np
import pytest

from armguard import SeparationRule
from armguard.bounds import BrakingMotion
from armguard.exceptions import ArmguardError
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot.brakes import find_stop, rest_time
from armguard.robot.operating_limits import OperatingLimits
from armguard.robot.stop_time import speed_at_bite
from armguard.scheduling.certificates import stop_place
from armguard.verdict import Effect, Level, ReasonKind
from support.panda_monitor import (
    HOME,
    PERIOD,
    STILL,
    kinds,
    make_monitor,
    ranged_panda,
    see,
    steps,
)  # fmt: skip

UNBRAKED = ReasonKind.BRAKES_NOT_COVERED
RANGE = 1.305
"""Of the first joint with 1 kg, [rad/s]: 60 % of its limit."""


def make_ranged(**settings):
    """A table and a monitor on a Panda as it comes."""
    return make_monitor(robot=ranged_panda(), **settings)


def moving(speed, joint=0):
    v = STILL.copy()
    v[joint] = speed
    return v


def glide(monitor, start, count, speed, q=HOME):
    """Verdicts while the first joint moves steadily."""
    v, verdicts = moving(speed), []
    for i in range(start, start + count):
        now = i * PERIOD
        verdicts.append(monitor.step(now, q + v * now, v))
    return verdicts


def test_a_joint_that_its_stop_may_throw_back_too_fast_is_named():
    operating = OperatingLimits(np.full(7, 2.0), np.full(7, 3.0))
    obstacles, monitor = make_ranged(
        rise_delay=0.0, operating=operating, latency=0.1, reaction_time=0.1
    )
    details = []
    for tick, lift in enumerate((0.5, 1e-4)):
        q = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
        q[1] = ranged_panda().lower_position_limit[1] + lift
        monitor.reset()
        see(obstacles, tick * PERIOD, [1.3, 0.0, 0.6])
        verdict = monitor.step(tick * PERIOD, q, STILL)
        details.append((verdict.level, str(verdict.reasons)))
    assert "throw" not in details[0][1]
    assert details[1][0] is Level.STOP
    assert "the stop of panda_joint2 may throw it back beyond its brakes' range" in details[1][1]


@pytest.mark.hazard("H-06")
def test_a_joint_that_may_be_too_fast_for_its_brakes_is_a_stop_that_names_it():
    _, monitor = make_ranged(rise_delay=0.0)
    delay = PERIOD + 0.002 + 0.02
    most = RANGE - 0.02 - 15.0 * delay
    for speed, is_covered in ((most - 1e-6, True), (most + 1e-6, False), (-most - 1e-6, False)):
        monitor.reset()
        verdict = monitor.step(0.0, HOME, moving(speed))
        assert (UNBRAKED in kinds(verdict)) == (not is_covered)
        assert (verdict.level is Level.STOP) == (not is_covered)
        assert (verdict.stop_time == math.inf) == (not is_covered)
    # Nothing is compiled in the tick that says so.
    assert not speed_at_bite.overloads
    reason = next(one for one in verdict.reasons if one.kind is UNBRAKED)
    assert reason.kind.effect is Effect.STANDING
    assert reason.subject == "panda_joint1"
    for part in ("-0.94 rad/s", "23 ms", "stated up to 1.3 rad/s"):
        assert part in reason.detail, reason.detail
    assert verdict.speed_scale == 0.0


def test_a_joint_state_that_is_old_leaves_time_to_get_too_fast():
    _, monitor = make_ranged(rise_delay=0.0)
    age = 0.01
    most = RANGE - 0.02 - 15.0 * (age + PERIOD + 0.002 + 0.02)
    for speed, is_covered in ((most - 1e-6, True), (most + 1e-6, False), (-most - 1e-6, False)):
        monitor.reset()
        verdict = monitor.step(0.0, HOME, moving(speed), age)
        assert (UNBRAKED in kinds(verdict)) == (not is_covered)
        assert (verdict.level is Level.STOP) == (not is_covered)
        assert (verdict.stop_time == math.inf) == (not is_covered)


def test_it_lasts_as_long_as_it_lasts_and_the_delay_beyond():
    _, monitor = make_ranged(rise_delay=0.05)
    fast = glide(monitor, 0, 20, 1.0)
    assert all(verdict.level is Level.STOP for verdict in fast)
    q, slow = HOME + moving(1.0) * 19 * PERIOD, []
    for i in range(100):
        v = max(1.0 - 3.75 * PERIOD * (i + 1), 0.0)
        q = q + moving(v) * PERIOD
        slow.append(monitor.step((20 + i) * PERIOD, q, moving(v)))
    covered = next(i for i, verdict in enumerate(slow) if UNBRAKED not in kinds(verdict))
    assert slow[covered].level is Level.STOP
    assert slow[covered + 60].level is Level.CLEAR


def test_operating_limits_bound_how_fast_a_joint_can_be_at_the_bite():
    # At 100 ms a joint without them may be anything by then, even one that rests.
    _, free = make_ranged(reaction_time=0.1)
    assert UNBRAKED in kinds(steps(free, 0, 1)[-1])
    limits = OperatingLimits(velocity=0.6, acceleration=3.0)
    _, monitor = make_ranged(reaction_time=0.1, operating=limits)
    assert steps(monitor, 0, 1)[-1].level is Level.CLEAR
    # And so does less load.
    _, light = make_ranged(reaction_time=0.07, payload=0.0)
    assert steps(light, 0, 1)[-1].level is Level.CLEAR


def test_no_scale_that_promises_something_exceeds_the_range():
    slow, most = 0, 0.0
    for distance in np.arange(0.9, 2.2, 0.05):
        obstacles, monitor = make_ranged(obstacles=Obstacles(speed=1.0), slow_margin=1.0)
        see(obstacles, 0.0, [distance, 0.0, 0.5])
        verdict = monitor.step(0.0, HOME, STILL)
        delay = monitor._judge._stopping.braking_delay
        assert delay == pytest.approx(PERIOD + 0.002 + 0.02)
        share = (RANGE - 0.02 - 15.0 * delay) / 2.175
        share = min(share, (0.6 * 2.61 - 0.02 - 20.0 * delay) / 2.61)
        if verdict.level is Level.SLOW:
            slow += 1
            most = max(most, verdict.speed_scale)
            assert verdict.speed_scale <= share + 1e-12
    assert slow > 3
    assert most > 0.0
    # An arm that keeps to it is never told that it may be too fast.
    _, monitor = make_ranged()
    glided = glide(monitor, 0, 50, share * 2.175 - 1e-9)
    assert not any(UNBRAKED in kinds(verdict) for verdict in glided)


def test_no_proof_that_lasts_counts_with_brakes_beyond_their_range():
    """What may be too fast by then proves nothing, though it may be told to stop in this tick."""
    proved = {}
    for below in (1e-3, 1.0):
        speed = RANGE - 0.02 - 15.0 * (PERIOD + 0.002 + 0.02) - below
        for distance in np.arange(0.7, 1.8, 0.05):
            obstacles, monitor = make_ranged(obstacles=Obstacles(speed=1.0), slow_margin=1.0)
            see(obstacles, 0.0, [distance, 0.0, 0.5], ["post"])
            monitor.step(0.0, HOME, moving(speed))
            scheduler, (tick, *_) = monitor._scheduler, monitor._last
            place = stop_place(obstacles.row("post"), False)
            until = scheduler.certificates.proofs.until[place]
            lasting = until - tick.time
            if lasting > 0.0:
                proved[below] = max(proved.get(below, 0.0), lasting)
                braking = scheduler.arm.motion.braking
                assert braking.covers(tick.q, tick.v, 0.0, PERIOD + 0.002 + lasting - 1e-9)
    assert 1e-3 not in proved
    assert proved[1.0] > 0.005


def test_by_free_bodies_the_scale_is_what_rests_in_time_by_the_table():
    found = set()
    for distance in np.arange(1.5, 12.0, 0.5):
        obstacles, monitor = make_ranged(
            obstacles=Obstacles(speed=1.0), slow_margin=1.0, motion="isotropic"
        )
        see(obstacles, 0.0, [distance, 0.0, 0.5])
        verdict = monitor.step(0.0, HOME, STILL)
        if verdict.level is not Level.SLOW:
            continue
        curves, robot = ranged_panda().brakes.make_curves(), ranged_panda()
        left = verdict.contact_time - (PERIOD + 0.002 + 0.02)
        for j in range(7):
            speed = verdict.speed_scale * robot.velocity_limit[j]
            assert rest_time(find_stop(curves, j, speed), speed) <= left * (1.0 + 1e-9)
            assert speed <= curves.speed[j, -1] * (1.0 + 1e-12)
        found.add(verdict.speed_scale)
    assert found


def margin_of(payload):
    """How near a ball may be for the arm to be allowed to go on."""
    for distance in np.arange(0.6, 3.0, 0.05):
        obstacles, monitor = make_ranged(payload=payload, obstacles=Obstacles(speed=1.0))
        see(obstacles, 0.0, [distance, 0.0, 0.5])
        v = moving(0.6, joint=1)
        if monitor.step(0.0, HOME, v).level is not Level.STOP:
            return distance
    return math.inf


def test_less_load_lets_an_arm_go_on_nearer():
    heavy, some, none = (margin_of(payload) for payload in (1.0, 0.5, 0.0))
    assert none <= some <= heavy
    assert none < heavy
    assert margin_of(None) == heavy


def test_a_payload_that_changes_counts_in_the_next_tick():
    obstacles, monitor = make_ranged(payload=0.0, obstacles=Obstacles(speed=1.0))
    place = [margin_of(0.0) + 0.1, 0.0, 0.5]
    assert place[0] < margin_of(1.0)
    see(obstacles, 0.0, place)
    light = monitor.step(0.0, HOME, moving(0.6, joint=1))
    assert light.level is not Level.STOP
    assert monitor.payload == 0.0
    monitor.payload = 1.0
    assert monitor.payload == 1.0
    heavy = monitor.step(PERIOD, HOME + 0.6 * PERIOD * np.eye(7)[1], moving(0.6, joint=1))
    assert heavy.level is Level.STOP
    assert heavy.stop_time > light.stop_time
    # All that was known is evaluated anew, whatever its deadline.
    assert heavy.evaluated > 0
    # Put down again, the arm goes on only with evidence.
    monitor.payload = 0.0
    again = monitor.step(2 * PERIOD, HOME + 1.2 * PERIOD * np.eye(7)[1], moving(0.6, joint=1))
    assert again.level is Level.STOP
    assert again.stop_time == light.stop_time


@pytest.mark.hazard("H-06")
def test_all_certificates_are_due_when_the_payload_changes():
    obstacles, monitor = make_ranged()
    see(obstacles, 0.0, [5.0, 0.0, 0.5])
    spent = [verdict.evaluated for verdict in steps(monitor, 0, 5)]
    assert spent[0] > 0 == spent[-1]
    monitor.payload = 0.5
    assert steps(monitor, 5, 1)[0].evaluated > 0
    # The same again is no news.
    assert steps(monitor, 6, 2)[-1].evaluated == 0
    monitor.payload = 0.5
    assert steps(monitor, 8, 1)[0].evaluated == 0


@pytest.mark.parametrize("payload", [-0.1, 1.001, math.nan, math.inf, "heavy", True, [0.5]])
def test_payloads_that_cannot_be_are_refused_by_name(payload):
    expected = r"payload: is .*kilograms from 0 to 1, the heaviest"
    # What no robot could carry is refused before there is one.
    with pytest.raises(ArmguardError, match=rf"{expected}|payload: is .*a number from 0 on"):
        Monitor(ranged_panda(), Obstacles(sources=[]), payload=payload)
    _, monitor = make_ranged(payload=0.5)
    before = steps(monitor, 0, 1)[0].stop_time
    with pytest.raises(ArmguardError, match=expected):
        monitor.payload = payload
    assert monitor.payload == 0.5
    assert steps(monitor, 1, 1)[0].stop_time == before


@pytest.mark.hazard("H-06")
def test_the_default_is_the_heaviest():
    _, monitor = make_ranged()
    assert monitor.payload == ranged_panda().brakes.most_payload == 1.0
    monitor.payload = 0.0
    monitor.payload = None
    assert monitor.payload == 1.0


def test_bounds_beyond_the_range_let_joints_go_on():
    motion = BrakingMotion(ranged_panda(), 0.02)
    fast, direction = moving(1.2), np.array([0.0, 1.0, 0.0])
    assert motion.stop_time(HOME, fast, 0.0, 0.0) == math.inf
    assert not motion.covers(HOME, fast, 0.0, 0.0)
    question = HOME, fast, "panda_hand", np.zeros(3), direction
    slower = HOME, moving(0.5), *question[2:]
    assert motion.advance(*slower, 1.5) == pytest.approx(motion.advance(*slower, 0.6))
    assert motion.advance(*question, 1.5) > 1.1 * motion.advance(*question, 0.6)
    with pytest.raises(ArmguardError, match=r"'panda_joint1'.*may be faster .*at most 1\.305"):
        motion.stopping_volume(HOME, fast, 0.0, 0.0)


def test_the_separation_margin_of_an_arm_that_nothing_is_known_to_stop_is_none():
    obstacles, monitor = make_ranged(separation=SeparationRule(human_speed=1.6))
    see(obstacles, 0.0, [5.0, 0.0, 0.5])
    verdict = monitor.step(0.0, HOME, moving(1.2))
    assert UNBRAKED in kinds(verdict)
    assert verdict.separation == -math.inf
