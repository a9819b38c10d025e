"""Refused samples stop where they matter: each may be true, is bounded, and geometry decides."""

import functools
import math

import numpy as np
import pytest

from armguard.bounds.planned.plan import Plan
from armguard.obstacles import Obstacles, Source
from armguard.pairs.hull_distance import HullDistance
from armguard.robot import Kinematics
from armguard.verdict import Effect, Level, ReasonKind
from support.panda_monitor import HOME, PERIOD, STILL, kinds, make_monitor, panda, subjects

SCHEDULES = ["deadline", "full", "daa"]
REST = np.zeros((1, 3))
LASTING = 0.3


@pytest.fixture(params=SCHEDULES)
def schedule(request):
    return request.param


def tell(obstacles, tick, places, source="camera", **fields):
    """One message about bodies at rest, by id."""
    ids = list(places)
    positions = np.array([places[name] for name in ids], dtype=float)
    fields = {"radius": 0.1, "velocity": np.zeros_like(positions)} | fields
    obstacles.update(ids, tick * PERIOD, positions, source=source, **fields)


def step(monitor, tick):
    return monitor.step(tick * PERIOD, HOME, STILL)


def test_a_refused_sample_far_away_changes_neither_the_level_nor_any_stop(schedule):
    """Six metres off, then five; the verdict says so, and that is all."""
    # By distance over closing speed alone, five metres are not far.
    away = 5.0
    obstacles, monitor = make_monitor(schedule, obstacles=Obstacles())
    for tick in range(400):
        place = [0.0, away, 0.5] if tick in (100, 103, 200) else [6.0, 0.0, 0.5]
        tell(obstacles, tick, {"ball": place, "other": [-6.0, 0.0, 0.5]})
        verdict = step(monitor, tick)
        assert (verdict.level, verdict.complete) == (Level.CLEAR, True)
        assert verdict.speed_scale == 1.0
        assert verdict.contact_time > 0.4
        said = {ReasonKind.OBSTACLE_REFUSED} if 100 <= tick <= 399 else set()
        assert kinds(verdict) == said
    assert ReasonKind.OBSTACLE_REFUSED.effect is Effect.NOTE
    assert monitor.faults == 3


def test_what_is_refused_is_told_with_what_it_was_and_for_how_long():
    obstacles, monitor = make_monitor(obstacles=Obstacles())
    for tick in range(320):
        tell(obstacles, tick, {"ball": [0.0, 5.0 if tick == 5 else 6.0, 0.5], "b": [9, 9, 9]})
        verdict = step(monitor, tick)
        told = [one for one in verdict.reasons if one.kind is ReasonKind.OBSTACLE_REFUSED]
        assert len(told) == (5 <= tick <= 305)
        assert bool(told and told[0].detail) == (tick == 5)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_contact_time_is_the_least_of_all_states_that_may_be_true(schedule, count):
    """As with as many bodies as there are states, each seen in its place: plainly computed."""
    rng = np.random.default_rng([count, SCHEDULES.index(schedule)])
    obstacles, monitor = make_monitor(schedule, obstacles=Obstacles())
    others, reference = make_monitor("full" if schedule == "deadline" else schedule)
    tell(obstacles, 0, {"ball": [2.0, 0.0, 0.5]})
    tell(others, 0, {"accepted": [2.0, 0.0, 0.5]})
    tell(others, 0, {"post": [9.0, 0.0, 0.5]})
    assert step(monitor, 0).contact_time == pytest.approx(step(reference, 0).contact_time)
    for k in range(count):
        angle = rng.uniform(-3.0, 3.0)
        place = rng.uniform(1.0, 4.0) * np.array([math.cos(angle), math.sin(angle), 0.3])
        fields = {"radius": rng.uniform(0.05, 0.3), "accel": 10.0, "speed": 2.0}
        fields |= {"position_error": 0.01, "velocity_error": rng.uniform(0.0, 0.5)}
        fields["velocity"] = rng.uniform(-0.8, 0.8, (1, 3))
        tick = 2 * k + 1
        tell(obstacles, tick, {"ball": place}, **fields)
        tell(others, tick, {f"refused{k}": place}, **fields)
        for later in (tick, tick + 1):
            verdict, expected = step(monitor, later), step(reference, later)
            stale = PERIOD if schedule in ("deadline", "daa") else 0.0
            assert verdict.contact_time <= expected.contact_time + 1e-9
            assert verdict.contact_time >= expected.contact_time - stale - 1e-9
            assert verdict.complete
    assert not obstacles.table.unknown.any()
    # By how far each state's own body could have come, dash by dash, it is never too late.
    kinematics = monitor._scheduler.arm.kinematics
    centers, radii = kinematics.centers, kinematics.spheres.radius
    leaves = kinematics.spheres.child_count == 0
    table = others.table
    first = math.inf
    for row in np.flatnonzero(table.has_state):
        gap = np.linalg.norm(centers[leaves] - table.points[row, 0], axis=1) - radii[leaves]
        gap = max(gap.min() - table.radius[row], 0.0)
        # From the greatest speed that it may have: the worst, in no direction better.
        first = min(first, gap / table.speed[row])
    first_dash = dash(others, centers[leaves], radii[leaves])
    assert verdict.contact_time <= first_dash + 1e-9
    assert first_dash >= first - 0.01


