"""No point of the surface is faster, or goes farther, than its bound, in motions within limits.

ARMGUARD_MOTIONS sets how many motions are tried in all; a million take some minutes.
"""

import os

import numpy as np
import pytest

from armguard.bounds import BrakingMotion, JointMotion
from armguard.bounds.joint_table import set_span
from armguard.bounds.surface_speed import (
    find_harmless_node,
    harmless_time,
    set_joints,
    speed_from,
    speed_in_box,
    speed_until,
    way_from,
)
from armguard.bounds.table_time import ArmSphere
from armguard.jit.kernels import kernel
from armguard.robot.kinematics import Kinematics
from armguard.robot.operating_limits import OperatingLimits
from support.example_arms import load_arm
from support.hostile_joints import STEP, chain_to, pick_error, random_state
from support.hostile_speeds import (
    Drive,
    ball_speed,
    drive_arm,
    farthest_ways,
    find_goals,
    place_ball,
)

MOTIONS = int(os.environ.get("ARMGUARD_MOTIONS", "4000"))
ARMS = ("panda", "xarm7", "ur5", "tiago")
EACH = 25  # motions from one state
REACTION = 0.02
FREE_STEPS = 300
SPOTS = 20  # of a motion, between which ways are compared


@kernel
def fill_bounds(sphere, radius, moves, table, brakes, speeds, ways):
    count = set_joints(sphere, moves, table.box)
    for k in range(speeds.shape[0]):
        if not brakes:
            speeds[k] = speed_until(radius, count, table, k, np.inf)
        else:
            speeds[k] = speed_from(radius, count, table, k, np.inf)
            ways[k] = way_from(radius, count, table, k)


@kernel
def race(
    chain, drive, q, v, error_q, error_v, now, start, end, free, local, radius, around, motions,
    pace_by_step, way_by_step, random,
):  # fmt: skip
    """Fill the greatest speeds at each step, and the greatest ways from each on; how many ran.

    Rows of `q` and `v` up to `start`, the stamp, are how joints came there; the true state of each
    motion is within errors of the last of them, unless these rows say how it came there.
    """
    spots = np.empty((end + 1, 18))
    few, ways = np.empty((SPOTS, 18)), np.zeros(SPOTS)
    at = now + np.arange(SPOTS) * (end - now) // (SPOTS - 1)
    true_q, true_v = q[start].copy(), v[start].copy()
    goals = np.zeros(q.shape[1])
    done = 0
    for _ in range(motions):
        for j in range(q.shape[1]):
            if start == 0:
                off = true_q[j] + pick_error(random) * error_q[j]
                q[0, j] = min(max(off, drive.lower[j]), drive.upper[j])
                off = true_v[j] + pick_error(random) * error_v[j]
                v[0, j] = min(max(off, -drive.top[j]), drive.top[j])
                if now == 0:
                    v[0, j] = min(max(v[0, j], -drive.pace[j]), drive.pace[j])
        goals[:] = 0.0
        if random.random() < 0.5:
            find_goals(chain, q[start], v[start], local, goals, random)
        if not drive_arm(drive, now, start, end, free, goals, q, v, random):
            continue
        done += 1
        for k in range(now, end + 1):
            place_ball(chain, q[k], v[k], local, spots[k])
            pace_by_step[k] = max(pace_by_step[k], ball_speed(spots[k], radius))
        if free > end:
            continue
        for c in range(SPOTS):
            few[c] = spots[at[c]]
        farthest_ways(few, SPOTS, radius, around, ways)
        for c in range(SPOTS):
            way_by_step[at[c]] = max(way_by_step[at[c]], ways[c])
    return done


def draw_brakes(random, curves, top, accel):
    """By deceleration, by time and distance alone, or by both; they hold at each speed."""
    kind = random.integers(0, 3)
    time = top / accel * random.uniform(1.0, 3.0, len(top))
    least = 0.5 * top**2 / accel
    distance = least + (top * time - least) * random.uniform(0.0, 1.0, len(top))
    held = accel * random.uniform(0.1, 1.0, len(top))
    curves.speed[:] = 10.0 * top[:, None]
    curves.deceleration[:] = 0.0 if kind == 1 else held[:, None]
    curves.time[:] = np.inf if kind == 0 else time[:, None]
    curves.distance[:] = np.inf if kind == 0 else distance[:, None]


