"""The rule for a whole scene: the worked case, brute force in plain NumPy, and its laws."""

import math
from types import SimpleNamespace
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pytest

from armguard.bounds import IsotropicMotion
from armguard.bounds.arm import ArmMotion
from armguard.exceptions import ArmguardError
from armguard.jit import pack
from armguard.obstacles import Obstacles
from armguard.pairs import SeparationRule, compute_separation
from armguard.pairs.evaluate import TickState
from armguard.pairs.scene import ArmArrays
from armguard.pairs.separation import distance_covered, separation_of
from armguard.pairs.separation_margin import SeparationMargin
from armguard.robot import Kinematics, Robot
from armguard.robot.kinematics import SphereTree
from support.tick_states import begin_tick

PANDA = Robot.load("panda")
KINEMATICS = Kinematics(PANDA)
SPHERES = KINEMATICS.spheres
LEAVES = np.flatnonzero(SPHERES.child_count == 0)
LINKS = len(PANDA.links)
MOTION = IsotropicMotion(PANDA)
NEARLY = 2e-9  # no position is known more exactly than to a nanometre
RESPONSE_TIME, STOP_TIME = 0.03, 0.25


class Part(NamedTuple):
    """What the rule reads of a scene."""

    tree: Any
    arm: Any
    bodies: Any
    refused: Any
    marks: Any


def make_arm(centers, velocities, accel, speed, position_error, velocity_error):
    nothing = np.zeros((1, 1))
    return ArmArrays(
        *(np.array(values, dtype=float) for values in (centers, velocities, accel, speed)),
        *(np.array(values, dtype=float) for values in (position_error, velocity_error)),
        lever=nothing,
        slope_error=nothing,
        link_balls=nothing,
        arm_ball=nothing,
    )


def one_sphere(
    center, velocity, radius, accel=0.0, speed=5.0, position_error=0.0, velocity_error=0.0
):
    """An arm of one sphere."""
    none = np.full(1, -1)
    tree = SphereTree(np.zeros(1, np.int64), none, none, none, np.array([radius]))
    arm = make_arm([center], [velocity], [accel], [speed], [position_error], [velocity_error])
    return tree, arm


def whole_arm():
    tree = SphereTree(*(np.array(values) for values in SPHERES.tree))
    arm = make_arm(
        KINEMATICS.centers, KINEMATICS.velocities, MOTION.accel, MOTION.speed,
        MOTION.position_error, MOTION.velocity_error,
    )  # fmt: skip
    return tree, arm


def scene_of(tree, arm, obstacles, now=0.0, arm_age=0.0):
    table = obstacles.table
    handle = pack(Part(tree, arm, table.accepted, table.refused_states, table.marks))
    return SimpleNamespace(handle=handle, now=now, arm_age=arm_age)


def ball(position, radius=0.1, stamp=0.0, **fields):
    obstacles = Obstacles(extent=math.inf)
    obstacles.update(["ball"], stamp, [position], [[0.0, 0.0, 0.0]], radius, **fields)
    return obstacles


def margin_of(state, rule=None, stop_time=STOP_TIME, watched=None, response=RESPONSE_TIME):
    rule = SeparationRule() if rule is None else rule
    return SeparationMargin(rule, response).margin(state, stop_time, watched)


@pytest.mark.parametrize("distance", [1.0, 1.24, 3.0])
def test_worked_case(distance):
    arm = one_sphere([0.0, 0.0, 0.0], [1.0, 0.5, 0.0], 0.1)
    state = scene_of(*arm, ball([distance + 0.1 + 0.2, 0.0, 0.0], radius=0.2))
    rule = SeparationRule(1.6, 0.20, 0.10, 0.05)
    assert margin_of(state, rule, 0.40, response=0.10) == pytest.approx(distance - 1.24, abs=NEARLY)


