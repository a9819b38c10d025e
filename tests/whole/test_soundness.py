"""No contact is ever earlier than a verdict said: bodies that attack, an arm that moves as it may.

The truth is simulated first: joints that switch between their acceleration limits, obstacles that
accelerate towards the nearest link as hard as they may. Monitors then see it as a cell would: late,
with gaps, and with errors as large as were declared.
"""

import functools
import math
from types import SimpleNamespace

import numpy as np
import pytest

from armguard.pairs.hull_distance import HullDistance
from armguard.robot import Kinematics
from armguard.verdict import Level, ReasonKind
from support.panda_monitor import HOME, SCHEDULES, make_monitor, panda

PERIOD = 2e-3
TICKS = 500
POSITION_ERROR, VELOCITY_ERROR = 0.01, 0.05
KINEMATICS = Kinematics(panda())
EXACT = HullDistance(panda(), KINEMATICS)
LINKS = len(panda().links)


class Body:
    """A hull that hunts the arm, or wanders, within its bounds."""

    def __init__(self, name, rng, *, hunts):
        self.name, self.hunts = name, hunts
        self.accel, self.speed = rng.uniform(4.0, 12.0), rng.uniform(0.5, 2.5)
        self.radius = rng.uniform(0.03, 0.15)
        place = rng.normal(size=3)
        place *= (rng.uniform(1.3, 2.2) if hunts else rng.uniform(2.0, 5.0)) / np.linalg.norm(place)
        self.points = place + rng.uniform(-0.15, 0.15, (rng.choice([1, 2, 8]), 3))
        velocity = rng.normal(size=3)
        velocity *= rng.uniform(0.0, self.speed) / np.linalg.norm(velocity)
        self.velocities = np.tile(velocity, (len(self.points), 1))

    def move(self, direction):
        """One period at full acceleration; the speed limit bends it, and only weakens it."""
        faster = self.velocities + self.accel * PERIOD * direction
        speed = np.linalg.norm(faster, axis=1, keepdims=True)
        faster *= np.minimum(1.0, self.speed / np.maximum(speed, 1e-300))
        self.points = self.points + 0.5 * (self.velocities + faster) * PERIOD
        self.velocities = faster


def move_joints(rng, q, v, accel, tick):
    """One period of joints that switch between their limits and turn before their stops."""
    robot = panda()
    if tick % 40 == 0:
        accel = robot.acceleration_limit * rng.choice([-1.0, 1.0], 7)
    low, high = robot.lower_position_limit + 0.1, robot.upper_position_limit - 0.1
    end = q + v * np.abs(v) / (2.0 * 0.5 * robot.acceleration_limit)
    accel = np.where(end > high, -robot.acceleration_limit, accel)
    accel = np.where(end < low, robot.acceleration_limit, accel)
    top = 0.9 * robot.velocity_limit
    faster = np.clip(v + accel * PERIOD, -top, top)
    return q + 0.5 * (v + faster) * PERIOD, faster, accel


@functools.cache
def simulate(seed):
    """States at every tick until something touches, and when that is; inf if nothing does."""
    rng = np.random.default_rng(seed)
    bodies = [Body(f"b{k}", rng, hunts=k < 3) for k in range(10)]
    q, v, accel = HOME.copy(), np.zeros(7), np.zeros(7)
    history, first_contact = [], math.inf
    for tick in range(TICKS):
        KINEMATICS.compute(q, v)
        history.append((q, v, [(body.points, body.velocities) for body in bodies]))
        for body in bodies:
            direction = rng.normal(size=3)
            if body.hunts or tick % 10 == 0:
                measured = [EXACT.distance(k, body.points, body.radius) for k in range(LINKS)]
                distance, on_link, on_body = min(measured, key=lambda found: found[0])
                if distance <= 0.0:
                    first_contact = tick * PERIOD
                if body.hunts:
                    direction = on_link - on_body
            body.move(direction / np.linalg.norm(direction))
        if first_contact < math.inf:
            break
        q, v, accel = move_joints(rng, q, v, accel, tick)
    return SimpleNamespace(bodies=bodies, history=history, first_contact=first_contact)


def errors_of(rng, shape, size):
    """Vectors no longer than `size`, most of them exactly that long."""
    vectors = rng.normal(size=shape)
    return vectors * (size / np.linalg.norm(vectors, axis=-1, keepdims=True))