class Racer:
    """One arm with what bounds it, under one set of operating limits."""

    def __init__(self, robot, operating=None):
        self.robot, self.kinematics = robot, Kinematics(robot)
        self.free = JointMotion(robot, operating=operating, with_velocities=True)
        self.braking = BrakingMotion(robot, REACTION, operating=operating, with_velocities=True)
        if operating is not None:
            # Its last joint turns without end.
            for model in (self.free, self.braking):
                model.limits.lower[-1], model.limits.upper[-1] = -np.inf, np.inf
        self.curves = self.braking.limits.brakes
        self.stated = [part.copy() for part in self.curves]

    def sphere(self, node, q, v):
        self.kinematics.compute(q, v)
        placement = self.kinematics.placement
        model = self.free
        sphere = ArmSphere(
            *self.kinematics.centers[node], placement.jacobian.T, model.lever[node],
            model.slope_error[node],
        )  # fmt: skip
        spheres = self.kinematics.spheres
        moves = placement.moves[placement.joint[node]]
        return sphere, float(spheres.radius[node]), moves

    def race(self, random, node, q, v, now, horizon, pace, brakes, motions):
        """Bounds at each node, and what was found there: speeds and ways, and speeds by step.

        `now` is the age in steps; the state is the true one where that is negative.
        """
        limits = (self.braking if brakes else self.free).limits
        top, start = limits.operating_velocity, max(-now, 0)
        drive = Drive(
            limits.lower, limits.upper, top.copy(), pace * top, limits.acceleration,
            limits.operating_acceleration, *(part[:, 0].copy() for part in self.curves[1:]),
        )  # fmt: skip
        now, age = max(now, 0), now * STEP
        rows_q, rows_v = np.zeros((2, 4000, len(q)))
        rows_q[0], rows_v[0] = np.clip(q, limits.lower, limits.upper), np.clip(v, -top, top)
        if start > 0:
            rows_v[0] = np.clip(v, -pace * top, pace * top)
            if not drive_arm(
                drive, now, 0, start, start + 1, np.zeros(len(q)), rows_q, rows_v, random
            ):
                return None
        errors = limits.position_error, limits.velocity_error
        sizes = random.choice([-1.0, 0.0, 1.0], (2, len(q))) * (start > 0)
        q, v = rows_q[start] + sizes[0] * errors[0], rows_v[start] + sizes[1] * errors[1]
        if brakes:
            table = self.braking.tabulate(q, v, age, horizon * STEP, pace=pace)
            free = now + horizon + round(REACTION / STEP)
            end = now + int(np.ceil(table.time[-1] / STEP)) + 2
        else:
            table, end = self.free.tabulate(q, v, age), now + FREE_STEPS
            free = end + 1
        assert end < len(rows_q)
        sphere, radius, moves = self.sphere(node, q, v)
        given = sphere, radius, moves, table
        bounds, most = np.zeros((2, len(table.time)))
        fill_bounds(*given, brakes, bounds, most)
        spheres = self.kinematics.spheres
        around = random.normal(size=(5, 3))
        around /= np.linalg.norm(around, axis=1)[:, None]
        around[0] = 0.0
        pace_by_step, way_by_step = np.zeros((2, end + 1))
        ran = race(
            chain_to(self.robot, int(spheres.joint[node])), drive, rows_q, rows_v, *errors, now,
            start, end, free, spheres.local[node], radius, around, motions, pace_by_step,
            way_by_step, random,
        )  # fmt: skip
        times = (np.arange(end + 1) - now) * STEP
        found = np.zeros((2, len(table.time)))
        for k, time in enumerate(table.time):
            there = times >= time if brakes else (times >= 0.0) & (times <= time)
            found[0, k] = pace_by_step[there].max(initial=0.0)
            found[1, k] = way_by_step[there].max(initial=0.0)
        paces = pace_by_step[now:], times[now:]
        return given, bounds, most, found, paces, ran


def draw_state(random, robot, top, accel, age, pace):
    q, v = random_state(robot, random)
    most = top * pace
    if random.random() < 0.5:
        most = np.minimum(most + accel * max(age, 0) * STEP, top)
    return q, np.clip(v, -most, most)