def test_a_receding_sphere_adds_nothing_and_errors_count():
    obstacles = ball([1.0, 0.0, 0.0], position_error=0.01)
    away = scene_of(*one_sphere([0.0, 0.0, 0.0], [-2.0, 0.0, 0.0], 0.1), obstacles)
    assert margin_of(away) == pytest.approx(0.8 - 0.01 - 1.6 * 0.25, abs=NEARLY)
    errors = {"position_error": 0.02, "velocity_error": 0.3}
    still = scene_of(*one_sphere([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 0.1, **errors), obstacles)
    expected = 0.8 - 0.01 - 0.02 - compute_separation(0.3, 0.03, 0.22)
    assert margin_of(still) == pytest.approx(expected, abs=NEARLY)


def test_what_may_have_happened_since_a_stamp_counts():
    arm = one_sphere([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.1, accel=2.0)
    obstacles = ball([2.0, 0.0, 0.0], accel=10.0, speed=2.0)
    fresh = margin_of(scene_of(*arm, obstacles))
    # From rest at 10 m/s²: 0.05 m in 0.1 s, then at 2 m/s.
    assert margin_of(scene_of(*arm, obstacles, now=0.1)) == pytest.approx(fresh - 0.05, abs=NEARLY)
    assert margin_of(scene_of(*arm, obstacles, now=0.3)) == pytest.approx(fresh - 0.4, abs=NEARLY)
    for age in (0.1, -0.1):
        aged = margin_of(scene_of(*arm, obstacles, arm_age=age))
        gone = 0.1 + 0.5 * 2.0 * 0.1**2
        faster = compute_separation(1.2, 0.03, 0.22) - compute_separation(1.0, 0.03, 0.22)
        assert aged == pytest.approx(fresh - gone - faster, abs=NEARLY)


def test_speed_bounds_of_obstacles_where_told_so():
    arm = one_sphere([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 0.1)
    obstacles = ball([3.0, 0.0, 0.0], speed=2.5)
    own = margin_of(scene_of(*arm, obstacles), SeparationRule(human_speed=None))
    assert own == pytest.approx(2.8 - 2.5 * 0.25, abs=NEARLY)
    assert margin_of(scene_of(*arm, obstacles)) == pytest.approx(2.8 - 1.6 * 0.25, abs=NEARLY)
    unbounded = ball([3.0, 0.0, 0.0], speed=math.inf)
    state = scene_of(*arm, unbounded)
    assert margin_of(state, SeparationRule(human_speed=None)) == -math.inf
    assert margin_of(state) > 0.0


def test_statics_do_not_walk():
    obstacles = Obstacles()
    obstacles.add_static("table", [[2.0, 0.0, 0.0]], radius=0.5)
    arm = one_sphere([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.1)
    rule = SeparationRule(intrusion_distance=0.3)
    expected = 1.4 - compute_separation(1.0, 0.03, 0.22, human_speed=0.0)
    margin = margin_of(scene_of(*arm, obstacles, now=9.0), rule)
    assert margin == pytest.approx(expected, abs=NEARLY)


def test_what_comes_out_of_an_entrance_walks():
    arm = one_sphere([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.1)
    rule = SeparationRule(intrusion_distance=0.3)
    obstacles = Obstacles(speed=2.5)
    obstacles.add_entrance("door", [[3.0, 0.0, 0.0]], 0.5, 0.1)
    walking = ball([3.0, 0.0, 0.0], radius=0.75, speed=2.5)
    for chosen in (rule, msgspec.structs.replace(rule, human_speed=None)):
        margin = margin_of(scene_of(*arm, obstacles, now=9.0), chosen)
        assert margin == pytest.approx(margin_of(scene_of(*arm, walking), chosen), abs=1e-6)


def random_scene(random):
    low, high = PANDA.lower_position_limit, PANDA.upper_position_limit
    v = random.uniform(-1.0, 1.0, 7) * PANDA.velocity_limit
    KINEMATICS.compute(low + random.uniform(0.1, 0.9, 7) * (high - low), v)
    MOTION.update(v)
    obstacles = Obstacles()
    bodies = []
    for count in (1, 2, 8):
        number = int(random.integers(0, 4))
        corner = random.uniform([-1.5, -1.5, -1.0], [1.5, 1.5, 2.0], (number, 1, 3))
        if count == 8:
            size = random.uniform(0.05, 0.4, (number, 1, 3))
            signs = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T
            points = corner + signs * size
        else:
            points = corner + random.uniform(-0.4, 0.4, (number, count, 3))
        velocity = np.zeros(points.shape) + random.uniform(-1.0, 1.0, (number, 1, 3))
        radius, error = random.uniform(0.0, 0.2, number), random.uniform(0.0, 0.05, number)
        obstacles.update(
            [f"{count}-{k}" for k in range(number)], 0.0, points, velocity, radius, 10.0, 2.0,
            error,
        )  # fmt: skip
        bodies += list(zip(points, radius, error, strict=True))
    return obstacles, bodies


def nearest_points(points, centers):
    """On the hull of 1 or 2 points, or of an upright box's 8. Shape (n, 3)."""
    if len(points) == 8:
        return np.clip(centers, points.min(axis=0), points.max(axis=0))
    along = points[-1] - points[0]
    share = np.clip((centers - points[0]) @ along / max(along @ along, 1e-300), 0.0, 1.0)
    return points[0] + share[:, None] * along


def brute_force(bodies, rule, stop_time, response):
    least = math.inf
    for points, radius, error in bodies:
        centers = KINEMATICS.centers[LEAVES]
        gap = nearest_points(points, centers) - centers
        distance = np.linalg.norm(gap, axis=1)
        outside = distance > 0.0
        towards = np.einsum("ij,ij->i", gap, KINEMATICS.velocities[LEAVES])
        towards = np.divide(towards, distance, where=outside, out=np.zeros(len(gap)))
        inside = np.linalg.norm(KINEMATICS.velocities[LEAVES], axis=1)
        towards = np.where(outside, towards, inside) + MOTION.velocity_error[LEAVES]
        separation = compute_separation(
            np.clip(towards, 0.0, MOTION.speed[LEAVES]),
            response,
            stop_time - response,
            human_speed=rule.human_speed,
            intrusion_distance=rule.intrusion_distance,
            human_uncertainty=rule.human_uncertainty + error,
            robot_uncertainty=rule.robot_uncertainty + MOTION.position_error[LEAVES],
        )
        least = min(least, np.min(distance - SPHERES.radius[LEAVES] - radius - separation))
    return least


def test_against_brute_force():
    random = np.random.default_rng(3)
    scenes_with_bodies = 0
    for _ in range(300):
        obstacles, bodies = random_scene(random)
        rule = SeparationRule(*random.uniform(0.0, [2.0, 0.2, 0.1, 0.1]))
        response = random.uniform(0.0, 0.1)
        stop_time = response + random.uniform(0.0, 0.5)
        state = scene_of(*whole_arm(), obstacles)
        found = margin_of(state, rule, stop_time, response=response)
        expected = brute_force(bodies, rule, stop_time, response)
        assert found <= expected + 1e-9
        assert found == pytest.approx(expected, abs=1e-8)
        scenes_with_bodies += len(bodies) > 0
    assert scenes_with_bodies > 250


def test_a_ticks_state_gives_the_same():
    obstacles, _ = random_scene(np.random.default_rng(8))
    obstacles.update(["more"], 0.0, [[0.8, 0.3, 0.6]], [[0.0, 0.0, 0.0]], 0.1)
    motion = ArmMotion(PANDA, 0.02)
    motion.isotropic.velocity_errors.error[:] = MOTION.velocity_error
    state = TickState(KINEMATICS, motion, obstacles, margin=0.0)
    begin_tick(state, 0.02, 0.001, 0.0)
    margin = SeparationMargin(SeparationRule(), RESPONSE_TIME)
    margin.compile(state)
    expected = margin_of(scene_of(*whole_arm(), obstacles, 0.02, 0.001))
    assert margin.margin(state, STOP_TIME) == expected


def test_only_what_is_watched_counts():
    random = np.random.default_rng(4)
    obstacles, bodies = random_scene(random)
    while len(bodies) < 3:
        obstacles, bodies = random_scene(random)
    state = scene_of(*whole_arm(), obstacles)
    rows = len(obstacles.table.alive)
    everything = margin_of(state)
    parts = []
    for pair in range(len(bodies) * LINKS):
        watched = np.zeros(rows * LINKS, dtype=bool)
        watched[pair] = True
        parts.append(margin_of(state, watched=watched))
    assert min(parts) == everything < max(parts)
    assert margin_of(state, watched=np.zeros(rows * LINKS, dtype=bool)) == math.inf
    assert margin_of(state, watched=np.ones(rows * LINKS, dtype=bool)) == everything


def test_never_more_for_more_of_anything():
    random = np.random.default_rng(5)
    for _ in range(30):
        obstacles, bodies = random_scene(random)
        if not bodies:
            continue
        state = scene_of(*whole_arm(), obstacles, now=0.01)
        numbers = random.uniform(0.0, 0.3, 4)
        base = margin_of(state, SeparationRule(*numbers))
        for k in range(4):
            more = numbers.copy()
            more[k] += 0.1
            assert margin_of(state, SeparationRule(*more)) <= base
        assert margin_of(state, SeparationRule(*numbers), 0.3) <= base
        longer = margin_of(state, SeparationRule(*numbers), 0.25, response=0.05)
        assert longer <= base + 1e-9  # more of the same time before the brakes bite
        for now, arm_age in ((0.02, 0.0), (0.01, 0.002), (0.01, -0.002)):
            aged = scene_of(*whole_arm(), obstacles, now, arm_age)
            assert margin_of(aged, SeparationRule(*numbers)) <= base + 1e-9


def test_both_tracks_count_until_one_is_confirmed():
    arm = one_sphere([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 0.1)
    obstacles = ball([3.0, 0.0, 0.0])
    obstacles.update(["ball"], 0.01, [[1.0, 0.0, 0.0]], [[0.0, 0.0, 0.0]], 0.1)
    assert obstacles.table.refused.any()
    refused = margin_of(scene_of(*arm, obstacles, now=0.01))
    assert refused == pytest.approx(0.8 - 1.6 * 0.25, abs=NEARLY)


def test_what_is_unknown_is_the_worst():
    arm = one_sphere([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 0.1)
    assert margin_of(scene_of(*arm, Obstacles())) == math.inf
    first = ball([math.nan, 0.0, 0.0])
    assert margin_of(scene_of(*arm, first)) == -math.inf
    lost = ball([3.0, 0.0, 0.0])
    lost.update(["ball"], 0.01, [[math.nan, 0.0, 0.0]], [[0.0, 0.0, 0.0]], 0.1)
    assert margin_of(scene_of(*arm, lost)) == -math.inf
    known = scene_of(*arm, ball([3.0, 0.0, 0.0]))
    for stop_time in (math.nan, math.inf):
        assert margin_of(known, stop_time=stop_time) == -math.inf
    known.now = math.nan
    assert margin_of(known) == -math.inf
    known.now, known.arm_age = 0.0, math.nan
    assert margin_of(known) == -math.inf


@pytest.mark.parametrize("bad", [math.nan, math.inf])
@pytest.mark.parametrize("where", ["center", "velocity", "position_error", "velocity_error"])
def test_an_arm_that_is_nowhere_has_no_margin(where, bad):
    fields = {"center": [0.0, 0.0, 0.0], "velocity": [0.0, 0.0, 0.0], "radius": 0.1}
    if where in fields:
        fields[where] = [bad, 0.0, 0.0]
    else:
        fields[where] = bad
    margin = margin_of(scene_of(*one_sphere(**fields), ball([3.0, 0.0, 0.0])))
    if where == "velocity_error" and bad == math.inf:
        # Its speed is bounded all the same.
        assert margin == pytest.approx(2.8 - compute_separation(5.0, 0.03, 0.22), abs=NEARLY)
    else:
        assert margin == -math.inf


@pytest.mark.parametrize("field", ["centers", "velocities", "position_error", "velocity_error"])
def test_no_sphere_that_is_nowhere_is_overlooked(field):
    obstacles, _ = random_scene(np.random.default_rng(7))
    obstacles.update(["near"], 0.0, [[0.4, 0.0, 0.6]], [[0.0, 0.0, 0.0]], 0.3)
    tree, arm = whole_arm()
    for leaf in LEAVES:
        before = np.copy(getattr(arm, field)[leaf])
        getattr(arm, field)[leaf] = math.nan
        assert margin_of(scene_of(tree, arm, obstacles)) == -math.inf
        getattr(arm, field)[leaf] = before
    assert margin_of(scene_of(tree, arm, obstacles)) > -math.inf


@pytest.mark.parametrize("scale", [1e-200, 1e-30, 1e30, 1e160, 1e300])
def test_no_distance_is_too_great_or_small(scale):
    arm = one_sphere([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 0.1)
    margin = margin_of(scene_of(*arm, ball([scale, 0.0, 0.0])))
    assert margin <= scale - 0.2 - 1.6 * 0.25
    if 1e-10 < scale < 1e150:
        assert margin == pytest.approx(scale - 0.6, rel=1e-9)


def test_what_is_no_rule_is_refused():
    with pytest.raises(ArmguardError, match="separation"):
        SeparationMargin("strict", 0.03)


@pytest.mark.parametrize("name", [*SeparationRule.__struct_fields__, "response_time"])
@pytest.mark.parametrize("bad", [-0.1, math.nan, math.inf, "far"])
def test_bad_parameters_are_refused_by_name(name, bad):
    numbers = {"response_time": 0.03, name: bad}
    response = numbers.pop("response_time")
    with pytest.raises(ArmguardError) as caught:
        SeparationMargin(SeparationRule(**numbers), response)
    assert caught.value.offender == name


def test_the_compiled_formula_is_the_public_one():
    random = np.random.default_rng(6)
    for _ in range(100):
        speed, reaction, stopping, human, *offsets = random.uniform(0.0, 2.0, 7)
        names = ("intrusion_distance", "human_uncertainty", "robot_uncertainty")
        expected = compute_separation(
            speed, reaction, stopping, human_speed=human, **dict(zip(names, offsets, strict=True))
        )
        found = separation_of(speed, reaction, stopping, human, sum(offsets))
        assert found == pytest.approx(expected, rel=1e-12)
    assert distance_covered(0.0, math.inf) == distance_covered(math.inf, 0.0) == 0.0
    assert math.isnan(distance_covered(math.nan, 0.0))
    assert math.isnan(separation_of(1.0, 0.1, math.nan, 1.0, 0.0))
