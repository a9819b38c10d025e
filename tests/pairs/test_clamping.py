"""Where a body part could be clamped is never missed, nor how far a link presses it."""

import functools

import numpy as np
import pytest

from armguard.bounds.arm import ArmMotion
from armguard.bounds.joint_table import set_span
from armguard.jit.kernels import kernel
from armguard.obstacles import Obstacles
from armguard.obstacles.reference_states import keep_reference_state
from armguard.obstacles.regions import ContactLimit, RegionLimits
from armguard.pairs.clamping import (
    Clamp,
    find_clamp,
    find_near_obstacles,
    find_short_way_node,
    is_obstacle_near,
    is_same_person,
)
from armguard.pairs.contact_time import moves_of
from armguard.pairs.evaluate import TickState
from armguard.pairs.scene import MOST_NEAR, prepare_arm, sphere_of
from armguard.robot.kinematics import Kinematics
from support.example_arms import load_arm

NOW, HORIZON, REACTION = 5.0, 0.004, 0.02
GAP = 0.1


@functools.cache
def arm_of(name):
    """Kinematics, motion and how gaps between links vary."""
    robot = load_arm(name)
    kinematics = Kinematics(robot)
    motion = ArmMotion(robot, REACTION, with_velocities=True)
    return robot, kinematics, motion, motion.link_gaps


def draw_q(random, robot):
    lower = np.maximum(robot.lower_position_limit, -6.0)
    upper = np.minimum(robot.upper_position_limit, 6.0)
    return lower + (upper - lower) * random.random(len(lower))


@kernel
def ask_clamp(handle, link, node, row, brakes, gap, thickness):
    """How many obstacles are near a link, and what a sphere of it can clamp a row against."""
    scene = handle.content
    table = scene.braking if brakes else scene.table
    last = table.time.shape[0] - 1
    limit = ContactLimit(1.0, 1.0, gap, thickness)
    near = find_near_obstacles(scene, link, row, table, last, NOW, limit)
    return near, find_clamp(scene, node, table, last, NOW, near, limit)


@kernel
def ask_short(handle, node, links, by_obstacle, speed, max_way):
    scene = handle.content
    return find_short_way_node(
        sphere_of(scene, node), scene.tree.radius[node], moves_of(scene, node), scene.braking,
        scene.clamp_room.closing, Clamp(links, by_obstacle, speed), max_way,
    )  # fmt: skip


@kernel
def ask_person(handle, row, other):
    return is_same_person(handle.content.marks, row, other)


@kernel
def ask_obstacle(handle, row, reach, now, until):
    scene = handle.content
    return is_obstacle_near(np.zeros(3), reach, scene.bodies, scene.marks, row, now, until)


class World:
    """An arm in motion beside obstacles: of these a hand is the first one."""

    def __init__(self, name, seed, count=10, pace=0.1):
        self.robot, self.kinematics, self.motion, self.gaps = arm_of(name)
        self.random = random = np.random.default_rng(seed)
        robot = self.robot
        self.q = draw_q(random, robot)
        self.v = random.uniform(-pace, pace, len(self.q)) * robot.velocity_limit
        self.age = 0.003
        self.obstacles = Obstacles(accel=2.0, speed=0.6)
        self.kinematics.compute(self.q, self.v)
        centers = self.kinematics.centers
        self.points = [
            centers[random.integers(len(centers))] + random.normal(size=(each, 3)) * 0.5
            for each in [1, *random.integers(1, 4, count)]
        ]
        self.rows = []
        for k, points in enumerate(self.points):
            self.obstacles.update(
                [f"p{k}/part"], NOW - 0.02, points[None],
                random.uniform(-0.2, 0.2, (1, len(points), 3)),
                radius=0.03, position_error=0.01, velocity_error=0.05, region="hand",
            )  # fmt: skip
            self.rows.append(self.obstacles.row(f"p{k}/part"))
        none = RegionLimits(*(np.zeros(0) for _ in range(4)))
        self.state = TickState(
            self.kinematics, self.motion, self.obstacles, margin=0.0, contact_limits=none,
        )  # fmt: skip
        table = self.obstacles.table
        for row in self.rows:
            keep_reference_state(table.accepted, table.reference_states, table.marks, row, row)
        self.kinematics.place(self.q)
        prepare_arm(self.state.scene, self.q, self.v, self.age)
        self.motion.braking.tabulate(self.q, self.v, self.age, HORIZON)

    def clamp(self, link, node, *, gap=GAP, thickness=0.0, brakes=True):
        return ask_clamp(self.state.handle, link, node, self.rows[0], brakes, gap, thickness)

    def draw_configuration(self):
        """One that the table allows for, of an arm that was measured wrongly."""
        random, table = self.random, self.motion.braking.table
        set_span(table, 0, len(table.time) - 1, 1.0)
        high, low = table.box.span[:2]
        error = self.robot.position_error
        true = self.q + np.where(random.random(len(error)) < 0.5, -error, error)
        part = random.random(len(error))
        return (
            true
            + np.where(random.random(len(error)) < 0.7, np.round(part), part) * (high - low)
            + low
        )

    def draw_obstacle(self, number, until):
        """Where points of an obstacle can be at some time, from its stamp by constant speed."""
        random, table = self.random, self.obstacles.table
        row = self.rows[number]
        points, velocities = table.points[row], table.velocities[row]
        count = table.point_count[row]
        duration = 0.02 + random.uniform(0.0, until)
        away = random.normal(size=3)
        away /= np.linalg.norm(away)
        return points[:count] + duration * (velocities[:count] + 0.05 * away) + 0.01 * away


