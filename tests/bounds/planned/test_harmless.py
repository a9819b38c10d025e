"""No point of the arm is faster than the bound on a piece, or goes farther than the way left.

ARMGUARD_MOTIONS sets how many joint motions are tried in all; a million take an hour.
"""

import math
import os

import numpy as np
import pytest

from armguard.bounds import CheckedPlan, Plan, PlannedMotion, append_stop, check_plan
from armguard.bounds.planned.contact import Permissions, make_surroundings
from armguard.bounds.planned.course import BLOCK, find_center, find_frame
from armguard.bounds.planned.harmless import (
    CourseSpeeds,
    find_harmless_speed,
    find_speed_from,
    find_way_from,
    sum_up_speeds,
)
from armguard.jit.handle import pack
from armguard.jit.kernels import kernel
from armguard.obstacles import Obstacles
from armguard.obstacles.regions import ContactLimit, RegionLimits, make_no_limits
from armguard.obstacles.tethers import make_tethers
from armguard.settings.contact_limits import ContactLimits
from support.example_arms import load_holding
from support.hostile_joints import STEP, chain_to, place_point, set_slopes
from support.plan_cases import Follower, Hermite, Waves, all_pairs, make_plan, place_course

USUAL_MOTIONS = 7_200
MORE = max(1, round(int(os.environ.get("ARMGUARD_MOTIONS", "0")) / USUAL_MOTIONS))
"""Times as many as usual."""

ARMS = 20  # that follow one plan
HAND, HEAD = 11, 1
SHARE = 0.999  # of the radius of a sphere, for what is surely inside


@kernel
def follow_point(chain, qs, vs, point, inner, slope, places, paces):
    """Fill where a point is, and how fast, along a motion."""
    direction = np.zeros(3)
    for k in range(qs.shape[0]):
        places[k] = place_point(chain, qs[k], point, inner)
        square = 0.0
        for axis in range(3):
            direction[:] = 0.0
            direction[axis] = 1.0
            set_slopes(chain, qs[k], direction, inner, slope)
            pace = (slope * vs[k]).sum()
            square += pace * pace
        paces[k] = np.sqrt(square)


def trace(robot, joint, point, qs, vs):
    """Places, (k, 3), and speeds, (k,), of a point along a motion."""
    chain = chain_to(robot, joint)
    places, paces = np.empty((len(qs), 3)), np.empty(len(qs))
    inner, slope = np.empty((len(chain.column) + 1, 3)), np.zeros(qs.shape[1])
    qs, vs = np.ascontiguousarray(qs), np.ascontiguousarray(vs)
    follow_point(chain, qs, vs, np.asarray(point), inner, slope, places, paces)
    return places, paces


@kernel
def bound_all(handle, course, node, speeds, ways):
    """Fill the bounds of a sphere from each slab on."""
    for slab in range(speeds.shape[0]):
        speeds[slab] = find_speed_from(node, slab, np.inf, course, handle.content.arm)
        ways[slab] = find_way_from(node, slab, course, handle.content.arm)


@kernel
def bound_within(handle, course, node, slab, limit, way, obstacle_speed):
    given = ContactLimit(limit, way, 0.0, 0.0)
    return find_harmless_speed(node, slab, given, obstacle_speed, course, handle.content.arm)


def pack_around(motion, obstacles=None):
    table = (obstacles or Obstacles()).table
    return pack(
        make_surroundings(
            motion._arm,
            table.accepted,
            table.refused_states,
            table.marks,
            make_no_limits(),
            make_tethers(0, 0),
        )
    )


def bounds_of(motion, course, node):
    speeds, ways = np.empty(len(course.start)), np.empty(len(course.start))
    bound_all(pack_around(motion), course, node, speeds, ways)
    return speeds, ways


@pytest.fixture(scope="module", params=["panda", "kinova", "tiago"])
def robot(request):
    return load_holding(request.param)


def draw_plan(robot, random):
    """A motion, and its plan with errors that are stated or not."""
    nv, duration = len(robot.joints), 0.01 * random.integers(5, 30)
    waves = Waves(robot, random, random.choice([0.1, 0.5]))
    errors = random.choice([1e-4, 2e-3, 1e-2]) * np.ones(nv)
    speeds = random.choice([0.02, 0.1]) * np.ones(nv) if random.random() < 0.7 else None
    times = np.linspace(0.0, duration, random.integers(12, 60))
    return waves, make_plan(robot, waves, 0.0, times, errors, speeds)


