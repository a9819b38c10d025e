"""Contact times bound by bound: each no worse than its parts, and never later than contact."""

import math

import numpy as np
import pytest

from armguard.bounds import table_contact_time
from armguard.bounds.arm import ArmMotion
from armguard.contact import earliest_contact_pair
from armguard.jit import kernel
from armguard.obstacles import Obstacles
from armguard.pairs.contact_time import (
    RESTS,
    StatePlace,
    arm_reach_time,
    contact_distance,
    hull_of,
    is_known,
    link_reach_time,
    link_time,
    pair_time,
    rests_in_time,
    root_time,
)
from armguard.pairs.evaluate import TickState
from armguard.pairs.hull_distance import HullDistance
from armguard.pairs.scene import ISOTROPIC, JOINT, REACH, sphere_of
from armguard.robot import Kinematics
from support.panda_monitor import panda
from support.tick_states import begin_tick

KINEMATICS = Kinematics(panda())
SPHERES = KINEMATICS.spheres
COUNT, LINKS = len(SPHERES), len(panda().links)
MARGIN, HORIZON, NOW = 0.01, 0.003, 5.0
ACCEL = 10.0


@kernel
def ask_link(handle, link, row, arm_age, age, floor, refinement_threshold, ceiling):
    scene = handle.content
    state = StatePlace(row, bool(0), age, scene.bodies.radius[row])
    known, bound = root_time(scene, link, state, arm_age, floor)
    return link_time(handle, link, state, arm_age, known, bound, refinement_threshold, ceiling)


@kernel
def ask_root(handle, link, row, arm_age, age, floor):
    """By reach, and by the sphere around the link as well."""
    scene = handle.content
    state = StatePlace(row, bool(0), age, scene.bodies.radius[row])
    reach = link_reach_time(scene, link, state, floor)
    return reach, root_time(scene, link, state, arm_age, reach)[0]


@kernel
def ask_pair(handle, link, row, now, arm_age, floor, refinement_threshold, ceiling):
    return pair_time(handle, link, row, now, arm_age, floor, refinement_threshold, ceiling)


@kernel
def ask_reach(handle, row, now):
    return arm_reach_time(handle.content, row, now)


@kernel
def ask_known(handle, row):
    return is_known(handle.content.marks, row)


@kernel
def ask_rest(handle, link, row, now):
    return rests_in_time(handle, link, row, now, 10**6)[0] == RESTS


@kernel
def ask_joint(handle, node, row, age, brakes):
    """Contact time of one sphere by the table of joints alone, or by that of braking."""
    scene = handle.content
    bodies = scene.bodies
    return table_contact_time(
        sphere_of(scene, node), scene.braking if brakes else scene.table,
        hull_of(bodies, row, age), contact_distance(
            scene, node, bodies, StatePlace(row, bool(0), age, bodies.radius[row])
        ), 0.0, np.inf,
    )  # fmt: skip