def dash(obstacles, centers, radii):
    """When a body that accelerates straight at a sphere of a resting arm first touches any."""
    table, soonest = obstacles.table, math.inf
    for row in np.flatnonzero(table.has_state):
        place, velocity = table.points[row, 0], table.velocities[row, 0]
        for target in centers[::5]:
            way = target - place
            way /= np.linalg.norm(way)
            time = np.arange(0.0, 4.0, 1e-2)[:, None]
            ramp = np.clip((table.speed[row] - np.linalg.norm(velocity)) / table.accel[row], 0, 4)
            push = np.minimum(time, ramp)
            x = place + velocity * time + way * table.accel[row] * push * (time - push / 2.0)
            gaps = np.linalg.norm(x[:, None] - centers, axis=2) - radii - table.radius[row]
            touching = np.flatnonzero((gaps <= 0.0).any(axis=1))
            if len(touching):
                soonest = min(soonest, float(time[touching[0], 0]))
    return soonest


def test_a_fifth_sample_that_disagrees_counts_as_well(schedule):
    """One of the four before it grows to cover it."""
    obstacles, monitor = make_monitor(schedule, obstacles=Obstacles())
    for tick in range(400):
        place = [6.0, 0.0, 0.5]
        if 10 <= tick < 14:
            place = [6.0, 10.0 * (tick - 9), 0.5]
        elif tick == 14:
            place = [0.5, 0.0, 0.5]
        others = {f"post{k}": [-6.0, 2.0 * k, 0.5] for k in range(3)}
        tell(obstacles, tick, {"ball": place, **others})
        verdict = step(monitor, tick)
        if 14 <= tick <= 313:
            assert (verdict.level, verdict.contact_time) == (Level.STOP, 0.0)
            assert verdict.obstacle == "ball"
            told = [reason.kind for reason in verdict.reasons if reason.kind is not ReasonKind.HOLD]
            alternative, contact = ReasonKind.REFUSED_ALTERNATIVE, ReasonKind.CONTACT
            assert told[:3] == [alternative, contact, ReasonKind.OBSTACLE_REFUSED]
            assert not obstacles.table.unknown[obstacles.row("ball")]
        elif tick < 14:
            assert verdict.level is Level.CLEAR
        elif tick > 316:
            assert verdict.contact_time > 0.5


def test_a_source_may_ask_for_a_stop_instead(schedule):
    sources = [Source("camera", on_refusal="stop")]
    obstacles, monitor = make_monitor(schedule, obstacles=Obstacles(sources=sources))
    for tick in range(700):
        place = [0.0, 9.0, 0.5] if tick == 50 else [6.0, 0.0, 0.5]
        tell(obstacles, tick, {"ball": place, "other": [-6.0, 0.0, 0.5]})
        verdict = step(monitor, tick)
        if 50 <= tick <= 348:
            assert verdict.level is Level.STOP
            assert subjects(verdict, ReasonKind.OBSTACLE_NOT_BELIEVED) == {"ball"}
        elif 353 <= tick < 645:
            assert (verdict.level, kinds(verdict)) == (Level.STOP, {ReasonKind.HOLD})
    assert verdict.level is Level.CLEAR