def check(robot, plan, now):
    curve = Hermite(plan.times, plan.q, plan.v)
    q, v = curve(now), curve(now, 1)
    checked = check_plan(plan, robot, 0.0, plan.q[0], plan.v[0], 0.0)
    assert isinstance(checked, CheckedPlan), checked
    return checked._replace(now=now, measured_stamp=now, measured_q=q, measured_v=v)


def attack(motion, robot, random, course, time, qs, vs, end):
    """How much of the bounds on speed and on the way left some points use, at the most."""
    arm = motion._arm
    node = int(random.integers(len(arm.carrier)))
    around = random.normal(size=3)
    around *= SHARE * arm.tree.radius[node] / np.linalg.norm(around)
    point = arm.local[node] + random.choice([0.0, 1.0]) * around
    inside = (time >= 0.0) & (time <= end)
    places, paces = trace(robot, int(arm.carrier[node]), point, qs[inside], vs[inside])
    speeds, ways = bounds_of(motion, course, node)
    slab = np.minimum(np.searchsorted(course.end, time[inside] - 1e-12), len(course.end) - 1)
    assert (paces <= speeds[slab] + 1e-9).all(), (node, point)
    # The farthest that the point gets from where it is, then or at any later time.
    some = np.arange(0, len(places), 10)
    for k in some:
        gone = np.linalg.norm(places[k:] - places[k], axis=1).max()
        assert gone <= ways[slab[k]] + 1e-9, (node, point)
    moving = speeds[slab] > 1e-3
    return (paces[moving] / speeds[slab][moving]).max(initial=0.0)


def test_no_point_is_faster_on_a_piece(robot):
    random, motion, most = np.random.default_rng(1), PlannedMotion(robot), 0.0
    for _ in range(20 * MORE):
        waves, plan = draw_plan(robot, random)
        now = STEP * random.integers(0, 40)
        follower = Follower(robot, waves, plan, random, ARMS, now - 0.01, now)
        course = motion.lay_out(check(robot, plan, now), with_velocities=True)
        for arm in range(ARMS):
            most = max(
                most,
                attack(
                    motion, robot, random, course, follower.time - now, follower.q[:, arm],
                    follower.v[:, arm], plan.times[-1] - now,
                ),
            )  # fmt: skip
    assert most > 0.85


def test_no_point_is_faster_of_joints_that_leave_a_piece_when_they_like(robot):
    random, motion, most = np.random.default_rng(2), PlannedMotion(robot), 0.0
    for _ in range(20 * MORE):
        waves, plan = draw_plan(robot, random)
        now = STEP * random.integers(0, 40)
        follower = Follower(robot, waves, plan, random, ARMS, now - 0.01, now)
        follower.brake_joints(max(plan.times[-1] - now, STEP))
        checked, seen = check(robot, plan, now), follower.index(now)
        for arm in range(ARMS):
            sides = random.choice([-1.0, 0.0, 1.0], (2, len(robot.joints)))
            measured = checked._replace(
                measured_q=follower.q[seen, arm] + sides[0] * robot.position_error,
                measured_v=follower.v[seen, arm] + sides[1] * robot.velocity_error,
            )
            course = motion.lay_out_left(measured, with_velocities=True)
            most = max(
                most,
                attack(
                    motion, robot, random, course, follower.time - now, follower.q[:, arm],
                    follower.v[:, arm], course.end[-1],
                ),
            )  # fmt: skip
    assert most > 0.8


def test_velocities_change_no_position(robot):
    random, motion = np.random.default_rng(3), PlannedMotion(robot)
    for _ in range(5):
        _, plan = draw_plan(robot, random)
        checked = check(robot, plan, 0.03)
        for lay_out in (motion.lay_out, motion.lay_out_left):
            with_velocities = lay_out(checked, with_velocities=True)
            for one, other in zip(lay_out(checked)[:-1], with_velocities[:-1], strict=True):
                np.testing.assert_array_equal(one, other)


