"""Against brute force: every sphere of the arm, and fine steps in time, in plain NumPy."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armguard.bounds import IsotropicMotion
from armguard.bounds.arm import ArmMotion
from armguard.obstacles import Obstacles
from armguard.pairs.evaluate import TickState, evaluate
from armguard.pairs.scene import ISOTROPIC, REACH
from armguard.robot import Kinematics
from support.panda_monitor import panda
from support.tick_states import begin_tick

KINEMATICS = Kinematics(panda())
SPHERES = KINEMATICS.spheres
COUNT = len(SPHERES)
LEAVES = np.flatnonzero(SPHERES.child_count == 0)
LINKS = len(panda().links)
MARGIN = 0.02
MOTION = ArmMotion(panda(), 0.02, with_joints=False)


def read_only(array):
    array.flags.writeable = False  # as those of a motion model: else kernels compile anew
    return array


def free_bodies(isotropic):
    """A motion whose spheres are free bodies, and may get anywhere."""
    anywhere = SimpleNamespace(
        link_balls=read_only(np.tile([0.0, 0.0, 0.0, np.inf], (LINKS, 1))),
        arm_ball=read_only(np.array([0.0, 0.0, 0.0, np.inf])),
    )
    return SimpleNamespace(**vars(MOTION) | {"isotropic": isotropic, "reach": anywhere})


def free_motion(rng):
    """Bounds on accelerations alone, for which contact times have a closed form."""
    bounds = {
        "accel": np.full(COUNT, rng.uniform(1.0, 20.0)),
        "speed": np.full(COUNT, np.inf),
        "position_error": np.full(COUNT, rng.uniform(0.0, 0.01)),
        "velocity_error": np.full(COUNT, rng.uniform(0.0, 0.05)),
    }
    errors = MOTION.isotropic.velocity_errors
    bounds = {name: read_only(array) for name, array in bounds.items()}
    return free_bodies(SimpleNamespace(**bounds, velocity_errors=errors))


def make_state(motion, obstacles, *, margin=MARGIN):
    return TickState(KINEMATICS, motion, obstacles, margin=margin)


def look(state, rows, now, arm_age=0.0, refinement_threshold=math.inf):
    """Contact times, shape (rows, links), the deciding spheres, their bounds, and evaluations."""
    pairs = np.concatenate([np.arange(LINKS) + row * LINKS for row in rows])
    times, nodes = np.full(len(pairs), -1.0), np.full(len(pairs), -1)
    bounds = np.full(len(pairs), -1, dtype=np.int8)
    begin_tick(state, now, arm_age, refinement_threshold)
    spent = evaluate(state, pairs, times, nodes, bounds)
    return *(answer.reshape(len(rows), LINKS) for answer in (times, nodes, bounds)), spent


def random_pose(rng):
    robot = panda()
    low, high = robot.lower_position_limit, robot.upper_position_limit
    q = low + rng.uniform(0.1, 0.9, 7) * (high - low)
    KINEMATICS.compute(q, rng.uniform(-1.0, 1.0, 7) * robot.velocity_limit)


def hull_distance(points, centers):
    """From centres (n, 3) to the hull of 1 or 2 points, or of an upright box's 8. Shape (n,)."""
    if len(points) == 8:
        nearest = np.clip(centers, points.min(axis=0), points.max(axis=0))
    elif len(points) == 2:
        along = points[1] - points[0]
        share = np.clip((centers - points[0]) @ along / max(along @ along, 1e-300), 0.0, 1.0)
        nearest = points[0] + share[:, None] * along
    else:
        nearest = points[0]
    return np.linalg.norm(centers - nearest, axis=1)


def brute_force(motion, body, now, arm_age, horizon=3.0, step=1e-3):
    """Earliest contact of each link with one body, accelerations alone being bounded.

    Steps finely in time, and halves the first step in which reachable balls meet.
    """
    centers, velocities = KINEMATICS.centers, KINEMATICS.velocities
    motion = motion.isotropic
    reach = SPHERES.radius + motion.position_error + body["radius"] + MARGIN
    reach += body["position_error"]
    age = now - body["stamp"]

    def apart(t, sphere=slice(None)):
        arm_time, body_time = arm_age + t, age + t
        gap = hull_distance(
            body["points"] + body["velocities"] * body_time,
            (centers + velocities * arm_time)[sphere],
        )
        grown = motion.velocity_error * abs(arm_time)
        grown += 0.5 * motion.accel * arm_time**2
        grown += body["velocity_error"] * abs(body_time) + 0.5 * body["accel"] * body_time**2
        return gap > (reach + grown)[sphere]

    first = np.full(COUNT, np.inf)
    for t in np.arange(0.0, horizon, step):
        first[~apart(t) & np.isinf(first)] = t
        if np.isfinite(first).all():
            break
    for i in np.flatnonzero((first > 0.0) & np.isfinite(first)):
        low, high = first[i] - step, first[i]
        while high - low > 1e-12:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if apart(middle, [i])[0] else (low, middle)
        first[i] = low
    return first_of_links(first)