def draw_case(random, racer, brakes):
    limits = racer.braking.limits
    age = int(random.choice([-5, -1, 0, 1, 10, 40]))
    pace = float(random.choice([1.0, random.uniform(0.05, 1.0)])) if brakes else 1.0
    q, v = draw_state(
        random, racer.robot, limits.operating_velocity, limits.acceleration, age, pace
    )
    node = int(random.integers(len(racer.kinematics.spheres)))
    return node, q, v, age, int(random.integers(0, 20)), pace


def states_of(name, kinds):
    robot = load_arm(name)
    operating = OperatingLimits.fraction(robot, velocity=0.5, acceleration=0.3)
    racers = [Racer(robot), Racer(robot, operating)]
    for number in range(max(8, MOTIONS // (len(ARMS) * kinds * EACH))):
        yield racers[number % 2]


def holds(found, bound):
    return found <= bound * (1.0 + 1e-9) + 1e-9


@pytest.mark.parametrize("name", ARMS)
def test_no_point_of_a_braking_arm_is_faster_or_goes_farther(name, record_property):
    random = np.random.default_rng(ARMS.index(name))
    closest, ran, ended = [], 0, 0
    for racer in states_of(name, 2):
        limits = racer.braking.limits
        draw_brakes(random, racer.curves, limits.operating_velocity, limits.acceleration)
        case = draw_case(random, racer, brakes=True)
        raced = racer.race(random, *case, True, EACH)
        if raced is None:
            continue
        given, speeds, ways, found, _, done = raced
        ran += done
        assert holds(found[0], speeds).all(), (case, found[0], speeds)
        # The table ends when all joints rest, but for one that its stop throws back.
        rests = speeds[-1] <= 1e-9
        ended += rests
        assert holds(found[1], ways).all() or not rests, (case, found[1], ways)
        for _ in range(3):
            max_speed = speeds[0] * random.uniform(0.01, 1.1) + 1e-6
            node, bound = find_harmless_node(*given, max_speed)
            before = node - 1
            if node + 1 < len(speeds):
                assert bound == speeds[node] <= max_speed
            else:
                assert bound == 0.0
            assert node == 0 or not speeds[before] <= max_speed
        if done and speeds[0] > 1e-3:
            closest.append((found[0, 0] / speeds[0], found[1, 0] / ways[0]))
    assert ended > 0
    tell(record_property, ran, np.array(closest))


@pytest.mark.parametrize("name", ARMS)
def test_no_point_of_a_free_arm_is_faster(name, record_property):
    random = np.random.default_rng(ARMS.index(name))
    closest, ran = [], 0
    for racer in states_of(name, 2):
        case = draw_case(random, racer, brakes=False)
        raced = racer.race(random, *case, False, EACH)
        if raced is None:
            continue
        given, speeds, _, found, (paces, times), done = raced
        ran += done
        within = given[3].time <= FREE_STEPS * STEP
        assert holds(found[0], speeds)[within].all(), (case, found[0], speeds)
        for _ in range(3):
            max_speed = random.uniform(0.5, 1.1) * speeds[random.integers(len(speeds))]
            until = harmless_time(*given, max_speed)
            assert 0.0 <= until <= given[3].time[-1]
            assert holds(paces[times < until], max_speed).all()
            slow = np.flatnonzero(speeds <= max_speed)
            assert until <= (given[3].time[slow[-1]] if len(slow) else 0.0)
        if done and speeds[0] > 1e-3:
            closest.append((found[0, 0] / speeds[0], found[0, 8] / speeds[8]))
    tell(record_property, ran, np.array(closest))


def tell(record_property, ran, closest):
    told = {
        "motions": ran,
        "found / bound, median": np.median(closest, axis=0).round(3).tolist(),
        "greatest": closest.max(axis=0).round(4).tolist(),
    }
    for key, value in told.items():
        record_property(key, value)
    assert ran > 0
    assert (closest.max(axis=0) > 0.5).all()


@pytest.mark.parametrize("speed", [0.3, 0.8])
def test_bounds_are_near_what_a_panda_at_work_can_do(speed, record_property):
    """The fastest sphere of an arm whose joints keep to a speed, 23 ms before brakes engage."""
    robot, random = load_arm("panda"), np.random.default_rng(0)
    share = 1.05 * speed / robot.velocity_limit.min()
    racer = Racer(robot, OperatingLimits.fraction(robot, velocity=share, acceleration=0.27))
    spheres, shares = racer.kinematics.spheres, []
    leaves = np.flatnonzero(spheres.first_child < 0)
    for _ in range(30):
        q = random.uniform(robot.lower_position_limit, robot.upper_position_limit)
        v = random.uniform(-speed, speed, 7)
        racer.kinematics.compute(q, v)
        paces = np.linalg.norm(racer.kinematics.velocities[leaves], axis=1)
        node = leaves[paces.argmax()]
        _, speeds, ways, found, _, _ = racer.race(random, node, q, v, 1, 3, 1.0, True, 100)
        _, free_speeds, _, free_found, _, _ = racer.race(random, node, q, v, 1, 3, 1.0, False, 100)
        shares.append(
            (paces.max(), found[0, 0], speeds[0], found[1, 0], ways[0], free_found[0, 5],
             free_speeds[5], free_found[0, 10], free_speeds[10])
        )  # fmt: skip
    shares = np.array(shares)
    told = np.median(shares, axis=0).round(3).tolist()
    record_property("now, found and bound: braking speed, way; free for 25 ms, 100 ms", told)
    assert np.median(shares[:, 1] / shares[:, 2]) > 0.6


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("what", ["velocity", "column", "displacement"])
def test_what_is_no_number_is_never_harmless(bad, what):
    robot = load_arm("panda")
    racer = Racer(robot)
    q, v = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.0]), np.full(7, 0.1)
    node = len(racer.kinematics.spheres) - 1
    for side in ("fastest", "slowest"):
        tables = racer.braking.tabulate(q, v, 0.0, 0.0), racer.free.tabulate(q, v, 0.0)
        sphere, radius, moves = racer.sphere(node, q, v)
        for table in tables:
            if what == "velocity":
                getattr(table, side)[:-1, 2] = bad
            elif what == "displacement":
                # Levers alone bound it then.
                table.high[:], table.highest[:] = bad, bad
        if what == "column":
            sphere = sphere._replace(x=bad)
        braking, free = tables
        last = len(braking.time) - 1
        limit = 1e9 if what != "displacement" else 0.01
        found = find_harmless_node(sphere, radius, moves, braking, limit)
        until = harmless_time(sphere, radius, moves, free, limit)
        if what == "displacement":
            assert found[0] > 0
            assert until == 0.0
        else:
            assert found == (last, 0.0)
            assert until == 0.0