def test_until_a_piece_begins_joints_are_as_fast_as_on_those_before_or_free():
    robot, random = load_holding("panda"), np.random.default_rng(4)
    motion = PlannedMotion(robot)
    for _ in range(20):
        waves, plan = draw_plan(robot, random)
        times = np.linspace(0.0, 0.2, 41)
        first = make_plan(robot, waves, -0.05, times, plan.tracking_error, np.full(7, 0.02))
        here = waves.position(-0.03), waves.velocity(-0.03)
        first = check_plan(first, robot, -0.03, *here, -0.03)
        later = check_plan(plan, robot, -0.03, *here, -0.03)
        assert isinstance(later, CheckedPlan), later
        for course, slack in (
            (motion.lay_out(later, [first], with_velocities=True), 0.02),
            (motion.lay_out_left(later, [first], with_velocities=True), 0.02),
            (motion.lay_out(later, with_velocities=True), 0.0),
        ):
            speeds = course.speeds._content
            for k in np.flatnonzero(course.end <= 0.03 + 1e-12):
                within = waves.velocity(-0.03 + np.linspace(course.start[k], course.end[k], 20))
                assert (speeds.slowest[k] <= within.min(axis=0) - slack + 1e-4).all()
                assert (speeds.fastest[k] >= within.max(axis=0) + slack - 1e-4).all()
            # As tight as what is stated, while the piece before counts.
            if slack:
                off = speeds.fastest[0] - speeds.slowest[0]
                assert (off < 2.0 * (slack + robot.velocity_error) + 0.1).all()


def test_from_later_on_an_arm_is_never_faster_and_goes_no_farther(robot):
    random, motion = np.random.default_rng(5), PlannedMotion(robot)
    for _ in range(10):
        _, plan = draw_plan(robot, random)
        checked = check(robot, plan, 0.02)
        for lay_out in (motion.lay_out, motion.lay_out_left):
            course = lay_out(checked, with_velocities=True)
            node = int(random.integers(len(motion._arm.carrier)))
            speeds, ways = bounds_of(motion, course, node)
            assert (np.diff(ways) <= 0.0).all()
            assert (speeds >= 0.0).all()
            around = pack_around(motion)
            for slab in random.integers(0, len(speeds), 5):
                # What holds from a slab on is the greatest of all slabs, whatever is asked first.
                found = [
                    bound_within(around, course, node, k, speeds[slab], math.inf, -1.0)
                    for k in range(slab, len(speeds))
                ]
                assert max(found) <= speeds[slab]
                assert (np.diff(found) <= 1e-12).all() or len(found) < 2
                below = bound_within(around, course, node, slab, 0.5 * found[0], 1.0, -1.0)
                assert below == math.inf or below <= 0.5 * found[0]


def test_a_way_that_is_too_long_is_harmful_where_something_may_be_clamped(robot):
    random, motion = np.random.default_rng(6), PlannedMotion(robot)
    _, plan = draw_plan(robot, random)
    course = motion.lay_out(check(robot, plan, 0.0), with_velocities=True)
    node = len(motion._arm.carrier) - 1
    _, ways = bounds_of(motion, course, node)
    around = pack_around(motion)
    for slab in range(0, len(ways), 7):
        ask = around, course, node, slab
        assert bound_within(*ask, 1e3, 0.999 * ways[slab], -1.0) <= 1e3
        assert bound_within(*ask, 1e3, 0.999 * ways[slab], 0.0) == math.inf
        assert bound_within(*ask, 1e3, ways[slab], 0.0) <= 1e3
        # What moves by itself goes on until the arm rests.
        own = 0.3 * (course.end[-1] - course.start[slab])
        assert bound_within(*ask, 1e3, ways[slab] + 0.999 * own, 0.3) == math.inf
        assert bound_within(*ask, 1e3, ways[slab] + 1.001 * own, 0.3) <= 1e3
        assert bound_within(*ask, 1e3, math.nan, 0.0) == math.inf
        assert bound_within(*ask, 0.0, math.inf, -1.0) == math.inf
        assert bound_within(*ask, math.nan, math.inf, -1.0) == math.inf


def test_without_velocities_nothing_is_harmless(robot):
    random, motion = np.random.default_rng(7), PlannedMotion(robot)
    _, plan = draw_plan(robot, random)
    course = motion.lay_out(check(robot, plan, 0.0))
    assert bound_within(pack_around(motion), course, 0, 0, 1e3, math.inf, -1.0) == math.inf