def watch(truth, schedule, seed):
    """Verdicts of a monitor that sees the truth late, with gaps and errors."""
    robot, rng = panda(), np.random.default_rng([seed, 1])
    obstacles, monitor = make_monitor(schedule, rate=1.0 / PERIOD, source_timeout=1.0)
    flagged, newest = 0, [0] * len(truth.bodies)
    for tick, (q, v, _) in enumerate(truth.history):
        now = tick * PERIOD
        for k, body in enumerate(truth.bodies):
            if tick > 0 and rng.random() < 0.85:
                continue
            # Measured some ticks ago, or, with a clock that is off, some ticks ahead.
            measured = min(max(tick - rng.integers(-3, 20), 0), len(truth.history) - 1)
            # Now and then a message is overtaken by a newer one.
            measured = measured if rng.random() < 0.1 else max(measured, newest[k])
            newest[k] = max(measured, newest[k])
            points, velocities = truth.history[measured][2][k]
            obstacles.update(
                [body.name],
                measured * PERIOD,
                points[None] + errors_of(rng, points.shape, 0.999 * POSITION_ERROR),
                velocities[None] + errors_of(rng, velocities.shape, 0.999 * VELOCITY_ERROR),
                radius=body.radius,
                accel=body.accel,
                speed=body.speed,
                position_error=POSITION_ERROR,
                velocity_error=VELOCITY_ERROR,
            )
        seen = min(max(tick + (seed % 3 - 1), 0), len(truth.history) - 1)
        q, v, _ = truth.history[seen]
        noise = rng.uniform(-1.0, 1.0, (2, 7))
        yield now, monitor.step(
            seen * PERIOD, q + noise[0] * robot.position_error,
            v + noise[1] * robot.velocity_error, now,
        )  # fmt: skip
        if not isinstance(schedule, str):
            flagged += len(monitor._scheduler.schedule.flagged())
    if not isinstance(schedule, str):
        assert flagged > 0


SEEDS = range(3)


@pytest.mark.hazard("H-25")
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("schedule", SCHEDULES, ids=str)
def test_no_contact_comes_before_its_time(schedule, seed):
    truth = simulate(seed)
    for now, verdict in watch(truth, schedule, seed):
        assert now + verdict.contact_time <= truth.first_contact + 1e-9
        assert not any(
            reason.kind in (ReasonKind.BOUND_BROKEN, ReasonKind.OBSTACLE_REFUSED)
            or reason.kind.name.startswith("JOINT_STATE")
            for reason in verdict.reasons
        ), verdict.reasons
    if truth.first_contact < math.inf:
        assert verdict.level is Level.STOP


def test_attacks_succeed_and_answers_are_not_idle():
    """Else the test above would prove nothing."""
    contacts = [simulate(seed).first_contact for seed in SEEDS]
    assert np.isfinite(contacts).sum() >= len(SEEDS) - 1
    for schedule in ("deadline", "full", ("powers", "partial")):
        answers = [verdict.contact_time for _, verdict in watch(simulate(0), schedule, 0)]
        assert answers[0] > 0.1 * contacts[0]


def watch_statics(q, v, tick, refused=()):
    """Evaluations at a tick of DAA, after it has seen the same arm at rest or in motion for long.

    Arms are at `q(i)` and `v(i)` at tick i; those in `refused` report an impossible state.
    """
    obstacles, monitor = make_monitor("daa")
    for k in range(20):
        obstacles.add_static(f"static{k}", [3.0 + 0.1 * k, 0.0, 0.5], 0.1)
    for i in range(tick + 1):
        impossible = np.full(7, math.nan)
        verdict = monitor.step(i * 1e-3, q(i), impossible if i in refused else v(i))
    assert verdict.complete
    return verdict.evaluated


@pytest.mark.hazard("H-17")
def test_certificates_end_when_the_arm_is_faster_than_they_took_it_to_be():
    limit, error = panda().velocity_limit[0], panda().velocity_error[0]
    axis = np.eye(7)[0]

    def q(i):
        return HOME + (-1.0 + limit * i * 1e-3) * axis

    # Up to its limit, then beyond: the certificates of the ticks before took it to be slower.
    excess = {20: 0.5, 21: 0.5, 22: 0.4, 23: 0.5, 24: 0.9}

    def v(i):
        return (limit + excess.get(i, 0.0) * error) * axis

    everything = watch_statics(q, v, 0)
    evaluated = [watch_statics(q, v, tick) >= everything for tick in range(18, 27)]
    assert evaluated == [False, False, True, False, False, True, True, False, False]


def test_certificates_end_with_the_trust_in_the_arm():
    def still(i):
        return 0.0 * HOME

    def home(i):
        return HOME

    everything = watch_statics(home, still, 0)
    assert watch_statics(home, still, 30) < everything
    assert watch_statics(home, still, 30, refused=[29]) >= everything
    assert watch_statics(home, still, 31, refused=[29]) < everything
