import itertools
import math

import numba
import numpy as np
import pinocchio
import pytest

from armguard.exceptions import ArmguardError
from armguard.verdict import Level, ReasonKind
from support.panda_monitor import (
    HOME,
    PERIOD,
    SCHEDULES,
    STILL,
    kinds,
    make_monitor,
    panda,
    see,
    steps,
)

FRESHNESS = 0.25


@pytest.mark.parametrize("schedule", SCHEDULES, ids=str)
def test_an_empty_cell_is_clear_and_says_why(schedule):
    _, monitor = make_monitor(schedule)
    (verdict,) = steps(monitor, 0, 1)
    assert (verdict.level, verdict.contact_time) == (Level.CLEAR, math.inf)
    assert (verdict.link, verdict.obstacle, verdict.evaluated) == (None, None, 0)
    assert kinds(verdict) == {ReasonKind.NO_SOURCES_EXPECTED}
    assert (verdict.complete, verdict.speed_scale, verdict.sequence) == (True, 1.0, 1)


@pytest.mark.parametrize(("schedule", "stale"), [("full", 0.0), ("deadline", FRESHNESS)])
def test_a_static_needs_no_source_and_never_ages(schedule, stale):
    obstacles, monitor = make_monitor(schedule)
    obstacles.add_static("table", [0.9, 0.0, 0.0], 0.1)
    first, *later = steps(monitor, 0, 3000)
    assert 0.0 < first.contact_time < 2.0
    assert first.obstacle == "table"
    for verdict in later:
        assert verdict.contact_time <= first.contact_time * (1.0 + 1e-9)
        assert (
            verdict.contact_time >= first.contact_time * (1.0 - stale - 1e-9) - 2.0 * PERIOD * stale
        )
        assert (verdict.level, verdict.complete) == (first.level, True)


@pytest.mark.parametrize("schedule", ["deadline", "full"])
@pytest.mark.parametrize("motion", ["isotropic", "joint"])
def test_stop_time_speed_scale_and_validity_are_the_formulas(schedule, motion):
    """Where braking is not reckoned with; elsewhere it only spares stops."""
    robot, latency, reaction, rate = panda(), 0.004, 0.03, 500.0
    obstacles, monitor = make_monitor(
        schedule, motion=motion, rate=rate, latency=latency, reaction_time=reaction, rise_delay=0.0,
        slow_margin=0.5, aware_margin=1.0,
    )  # fmt: skip
    found = set()
    horizon = 1.0 / rate + latency
    for age, x in itertools.product((0.0, 0.01), (1.6, 2.0, 3.0, 20.0)):
        monitor.reset()
        obstacles.remove(list(filter(None, obstacles.ids)))
        see(obstacles, 5.0, [x, 0.0, 0.5], (f"{age} {x}",))
        v = 0.1 * robot.velocity_limit
        verdict = monitor.step(5.0 - age, HOME, v, 5.0)
        slowest = max(
            min(top, abs(speed) + error + accel * (age + horizon + reaction)) / brake
            for speed, top, error, accel, brake in zip(
                v,
                robot.velocity_limit,
                robot.velocity_error,
                robot.acceleration_limit,
                robot.braking_deceleration,
                strict=True,
            )
        )
        assert verdict.stop_time == pytest.approx(horizon + reaction + slowest)
        scale = (verdict.contact_time - horizon - reaction) * min(
            robot.braking_deceleration / robot.velocity_limit
        )
        stopped = not verdict.contact_time > verdict.stop_time
        if motion == "isotropic":
            slow = not stopped and not verdict.contact_time > verdict.stop_time + 0.5
            scale = min(max(scale, 0.0), 1.0) if slow else float(not stopped)
            assert (verdict.level is Level.STOP, verdict.level is Level.SLOW) == (stopped, slow)
            assert verdict.speed_scale == pytest.approx(scale)
            found.add(verdict.level)
        else:
            assert stopped or verdict.level > Level.STOP
            assert 0.0 <= verdict.speed_scale <= 1.0
            assert verdict.speed_scale == 0.0 or verdict.level > Level.STOP
            assert verdict.speed_scale == 1.0 or verdict.level < Level.AWARE
        assert verdict.valid_until == pytest.approx(5.0 + horizon)
        assert verdict.valid_until <= 5.0 + horizon
        assert verdict.stamp == 5.0 - age
    assert motion == "joint" or found == set(Level)


