"""Which states of an obstacle may be true, and for how long."""

import math

import numpy as np
import pytest

from armguard.jit.kernels import kernel
from armguard.obstacles import Obstacles
from armguard.obstacles.possible_states import COVERING, possible_states, state_at, widen_to_cover
from armguard.obstacles.record import Record
from armguard.obstacles.table import MOST_REFUSED, make_states
from support.obstacle_samples import check_invariants, possible, refused, see

LASTING = 0.3


@kernel
def list_compiled(handle, row, now, found):
    table = handle.content
    count = 0
    for number in possible_states(table.marks, row):
        bodies, place, age = state_at(table.accepted, table.refused, table.marks, row, number, now)
        found[count, 0] = bodies.points[place, 0, 0]
        found[count, 1] = age
        count += 1
    return count


def test_compiled_code_and_python_see_the_same_states():
    obstacles = Obstacles()
    row = see(obstacles, 1.0)
    obstacles.add_static("post", [3.0, 0.0, 0.0], 0.1)
    for k in range(5):
        found = np.zeros((1 + MOST_REFUSED, 2))
        count = list_compiled(obstacles.table.handle, row, 2.0, found)
        places = [states.points[place, 0, 0] for states, place, _ in possible(obstacles, row)]
        assert found[:count, 0].tolist() == places == [0.0, *(10.0 * j for j in range(1, k + 1))]
        ages = [age for _, _, age in possible(obstacles, row, 2.0)]
        assert found[:count, 1].tolist() == ages
        see(obstacles, 1.0 + 0.01 * (k + 1), x=10.0 * (k + 1))
    ((_, _, age),) = possible(obstacles, obstacles.row("post"), 5.0)
    assert age == 0.0


def test_four_samples_that_disagree_are_kept_and_one_of_them_grows_to_cover_a_fifth():
    obstacles = Obstacles()
    row = see(obstacles, 0.0)
    for k in range(1, 5):
        see(obstacles, 0.01 * k, x=10.0 * k)
        assert not obstacles.table.unknown[row]
    assert refused(obstacles, row) == [10.0, 20.0, 30.0, 40.0]
    see(obstacles, 0.05, x=50.0)
    assert not obstacles.table.unknown[row]
    assert refused(obstacles, row) == [10.0, 20.0, 30.0, 40.0]
    for x in (0.0, 10.0, 20.0, 30.0, 40.0, 50.0):
        # Each is where a state allows it to be: within its errors, and what bounds add until then.
        assert any(
            abs(states.points[place, 0, 0] - x)
            <= states.position_error[place] + (states.velocity_error[place] + 0.2) * 0.04 + 1e-6
            for states, place, _ in possible(obstacles, row)
        )
    check_invariants(obstacles)
    # Another body's are its own.
    assert len(possible(obstacles, see(obstacles, 0.05, id="b"))) == 1


def test_each_sample_is_possible_for_its_time_from_the_tick_that_saw_it_first():
    """Whatever its stamp: late, ahead, or the same as another's."""
    obstacles = Obstacles()
    row = see(obstacles, 5.0)
    obstacles.forget_refused(5.0, LASTING)
    for now, stamp, x in ((5.1, 3.0, 10.0), (5.2, 5.35, 20.0), (5.3, 5.0, 30.0)):
        see(obstacles, stamp, x=x)
        obstacles.forget_refused(now, LASTING)
    assert refused(obstacles, row) == [10.0, 20.0, 30.0]
    left = {10.0, 20.0, 30.0}
    for now, gone in ((5.39, None), (5.41, 10.0), (5.49, None), (5.51, 20.0), (5.61, 30.0)):
        see(obstacles, 5.0)
        obstacles.forget_refused(now, LASTING)
        left -= {gone}
        assert set(refused(obstacles, row)) == left
        check_invariants(obstacles)
    assert not len(obstacles.refused_rows())


def test_a_sample_counts_in_the_tick_that_sees_it_even_if_it_lasts_no_time():
    obstacles = Obstacles()
    row = see(obstacles, 0.0)
    see(obstacles, 0.01, x=10.0)
    obstacles.forget_refused(0.01, 0.0)
    assert refused(obstacles, row) == [10.0]
    obstacles.forget_refused(0.011, 0.0)
    assert refused(obstacles, row) == []


