"""An arm that is said to recede presses the part with no point of its surface."""

import numpy as np
import pytest

from armguard.bounds import CheckedPlan, Plan, append_stop, check_plan
from armguard.bounds.arm import ArmMotion
from armguard.jit.kernels import kernel
from armguard.pairs.receding import find_pressing_link, sum_up_motion
from armguard.pairs.touching import NO_LINK
from armguard.robot.kinematics import Kinematics
from armguard.settings.contact_limits import ContactLimit, ContactLimits
from support.panda_monitor import HOME, STILL, panda
from support.permitted_contact import RADIUS, Encounter, find_columns, find_front, go_straight
from support.plan_cases import Hermite

LIMITS = ContactLimits({"hand": ContactLimit(speed=1.0, source="test")})
TIMES = np.linspace(0.0, 0.25, 26)
ERROR = 1e-4


@kernel
def ask(handle, row, watched, course, now):
    return find_pressing_link(handle, row, watched, course, now)


def make_piece(rates, seconds=0.25):
    """A piece that starts and ends at rest, at these velocities in the mean, in [rad]/[s]."""
    times = TIMES * (seconds / TIMES[-1])
    along = np.sin(0.5 * np.pi * times / times[-1]) ** 2
    pace = 0.5 * np.pi / times[-1] * np.sin(np.pi * times / times[-1])
    q = HOME + times[-1] * along[:, None] * rates
    v = times[-1] * pace[:, None] * rates
    error = np.full(len(HOME), ERROR)
    plan = append_stop(Plan(0.0, times, q, v, error, error), panda().braking_deceleration)
    checked = check_plan(plan, panda(), 0.0, HOME, STILL, 0.0)
    assert isinstance(checked, CheckedPlan), checked
    return checked


class Touch:
    """A hand that touches the front of the last link, or another place."""

    def __init__(self, depth=0.005, position=None, **fields):
        self.encounter = encounter = Encounter(-depth, limits=LIMITS)
        encounter.see(position=position, **fields)
        encounter.step()
        self.tick, self.row = encounter.monitor._last[0], encounter.row()
        encounter.scheduler.prepare(self.tick)

    def presses(self, plan, *, may_leave=False):
        scheduler = self.encounter.scheduler
        left = None
        if may_leave:
            motion = ArmMotion(panda(), 0.02, with_plans=True, with_velocities=True)
            left = motion.planned.lay_out_left(plan)
        course = sum_up_motion(plan, 0.0, HOME, left)
        watched = scheduler.certificates.watched[self.row]
        handle = scheduler.arm.state.handle
        return ask(handle, self.row, watched, course, 0.0) != NO_LINK


@pytest.mark.parametrize(
    ("velocity", "presses"),
    [
        ((-0.03, 0.0, 0.0), False),
        ((-0.03, 0.006, 0.0), False),
        ((0.0, 0.0, 0.0), False),
        ((0.03, 0.0, 0.0), True),
        ((0.0, 0.03, 0.0), True),
        ((-0.03, 0.06, 0.0), True),
    ],
)
def test_what_draws_straight_back_recedes_and_nothing_else(velocity, presses):
    touch = Touch()
    assert touch.presses(make_piece(go_straight(velocity))) == presses


def test_a_link_that_turns_about_what_touches_presses():
    """The centre of the sphere stays, or draws back, but the rest of its surface does not."""
    columns, axes = find_columns()
    for back in (0.0, -0.005):
        wanted = np.array([back, 0.0, 0.0, 0.0, 0.0, 0.3])
        rates = np.linalg.lstsq(np.concatenate([columns, axes]), wanted, rcond=None)[0]
        assert (columns @ rates)[0] == pytest.approx(back, abs=1e-6)
        assert Touch().presses(make_piece(rates))


def test_a_piece_that_comes_back_presses():
    there = make_piece(go_straight((-0.03, 0.0, 0.0)))
    back = make_piece(go_straight((0.03, 0.0, 0.0)))
    q = np.concatenate([there.q, there.q[-1] + back.q[1:] - HOME])
    times = np.concatenate([there.times, there.times[-1] + back.times[1:]])
    plan = there._replace(times=times, q=q, v=np.concatenate([there.v, back.v[1:]]))
    touch = Touch()
    assert not touch.presses(there)
    assert touch.presses(plan)
    # What is over does not count, nor what does not touch.
    over = plan._replace(stamp=-there.times[-1])
    assert touch.presses(over)
    assert not touch.presses(plan._replace(stamp=-times[-1]))
    assert not Touch(-0.02).presses(plan)


def test_joints_that_may_leave_a_piece_must_recede_one_by_one():
    """Together they draw straight back, but some of them alone would not."""
    plan = make_piece(go_straight((-0.03, 0.0, 0.0)))
    touch = Touch()
    assert not touch.presses(plan)
    assert touch.presses(plan, may_leave=True)


def test_a_part_whose_place_is_vague_is_not_surely_receded_from():
    plan = make_piece(go_straight((-0.03, 0.009, 0.0)))
    assert not Touch().presses(plan)
    assert Touch(position_error=0.05).presses(plan)
    # Deep inside it lies in every direction.
    assert Touch(0.099).presses(plan)


def test_no_point_of_a_sphere_ever_moves_towards_the_part():
    """Points of the arm inside spheres that touch, in all directions in which the part can lie."""
    random = np.random.default_rng(3)
    robot = panda()
    kinematics = Kinematics(robot)
    spheres, model = kinematics.spheres, robot.model
    leaves = np.flatnonzero(spheres.tree.first_child < 0)
    center, radius = find_front()
    accepted, closest = 0, -np.inf
    for _ in range(60):
        away = random.normal(size=3) * 0.4 + [1.0, 0.0, 0.0]
        away /= np.linalg.norm(away)
        error = random.choice([0.0, 0.003])
        position = center + away * (radius + RADIUS - random.uniform(0.0, 0.01))
        rates = go_straight(-0.03 * away + 0.006 * random.normal(size=3))
        rates += 0.005 * random.normal(size=7) * (random.random() < 0.5)
        plan = make_piece(rates, random.choice([0.15, 0.3]))
        touch = Touch(position=position, position_error=error)
        if touch.presses(plan):
            continue
        accepted += 1
        curve = Hermite(plan.times, plan.q, plan.v)
        off = random.choice([-1.0, 1.0], 7) * plan.deviation
        true = position + error * off[:3] / max(np.linalg.norm(off[:3]), 1e-12)
        for time in np.linspace(0.0, plan.times[-1], 12):
            kinematics.compute(curve(time) + off, curve(time, 1))
            centers, joint = kinematics.centers.copy(), spheres.joint
            jacobian = np.array(kinematics.placement.jacobian)
            moves = kinematics.placement.moves
            gaps = np.linalg.norm(centers - true, axis=1) - spheres.radius - RADIUS
            for leaf in leaves[gaps[leaves] <= 0.0]:
                rate = curve(time, 1) * moves[joint[leaf]]
                linear, angular = rate @ jacobian[:, :3], rate @ jacobian[:, 3:]
                points = random.normal(size=(60, 3))
                points *= spheres.radius[leaf] / np.linalg.norm(points, axis=1)[:, None]
                velocities = linear + np.cross(angular, centers[leaf] + points)
                normal = true - centers[leaf]
                towards = velocities @ (normal / np.linalg.norm(normal))
                closest = max(closest, towards.max())
    assert accepted > 10
    assert closest <= 1e-7
    assert model.nv == 7