def first_of_links(times):
    """Each sphere's proof holds for all that it owns: the best on the way to each leaf counts."""
    best = times.copy()
    for sphere, (child, count) in enumerate(
        zip(SPHERES.first_child, SPHERES.child_count, strict=True)
    ):
        if count:
            best[child : child + count] = np.maximum(best[child : child + count], best[sphere])
    of_link = np.full(LINKS, np.inf)
    np.minimum.at(of_link, SPHERES.link[LEAVES], best[LEAVES])
    return of_link


def random_body(rng, count, stamp):
    center = rng.normal(size=3)
    center *= rng.uniform(0.8, 3.0) / np.linalg.norm(center)
    points = center + rng.uniform(-0.3, 0.3, (count, 3))
    velocities = rng.uniform(-1.0, 1.0, (count, 3))
    if count == 8:
        corners = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)]) - 0.5
        points = center + corners * rng.uniform(0.1, 0.6, 3)
        velocities[:] = velocities[0]
    return {
        "points": points,
        "velocities": velocities,
        "radius": rng.uniform(0.0, 0.2),
        "accel": rng.uniform(0.0, 15.0),
        "position_error": rng.uniform(0.0, 0.02),
        "velocity_error": rng.uniform(0.0, 0.1),
        "stamp": stamp,
    }


def report(obstacles, name, body, **changes):
    obstacles.update(
        [name],
        body["stamp"],
        body["points"][None],
        body["velocities"][None],
        radius=body["radius"],
        accel=body["accel"],
        speed=changes.get("speed", math.inf),
        position_error=body["position_error"],
        velocity_error=body["velocity_error"],
    )
    return obstacles.row(name)


@pytest.mark.parametrize("count", [1, 2, 8])
@pytest.mark.parametrize("seed", range(4))
def test_contact_times_are_those_of_brute_force(count, seed):
    rng = np.random.default_rng([count, seed])
    random_pose(rng)
    motion, obstacles = free_motion(rng), Obstacles()
    now = 10.0
    arm_age = rng.choice([0.0, 0.004, -0.003])
    bodies = [random_body(rng, count, now - rng.choice([0.0, 0.05, -0.02])) for _ in range(3)]
    rows = [report(obstacles, str(i), body) for i, body in enumerate(bodies)]
    state = make_state(motion, obstacles)
    times, nodes, bounds, spent = look(state, rows, now, arm_age)
    assert spent > len(rows) * LINKS
    assert ((bounds == ISOTROPIC) | (times == 0.0)).all()
    closed, _, bounds, few = look(state, rows, now, arm_age, refinement_threshold=0.0)
    # Nothing matters: what the arm cannot leave is all that is asked for, once and for each link.
    assert few == len(rows) * (1 + LINKS)
    assert (bounds == REACH).all()
    for i, body in enumerate(bodies):
        expected = brute_force(motion, body, now, arm_age)
        known = np.isfinite(expected)
        assert (times[i][known] <= expected[known] + 1e-9).all()
        assert times[i][known] == pytest.approx(expected[known], rel=1e-6, abs=1e-9)
        assert (closed[i][known] <= expected[known] + 1e-9).all()
        assert (SPHERES.link[nodes[i]] == np.arange(LINKS)).all()