def distance_to_hull(center, points, random):
    """At most a little more than the distance: the least over many of the hull's points."""
    weights = random.dirichlet(np.ones(len(points)) * 0.4, 30)
    weights = np.concatenate([weights, np.eye(len(points))])
    return np.linalg.norm(weights @ points - center, axis=1).min()


@pytest.mark.hazard("H-12")
@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_nothing_that_could_clamp_is_missed(name):
    clamps = free = 0
    for seed in range(12):
        world = World(name, seed)
        tree, link_of = world.kinematics.spheres.tree, world.kinematics.spheres.link
        moves = world.kinematics.placement.moves[world.kinematics.placement.joint]
        leaves = np.flatnonzero(tree.first_child < 0)
        until = float(world.motion.braking.table.time[-1])
        said = {node: world.clamp(link_of[node], node)[1] for node in range(len(link_of))}
        for _ in range(20):
            q = world.draw_configuration()
            world.kinematics.compute(q, np.zeros(len(q)))
            centers = world.kinematics.centers.copy()
            places = [world.draw_obstacle(k, until) for k in range(1, len(world.rows))]
            for leaf in leaves[:: max(1, len(leaves) // 12)]:
                apart = np.linalg.norm(centers - centers[leaf], axis=1)
                apart -= tree.radius + tree.radius[leaf]
                between = (moves != moves[leaf]).sum(axis=1)
                by_link = bool((apart[leaves] <= GAP)[between[leaves] > 1].any())
                for points in world.robot.fixed_points().values():
                    away = distance_to_hull(centers[leaf], points, world.random)
                    by_link |= bool(away <= tree.radius[leaf] + GAP)
                reach = tree.radius[leaf] + 0.03 + GAP
                by_obstacle = any(
                    distance_to_hull(centers[leaf], points, world.random) <= reach
                    for points in places
                )
                node = leaf
                while node >= 0:
                    assert said[node].links > 0 or not by_link
                    assert said[node].by_obstacle or not by_obstacle
                    node = tree.parent[node]
                clamps += by_link + by_obstacle
                free += not said[leaf].by_obstacle
    assert clamps > 30
    assert free > 30


def test_measurement_errors_of_joints_count_as_way():
    """An arm that is measured at rest, a static obstacle just beyond the gap, and an error."""
    robot, kinematics, motion, _ = arm_of("panda")
    q, v = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8]), np.zeros(7)
    kinematics.compute(q, v)
    node = int(kinematics.spheres.tree.root[-1])
    center, radius = kinematics.centers[node].copy(), kinematics.spheres.radius[node]
    reach = float(motion.joint.lever[node] @ robot.position_error)
    assert reach > 0.0
    motion.braking.tabulate(q, v, 0.0, 0.0)
    set_span(motion.braking.table, 0, len(motion.braking.table.time) - 1, 1.0)
    way = float(motion.joint.lever[node] @ motion.braking.table.box.span[2])
    obstacles = Obstacles(sources=[])
    obstacles.update(["hand"], NOW, [[9.0, 0.0, 0.0]], [[0.0] * 3], radius=0.1, region="hand")
    beyond = radius + 0.05 + GAP + way + 0.5 * reach
    obstacles.add_static("table", center + np.array([0.0, 0.0, beyond]), 0.05)
    table = obstacles.table
    for name in ("hand", "table"):
        row = obstacles.row(name)
        keep_reference_state(table.accepted, table.reference_states, table.marks, row, row)
    none = RegionLimits(*(np.zeros(0) for _ in range(4)))
    state = TickState(kinematics, motion, obstacles, margin=0.0, contact_limits=none)
    kinematics.place(q)
    prepare_arm(state.scene, q, v, 0.0)
    motion.braking.tabulate(q, v, 0.0, 0.0)
    link, row = int(kinematics.spheres.link[node]), obstacles.row("hand")
    near, clamp = ask_clamp(state.handle, link, node, row, True, GAP, 10.0)
    assert near == 1
    assert clamp.by_obstacle