def test_a_source_of_which_most_is_refused_is_not_believed(schedule):
    obstacles, monitor = make_monitor(schedule, obstacles=Obstacles(), source_timeout=5.0)
    levels = []
    for tick in range(0, 1500, 10):
        # Two of three bodies jump to and fro between two places.
        jumps = 20 <= tick < 600 and tick % 20 == 0
        place = [6.0, 9.0 if jumps else 0.0, 0.5]
        bodies = {"a": place, "b": place}
        if 200 <= tick < 600:
            bodies = {"a": [6.0, 30.0 * (tick % 40) / 40.0, 0.5]}
        tell(obstacles, tick, bodies)
        verdict = step(monitor, tick)
        levels.append(subjects(verdict, ReasonKind.SOURCE_NOT_BELIEVED))
        if levels[-1]:
            assert verdict.level is Level.STOP
    assert {"camera"} in levels
    assert levels[-1] == set()


def test_queries_and_view_know_of_all_that_may_be_true(schedule):
    obstacles, monitor = make_monitor(schedule, obstacles=Obstacles())
    tell(obstacles, 0, {"ball": [3.0, 0.0, 0.5], "other": [-4.0, 0.0, 0.5]})
    step(monitor, 0)
    before = monitor.explain().contact_time
    tell(obstacles, 1, {"ball": [0.0, 1.5, 0.5], "other": [-4.0, 0.0, 0.5]})
    verdict = step(monitor, 1)
    assert verdict.obstacle == "ball"
    told = monitor.explain()
    assert told.contact_time == pytest.approx(verdict.contact_time) != before
    assert told.fresh_contact_time <= told.contact_time + 2e-3
    report = monitor.pairs(1)[0]
    assert report.obstacle == "ball"
    assert np.linalg.norm(report.point_on_obstacle - [0.0, 1.5, 0.5]) == pytest.approx(0.1, 0.05)
    # That is where the link is measured to, and not where the body was believed to be.
    assert monitor.attention(1)[0].obstacle == "ball"
    assert monitor.attention(1)[0].gain >= 0.0
    snapshot = monitor.snapshot(pair_limit=4, row_limit=4)
    assert snapshot.rows[0] == obstacles.row("ball")
    assert snapshot.row_times[0] == pytest.approx(verdict.contact_time, abs=1e-3)


def test_a_plan_is_judged_by_all_that_may_be_true_and_not_refused_for_it():
    """With a refused sample at hand nothing is safe to commit; far away it does not matter."""
    for place, safe in (([9.0, 9.0, 0.5], True), ([0.3, 0.1, 0.6], False)):
        obstacles, monitor = make_monitor("deadline", obstacles=Obstacles(), motion="planned")
        tell(obstacles, 0, {"ball": [6.0, 0.0, 0.5], "b": [7.0, 7.0, 0.5]})
        step(monitor, 0)
        tell(obstacles, 1, {"ball": place, "b": [7.0, 7.0, 0.5]})
        step(monitor, 1)
        time = 0.01 * np.arange(3)
        still = np.tile(HOME, (3, 1))
        plan = Plan(2 * PERIOD, time, still, 0.0 * still, np.full(7, 0.01), np.full(7, 0.1))
        assert monitor.commit(plan).safe == safe


def test_errors_larger_than_promised_are_a_note():
    rng = np.random.default_rng(0)
    obstacles, monitor = make_monitor(obstacles=Obstacles())
    for tick in range(0, 2000, 10):
        noise = rng.normal(size=3)
        noise *= 0.008 / np.linalg.norm(noise)
        tell(
            obstacles, tick, {"left_elbow": np.add(noise, [6.0, 0.0, 0.5])}, position_error=0.002,
            velocity_error=1.0,
        )  # fmt: skip
        verdict = step(monitor, tick)
    (reason,) = [one for one in verdict.reasons if one.kind is ReasonKind.ERRORS_EXCEEDED]
    assert reason.subject == "left_elbow"
    assert reason.detail.startswith("camera: the spread of left_elbow is ")
    assert reason.kind.effect is Effect.NOTE
    assert verdict.level is Level.CLEAR


TICK = 5e-3
DELAY = 0.022
EXACT_KINEMATICS = Kinematics(panda())


@functools.cache
def exact():
    return HullDistance(panda(), EXACT_KINEMATICS)


def distance(q, place):
    EXACT_KINEMATICS.compute(q, STILL)
    found = [exact().distance(link, place[None], 0.1) for link in range(len(panda().links))]
    return min(found, key=lambda one: one[0])