@pytest.mark.hazard("H-03")
def test_a_clock_that_is_set_back_keeps_nothing_longer_than_from_then_on():
    obstacles = Obstacles()
    row = see(obstacles, 1000.0)
    see(obstacles, 1000.0, x=10.0)
    see(obstacles, 1000.01, x=math.nan)
    obstacles.forget_refused(1000.0, LASTING)
    for now, count, unknown in ((3.0, 1, True), (3.29, 1, True), (3.31, 0, False)):
        obstacles.forget_refused(now, LASTING)
        assert (len(refused(obstacles, row)), obstacles.table.unknown[row]) == (count, unknown)


@pytest.mark.parametrize("how", ["removed", "snapshot"])
def test_a_body_that_comes_anew_has_nothing_of_what_was_refused_before(how):
    obstacles = Obstacles()
    see(obstacles, 0.0)
    see(obstacles, 0.01, x=10.0)
    see(obstacles, 0.02, x=math.nan)
    if how == "removed":
        obstacles.remove(["a"])
    else:
        obstacles.update([], 0.03, snapshot=True)
    assert not len(obstacles.refused_rows())
    row = see(obstacles, 0.04, x=20.0)
    assert len(possible(obstacles, row)) == 1
    assert not obstacles.table.refused[row]
    check_invariants(obstacles)


def test_of_a_body_that_was_never_believed_the_refused_samples_are_all_there_is():
    obstacles = Obstacles()
    row = see(obstacles, 0.0, velocity=[[7.0, 0.0, 0.0]])
    for now in (0.0, 1.0, 100.0):
        obstacles.forget_refused(now, LASTING)
        assert len(possible(obstacles, row)) == 1
    lost = see(obstacles, 0.0, x=math.nan, id="lost")
    for now in (100.0, 200.0):
        obstacles.forget_refused(now, LASTING)
        assert possible(obstacles, lost) == []
    see(obstacles, 200.0, id="lost")
    obstacles.forget_refused(201.0, LASTING)
    assert len(possible(obstacles, lost)) == 1


def furthest(along, error, accel, speed, measured, velocity_error, time):
    """Of a free body along a direction, as the design has it; independent of compiled code."""
    top = speed if measured - velocity_error <= speed else measured + velocity_error
    start = min(top, along + velocity_error)
    if math.isinf(accel):
        return error + top * time
    ramp = min(time, (top - start) / accel if accel > 0.0 else math.inf)
    return error + start * ramp + accel * ramp * ramp / 2.0 + top * (time - ramp)


def test_a_state_that_covers_another_sample_bounds_all_that_becomes_of_it():
    """Along every direction, at every later time: checked against the bound of the sample."""
    rng = np.random.default_rng(5)
    covered = refused_to = 0
    for _ in range(4000):
        states = make_states(2, 2)
        count = rng.integers(1, 3)
        accel, speed = rng.choice([0.0, 2.0, 10.0, math.inf]), rng.choice([0.5, 2.0])
        error, rate_error = rng.choice([1e-9, 0.002, 0.05]), rng.choice([1e-9, 0.2, speed])
        h = rng.choice([0.0, 0.01, 0.04, 0.2, 0.5])
        states.points[0, :count] = rng.normal(size=(count, 3))
        direction = rng.normal(size=(count, 3))
        velocity = direction / np.linalg.norm(direction, axis=1)[:, None] * rng.uniform(0, speed)
        states.velocities[0, :count] = velocity
        states.point_count[0], states.radius[0] = count, 0.1
        states.accel[0], states.speed[0] = accel, speed
        states.position_error[0], states.velocity_error[0] = error, rate_error
        slack = rng.choice([0.2, 1.0, 2.0, 3.0])
        reach = min(accel, 50.0) * h
        push = rng.normal(size=(count, 3))
        push /= np.linalg.norm(push, axis=1)[:, None]
        v1 = velocity + push * (reach + rate_error) * rng.uniform(0.0, slack)
        v1 *= np.minimum(1.0, speed / np.maximum(np.linalg.norm(v1, axis=1), 1e-9))[:, None]
        moved = velocity * h + push * (reach * h / 2.0 + error) * rng.uniform(0.0, slack)
        x1 = states.points[0, :count] + moved
        before = [array[0].copy() for array in states]
        mine = 0.15, rng.choice([accel, 2.0 * accel]), speed
        sample = make_states(2, 2)
        sample.points[1, :count], sample.velocities[1, :count] = x1, v1
        sample.point_count[1], sample.stamp[1] = count, h
        sample.position_error[1], sample.velocity_error[1] = error, rate_error
        done = widen_to_cover(states, 0, Record(sample, 1, *mine), COVERING)
        if not done:
            refused_to += 1
            after = [array[0] for array in states]
            assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
            continue
        covered += 1
        assert states.position_error[0] <= max(before[6], 3.0 * error)
        assert states.velocity_error[0] <= max(before[7], 3.0 * rate_error)
        assert states.radius[0] == 0.15
        for k in range(count):
            for _ in range(6):
                m = rng.normal(size=3)
                m /= np.linalg.norm(m)
                later = rng.choice([0.0, 0.01, 0.1, 0.4])
                fast0 = np.linalg.norm(velocity[k])
                base = m @ states.points[0, k] + furthest(
                    m @ velocity[k], states.position_error[0], states.accel[0], states.speed[0],
                    fast0, states.velocity_error[0], h + later,
                )  # fmt: skip
                sample = m @ x1[k] + furthest(
                    m @ v1[k], error, mine[1], speed, np.linalg.norm(v1[k]), rate_error, later
                )
                assert sample <= base + 1e-11
    assert covered > 500
    assert refused_to > 500