def test_many_near_obstacles_count_as_near():
    world = World("panda", 1, count=MOST_NEAR + 2)
    link = len(world.robot.links) - 1
    node = world.kinematics.spheres.tree.root[link]
    near, clamp = world.clamp(link, node, gap=50.0)
    assert near == MOST_NEAR + 2
    assert clamp.by_obstacle
    assert clamp.obstacle_speed == np.inf


def test_of_what_nothing_is_known_counts_as_near():
    world = World("panda", 2, count=1)
    link = len(world.robot.links) - 1
    node = world.kinematics.spheres.tree.root[link]
    table = world.obstacles.table
    table.accepted.points[world.rows[1]] += 90.0
    table.reference_states.points[world.rows[1]] += 90.0
    assert not world.clamp(link, node)[1].by_obstacle
    table.marks.refused[world.rows[1]] = True
    assert world.clamp(link, node)[1] == (world.clamp(link, node)[1].links, True, np.inf)
    table.marks.refused[world.rows[1]] = False
    table.reference_states.point_count[world.rows[1]] = 0
    assert world.clamp(link, node)[1].by_obstacle


def beside(*, position, **stated):
    """Whether one obstacle is near a ball of 0.1 m around the origin by 0.2 s after the tick."""
    _, kinematics, motion, _ = arm_of("panda")
    obstacles = Obstacles(sources=[], **{"accel": 2.0, "speed": 0.6} | stated.pop("bounds", {}))
    stamp, velocity = stated.pop("stamp", NOW), stated.pop("velocity", [0.0, 0.0, 0.0])
    obstacles.update(["cart"], stamp, [[position, 0.0, 0.0]], [velocity], radius=0.05, **stated)
    none = RegionLimits(*(np.zeros(0) for _ in range(4)))
    state = TickState(kinematics, motion, obstacles, margin=0.0, contact_limits=none)
    return ask_obstacle(state.handle, obstacles.row("cart"), 0.1, NOW, 0.2)


@pytest.mark.parametrize(
    ("stated", "way"),
    [
        ({}, 0.04),
        ({"position_error": 0.03}, 0.07),
        ({"stamp": NOW - 0.1}, 0.09),
        ({"velocity": [-0.3, 0.0, 0.0]}, 0.0975),
        ({"velocity": [-0.3, 0.0, 0.0], "velocity_error": 0.1}, 0.11),
        # Later than the tick: the body was in front of where it is by then, or behind.
        ({"velocity": [0.6, 0.0, 0.0], "stamp": NOW + 0.1}, 0.06),
        ({"velocity": [0.6, 0.0, 0.0], "stamp": NOW + 0.3}, 0.18),
    ],
)
def test_an_obstacle_is_near_that_can_come_within_reach(stated, way):
    """With a = 2 m/s² and no more than 0.6 m/s, for 0.2 s from the tick."""
    near, speed = beside(position=0.15 + way - 1e-6, **stated)
    assert near
    assert speed == pytest.approx(0.6)
    assert not beside(position=0.15 + way + 0.4, **stated)[0]


@pytest.mark.parametrize("stated", [{}, {"velocity_error": np.inf}])
def test_an_obstacle_without_bounds_is_near_wherever_it_is(stated):
    bounds = {"accel": np.inf, "speed": np.inf}
    assert beside(position=50.0, bounds=bounds, **stated) == (True, np.inf)


