import math

import coal
import numpy as np
import pytest

from armguard.bounds import Plan
from armguard.bounds.planned.motion import PlannedMotion
from armguard.exceptions import ArmguardError
from armguard.monitor import Monitor
from armguard.monitor.followed_trajectory import MOST_TRAJECTORIES, FollowedTrajectory
from armguard.monitor.stop_decision import PROVING
from armguard.obstacles import Obstacles
from armguard.robot import Kinematics, OperatingLimits, Robot
from armguard.verdict import Level, ReasonKind
from support.example_arms import hold_at_all_speeds
from support.panda_monitor import (
    HOME,
    STILL,
    kinds,
    make_monitor,
    panda,
    ranged_panda,
    see,
)

PERIOD = 0.01
TIMES = np.linspace(0.0, 1.5, 151)
ERROR, SPEED_ERROR = 1e-3, 0.01
TURNS = np.array([0.6, 0.2, 0.0, 0.3, 0.0, 0.2, 0.0])


def make_plan(turns=TURNS, stamp=0.0, **changes):
    """From rest to rest, by several joints."""
    angle = np.pi * TIMES / TIMES[-1]
    q = HOME + 0.5 * np.outer(1.0 - np.cos(angle), turns)
    v = 0.5 * np.pi / TIMES[-1] * np.outer(np.sin(angle), turns)
    plan = Plan(stamp, TIMES.copy(), q, v, np.full(7, ERROR), np.full(7, SPEED_ERROR))
    return plan._replace(**changes)


def start(position=None, **settings):
    """A monitor at 100 Hz that paths are told to, after one tick, and its obstacles."""
    settings = {"rate": 1.0 / PERIOD, "reaction_time": 0.1, "rise_delay": 0.0} | settings
    obstacles, monitor = make_monitor(motion="planned", **settings)
    if position is not None:
        obstacles.add_static("post", position, 0.05)
    monitor.step(0.0, HOME, STILL)
    return obstacles, monitor


def run(monitor, plan, until=151, *, tell=False, slower=1):
    """Verdicts of an arm that is where the plan has it, its clock slower by a whole number."""
    verdicts = []
    for k in range(1, until):
        j, part = divmod(k, slower)
        share = part / slower
        after = min(j + 1, len(TIMES) - 1)
        q = (1.0 - share) * plan.q[j] + share * plan.q[after]
        v = ((1.0 - share) * plan.v[j] + share * plan.v[after]) / slower
        told = PERIOD * k / slower if tell else None
        verdicts.append(monitor.step(PERIOD * k, q, v, path_time=told))
    return verdicts


def test_a_trajectory_faster_than_the_operating_velocity_is_refused_by_name():
    plan = make_plan()
    top = np.abs(plan.v).max(axis=0)
    for share, is_taken in ((1.01, True), (0.7, False)):
        velocity = np.maximum(share * top, 0.1)
        _, monitor = start(operating=OperatingLimits(velocity=velocity))
        answer = monitor.follow(plan)
        assert answer.safe is is_taken
        if not is_taken:
            assert "panda_joint1" in str(answer.reasons[0])
            assert "velocity in force" in str(answer.reasons[0])


def test_a_trajectory_that_speeds_up_harder_than_the_controller_is_refused_by_name():
    plan = make_plan()
    # From rest to rest by a cosine: it speeds up hardest in the beginning.
    hardest = 0.5 * (np.pi / TIMES[-1]) ** 2 * np.abs(TURNS)
    for share, is_taken in ((1.01, True), (0.9, False)):
        _, monitor = start(operating=OperatingLimits(acceleration=np.maximum(share * hardest, 0.1)))
        answer = monitor.follow(plan)
        assert answer.safe is is_taken
        if not is_taken:
            assert "panda_joint1" in str(answer.reasons[0])
            assert "acceleration in force" in str(answer.reasons[0])