class World:
    """A Panda in motion, and a few balls around it."""

    def __init__(self, seed, *, speed=math.inf, count=6, errors=True):
        rng, robot = np.random.default_rng(seed), panda()
        low, high = robot.lower_position_limit, robot.upper_position_limit
        self.q = low + rng.uniform(0.2, 0.8, 7) * (high - low)
        self.v = rng.uniform(-0.3, 0.3, 7) * robot.velocity_limit
        self.arm_age, self.age = (rng.uniform(0.0, 0.005), 0.01) if errors else (0.0, 0.0)
        self.obstacles = Obstacles(accel=ACCEL, speed=speed)
        directions = rng.normal(size=(count, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        self.position = np.array([0.0, 0.0, 0.4])
        self.position = self.position + rng.uniform(0.5, 1.8, (count, 1)) * directions
        self.velocity = rng.uniform(-0.25, 0.25, (count, 3))
        names = [f"b{k}" for k in range(count)]
        self.obstacles.update(
            names, NOW - self.age, self.position, self.velocity, radius=0.05,
            velocity_error=0.02 if errors else 0.0, position_error=0.03 if errors else 0.0,
        )  # fmt: skip
        self.rows = [self.obstacles.row(name) for name in names]
        self.motion = ArmMotion(robot, 0.02)
        self.state = TickState(KINEMATICS, self.motion, self.obstacles, margin=MARGIN)
        begin_tick(self.state, NOW, self.arm_age, math.inf)
        KINEMATICS.place(self.q)
        self.state.prepare_arm(self.q, self.v)
        self.motion.braking.tabulate(self.q, self.v, self.arm_age, HORIZON)

    def link(self, link, row, floor=0.0, refinement_threshold=math.inf, ceiling=math.inf):
        return ask_link(
            self.state.handle,
            link,
            row,
            self.arm_age,
            self.age,
            floor,
            refinement_threshold,
            ceiling,
        )

    def pair(self, link, row, floor=0.0, refinement_threshold=math.inf, ceiling=math.inf):
        return ask_pair(
            self.state.handle, link, row, NOW, self.arm_age, floor, refinement_threshold, ceiling
        )

    def body(self, row):
        bodies = self.state.bodies
        return {
            "p2": bodies.points[row, 0], "v2": bodies.velocities[row, 0],
            "a2": bodies.accel[row], "s2": bodies.speed[row], "age2": self.age,
            "velocity_error2": bodies.velocity_error[row],
        }  # fmt: skip

    def free_times(self, row):
        """Of all spheres as free bodies. Shape (n,)."""
        arm, bodies = self.state.arm, self.state.bodies
        distance = SPHERES.radius + arm.position_error + bodies.radius[row] + MARGIN
        return earliest_contact_pair(
            p1=arm.centers, v1=arm.velocities, a1=arm.accel, s1=arm.speed, **self.body(row),
            contact_distance=distance + bodies.position_error[row], age1=self.arm_age,
            velocity_error1=arm.velocity_error,
        )  # fmt: skip

    def ball_time(self, ball, row):
        """Of a ball that stands still."""
        still = {"p1": ball[:3], "v1": np.zeros(3), "a1": 0.0, "s1": 0.0}
        distance = ball[3] + self.state.bodies.radius[row] + MARGIN
        distance += self.state.bodies.position_error[row]
        return float(earliest_contact_pair(**still, **self.body(row), contact_distance=distance))


def own(times):
    """Each sphere's proof holds for all that it owns: the latest on the way to it. Shape (n,)."""
    best = np.array(times)
    for sphere, (child, count) in enumerate(
        zip(SPHERES.first_child, SPHERES.child_count, strict=True)
    ):
        if count:
            best[child : child + count] = np.maximum(best[child : child + count], best[sphere])
    return best


def of_links(times):
    leaves = np.flatnonzero(SPHERES.child_count == 0)
    soonest = np.full(LINKS, math.inf)
    np.minimum.at(soonest, SPHERES.link[leaves], times[leaves])
    return soonest


SEEDS = range(6)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_best_of_all_bounds_is_no_worse_than_each(seed):
    """And no better than all together, where the search by joints starts from scratch."""
    world = World(seed, speed=2.0)
    decided = set()
    for row in world.rows:
        free = world.free_times(row)
        joint = np.array(
            [ask_joint(world.state.handle, node, row, world.age, False) for node in range(COUNT)]
        )
        least, most = np.maximum(of_links(own(free)), 0.0), of_links(own(joint))
        together = of_links(own(np.maximum(free, joint)))
        for link in range(LINKS):
            time, node, bound, evaluations = world.link(link, row)
            assert time >= least[link] * (1.0 - 1e-6)
            assert time >= 0.9 * max(most[link], together[link])
            assert time <= 1.1 * together[link] + 0.01
            assert SPHERES.link[node] == link
            assert evaluations >= 1
            decided.add(bound)
            floored, _, bound, _ = world.link(link, row, floor=time + 1.0)
            assert (floored, bound) == (time + 1.0, REACH)
            reach, known = ask_root(world.state.handle, link, row, world.arm_age, world.age, 0.0)
            ball = world.ball_time(world.motion.reach.link_balls[link], row)
            root = max(ball, free[world.state.tree.root[link]], 0.0)
            # Against balls that stand still a few advances are enough.
            assert ball * (1.0 - 1e-4) <= reach <= max(ball, 0.0) * (1.0 + 1e-9)
            assert root * (1.0 - 1e-4) <= known <= root * (1.0 + 1e-9)
            time, _, bound, _ = world.pair(link, row)
            assert time >= max(ball, least[link]) * (1.0 - 1e-4)
            decided.add(bound)
    assert decided == {REACH, ISOTROPIC, JOINT} or decided == {REACH, JOINT}


@pytest.mark.parametrize("seed", SEEDS)
def test_what_need_not_be_known_better_is_only_known_worse(seed):
    world, rng = World(seed, speed=2.0), np.random.default_rng(seed)
    spared = 0
    for row in world.rows:
        for link in range(LINKS):
            wide, _, _, many = world.pair(link, row)
            for _ in range(5):
                refinement_threshold, ceiling = rng.choice([0.0, 0.1, 0.5, 1.0, math.inf, wide], 2)
                time, _, _, few = world.pair(link, row, 0.0, refinement_threshold, ceiling)
                assert time <= wide * (1.0 + 1e-12)
                assert time == wide or time >= min(refinement_threshold, ceiling)
                assert few <= many
                spared += few < many
    assert spared > 0


def move(q, v, accel, t):
    """Joints that accelerate as hard as `accel` until their top speed; never beyond their range."""
    robot = panda()
    top = np.where(accel > 0.0, robot.velocity_limit, -robot.velocity_limit)
    ramp = np.clip((top - v) / accel, 0.0, t)
    end = q + v * ramp + 0.5 * accel * ramp**2 + np.where(ramp < t, top, 0.0) * (t - ramp)
    inside = (robot.lower_position_limit <= end) & (end <= robot.upper_position_limit)
    return end, bool(inside.all())


@pytest.mark.parametrize("seed", SEEDS)
def test_no_contact_comes_earlier(seed):
    """Joints at their limits, balls that steer for the link: times of feasible contacts.

    Of its true geometry: a sphere may be touched where it is not the link's.
    """
    world, rng = World(seed, errors=False), np.random.default_rng([seed, 1])
    promised = np.array([[world.pair(link, row)[0] for row in world.rows] for link in range(LINKS)])
    leaves, alone = np.flatnonzero(SPHERES.child_count == 0), Kinematics(panda())
    exact = HullDistance(panda(), alone)
    reach = (SPHERES.radius + 0.05 + MARGIN)[leaves, None]
    first = np.full((LINKS, len(world.rows)), math.inf)
    for _ in range(12):
        accel = panda().acceleration_limit * rng.choice([-1.0, 1.0], 7)
        for t in np.arange(0.0, 0.8, 0.01):
            q, inside = move(world.q, world.v, accel, t)
            if not inside:
                break
            alone.compute(q, np.zeros(7))
            carried = world.position + world.velocity * t
            gap = np.linalg.norm(alone.centers[leaves, None] - carried, axis=2) - reach
            touched = gap <= 0.5 * ACCEL * t * t
            for link in range(LINKS):
                for k in np.flatnonzero(touched[SPHERES.link[leaves] == link].any(axis=0)):
                    if first[link, k] <= t:
                        continue
                    distance, _, _ = exact.distance(link, carried[k : k + 1], 0.05 + MARGIN)
                    if distance <= 0.5 * ACCEL * t * t:
                        first[link, k] = t
    assert (promised <= first + 1e-9).all()
    # Not idly so: many of these contacts are not much later than promised.
    met = np.isfinite(first)
    assert met.mean() > 0.5
    assert np.median(promised[met] / np.maximum(first[met], 0.01)) > 0.4


@pytest.mark.parametrize("seed", SEEDS)
def test_the_reach_of_the_whole_arm(seed):
    world = World(seed, speed=2.0)
    for row in world.rows:
        time, evaluations = ask_reach(world.state.handle, row, NOW)
        ball = world.ball_time(world.motion.reach.arm_ball, row)
        assert time == pytest.approx(ball, rel=1e-4, abs=1e-9)
        assert time <= ball * (1.0 + 1e-9)
        assert evaluations == 1
        links = [world.ball_time(one, row) for one in world.motion.reach.link_balls]
        assert time <= min(links) * (1.0 + 1e-9)


def test_while_two_tracks_are_possible_the_sooner_one_counts():
    """As if there were two bodies, one at either place."""
    told = {"radius": 0.05, "velocity_error": 0.02, "position_error": 0.03}
    rng, still, orders, differ = np.random.default_rng(2), np.zeros((1, 3)), set(), 0
    for seed in SEEDS:
        world = World(seed, speed=0.5, count=2)
        stamp = NOW - world.age
        for k in range(4):
            # At hand, or further off than the arm reaches.
            away = rng.normal(size=(2, 3)) * (0.4 if k < 2 else 2.0)
            place = np.array([0.0, 0.0, 0.4]) + away
            names = [f"first{k}", f"second{k}", f"either{k}"]
            world.obstacles.update([names[0]], stamp, place[:1], still, **told)
            world.obstacles.update([names[1]], stamp + 1e-3, place[1:], still, **told)
            world.obstacles.update([names[2]], stamp, place[:1], still, **told)
            world.obstacles.update([names[2]], stamp + 1e-3, place[1:], still, **told)
            first, second, either = (world.obstacles.row(name) for name in names)
            assert world.obstacles.table.refused[either]
            begin_tick(world.state, NOW, world.arm_age, math.inf)
            handle = world.state.handle
            reach = [ask_reach(handle, row, NOW)[0] for row in (first, second, either)]
            assert reach[2] == min(reach[:2])
            orders.add(int(np.sign(reach[1] - reach[0])))
            for link in range(LINKS):
                times = [world.pair(link, row)[0] for row in (first, second, either)]
                assert times[2] == pytest.approx(min(times[:2]), rel=1e-9)
                rests = [ask_rest(handle, link, row, NOW) for row in (first, second, either)]
                assert rests[2] == (rests[0] and rests[1])
                differ += rests[0] != rests[1]
    assert orders >= {-1, 1}
    assert differ > 0


def test_obstacles_of_unknown_whereabouts():
    world = World(0)
    row, other = world.rows[:2]
    world.obstacles.update(["b0"], NOW, [[math.nan, 0.0, 0.0]], radius=0.05)
    world.obstacles.distrust(other)
    world.obstacles.update(["lost"], NOW, [[math.inf, 0.0, 0.0]], radius=0.05)
    lost = world.obstacles.row("lost")
    begin_tick(world.state, NOW, 0.0, math.inf)
    for unknown in (row, lost):
        assert not ask_known(world.state.handle, unknown)
        assert ask_reach(world.state.handle, unknown, NOW)[0] == 0.0
        assert not any(ask_rest(world.state.handle, link, unknown, NOW) for link in range(LINKS))
    # One whose last state is doubted can still be reckoned with: by that state.
    assert ask_known(world.state.handle, other)
    assert ask_known(world.state.handle, world.rows[2])


@pytest.mark.parametrize("speed", [0.5, 2.0])
def test_links_that_rest_in_time_are_those_all_of_whose_pieces_do(speed):
    """Every piece must be inside some sphere that rests before it is touched."""
    answers = set()
    for seed in SEEDS:
        world = World(seed, speed=speed)
        rest = world.motion.braking_table.time[-1]
        for row in world.rows:
            reached = np.array(
                [ask_joint(world.state.handle, node, row, world.age, True) for node in range(COUNT)]
            )
            rests = of_links(own(reached)) >= rest * (1.0 - 1e-11)
            for link in range(LINKS):
                assert ask_rest(world.state.handle, link, row, NOW) == rests[link]
            answers |= set(rests.tolist())
    assert answers == {False, True}