@pytest.mark.parametrize("schedule", ["deadline", "full"])
@pytest.mark.parametrize("motion", ["isotropic", "joint"])
def test_levels_fall_as_a_ball_comes_and_rise_after_it_has_gone(schedule, motion):
    obstacles, monitor = make_monitor(schedule, motion=motion)
    path = np.concatenate([np.arange(4.0, 0.6, -0.002), np.arange(0.6, 4.0, 0.002)])
    levels, times = [], []
    for i, x in enumerate(path):
        velocity = [[-2.0 if i < len(path) / 2 else 2.0, 0.0, 0.0]]
        see(obstacles, i * PERIOD, [x, 0.0, 0.5], velocity=velocity, accel=math.inf, speed=2.1)
        (verdict,) = steps(monitor, i, 1)
        levels.append(verdict.level)
        times.append(verdict)
    seen = [level for level, _ in itertools.groupby(levels)]
    down, up = seen[: seen.index(Level.STOP) + 1], seen[seen.index(Level.STOP) :]
    assert down == [Level.CLEAR, Level.AWARE, Level.SLOW, Level.STOP]
    assert up == sorted(up)
    assert up[-1] is Level.CLEAR

    def earned(verdict, *, rests):
        contact_time, stop_time = verdict.contact_time, verdict.stop_time
        return monitor._rule.grade(contact_time, stop_time, rests=rests, whole=rests)

    # Whether the arm rests in time is asked by joint bounds alone, and told by the level.
    for before, verdict in itertools.pairwise(times):
        least, most = earned(verdict, rests=False), earned(verdict, rests=motion == "joint")
        held = ReasonKind.HOLD in kinds(verdict)
        assert verdict.level <= most
        assert verdict.level is not Level.SLOW or verdict.speed_scale < 1.0
        assert held or verdict.level >= least
        assert not held or verdict.level < most
        assert (ReasonKind.CONTACT in kinds(verdict)) == (least < Level.CLEAR)
        if verdict.level > before.level:
            recent = times[max(0, verdict.sequence - 301) : verdict.sequence][2:]
            assert verdict.level >= min(earned(one, rests=False) for one in recent)
            assert verdict.level <= min(earned(one, rests=motion == "joint") for one in recent)


def random_calls(seed, count=300):
    """What happens before each tick: reproducible, with refusals, removals, silence, a reset."""
    rng = np.random.default_rng(seed)
    positions = {f"o{k}": rng.uniform(-4.0, 4.0, 3) for k in range(12)}
    for i in range(count):
        actions = []
        for name, place in positions.items():
            place += rng.uniform(-0.002, 0.002, 3)
            chance = rng.random()
            if chance < 0.3:
                actions.append(("see", name, place.copy()))
            elif chance < 0.302:
                actions.append(("see", name, place + 1.0))
            elif chance < 0.304:
                actions.append(("remove", name, None))
        if rng.random() < 0.005:
            actions.append(("reset", "", None))
        yield i, actions, rng.uniform(-4e-4, 4e-4), rng.uniform(-1e-4, 1e-4, 7)


def run(schedule, seed, start=0.0, base=None, **settings):
    obstacles, monitor = make_monitor(schedule, base_placement=base, **settings)
    move = (lambda x: x) if base is None else base.act
    verdicts = []
    for i, actions, age, wobble in random_calls(seed):
        now = start + i * PERIOD
        for action, name, place in actions:
            if action == "see":
                see(obstacles, now - 0.01, move(place), [name])
            elif action == "remove" and obstacles.row(name) >= 0:
                obstacles.remove([name])
            elif action == "reset":
                monitor.reset()
        verdicts.append(monitor.step(now - age, HOME + wobble, STILL, now))
    assert not {ReasonKind.INTERNAL_ERROR, ReasonKind.TIME_BACKWARDS} & set(
        itertools.chain.from_iterable(map(kinds, verdicts))
    )
    return verdicts


@pytest.mark.parametrize("schedule", SCHEDULES, ids=str)
def test_a_replay_is_the_same_to_the_bit(schedule):
    assert run(schedule, 5) == run(schedule, 5)


