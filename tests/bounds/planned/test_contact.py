import numpy as np
import pytest

from armguard.bounds import Plan, PlannedCourse, PlannedMotion, append_stop, check_plan
from armguard.bounds.closing import make_arms
from armguard.bounds.joint_box import make_box
from armguard.bounds.link_gaps import make_no_gaps
from armguard.bounds.planned.contact import NONE, find_planned_contact, make_surroundings
from armguard.bounds.planned.course import ArmShape
from armguard.bounds.planned.harmless import NO_SPEEDS
from armguard.jit.handle import pack
from armguard.obstacles import Obstacles
from armguard.obstacles.regions import make_no_limits
from armguard.obstacles.tethers import make_tethers
from armguard.robot.kinematics import SphereTree
from support.example_arms import load_holding
from support.plan_cases import all_pairs, place_course

HOME = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8])
STILL = np.zeros(7)
NOW = 3.0
TIMES = np.linspace(0.0, 0.2, 21)


@pytest.fixture(scope="module")
def arm():
    """A robot, its motion, and a course: joint 1 turns for 0.2 s and brakes."""
    robot = load_holding("panda")
    motion = PlannedMotion(robot)
    q, v = np.tile(HOME, (21, 1)), np.zeros((21, 7))
    q[:, 0], v[:, 0] = TIMES, 1.0
    plan = Plan(NOW, TIMES, q, v, np.full(7, 1e-3), np.full(7, 0.02))
    plan = append_stop(plan, robot.braking_deceleration)
    return robot, motion, motion.lay_out(check_plan(plan, robot, NOW, q[0], v[0], NOW))


def crowd(positions, *, stamp=NOW, velocity=None, **fields):
    obstacles = Obstacles()
    positions = np.reshape(np.asarray(positions, dtype=float), (-1, 3))
    ids = [f"ball{k}" for k in range(len(positions))]
    velocity = np.zeros_like(positions) if velocity is None else velocity
    obstacles.update(ids, stamp, positions, velocity, **({"radius": 0.1} | fields))
    return obstacles


def ask(arm, obstacles, *, now=NOW, margin=0.0, pairs=None):
    robot, motion, course = arm
    table = obstacles.table
    pairs = all_pairs(obstacles, len(robot.links)) if pairs is None else pairs
    return motion.contact_time(
        course, pairs, now, margin, table.accepted, table.refused_states, table.marks
    )


def make_slide(along, center, radius, half):
    """An arm of one sphere that a single slide moves, and a course of one slab."""

    def frozen(values):
        array = np.array(values)
        array.flags.writeable = False
        return array

    arm = ArmShape(
        SphereTree(*(frozen([value]) for value in (0, -1, -1, -1, radius))),
        np.ones((1, 1)), make_box(np.array([False]), np.zeros(1)), np.zeros(1, dtype=np.int64),
        np.zeros((1, 3)), np.zeros(1), np.ones((1, 1), dtype=bool), make_no_gaps(),
        make_arms(1),
    )  # fmt: skip
    jacobian = np.append(along, np.zeros(3)).reshape(1, 6, 1)
    ball = np.append(center, radius + half)
    course = PlannedCourse(
        NOW, np.zeros(1), np.ones(1), np.zeros((1, 1)), np.full((1, 1), half),
        np.column_stack([np.eye(3), center])[None, None],
        jacobian, ball.reshape(1, 1, 4).copy(), ball, NO_SPEEDS,
    )  # fmt: skip
    return arm, course


@pytest.mark.parametrize("share", ["half", "radius", "body", "margin", "error"])
def test_what_a_sphere_is_off_and_all_errors_count_in_full(share):
    """A sphere on a slide is off its place by half the slab's width, one way or the other."""
    random = np.random.default_rng(3)
    for _ in range(40):
        along = random.normal(size=3)
        along /= np.linalg.norm(along)
        center = random.uniform(-1.0, 1.0, 3)
        parts = dict.fromkeys(["half", "radius", "body", "margin", "error"], 0.01)
        parts[share] = random.uniform(0.1, 0.5)
        arm, course = make_slide(along, center, parts["radius"], parts["half"])
        across = np.cross(along, random.normal(size=3))
        across /= np.linalg.norm(across)
        for way, needed in (
            (random.choice([-1.0, 1.0]) * along, sum(parts.values())),
            (across, sum(parts.values()) - parts["half"]),
        ):
            for factor in (1.0 - 1e-9, 1.0 + 1e-9):
                rest = crowd(
                    center + factor * needed * way,
                    radius=parts["body"], position_error=parts["error"], accel=0.0, speed=0.0,
                )  # fmt: skip
                table = rest.table
                around = make_surroundings(
                    arm,
                    table.accepted,
                    table.refused_states,
                    table.marks,
                    make_no_limits(),
                    make_tethers(0, 0),
                )
                given = course, all_pairs(rest, 1), np.zeros(1, bool), NOW, parts["margin"]
                time, *_ = find_planned_contact(pack(around), *given)
                assert time == (np.inf if factor > 1.0 else 0.0)


def random_place(random, least=0.3, most=1.5):
    way = random.normal(size=3)
    return np.array([0.2, 0.0, 0.5]) + way * random.uniform(least, most) / np.linalg.norm(way)