def drive(seed, schedule, *, tracks, hidden):
    """An arm that obeys, and a body that drives at it while its id is believed to be elsewhere.

    Messages about the id show it in one of several places, so that its true track is the refused
    one, though believed for a while now and then.

    Args:
        seed: Of all that happens.
        schedule: Of the monitor.
        tracks: Others than the one that is believed first, the true one among them.
        hidden: Whether the true track is left out: as for a monitor that ignores what it refuses.

    Returns:
        Whether the body touches the arm while it moves, and in which share of ticks it moves.
    """
    rng, robot = np.random.default_rng(seed), panda()
    obstacles, monitor = make_monitor(schedule, obstacles=Obstacles(), rate=1.0 / TICK)
    angle = rng.uniform(-1.5, 1.5)
    true = np.array([2.0 * math.cos(angle), 2.0 * math.sin(angle), rng.uniform(0.2, 0.9)])
    speed = np.zeros(3)
    ghosts = [np.array([6.0 + 3.0 * k, -6.0 + 3.0 * k, 0.5]) for k in range(tracks)]
    q, v, direction, brakes_at = HOME.copy(), np.zeros(7), 1.0, 0.0
    moving, run, last = 0, 0, -1
    apart = distance(q, true)
    for tick in range(500):
        now = tick * TICK
        if tick % 2 == 0:
            # The first track most of the time; every other one at least each 0.2 s.
            track = 0 if rng.random() < 0.55 else 1 + int(rng.integers(tracks))
            if tick % 20 == 0:
                track = 1
            run = run + 1 if track == last else 1
            last = track
            seen = true if track == 1 else ghosts[0 if track == 0 else track - 1]
            rate = speed if track == 1 else np.zeros(3)
            if track == 1 and hidden:
                seen, rate = ghosts[0], np.zeros(3)
            steady = {f"post{k}": [-7.0, 2.0 * k, 0.5] for k in range(4)}
            places = np.array([seen, *steady.values()])
            rates = np.vstack([rate, np.zeros((4, 3))])
            obstacles.update(["swapped", *steady], now, places, rates, radius=0.1, source="camera")
        verdict = monitor.step(now, q, v)
        assert not kinds(verdict) & {ReasonKind.INTERNAL_ERROR, ReasonKind.JOINT_STATE_JUMPED}
        stops = verdict.level is Level.STOP
        brakes_at = min(brakes_at, now + DELAY) if stops else math.inf
        push = target(apart, speed)
        for k in range(5):
            time = now + 1e-3 * k
            if abs(q[0]) > 1.0:
                direction = -math.copysign(1.0, q[0])
            goal = 0.0 if time >= brakes_at else 0.8 * direction
            limit = robot.braking_deceleration[0]
            change = np.clip(goal - v[0], -limit * 1e-3, limit * 1e-3)
            q[0] += (v[0] + change / 2.0) * 1e-3
            v[0] += change
            faster = speed + 9.9 * 1e-3 * push
            faster *= min(1.0, 1.99 / max(np.linalg.norm(faster), 1e-9))
            true = true + (speed + faster) / 2.0 * 1e-3
            speed = faster
        moving += abs(v[0]) > 1e-3
        apart = distance(q, true)
        if apart[0] <= 0.0:
            return abs(v[0]) > 1e-3, moving / (tick + 1)
    return False, moving / 500


def target(apart, speed):
    """Unit vector of an acceleration that takes a body to the arm, by the distance between them."""
    _, on_link, on_body = apart
    way = on_link - on_body
    wanted = 2.0 * way / max(np.linalg.norm(way), 1e-9) - speed
    return wanted / max(np.linalg.norm(wanted), 1e-9)


@pytest.mark.hazard("H-14")
@pytest.mark.parametrize("tracks", [1, 2, 4])
@pytest.mark.parametrize("schedule", ["deadline", "full"])
def test_a_body_whose_true_track_is_refused_never_touches_an_arm_that_obeys(schedule, tracks):
    touched, moved, hit = [], [], []
    for seed in range(4):
        found, share = drive(seed, schedule, tracks=tracks, hidden=False)
        touched.append(found)
        moved.append(share)
        hit.append(drive(seed, schedule, tracks=tracks, hidden=True)[0])
    assert not any(touched)
    # The arm is not at rest all the time, and one whose monitor ignores what it refuses is hit.
    assert max(moved) > 0.1
    assert sum(hit) >= 2