@pytest.mark.parametrize("schedule", ["deadline", "full", "daa"])
def test_unix_time_works_as_time_near_zero_does(schedule):
    # Rounding may put off an evaluation by a tick: answers are compared that are all fresh.
    near, far = (run(schedule, 7, start, max_staleness=0.0) for start in (0.0, 1.7e9))
    for one, other in zip(near, far, strict=True):
        assert one.level == other.level
        assert kinds(one) == kinds(other)
        # What broke a bound was seen between stamps a millisecond apart, rounded to 0.2 µs. That
        # can end the search in time one part of a step of its table sooner.
        assert other.contact_time == pytest.approx(one.contact_time, rel=0.02, abs=1e-5)


@pytest.mark.parametrize("schedule", ["deadline", "full"])
def test_a_base_that_stands_elsewhere(schedule):
    base = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.3, -1.0, 2.0), np.array([3.0, -2.0, 1.0]))
    for one, other in zip(run(schedule, 3), run(schedule, 3, base=base), strict=True):
        assert other.contact_time == pytest.approx(one.contact_time, rel=1e-6, abs=1e-9)
        assert (one.level, one.evaluated) == (other.level, other.evaluated)


@pytest.mark.parametrize("lead", [0.0, 0.01, 0.04])
def test_states_newer_than_now_count_their_lead(lead):
    """What is known of a moment ahead says less about now than what is known of now."""
    at_once, early = (make_monitor() for _ in range(2))
    see(at_once[0], 0.0, [2.5, 0.0, 0.5])
    see(early[0], lead, [2.5, 0.0, 0.5])
    (now,) = steps(at_once[1], 0, 1)
    ahead = early[1].step(lead, HOME, STILL, 0.0)
    assert ahead.contact_time > 0.0
    # Backwards in time the bodies can have been nearer, forwards the lead comes on top.
    assert ahead.contact_time <= now.contact_time + lead + 1e-9
    assert ahead.stop_time >= now.stop_time


@pytest.mark.parametrize(
    "wrong",
    [
        {"rate": 0.0},
        {"rate": math.inf},
        {"rate": math.nan},
        {"latency": -0.1},
        {"margin": math.nan},
        {"rise_delay": math.inf},
        {"max_staleness": 1.0},
        {"max_staleness": math.nan},
        {"motion": "hope"},
        {"budget": 0},
        {"budget": 1.5},
        {"budget": 9, "schedule": "full"},
        {"base_placement": np.eye(4)},
        {"schedule": "sometimes"},
        {"ignore": [("no_such_link", "*")]},
        {"ignore": [("panda_hand", 3)]},
        {"ignore": ["panda_hand"]},
    ],
    ids=str,
)
def test_settings_that_make_no_sense(wrong):
    with pytest.raises(ArmguardError):
        make_monitor(**wrong)


def test_a_margin_counts_as_contact():
    obstacles, monitor = make_monitor(margin=0.5)
    plain, other = make_monitor()
    for table in (obstacles, plain):
        see(table, 0.0, [2.5, 0.0, 0.5])
    assert steps(monitor, 0, 1)[0].contact_time < steps(other, 0, 1)[0].contact_time


def test_a_run_is_a_step_for_each_state_of_its_source():
    def states(obstacles):
        for tick in range(20):
            if tick % 5 == 0:
                see(obstacles, tick * PERIOD, [3.0 - 0.1 * tick * PERIOD, 0.0, 0.5])
            yield (
                (tick * PERIOD, HOME, STILL)
                if tick % 2
                else (
                    tick * PERIOD,
                    HOME,
                    STILL,
                    tick * PERIOD + 1e-4,
                )
            )

    (obstacles, monitor), (others, stepped) = make_monitor(), make_monitor()
    verdicts = []
    monitor.run(states(obstacles), verdicts.append)
    assert verdicts == [stepped.step(*state) for state in states(others)]
    assert len(verdicts) == 20


def test_whole_numbers_are_numbers_like_others():
    """They would be another type for compiled code, and everything be compiled again."""
    _, usual = make_monitor()
    numbers = {"aware_margin": 1, "reaction_time": 0, "latency": 0, "max_staleness": 0, "margin": 0}
    _, other = make_monitor(rate=np.float32(500.0), **numbers)
    for handle in ("_tick_data", "_handle"):
        kinds = [numba.typeof(getattr(monitor._scheduler, handle)) for monitor in (usual, other)]
        assert kinds[0] == kinds[1]
    assert other.headroom().evaluations == 0.0