def test_a_trajectory_of_wider_limits_ends_where_the_stated_ones_come_into_force_again():
    """What was taken while the hardware's limits were in force may not be kept to by then."""
    plan = make_plan()
    _, monitor = start(operating=OperatingLimits(acceleration=0.5), rise_delay=0.05)
    turned, speeds, said = HOME.copy(), [0.1, 0.2, 0.1, 0.0], set()
    for k, speed in enumerate(speeds, start=1):
        before = speeds[k - 2] if k > 1 else 0.0
        turned[0] += 0.5 * PERIOD * (speed + before)
        said |= kinds(monitor.step(PERIOD * k, turned, speed * np.eye(7)[0]))
    assert ReasonKind.OPERATING_LIMITS_BROKEN in said
    late = plan._replace(stamp=PERIOD * len(speeds), q=plan.q + turned - HOME)
    assert monitor.follow(late).safe
    voided = []
    for k in range(1, 120):
        verdict = monitor.step(late.stamp + PERIOD * k, late.q[k], late.v[k])
        voided += [one.detail for one in verdict.reasons if one.kind is ReasonKind.PLAN_VOID]
    (why,) = voided
    assert "acceleration in force is 0.5" in why


POST = [0.75 * np.cos(0.3), 0.75 * np.sin(0.3), 0.55]


@pytest.mark.parametrize("stop", ["joints", "path"])
@pytest.mark.parametrize("tell", [False, True])
def test_on_its_trajectory_an_arm_may_go_where_it_would_have_to_stop_without(stop, tell):
    levels = []
    for follows in (False, True):
        _, monitor = start(POST, stop=stop)
        plan = make_plan()
        if follows:
            answer = monitor.follow(plan)
            assert answer.safe
            assert not answer.reasons
        verdicts = run(monitor, plan, tell=tell)
        levels.append(np.mean([verdict.level is Level.STOP for verdict in verdicts]))
        assert all(ReasonKind.PLAN_VOID not in kinds(verdict) for verdict in verdicts)
        assert all(
            (verdict.stop == "brake") is (verdict.level is Level.STOP) for verdict in verdicts
        )
    assert levels[0] == 1.0
    assert levels[1] == 0.0


def test_a_trajectory_into_an_obstacle_is_a_stop_before_it_is_reached():
    kinematics = Kinematics(panda())
    plan = make_plan()
    kinematics.compute(plan.q[90], STILL)
    hand = kinematics.centers[kinematics.spheres.root[-1]]
    for stop in ("joints", "path"):
        _, monitor = start(hand, stop=stop)
        assert monitor.follow(plan).safe
        verdicts = run(monitor, plan, 90)
        levels = [verdict.level is Level.STOP for verdict in verdicts]
        assert any(levels)
        assert 10 < levels.index(True) < 80


def test_a_clock_that_is_told_may_be_slow_and_stand_still():
    _, monitor = start(POST)
    plan = make_plan(0.2 * TURNS)
    assert monitor.follow(plan).safe
    verdicts = run(monitor, plan, 120, tell=True, slower=2)
    last = 119 * PERIOD
    q = 0.5 * (plan.q[59] + plan.q[60])
    for k in range(1, 30):
        verdicts.append(monitor.step(last + k * PERIOD, q, STILL, path_time=0.595))
    assert all(ReasonKind.PLAN_VOID not in kinds(verdict) for verdict in verdicts)
    assert all(verdict.level > Level.STOP for verdict in verdicts)