def test_a_limit_of_zero_asks_for_rest():
    racer = Racer(load_arm("panda"))
    q, v = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.0]), np.full(7, 0.1)
    table = racer.braking.tabulate(q, v, 0.0, 0.0)
    sphere = racer.sphere(len(racer.kinematics.spheres) - 1, q, v)
    for max_speed in (0.0, np.nan):
        assert find_harmless_node(*sphere, table, max_speed) == (len(table.time) - 1, 0.0)
    assert find_harmless_node(*sphere, table, 10.0)[0] == 0
    free = racer.free.tabulate(q, v, 0.0)
    assert harmless_time(*sphere, free, 0.0) == harmless_time(*sphere, free, np.nan) == 0.0


def test_a_joint_that_turns_alone_is_as_fast_as_its_farthest_point():
    """Nearly exact at rest of all others: rate times the distance of the farthest point."""
    racer = Racer(load_arm("panda"))
    q, v = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.0]), np.zeros(7)
    v[0] = 0.5
    node = len(racer.kinematics.spheres) - 1
    table = racer.braking.tabulate(q, v, 0.0, 0.0)
    table.fastest[0], table.slowest[0] = v, v
    table.high[:], table.low[:] = 0.0, 0.0
    sphere, radius, moves = racer.sphere(node, q, v)
    speeds, ways = np.zeros((2, len(table.time)))
    fill_bounds(sphere, radius, moves, table, True, speeds, ways)
    exact = 0.5 * (np.hypot(sphere.x, sphere.y) + radius)
    assert exact <= speeds[0] <= 1.01 * exact


@kernel
def ask_box(sphere, radius, moves, slowest, fastest, box):
    return speed_in_box(radius, set_joints(sphere, moves, box), slowest, fastest, box, np.inf)