def test_samples_of_one_track_share_a_place_for_as_long_as_they_come():
    """Measured at 100 Hz with their errors, as a swapped marker is, turn by turn with the other."""
    rng = np.random.default_rng(2)
    obstacles = Obstacles()
    told = {"position_error": 0.002, "velocity_error": 0.3}
    for k in range(60):
        stamp = 0.01 * k
        noise = rng.uniform(-0.002, 0.002) / 2.0
        moving = [[0.5 + rng.uniform(-0.1, 0.1), 0.0, 0.0]]
        x = (0.5 * stamp if k % 2 == 0 else 3.0 + 0.5 * stamp) + noise
        row = see(obstacles, stamp, x=x, velocity=moving, **told)
        obstacles.forget_refused(stamp, LASTING)
        assert len(refused(obstacles, row)) == min(k, 1)
    obstacles.forget_refused(0.6 + LASTING, LASTING)
    assert not obstacles.table.refused[row]


def test_before_its_stamp_a_sample_in_a_shared_place_is_bounded_too():
    """Stamped ahead of the clock: where it was before is not what the other one becomes."""
    told = {"position_error": 0.05, "velocity_error": 2.0}
    obstacles = Obstacles()
    row = see(obstacles, 1.0, **told)
    see(obstacles, 1.05, x=5.0, velocity=[[1.0, 0.0, 0.0]], **told)
    see(obstacles, 1.15, x=5.2, velocity=[[-1.0, 0.0, 0.0]], **told)
    assert refused(obstacles, row) == [5.0]
    for now in (1.06, 1.02, 1.1):
        obstacles.forget_refused(now, LASTING)
        _, (states, place, age) = possible(obstacles, row, now)
        # As fast as it may be, it came from there.
        furthest_back = 5.2 + 0.05 + 2.0 * (1.15 - now)
        grown = states.speed[place] * max(age, 0.0)
        assert furthest_back <= 5.0 + states.position_error[place] + grown
    widened = states.position_error[place]
    obstacles.forget_refused(1.2, LASTING)
    assert states.position_error[place] == widened
    # Without a bound on its speed it could be anywhere.
    row = see(obstacles, 1.0, id="b", speed=math.inf, position_error=0.05)
    for stamp in (1.05, 1.15):
        obstacles.update(["b"], stamp, [[[50.0, 0.0, 0.0]] * 2], radius=0.1, speed=math.inf)
    assert len(refused(obstacles, row)) == 1
    obstacles.forget_refused(1.1, LASTING)
    assert obstacles.table.unknown[row]
    check_invariants(obstacles)


def test_hulls_and_late_samples_have_places_of_their_own():
    obstacles = Obstacles()
    row = see(obstacles, 1.0)
    see(obstacles, 1.01, x=5.0)
    obstacles.update(["a"], 1.02, [[[5.0, 0, 0], [5.0, 0, 1]]], radius=0.1)
    see(obstacles, 1.0, x=5.0)
    assert refused(obstacles, row) == [5.0, 5.0, 5.0]