def test_a_clock_of_its_own_is_told_where_limits_are_of_less_precision(monkeypatch):
    robot = panda()
    limits = np.floor(robot.acceleration_limit).astype(np.float32)
    monkeypatch.setattr(robot, "acceleration_limit", limits)  # other tests share the robot
    monitor = Monitor(robot, Obstacles(sources=[]), rate=1.0 / PERIOD, motion="planned")
    monitor.step(0.0, HOME, STILL)
    assert monitor.follow(make_plan()).safe
    assert monitor.step(PERIOD, HOME, STILL, path_time=0.0).level > Level.STOP


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ([0.0, 0.01, None], "is missing"),
        ([0.0, 0.01, math.nan], "is nan"),
        ([0.0, 0.01, math.inf], "is inf"),
        ([0.0, 0.01, "0.02"], "expected a finite number"),
        ([0.0, 0.01, [0.02]], "expected a finite number"),
        ([0.0, 0.01, 10**400], "expected a finite number"),
        ([0.0, 0.01, 0.2], "went on by 0.19 s"),
        ([0.0, 0.01, 0.005], "went on by -0.005 s"),
        ([0.0, 0.01, 1.0], "where the plan has it at"),
    ],
)
def test_a_clock_that_cannot_be_is_told_by_name_and_ends_it(told, words):
    _, monitor = start(POST)
    plan = make_plan(0.05 * TURNS)
    assert monitor.follow(plan).safe
    for k, path_time in enumerate(told):
        verdict = monitor.step(PERIOD * k, plan.q[k], plan.v[k], path_time=path_time)
    (reason,) = [one for one in verdict.reasons if one.kind is ReasonKind.PLAN_VOID]
    assert words in reason.detail
    assert (verdict.level, verdict.stop) == (Level.STOP, "brake")
    again = monitor.step(PERIOD * len(told), plan.q[3], plan.v[3])
    assert ReasonKind.PLAN_VOID not in kinds(again)


def test_a_path_that_is_left_is_told_once():
    _, monitor = start()
    plan = make_plan()
    assert monitor.follow(plan).safe
    run(monitor, plan, 20)
    told = []
    for k in range(20, 40):
        away = PERIOD * (k - 20)
        q = plan.q[20] + plan.v[20] * away
        told.append(ReasonKind.PLAN_VOID in kinds(monitor.step(PERIOD * k, q, plan.v[20])))
    assert sum(told) == 1


def test_a_dwell_and_a_crossing_are_no_riddle_on_time_nor_with_a_clock():
    """There and back through the same place, and a rest in the middle."""
    ways = np.concatenate([TIMES, TIMES[-1] + 0.5 + TIMES[1:]])
    plan = make_plan()
    there_and_back = plan._replace(
        times=np.concatenate([TIMES, [TIMES[-1] + 0.5], TIMES[-1] + 0.5 + TIMES[1:]]),
        q=np.concatenate([plan.q, plan.q[-1:], plan.q[-2::-1]]),
        v=np.concatenate([plan.v, plan.v[-1:], -plan.v[-2::-1]]),
    )
    assert len(ways) < len(there_and_back.times)
    for tell in (False, True):
        _, monitor = start(POST)
        assert monitor.follow(there_and_back).safe
        for now in np.arange(1, 350) * PERIOD:
            if now <= 1.5:
                k, sign = round(now / PERIOD), 1.0
            elif now < 2.0:
                k, sign = 150, 1.0
            else:
                k, sign = 150 - round((now - 2.0) / PERIOD), -1.0
            told = float(now) if tell else None
            verdict = monitor.step(float(now), plan.q[k], sign * plan.v[k], path_time=told)
            assert ReasonKind.PLAN_VOID not in kinds(verdict)
            assert verdict.level > Level.STOP