def test_who_is_of_one_person():
    obstacles = Obstacles(sources=["a", "b"])
    for name, source, region in [
        ("p1/hand", "a", "hand"), ("p1/head", "a", "head"), ("p2/hand", "a", "hand"),
        ("p1/hand", "b", "hand"), ("p1/table", "a", ""),
        ("p1", "a", "chest"), ("hand", "a", "hand"), ("head", "a", "head"), ("/arm", "a", "hand"),
    ]:  # fmt: skip
        obstacles.update(
            [name], NOW, [[2.0, 0.0, 0.0]], [[0.0] * 3], radius=0.1, source=source, region=region
        )
    _, kinematics, motion, _ = arm_of("panda")
    none = RegionLimits(*(np.zeros(0) for _ in range(4)))
    state = TickState(kinematics, motion, obstacles, margin=0.0, contact_limits=none)

    def is_same(name, source="a", first="p1/hand"):
        rows = obstacles.row(first, "a"), obstacles.row(name, source)
        return ask_person(state.handle, *rows)

    assert is_same("p1/head")
    assert not is_same("p2/hand")
    assert not is_same("p1/hand", "b")
    assert not is_same("p1/table")
    # Ids that name no person may be of two.
    for name in ("p1", "hand", "/arm"):
        assert not is_same(name)
        assert not is_same("head", first=name)


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_a_short_way_is_not_exceeded(name):
    """Joints that brake at once, each as weakly as it may, or harder."""
    closest = np.zeros(2)
    for seed in range(8):
        world = World(name, seed, count=1)
        random, robot = world.random, world.robot
        tree, link_of = world.kinematics.spheres.tree, world.kinematics.spheres.link
        table = world.motion.braking.table
        brakes = world.motion.braking.limits
        times = np.linspace(0.0, table.time[-1], 60)
        motions = []
        for _ in range(8):
            bite = random.uniform(0.0, HORIZON + REACTION)
            push = random.choice([-1.0, 0.0, 1.0], len(world.q)) * brakes.acceleration
            top = brakes.operating_velocity
            pace = np.clip(world.v + push * np.minimum(times, bite)[:, None], -top, top)
            rate = robot.braking_deceleration * random.choice([1.0, 1.5])
            left = np.abs(pace) - rate * np.maximum(times - bite, 0.0)[:, None]
            pace = np.sign(pace) * np.maximum(left, 0.0)
            steps = 0.5 * (pace[1:] + pace[:-1]) * np.diff(times)[:, None]
            motions.append(world.q + np.concatenate([0.0 * world.q[None], np.cumsum(steps, 0)]))
        inside = [
            (q >= robot.lower_position_limit).all() and (q <= robot.upper_position_limit).all()
            for q in motions
        ]
        motions = [q for q, keeps in zip(motions, inside, strict=True) if keeps]
        traces = []
        for q in motions:
            rows = []
            for each in q:
                world.kinematics.compute(each, np.zeros(len(each)))
                rows.append(world.kinematics.centers.copy())
            traces.append(np.array(rows))
        world.kinematics.compute(world.q, world.v)
        for node in random.choice(np.flatnonzero(tree.first_child < 0), 6):
            max_way = random.choice([0.002, 0.01, 0.05])
            _, clamp = world.clamp(link_of[node], node, gap=0.5)
            by_obstacle = ask_short(world.state.handle, node, 0, True, 0.0, max_way)
            by_link = ask_short(world.state.handle, node, clamp.links, False, 0.0, max_way)
            parts = world.gaps.parts[world.gaps.variation[node] > 0.0]
            for trace in traces:
                later = trace[times >= table.time[by_obstacle], node]
                if len(later):
                    gone = np.linalg.norm(later - later[0], axis=1).max()
                    closest[0] = max(closest[0], gone / max_way)
                later = trace[times >= table.time[by_link]]
                if len(later) < 2:
                    continue
                apart = np.linalg.norm(later[:, parts] - later[:, node, None], axis=2)
                near = apart - tree.radius[parts] - tree.radius[node] <= 0.5
                assert clamp.links > 0 or not near.any()
                # What is pressed may slip to the gap that closes fastest, again and again.
                falls = np.where(near[1:], -np.diff(apart, axis=0), 0.0)
                closes = falls.max(axis=1, initial=0.0).sum()
                closest[1] = max(closest[1], closes / max_way)
    assert (closest <= 1.0).all(), closest
    assert closest[0] > 0.2
    assert closest[1] > 0.01