def bound_by_formula(sphere, radius, moves, slowest, fastest, box):
    """The bound as the module states it, sum by sum."""
    joints = np.flatnonzero(moves)
    turns, lever = box.turning[joints], sphere.lever[joints]
    axes = sphere.jacobian[3:, joints].T
    columns = sphere.jacobian[:3, joints].T + np.cross(axes, [sphere.x, sphere.y, sphere.z])
    high, low, size = box.span[:, joints]
    error = box.position_error[joints]
    middle, wide, size = 0.5 * (high + low), 0.5 * (high - low) + error, size + error
    mean, half = (0.5 * (fastest + sign * slowest)[joints] for sign in (1.0, -1.0))
    pace = np.abs(mean) + half
    count = len(joints)

    def keeps(*some):
        """Whether all but the most distal of some joints turn."""
        return all(turns[each] for each in sorted(some)[:-1])

    shifted = columns.copy()
    second = third = broad = 0.0
    for i in range(count):
        for j in range(count):
            if not keeps(i, j):
                continue
            shifted[j] += np.cross(axes[min(i, j)], columns[max(i, j)]) * middle[i]
            second += np.linalg.norm(columns[max(i, j)]) * wide[i] * pace[j]
            broad += lever[max(i, j)] * size[i] * pace[j]
            for k in range(count):
                if keeps(i, j, k):
                    third += 0.5 * lever[max(i, j, k)] * size[i] * size[k] * pace[j]
    bend = second + third
    if broad < bend:
        shifted, bend = columns, broad
    x = mean @ shifted
    square = x @ x + 2.0 * np.abs(shifted @ x) @ half
    square += half @ np.abs(shifted @ shifted.T) @ half
    rate = pace[turns].sum()
    twist = sum(size[i] * pace[j] for j in range(count) for i in range(j) if turns[i] and turns[j])
    turn = np.linalg.norm(mean[turns] @ axes[turns]) + half[turns].sum() + twist
    return min(np.sqrt(square) + bend, lever @ pace) + radius * min(turn, rate)


@pytest.mark.parametrize("name", ["panda", "tiago"])
def test_the_bound_is_what_is_proved_of_it(name):
    """Narrow boxes, in which each sum counts, and wide ones."""
    robot, random = load_arm(name), np.random.default_rng(ARMS.index(name))
    racer = Racer(robot)
    box = racer.free.table.box
    for size in np.repeat([1e-3, 0.03, 0.2, 1.0], 15):
        q, v = random_state(robot, random)[:2]
        node = random.integers(len(racer.kinematics.spheres))
        sphere, radius, moves = racer.sphere(node, q, v)
        ends = np.sort(random.uniform(-size, size, (2, len(q))), axis=0)
        box.span[:] = ends[1], ends[0], np.abs(ends).max(axis=0)
        slowest, fastest = np.sort(v + 0.3 * random.normal(size=(2, len(q))), axis=0)
        expected = bound_by_formula(sphere, radius, moves, slowest, fastest, box)
        found = ask_box(sphere, radius, moves, slowest, fastest, box)
        assert found == pytest.approx(expected, rel=1e-9)


def test_a_way_counts_all_that_joints_go_forth_and_back():
    """Of joints that may turn round: the whole way is more than that to either side."""
    robot, random = load_arm("panda"), np.random.default_rng(5)
    racer = Racer(robot)
    q, v = random_state(robot, random)
    table = racer.braking.tabulate(q, v, 0.0, 0.0)
    sphere, radius, moves = racer.sphere(len(racer.kinematics.spheres) - 1, q, v)
    last = len(table.time) - 1
    table.slowest[:last], table.fastest[:last] = np.sort(random.normal(size=(2, last, 7)), axis=0)
    speeds, ways = np.zeros((2, last + 1))
    fill_bounds(sphere, radius, moves, table, True, speeds, ways)
    steps = np.diff(table.time)[:, None]
    rise, fall = (np.maximum(each[:last], 0.0) * steps for each in (table.fastest, -table.slowest))
    for node in (0, last // 2, last - 1):
        up, down, whole = (each[node:].sum(axis=0) for each in (rise, fall, np.maximum(rise, fall)))
        forth, back = np.where(up >= down, whole, up), np.where(up >= down, down, whole)
        set_span(table, node, last, 1.0)
        way = bound_by_formula(sphere, 0.0, moves, -back, forth, table.box)
        assert ways[node] == pytest.approx(way + radius * whole[moves].sum(), rel=1e-9)