def test_nobody_and_the_far_are_free(arm):
    assert ask(arm, crowd([])) == (np.inf, NONE, NONE, 0, 0.0, NONE)
    found = ask(arm, crowd([[5.0, 0.0, 0.0], [0.0, 0.0, 9.0]]))
    assert found[:3] == (np.inf, NONE, NONE)
    assert found.evaluated > 0


def test_contact_now_names_who_touches(arm):
    robot, motion, course = arm
    obstacles = crowd([[5.0, 0.0, 0.0], place_course(motion, course)[0, -1]])
    found = ask(arm, obstacles)
    assert found.time == 0.0
    row, link = divmod(found.pair, len(robot.links))
    assert obstacles.ids[row] == "ball1"
    sphere = motion._kinematics.spheres
    assert sphere.link[found.sphere] == link
    assert sphere.child_count[found.sphere] == 0


def test_the_earliest_of_all_pairs_decides_whatever_their_order(arm):
    random = np.random.default_rng(0)
    for _ in range(30):
        obstacles = crowd([random_place(random) for _ in range(5)])
        pairs = all_pairs(obstacles, len(arm[0].links))
        alone = [ask(arm, obstacles, pairs=pairs[k : k + 1]).time for k in range(len(pairs))]
        found = ask(arm, obstacles)
        assert found.time == min(alone)
        assert ask(arm, obstacles, pairs=random.permutation(pairs)).time == found.time
        if found.pair != NONE:
            assert alone[list(pairs).index(found.pair)] == found.time
            others = pairs[pairs // len(arm[0].links) != found.pair // len(arm[0].links)]
            assert ask(arm, obstacles, pairs=others).time >= found.time


def test_a_refused_sample_may_be_as_true_as_the_track_it_left(arm):
    near, far = place_course(*arm[1:])[0, -1] + [0.0, 0.0, 0.5], [9.0, 0.0, 0.0]
    for first, second in ((near, far), (far, near)):
        obstacles = crowd(first)
        obstacles.update(["ball0"], NOW, [second], np.zeros((1, 3)), radius=0.1)
        assert obstacles.table.refused.any()
        assert ask(arm, obstacles).time <= ask(arm, crowd(near)).time < np.inf


def test_where_nothing_is_known_contact_is_now(arm):
    for position in ([np.nan, 0.0, 0.0], [np.inf, 0.0, 0.0]):
        unseen = crowd([9.0, 0.0, 0.0])
        unseen.update(["ball0"], NOW, [position], np.zeros((1, 3)), radius=0.1)
        found = ask(arm, unseen)
        assert (found.time, found.sphere) == (0.0, NONE)
        assert found.pair // len(arm[0].links) in np.flatnonzero(unseen.table.alive)
    never = crowd([9.0, 0.0, 0.0])
    never.table.has_state[:] = False
    assert ask(arm, never).time == 0.0


@pytest.mark.parametrize(
    "field", ["points", "velocities", "radius", "accel", "speed", "velocity_error", "stamp"]
)
def test_nonsense_is_contact_now(arm, field):
    obstacles = crowd([1.6, 0.0, 0.5])
    assert ask(arm, obstacles).time > 0.1
    getattr(obstacles.table, field)[:] = np.nan
    assert ask(arm, obstacles).time == 0.0


@pytest.mark.parametrize("margin", [np.nan, -0.1, np.inf])
def test_no_sense_in_a_margin_is_contact_now(arm, margin):
    assert ask(arm, crowd([1.6, 0.0, 0.5]), margin=margin).time == 0.0


def test_what_stands_still_for_ever_does_not_age(arm):
    obstacles = Obstacles()
    obstacles.add_static("post", np.array([1.1, 0.0, 0.5]), 0.1)
    assert ask(arm, obstacles).time == np.inf
    assert ask(arm, obstacles, now=NOW + 0.1).time == np.inf
    in_the_way = Obstacles()
    path = place_course(*arm[1:])[:, -1]
    ahead = (path[39] - path[0]) / np.linalg.norm(path[39] - path[0])
    in_the_way.add_static("post", path[39] + 0.06 * ahead, 0.01)
    assert 0.0 < ask(arm, in_the_way).time < 0.3
    assert ask(arm, in_the_way, now=NOW + 0.1).time < ask(arm, in_the_way).time


def test_contact_of_a_resting_arm_does_not_count(arm):
    rest = arm[2].end[-1]
    reach = arm[2].arm_ball[3]
    center = arm[2].arm_ball[:3]
    place = center + np.array([reach + 0.1 + rest + 0.01, 0.0, 0.0])
    assert ask(arm, crowd(place, accel=100.0, speed=1.0)).time == np.inf
    closer = ask(arm, crowd(place - np.array([rest, 0.0, 0.0]), accel=100.0, speed=1.0))
    assert closer.time < np.inf


@pytest.mark.parametrize("now", [NOW - 1e-6, NOW + 10.0, np.nan, np.inf, -np.inf])
def test_outside_the_course_nothing_is_known(arm, now):
    assert ask(arm, crowd([9.0, 0.0, 0.0]), now=now)[:3] == (0.0, NONE, NONE)