def way_between(world, node, part):
    """How far two spheres can come nearer by the end of the braking table, in [m]."""
    placement, table = world.kinematics.placement, world.motion.braking.table
    lever, radius = world.motion.joint.lever, world.kinematics.spheres.tree.radius
    moved = placement.moves[placement.joint]
    arms = np.where(moved[node], lever[node], lever[part])
    arms += np.where(table.box.turning, np.where(moved[node], radius[node], radius[part]), 0.0)
    set_span(table, 0, len(table.time) - 1, 1.0)
    errors = (lever[node] + lever[part]) @ world.robot.position_error
    return (arms * table.box.span[2])[moved[node] != moved[part]].sum() + errors


def way_to_base(world, node):
    """How far a sphere can come nearer to what no joint moves by then, in [m]."""
    placement, table = world.kinematics.placement, world.motion.braking.table
    lever, radius = world.motion.joint.lever[node], world.kinematics.spheres.tree.radius[node]
    moved = placement.moves[placement.joint[node]]
    set_span(table, 0, len(table.time) - 1, 1.0)
    arms = lever + np.where(table.box.turning, radius, 0.0)
    return (arms * table.box.span[2])[moved].sum() + lever @ world.robot.position_error


def test_another_link_counts_from_the_gap_on_that_it_can_close():
    """From its distance on in any case, and not before what levers allow for.

    For neighbours as well whose distance varies by enough.
    """
    checked = 0
    for seed in range(6):
        world = World("panda", seed, count=0)
        tree = world.kinematics.spheres.tree
        link_of, centers = world.kinematics.spheres.link, world.kinematics.centers
        gaps = world.gaps
        for node in world.random.choice(np.flatnonzero(tree.first_child < 0), 5):
            varies = gaps.variation[node]
            apart = np.linalg.norm(centers[gaps.parts] - centers[node], axis=1)
            apart -= tree.radius[gaps.parts] + tree.radius[node]
            left = apart - [way_between(world, node, part) for part in gaps.parts]
            neighbours = np.flatnonzero((varies > 0.03) & np.isfinite(varies))
            to_base = np.linalg.norm(gaps.base[:, :3] - centers[node], axis=1) - gaps.base[:, 3]
            to_base -= tree.radius[node]
            if len(neighbours) == 0 or not left[neighbours].min() > 1e-3:
                continue
            nearest = neighbours[left[neighbours].argmin()]
            for thickness in (varies[nearest] - 0.01, 10.0):
                counts = varies > thickness
                before = min(left[counts].min(), to_base.min() - way_to_base(world, node))
                there = min(apart[counts].min(), to_base.min())
                for gap, expected in ((before - 1e-6, False), (there + 1e-6, True)):
                    if gap > 1e-3:
                        clamp = world.clamp(link_of[node], node, gap=gap, thickness=thickness)[1]
                        assert (clamp.links > 0) == expected, (seed, node, thickness)
                        checked += thickness < 10.0
    assert checked > 5


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_way_counts_to_either_side_and_with_what_moves_by_itself(sign):
    world = World("panda", 3, count=0)
    world.v = sign * 0.1 * world.robot.velocity_limit
    world.motion.braking.tabulate(world.q, world.v, world.age, HORIZON)
    table = world.motion.braking.table
    link = len(world.robot.links) - 1
    node = world.kinematics.spheres.tree.root[link]
    links = world.clamp(link, node, gap=50.0)[1].links
    forth, back = np.moveaxis(world.state.scene.clamp_room.closing[:links], 1, 0)
    rates = np.maximum(forth[:, None] * table.fastest[:-1], back[:, None] * -table.slowest[:-1])
    steps = np.diff(table.time) * rates.sum(axis=2).max(axis=0)
    left = np.append(np.cumsum(steps[::-1])[::-1], 0.0)
    for max_way in np.array([0.1, 0.3, 0.7]) * left[0]:
        found = ask_short(world.state.handle, node, links, False, 0.0, max_way)
        assert found == np.argmax(left <= max_way)
    rest = table.time[-1] - table.time
    for max_way in (0.1, 0.5):
        found = ask_short(world.state.handle, node, 0, True, 50.0, max_way)
        assert 50.0 * rest[found] <= max_way