def directions(count):
    """Unit vectors, evenly spread. Shape (count, 3)."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.pi * (3.0 - math.sqrt(5.0)) * np.arange(count)
    radius = np.sqrt(1.0 - z * z)
    return np.column_stack([radius * np.cos(turn), radius * np.sin(turn), z])


def advance(closing, accel, speed, t):
    """D(t) of a body that closes in as hard as it may."""
    closing = np.minimum(closing, speed)
    ramp = np.minimum((speed - closing) / accel, t)
    return closing * ramp + 0.5 * accel * ramp**2 + speed * (t - ramp)


@pytest.mark.parametrize("seed", range(3))
def test_panda_against_many_witnesses(seed):
    """With speed bounds: no better than the best of many witnesses, and hardly worse."""
    rng = np.random.default_rng(seed)
    random_pose(rng)
    motion, obstacles = IsotropicMotion(panda()), Obstacles()
    motion.update(np.zeros(7))
    body = random_body(rng, 1, 0.0) | {"accel": 10.0}
    center, velocity = body["points"][0], body["velocities"][0]
    row = report(obstacles, "ball", body, speed=2.0)
    times, *_ = look(make_state(free_bodies(motion), obstacles), [row], 0.0)

    apart = center - KINEMATICS.centers
    normals = np.tile(directions(300), (COUNT, 1, 1))
    relative = velocity - KINEMATICS.velocities
    carried = apart[:, None] + np.linspace(0.0, 1.0, 21)[:, None] * relative[:, None]
    carried /= np.linalg.norm(carried, axis=2, keepdims=True)
    normals = np.concatenate([normals, carried], axis=1)
    reach = SPHERES.radius + motion.position_error + body["radius"] + MARGIN
    gap0 = np.einsum("lnk,lk->ln", normals, apart) - (reach + body["position_error"])[:, None]
    closing1 = np.einsum("lnk,lk->ln", normals, KINEMATICS.velocities)
    closing1 += motion.velocity_error[:, None]
    closing2 = body["velocity_error"] - normals @ velocity
    accel1, speed1 = motion.accel[:, None], motion.speed[:, None]
    first = np.full(COUNT, np.inf)
    for t in np.arange(0.0, 2.0, 4e-3):
        gap = gap0 - advance(closing1, accel1, speed1, t) - advance(closing2, 10.0, 2.0, t)
        first[np.isinf(first) & ~(gap > 0.0).any(axis=1)] = t
    expected = first_of_links(first)
    assert (times[0] <= expected + 4e-3).all()
    assert (times[0] >= 0.9 * (expected - 4e-3)).all()


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 2.0))
def test_opening_later_never_lowers_a_time(seed, refinement_threshold):
    rng = np.random.default_rng(seed)
    random_pose(rng)
    obstacles = Obstacles()
    row = report(obstacles, "ball", random_body(rng, 1, 0.0))
    state = make_state(free_motion(rng), obstacles)
    closed, *_, few = look(state, [row], 0.0, refinement_threshold=0.0)
    ajar, *_, some = look(state, [row], 0.0, refinement_threshold=refinement_threshold)
    wide, *_, many = look(state, [row], 0.0)
    assert (closed <= ajar).all()
    assert (ajar <= wide).all()
    assert few <= some <= many
    # What was not opened wide was answered well beyond what matters.
    assert ((ajar == wide) | (ajar >= refinement_threshold)).all()


def test_extreme_values_end_in_contact_times():
    obstacles, tiny, huge = Obstacles(extent=math.inf), 5e-324, 1e300
    for i, (x, v, radius, accel, speed) in enumerate(
        [
            (huge, 0.0, 0.1, 10.0, 2.0),
            (-huge, 0.0, huge, 10.0, 2.0),
            (3.0, 0.0, tiny, tiny, tiny),
            (3.0, 0.0, 0.0, 0.0, 0.0),
            (3.0, 0.0, 0.1, math.inf, math.inf),
            (3.0, -huge, 0.1, huge, huge),
            (3.0, -1e160, 0.1, 10.0, math.inf),
        ]
    ):
        obstacles.update(
            [str(i)], 0.0, [[x, 0.0, 0.0]], [[v, 0.0, 0.0]], radius=radius, accel=accel, speed=speed
        )
    rows = [obstacles.row(str(i)) for i in range(7)]
    state = make_state(free_motion(np.random.default_rng(0)), obstacles)
    times, *_ = look(state, rows, 0.0)
    assert (times >= 0.0).all()
    assert (times[4] == 0.0).all()
    assert (times[5] < 1e-100).all()


@pytest.mark.parametrize("with_joints", [False, True])
def test_evaluations_of_many_pairs_are_those_of_each(with_joints):
    """Whatever is looked at together: rows in any order, each link by itself."""
    rng = np.random.default_rng(4)
    random_pose(rng)
    obstacles = Obstacles()
    rows = [report(obstacles, str(i), random_body(rng, 1, 0.0), speed=2.0) for i in range(5)]
    rows.append(
        report(obstacles, "lost", random_body(rng, 1, 0.0) | {"points": np.full((1, 3), np.nan)})
    )
    state = make_state(ArmMotion(panda(), 0.02, with_joints=with_joints), obstacles)
    begin_tick(state, 0.01, 0.0, 0.5)
    KINEMATICS.place(np.zeros(7))
    state.prepare_arm(np.zeros(7), np.zeros(7))
    pairs = rng.permutation(np.concatenate([np.arange(LINKS) + row * LINKS for row in rows]))
    answers = [np.zeros(len(pairs)), np.zeros(len(pairs), dtype=np.int64)]
    answers.append(np.zeros(len(pairs), dtype=np.int8))
    evaluate(state, pairs, *answers)
    for index, pair in enumerate(pairs):
        alone = [answer[:1].copy() for answer in answers]
        evaluate(state, np.array([pair]), *alone)
        assert [answer[index] for answer in answers] == [answer[0] for answer in alone]