REFUSED = {
    "starts elsewhere": (make_plan(q=make_plan().q + 0.01), "panda_joint1"),
    "in the past": (make_plan(stamp=-2.0), "plan"),
    "moving at its end": (make_plan(v=make_plan().v + 0.05), "panda_joint1"),
    "not finite": (make_plan(q=np.full((151, 7), np.nan)), "q"),
    "times not finite": (make_plan(times=np.full(151, np.inf)), "times"),
    "no plan": (None, "plan"),
    "faster than joints": (make_plan(10.0 * TURNS), "panda_joint1"),
    "error without a sign": (make_plan(stop_tracking_error=-np.ones(7)), "stop_tracking_error"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_bad_trajectory_is_refused_with_its_reason_and_not_followed(case):
    plan, subject = REFUSED[case]
    _, monitor = start()
    answer = monitor.follow(plan)
    assert (answer.safe, answer.contact_time) == (False, 0.0)
    (reason,) = answer.reasons
    assert (reason.kind, reason.subject) == (ReasonKind.PLAN_REFUSED, subject)
    assert not monitor._judge.path.is_followed


def test_a_path_that_cannot_be_stopped_on_is_refused_where_the_stop_is_to_be_on_it():
    sharp = make_plan(3.2 * TURNS)
    for stop, is_safe in (("joints", True), ("path", False)):
        _, monitor = start(stop=stop)
        answer = monitor.follow(sharp)
        assert answer.safe is is_safe
        if not is_safe:
            assert answer.reasons[0].subject == "panda_joint1"
            assert "no stop on the path" in answer.reasons[0].detail


def test_another_trajectory_agrees_with_the_one_before_until_it_can_have_been_told():
    _, monitor = start(latency=0.05)
    plan = make_plan()
    assert monitor.follow(plan).safe
    run(monitor, plan, 20)
    rest = plan._replace(
        stamp=float(TIMES[19]), times=TIMES[19:] - TIMES[19], q=plan.q[19:], v=plan.v[19:]
    )
    assert monitor.follow(rest).safe
    other = rest._replace(q=rest.q + np.linspace(0.0, 0.5, len(rest.q))[:, None], v=rest.v + 0.38)
    assert not monitor.follow(other).safe
    for verdict in run(monitor, plan)[20:]:
        assert ReasonKind.PLAN_VOID not in kinds(verdict)
        break


def hold(stamp, error=ERROR):
    """A trajectory that stays where the arm is for a short time."""
    q = np.tile(HOME, (2, 1))
    return Plan(stamp, [0.0, 0.05], q, np.zeros_like(q), np.full(7, error), np.full(7, SPEED_ERROR))


def test_an_arm_that_is_told_to_stay_again_and_again_is_not_on_ever_more_trajectories():
    _, monitor = start()
    for k in range(MOST_TRAJECTORIES + 4):
        answer = monitor.follow(hold(0.1 * k))
        assert answer.safe, answer.reasons
        for part in range(1, 11):
            verdict = monitor.step(0.1 * k + PERIOD * part, HOME, STILL)
            assert ReasonKind.PLAN_VOID not in kinds(verdict)
    assert len(monitor.plans) == 1


def test_one_that_is_over_stays_while_it_says_more_than_a_newer_one():
    _, monitor = start()
    for k, (error, count) in enumerate([(2 * ERROR, 1), (ERROR, 2), (ERROR, 2), (3 * ERROR, 1)]):
        assert monitor.follow(hold(0.1 * k, error)).safe
        for part in range(1, 11):
            monitor.step(0.1 * k + PERIOD * part, HOME, STILL)
        assert len(monitor.plans) == count, "the arm may be as far off as any of them says"


GENTLE = OperatingLimits(acceleration=1.4)
"""With which an arm that was slowed down is still slow when its brakes bite."""


@pytest.mark.parametrize("operating", [GENTLE, None])
def test_the_scale_is_that_of_the_clock(operating):
    """The nearer a person, the slower; on time there is the whole or nothing.

    And so it is where slowing down gains nothing, since joints are as fast again by the bite.
    """
    found, between = {}, 0
    for tell in (False, True):
        for distance in (0.7, 0.8, 0.9, 1.0, 1.2, 2.4):
            obstacles, monitor = start(slow_margin=0.3, operating=operating)
            plan = make_plan()
            assert monitor.follow(plan).safe
            for k in range(1, 60):
                see(obstacles, PERIOD * k, [distance, 0.6, 0.6], velocity=[[0.0, 0.0, 0.0]])
                verdict = monitor.step(
                    PERIOD * k, plan.q[k], plan.v[k], path_time=PERIOD * k if tell else None
                )
                scale = verdict.speed_scale
                assert 0.0 <= scale <= 1.0
                assert (tell and operating is not None) or scale in (0.0, 1.0)
                assert (verdict.level is Level.STOP) <= (scale == 0.0)
                if tell and operating is None:
                    assert (verdict.level is Level.STOP) is (scale == 0.0)
                between += 0.0 < scale < 1.0
            found[tell, distance] = scale
    told = [scale for (tell, _), scale in found.items() if tell]
    assert told == sorted(told)
    assert told[-1] == 1.0
    assert (between > 0) is (operating is not None)


def test_on_time_the_scale_rises_again_as_soon_as_the_whole_is_safe():
    """There and back: towards the post there is nothing but to stop, and away from it no need."""
    angle = 2.0 * np.pi * TIMES / TIMES[-1]
    there = make_plan()
    plan = there._replace(
        times=2.0 * TIMES,
        q=HOME + 0.5 * np.outer(1.0 - np.cos(angle), TURNS),
        v=0.5 * np.pi / TIMES[-1] * np.outer(np.sin(angle), TURNS),
    )
    kinematics = Kinematics(panda())
    hands = []
    for q in there.q[[-10, -1]]:
        kinematics.compute(q, STILL)
        hands.append(np.array(kinematics.centers[kinematics.spheres.root[-1]]))
    ahead = (hands[1] - hands[0]) / np.linalg.norm(hands[1] - hands[0])
    _, monitor = start(hands[1] + 0.1 * ahead)
    assert monitor.follow(plan).safe
    # By steps of 20 ms, which are those of the plan.
    verdicts = [
        monitor.step(2.0 * PERIOD * k, plan.q[k], plan.v[k]) for k in range(1, len(plan.times))
    ]
    slow = [one.speed_scale for one in verdicts if one.level is Level.SLOW]
    away = [one.speed_scale for one in verdicts[100:]]
    assert 0.0 in slow
    assert away == [1.0] * len(away)


def test_a_stop_on_the_path_is_only_for_a_known_path():
    with pytest.raises(ArmguardError, match="planned"):
        make_monitor(stop="path")
    for junk in ("brake", None, 3):
        with pytest.raises(ArmguardError, match="stop"):
            make_monitor(motion="planned", stop=junk)


def test_a_stated_stop_on_the_path_lasts_as_long_as_it_says():
    for rate in (0.5, 1.0):
        _, monitor = start(stop="path", path_deceleration=rate)
        plan = make_plan()
        assert monitor.follow(plan).safe
        verdict = run(monitor, plan, 5)[-1]
        # Period, latency, reaction time; then the clock; then what joints are still off their path.
        assert 0.0 < verdict.stop_time - (PERIOD + 0.102 + 1.0 / rate) < 0.1


def test_a_slower_stated_stop_never_lets_an_arm_go_on():
    def count(rate):
        stops = 0
        for distance in np.linspace(0.7, 2.2, 14):
            obstacles, monitor = start(stop="path", path_deceleration=rate)
            plan = make_plan()
            assert monitor.follow(plan).safe
            for k in range(1, 40):
                see(obstacles, PERIOD * k, [distance, 0.5, 0.6], velocity=[[0.0, 0.0, 0.0]])
                verdict = monitor.step(PERIOD * k, plan.q[k], plan.v[k])
            stops += verdict.level is Level.STOP
        return stops

    stops = [count(rate) for rate in (1.0, 3.0, 20.0)]
    assert stops == sorted(stops, reverse=True)
    assert stops[0] > stops[-1]


def test_a_path_that_brakes_cannot_stop_on_is_followed_where_the_controller_can():
    wave = 4.0 * np.pi * TIMES / TIMES[-1]
    bend = make_plan()._replace(
        q=HOME + 0.02 * np.outer(1.0 - np.cos(wave), TURNS),
        v=0.02 * 4.0 * np.pi / TIMES[-1] * np.outer(np.sin(wave), TURNS),
        times=0.48 * TIMES / TIMES[-1],
    )
    bend = bend._replace(v=bend.v * TIMES[-1] / 0.48)
    _, monitor = start(stop="path")
    refused = monitor.follow(bend)
    assert not refused.safe
    assert "no stop on the path" in refused.reasons[0].detail
    _, monitor = start(stop="path", path_deceleration=5.0)
    assert monitor.follow(bend).safe


def test_more_error_and_more_delay_never_let_an_arm_go_on():
    """Whether it may go on beside a person, at many distances."""

    def count(error=ERROR, **settings):
        stops = 0
        for distance in np.linspace(0.7, 2.2, 14):
            obstacles, monitor = start(**settings)
            plan = make_plan(tracking_error=np.full(7, error))
            assert monitor.follow(plan).safe
            for k in range(1, 40):
                see(obstacles, PERIOD * k, [distance, 0.5, 0.6], velocity=[[0.0, 0.0, 0.0]])
                verdict = monitor.step(PERIOD * k, plan.q[k], plan.v[k])
            stops += verdict.level is Level.STOP
        return stops

    some = count()
    assert 0 < some < 14
    assert count(error=2e-2) >= some
    assert count(reaction_time=0.3) > some
    assert count(latency=0.2) > some


class Chase:
    """An arm on a trajectory, and a ball that drives at its hand as hard as it may."""

    def __init__(self, seed, mode, late, period=PERIOD):
        self.period = period
        self.random = np.random.default_rng(seed)
        self.mode, self.late = mode, late
        self.kinematics = Kinematics(panda())
        self.leaves = self.kinematics.spheres.child_count == 0
        self.obstacles = Obstacles(sources=["camera"])
        self.reaction, self.latency = 0.1, min(0.01, period)
        self.monitor = Monitor(
            panda(), self.obstacles, rate=1.0 / period, motion="planned",
            reaction_time=self.reaction, latency=self.latency, rise_delay=0.0,
        )  # fmt: skip
        self.plan = make_plan(self.random.choice([-1.0, 1.0]) * 1.4 * TURNS)
        angle = self.random.uniform(-1.0, 1.0)
        self.ball = np.array([1.5 * np.cos(angle), 1.5 * np.sin(angle), 0.6])
        self.pace = np.zeros(3)

    def drive(self):
        """One tick of the ball."""
        hand = self.kinematics.centers[self.kinematics.spheres.root[-1]]
        wanted = hand - self.ball
        wanted *= 2.0 / max(np.linalg.norm(wanted), 1e-9)
        push = (wanted - self.pace) / self.period
        push *= min(1.0, 10.0 / max(np.linalg.norm(push), 1e-9))
        self.ball = self.ball + self.period * self.pace + 0.5 * self.period**2 * push
        self.pace = self.pace + self.period * push

    def touches(self, q):
        self.kinematics.compute(q, STILL)
        away = np.linalg.norm(self.kinematics.centers[self.leaves] - self.ball, axis=1)
        return bool((away < self.kinematics.spheres.radius[self.leaves] + 0.1).any())

    def at(self, along):
        curve = self.plan
        q = np.array([np.interp(along, TIMES, curve.q[:, j]) for j in range(7)])
        return q, np.array([np.interp(along, TIMES, curve.v[:, j]) for j in range(7)])

    def run(self):
        """Whether the ball touches an arm that moves."""
        braking = panda().braking_deceleration
        q, v, along, bite = HOME, STILL, 0.0, math.inf
        self.kinematics.compute(q, v)
        for k in range(round(1.51 / self.period)):
            now = k * self.period
            if v.any() and self.touches(q):
                return True
            self.obstacles.update(
                ["ball"], now, [self.ball], [self.pace], radius=0.1, source="camera"
            )
            told = along if self.mode != "on time" else None
            verdict = self.monitor.step(now, q, v, path_time=told if bite > now else None)
            if k == 0:
                assert self.monitor.follow(self.plan).safe
            if verdict.level is Level.STOP and bite == math.inf:
                bite = now + self.latency + self.reaction + self.late
            self.drive()
            if now + self.period <= bite + 1e-9:
                along += self.period
                q, v = self.at(along)
            else:
                until = np.minimum(self.period, np.abs(v) / braking)
                q = q + np.sign(v) * until * (np.abs(v) - 0.5 * braking * until)
                v = np.sign(v) * np.maximum(np.abs(v) - braking * self.period, 0.0)
        return False


def test_a_scale_needs_brakes_for_all_speeds_until_the_stop_that_it_counts_with():
    """Far from anything, an arm that speeds up beyond their range by then has no scale of 1."""
    robot = ranged_panda()
    plan = make_plan(np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    plan = plan._replace(times=0.3 * TIMES, v=plan.v / 0.3)
    stated = robot.brakes.make_curves().speed[0, -1]
    obstacles, monitor = start(robot=robot, reaction_time=0.02, slow_margin=3.0)
    assert monitor.follow(plan).safe
    step = float(plan.times[1])
    # Period and latency, the delay of a STOP, and the time until brakes bite.
    ahead = round((2.0 * (PERIOD + 0.002 + 0.02)) / step)
    scales = []
    for k in range(1, 30):
        see(obstacles, step * k, [4.2, 0.0, 0.5], velocity=[[0.0, 0.0, 0.0]])
        verdict = monitor.step(step * k, plan.q[k], plan.v[k])
        if verdict.level is Level.SLOW:
            scales.append((plan.v[k + ahead, 0] > stated, verdict.speed_scale))
    assert {scale for is_beyond, scale in scales if is_beyond} == {0.0}
    assert (False, 1.0) in scales


@pytest.mark.parametrize("mode", ["on time", "with a clock"])
def test_a_ball_that_drives_at_an_arm_touches_only_one_that_brakes_later_than_told(mode):
    hits = {late: sum(Chase(seed, mode, late).run() for seed in range(12)) for late in (0.0, 0.5)}
    assert hits[0.0] == 0
    assert hits[0.5] > 3


@pytest.mark.parametrize("mode", ["on time", "with a clock"])
def test_such_a_ball_touches_nothing_where_one_proof_answers_many_ticks(mode):
    """As above, ticks being short beside what is proved at a time."""
    period = 2e-3
    assert 2.0 * period < 0.5 * PROVING
    hits = {
        late: sum(Chase(seed, mode, late, period).run() for seed in range(4)) for late in (0.0, 0.5)
    }
    assert hits[0.0] == 0
    assert hits[0.5] > 0


@pytest.fixture
def laid_out(monkeypatch):
    """Grows by one whenever the way of an arm that is stopped is laid out."""
    calls = []
    lay_out = PlannedMotion.lay_out_stop

    def count(*arguments, **named):
        calls.append(None)
        return lay_out(*arguments, **named)

    monkeypatch.setattr(PlannedMotion, "lay_out_stop", count)
    return calls


def follow_slowly(ticks=60):
    """An arm on a trajectory at 1 kHz, in SLOW beside a ball, and how its next tick is made."""
    robot = Robot.load("panda")  # of its own: a test attaches a tool to it
    hold_at_all_speeds(robot)
    obstacles = Obstacles(sources=["camera"])
    monitor = Monitor(
        robot, obstacles, rate=1000.0, reaction_time=0.1, rise_delay=0.0, motion="planned"
    )  # fmt: skip
    plan = make_plan(0.2 * TURNS)
    number = 0

    def step(ball=POST):
        nonlocal number
        now = 1e-3 * number
        if number % 10 == 0 or ball is not POST:
            obstacles.update(
                ["ball"], now, [ball], [[0.0, 0.0, 0.0]], radius=0.05, position_error=0.01,
                velocity_error=0.1, source="camera",
            )  # fmt: skip
        q, v = (
            np.array([np.interp(now, TIMES, samples[:, j]) for j in range(7)])
            for samples in (plan.q, plan.v)
        )
        verdict = monitor.step(now, q, v)
        if number == 0:
            assert monitor.follow(plan).safe
        number += 1
        return verdict

    for _ in range(ticks):
        verdict = step()
    assert verdict.level is Level.SLOW
    return robot, obstacles, monitor, plan, step


def test_one_proof_answers_the_ticks_to_come(laid_out):
    *_, step = follow_slowly()
    laid_out.clear()
    verdicts = [step() for _ in range(100)]
    assert {verdict.level for verdict in verdicts} == {Level.SLOW}
    assert {verdict.speed_scale for verdict in verdicts} == {1.0}
    assert 5 < len(laid_out) < 40


NEWS = {
    "a state of the obstacle": lambda robot, obstacles, monitor, plan: None,
    "an obstacle": lambda robot, obstacles, monitor, plan: obstacles.add_static(
        "post", [0.75 * np.cos(0.3), -0.75 * np.sin(0.3), 0.55], 0.05
    ),
    "a tool": lambda robot, obstacles, monitor, plan: robot.attach(
        "tool", "panda_hand", coal.Sphere(0.03)
    ),
    "a trajectory": lambda robot, obstacles, monitor, plan: monitor.follow(plan),
}


@pytest.mark.parametrize("news", NEWS)
def test_any_news_is_asked_in_its_own_tick(news, laid_out):
    robot, obstacles, monitor, plan, step = follow_slowly()
    step()
    laid_out.clear()
    assert step().level is Level.SLOW
    assert not laid_out, "the tick before has proved this one"
    NEWS[news](robot, obstacles, monitor, plan)
    laid_out.clear()
    step([*POST[:2], POST[2] + 1e-3] if news == "a state of the obstacle" else POST)
    assert laid_out


def test_what_stands_in_the_way_all_at_once_is_a_stop_in_its_own_tick():
    _, obstacles, _, plan, step = follow_slowly()
    kinematics = Kinematics(panda())
    kinematics.compute(plan.q[40], STILL)
    hand = kinematics.centers[kinematics.spheres.root[-1]]
    obstacles.add_static("post", hand, 0.05)
    assert step().level is Level.STOP


def test_a_trajectory_that_is_faster_than_brakes_are_stated_for_is_a_stop_before_it_is():
    turns = np.array([1.6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    robot = ranged_panda()
    plan = make_plan(turns)
    stated = robot.brakes.make_curves().speed[0, -1]
    assert np.abs(plan.v[:, 0]).max() > stated
    _, monitor = start(robot=robot, reaction_time=0.02)
    assert monitor.follow(plan).safe
    for k in range(1, 76):
        verdict = monitor.step(PERIOD * k, plan.q[k], plan.v[k])
        unbraked = ReasonKind.BRAKES_NOT_COVERED in kinds(verdict)
        assert unbraked is (verdict.level is Level.STOP)
        # Told to stop in the next tick, it is no faster before brakes bite.
        if plan.v[min(k + 4, 75), 0] > stated:
            assert unbraked
        if plan.v[k, 0] < 0.8 * stated:
            assert not unbraked


def test_a_scale_that_was_proved_on_one_trajectory_is_none_on_another(monkeypatch):
    _, monitor = start([0.9 * np.cos(0.3), 0.9 * np.sin(0.3), 0.55])
    plan = make_plan(0.2 * TURNS)
    assert monitor.follow(plan).safe
    verdicts = run(monitor, plan, 10)
    assert verdicts[-1].level is Level.SLOW
    assert verdicts[-1].speed_scale == 1.0
    rest = plan._replace(
        stamp=float(TIMES[9]), times=TIMES[9:] - TIMES[9], q=plan.q[9:], v=plan.v[9:]
    )
    assert monitor.follow(rest).safe
    # Nothing is proved of this one.
    monkeypatch.setattr(FollowedTrajectory, "is_free", lambda *_: False)
    verdict = monitor.step(float(TIMES[10]), plan.q[10], plan.v[10])
    assert verdict.level is Level.SLOW
    assert verdict.speed_scale == 0.0