HOME = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8])
NOW = 3.0
TIMES = np.linspace(0.0, 0.2, 21)


@pytest.fixture(scope="module")
def panda():
    robot = load_holding("panda")
    return robot, PlannedMotion(robot)


def turn(robot, motion, rate, *, with_velocities=True):
    """The course of joint 1 that turns at a rate for 0.2 s and brakes."""
    q, v = np.tile(HOME, (21, 1)), np.zeros((21, 7))
    q[:, 0], v[:, 0] = rate * TIMES, rate
    plan = Plan(NOW, TIMES, q, v, np.full(7, 1e-3), np.full(7, 0.01))
    plan = append_stop(plan, robot.braking_deceleration)
    checked = check_plan(plan, robot, NOW, q[0], v[0], NOW)
    return motion.lay_out(checked, with_velocities=with_velocities)


def permit(**speeds):
    limits = RegionLimits(*ContactLimits({}).tabulate())
    for name, region in (("hand", HAND), ("head", HEAD)):
        limits.max_speed[region] = speeds.get(name, 0.0)
        limits.max_way[region] = math.inf
    return limits


def put(places, *, region=HAND, stated=True):
    """Balls that rest at some places, one of them or all of a region."""
    obstacles = Obstacles(accel=0.0, speed=0.0)
    places = np.reshape(np.asarray(places, dtype=float), (-1, 3))
    names = [f"ball{k}" for k in range(len(places))]
    obstacles.update(names, NOW, places, np.zeros_like(places), radius=0.02)
    obstacles.table.marks.regions[:] = 2**region if stated else 1
    return obstacles


def ask(panda, course, obstacles, limits, obstacle_speeds=-1.0):
    robot, motion = panda
    table = obstacles.table
    permitted = None if limits is None else Permissions(limits, obstacle_speeds)
    return motion.contact_time(
        course, all_pairs(obstacles, len(robot.links)), NOW, 0.0, table.accepted,
        table.refused_states, table.marks, permitted,
    )  # fmt: skip


def on_the_way(panda, course, time):
    """Where the tip of the arm is at a time on a course."""
    slab = int(np.searchsorted(course.end, time))
    return place_course(panda[1], course)[slab, -1]


def test_a_slow_piece_may_go_on_beside_a_hand_and_not_beside_a_head(panda):
    course = turn(*panda, 0.3)
    place = on_the_way(panda, course, 0.15)
    refused = ask(panda, course, put(place), None)
    assert refused.time < 0.2
    assert (refused.permitted_speed, refused.permitted_pair) == (0.0, -1)
    allowed = ask(panda, course, put(place), permit(hand=0.9))
    assert allowed.time == math.inf
    assert 0.1 < allowed.permitted_speed <= 0.9
    assert allowed.permitted_pair // len(panda[0].links) == 0
    for limits, options in (
        (permit(hand=0.9), {"region": HEAD}),
        (permit(hand=0.9), {"stated": False}),
        (permit(hand=0.02), {}),
        (permit(hand=math.nan), {}),
    ):
        found = ask(panda, course, put(place, **options), limits)
        assert found[:4] == refused[:4]
    both = put(place)
    both.table.marks.regions[:] = 2**HAND | 2**HEAD
    assert ask(panda, course, both, permit(hand=0.9)).time == refused.time
    head_behind = put([place, place])
    head_behind.table.marks.regions[1] = 2**HEAD
    found = ask(panda, course, head_behind, permit(hand=0.9))
    assert found.time == refused.time
    assert found.pair // len(panda[0].links) == 1


def test_contact_before_the_arm_is_slow_enough_refuses(panda):
    """It is fast for 0.2 s, and then brakes."""
    course = turn(*panda, 1.0)
    limits = permit(hand=0.45)
    soon = on_the_way(panda, course, 0.1)
    found = ask(panda, course, put(soon), limits)
    assert found.time == ask(panda, course, put(soon), None).time < 0.15
    # The farther ahead, the later the contact: one that the arm only just gets to.
    path = place_course(panda[1], course)[:, -1]
    ahead = (path[-1] - path[-5]) / np.linalg.norm(path[-1] - path[-5])
    near, far = 0.0, 0.5
    for _ in range(12):
        middle = 0.5 * (near + far)
        is_touched = ask(panda, course, put(path[-1] + middle * ahead), None).time < math.inf
        near, far = (middle, far) if is_touched else (near, middle)
    late = put(path[-1] + near * ahead)
    assert 0.2 < ask(panda, course, late, None).time < math.inf
    found = ask(panda, course, late, limits)
    assert found.time == math.inf
    assert 0.0 < found.permitted_speed <= 0.45


def test_what_may_be_clamped_needs_a_short_way_left(panda):
    course = turn(*panda, 0.3)
    soon = put(on_the_way(panda, course, 0.02))
    limits = permit(hand=0.9)
    limits.max_way[HAND] = 0.005
    refused = ask(panda, course, soon, None)
    assert ask(panda, course, soon, limits).time == math.inf
    assert ask(panda, course, soon, limits, 0.0).time == refused.time
    each = np.ones(len(panda[0].links), dtype=bool)
    assert ask(panda, course, soon, limits, each).time == refused.time
    limits.max_way[HAND] = 10.0
    assert ask(panda, course, soon, limits, 0.0).time == math.inf
    with pytest.raises(ValueError, match="broadcast"):
        ask(panda, course, soon, limits, each[1:])


def test_where_nothing_is_permitted_answers_are_those_without_limits(panda):
    random = np.random.default_rng(8)
    for rate in (0.0, 0.3, 1.0):
        plain = turn(*panda, rate, with_velocities=False)
        course = turn(*panda, rate)
        for _ in range(20):
            way = random.normal(size=(5, 3))
            way *= random.uniform(0.3, 1.2, (5, 1)) / np.linalg.norm(way, axis=1)[:, None]
            crowd = put(way + np.array([0.2, 0.0, 0.5]))
            expected = ask(panda, plain, crowd, None)
            assert ask(panda, course, crowd, None) == expected
            assert ask(panda, course, crowd, permit()) == expected
            assert ask(panda, course, crowd, permit(hand=0.0, head=0.0), 0.0) == expected
            # Where contact is permitted, the first that is not comes no sooner.
            assert ask(panda, course, crowd, permit(hand=0.5)).time >= expected.time


def test_the_center_of_the_tip_is_bounded_closely(panda):
    """Exact but for deviations, where one joint turns."""
    motion, course = panda[1], turn(*panda, 0.3)
    arm = motion._arm
    node = len(arm.carrier) - 1
    speeds, _ = bounds_of(motion, course, node)
    center = np.array(find_center(arm, course.placement[0], node))
    truth = 0.3 * (np.hypot(center[0], center[1]) + arm.tree.radius[node])
    assert truth <= speeds[0] < truth + 0.1


def test_what_is_summed_up_from_a_slab_on_is_of_all_later_slabs():
    """Of joints that go forth and back, so that they end near where they begin."""
    random, slabs = np.random.default_rng(7), 3 * BLOCK + 1
    edges = np.cumsum(random.uniform(0.001, 0.01, slabs + 1))
    times = np.array([edges[:-1], edges[1:]])
    middle, half = random.normal(size=(slabs, 3)), random.uniform(0.0, 0.1, (slabs, 3))
    slowest, fastest = np.sort(random.normal(size=(2, slabs, 3)), axis=0)
    parts = np.zeros((0, 0, 3))
    found = CourseSpeeds(*sum_up_speeds(times, middle, half, slowest, fastest, 5), parts)
    steps = np.diff(edges)[:, None]
    rise, fall = np.maximum(fastest, 0.0) * steps, np.maximum(-slowest, 0.0) * steps
    for slab in range(slabs):
        up, down, whole = (each[slab:].sum(axis=0) for each in (rise, fall, np.maximum(rise, fall)))
        np.testing.assert_allclose(found.ways[:, slab], [up, down, whole])
        away = (abs(middle[slab:] - middle[-1]) + half[slab:]).max(axis=0)
        np.testing.assert_allclose(found.away[slab], away)
    for block in range(4):
        own = slice(block * BLOCK, (block + 1) * BLOCK)
        np.testing.assert_array_equal(found.block_slowest[block], slowest[own].min(axis=0))
        np.testing.assert_array_equal(found.block_fastest[block], fastest[own].max(axis=0))
        frame = middle[find_frame(block, slabs)]
        wide = (abs(middle[own] - frame) + half[own]).max(axis=0)
        np.testing.assert_allclose(found.block_half[block], wide)
