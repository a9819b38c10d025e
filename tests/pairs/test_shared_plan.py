"""A plan that another arm has shared: whatever it does without breaking its word is bounded."""

import math

import numpy as np
import pinocchio
import pytest

import armguard
from armguard.exceptions import ArmguardError
from armguard.obstacles.faults import FaultKind
from armguard.pairs.shared_plan import read_shared_plan
from support.panda_monitor import HOME, STILL, panda
from support.row_law import Told, go_on
from support.two_arms import TrueArm

START, FOR, STEP = 100.0, 0.35, 0.02  # when a plan begins, how long it is promised, its samples
TRACKING = 0.005  # rad/s
NO_TURNS = np.full(7, np.inf)  # no joint is continuous


def limits_of(robot):
    return armguard.OperatingLimits(0.2 * robot.velocity_limit, np.full(7, 1.0))


class Path:
    """A smooth way with speeds and accelerations below operating limits, exactly known."""

    def __init__(self, generator, q, velocity, acceleration):
        self.q = q
        frequency = generator.uniform(0.5, 3.0, 7)
        size = generator.uniform(0.1, 0.9, 7) * np.minimum(velocity, acceleration / frequency)
        self.size, self.frequency = size * generator.choice([-1.0, 1.0], 7), frequency
        self.phase = generator.uniform(0.0, 2.0 * np.pi, 7)

    def velocity(self, s):
        return self.size * np.sin(self.frequency * s + self.phase)

    def position(self, s):
        angle = np.cos(self.phase) - np.cos(self.frequency * s + self.phase)
        return self.q + self.size / self.frequency * angle

    def plan(self, begin, end):
        times = np.arange(round((end - begin) / STEP) + 2) * STEP
        places = np.array([self.position(begin + t) for t in times])
        speeds = np.array([self.velocity(begin + t) for t in times])
        errors = np.full(7, 1e-3), np.full(7, TRACKING)
        return armguard.Plan(START, times, places, speeds, *errors)


def leave(arm, path, plan, way, generator, times):
    """Joint positions of an arm that keeps its word until `FOR` and then attacks; and velocities.

    Args:
        arm: Moves by its operating limits.
        path: What it follows.
        plan: When its clock begins on the path.
        way: "on time", "slow", or "stop".
        generator: Chooses when it stops or slows down, and where it goes to afterwards.
        times: In [s] from the plan's beginning, rising.
    """
    clock, pace, before = plan, 1.0, 0.0
    begins = generator.uniform(0.0, FOR - 0.05)
    arm.q, arm.v = path.position(clock), path.velocity(clock)
    is_stopping, places, speeds = False, [], []
    wanted = generator.choice([-1.0, 1.0], 7) * arm.velocity
    for time in times:
        dt, before = time - before, time
        if time > FOR + 1e-12:
            arm.push(wanted, dt)
        elif way == "stop" and time > begins:
            # Each joint by itself, as hard or as gently as it likes, within what brakes do.
            hardness = arm.robot.braking_deceleration * generator.uniform(1.0, 1.5, 7)
            after = arm.v - np.clip(arm.v, -hardness * dt, hardness * dt)
            arm.q, arm.v = arm.q + 0.5 * dt * (arm.v + after), after
            is_stopping = True
        else:
            if way == "slow" and time > begins:
                pace = max(0.2, pace - 5.0 * dt)
            clock += pace * dt
            arm.q, arm.v = path.position(clock), pace * path.velocity(clock)
        places.append(arm.q)
        speeds.append(arm.v)
    assert is_stopping == (way == "stop")
    return np.array(places), np.array(speeds)


@pytest.mark.parametrize("way", ["on time", "slow", "stop"])
def test_no_ball_of_an_arm_that_keeps_its_word_leaves_what_its_row_allows(way):
    """Exact positions along the plan, every departure from it, and an attack as soon as it ends."""
    robot, generator = panda(), np.random.default_rng(11)
    velocity, acceleration = limits_of(robot).resolve(robot)
    arm = TrueArm(robot, pinocchio.SE3.Identity(), HOME, velocity, acceleration)
    spheres = [
        (robot.joint_index(link), robot.cover.spheres(link, min(1, robot.cover.levels(link) - 1)))
        for link in robot.links
    ]
    joint = np.concatenate([np.full(len(some), number) for number, some in spheres])
    local = np.concatenate([some for _, some in spheres])[:, :3]
    times = np.arange(1, 46) * 0.02
    told, plain, tightest, narrowed = Told(), Told(), -np.inf, []
    for _ in range(25):
        q = HOME + generator.uniform(-0.3, 0.3, 7)
        path, begin = Path(generator, q, velocity, acceleration), generator.uniform(0.0, 2.0)
        places, speeds = leave(arm, path, begin, way, generator, times)
        other = armguard.ArmObstacles(robot, operating=limits_of(robot))
        without = armguard.ArmObstacles(robot, operating=limits_of(robot))
        other.take_plan(path.plan(begin, begin + FOR), START + FOR)
        centers_at = [
            np.concatenate(
                [arm.points_at(q, int(one), local[joint == one]) for one in dict.fromkeys(joint)]
            )
            for q in places
        ]
        for k in range(0, round(FOR / 0.02), 4):
            wrong = generator.choice([-1.0, 1.0], (2, 7))
            q = places[k] + wrong[0] * robot.position_error
            v = speeds[k] + wrong[1] * robot.velocity_error
            other.publish(told, START + times[k], q, v)
            without.publish(plain, START + times[k], q, v)
            centers, velocities, _, accel, speed, error, velocity_error = told.fields
            narrowed.append(accel[-1] / plain.fields[3][-1])
            directions = generator.normal(size=(30, 3))
            directions /= np.linalg.norm(directions, axis=1)[:, None]
            closing = velocities @ directions.T + velocity_error[:, None]
            for m in range(k + 1, len(times)):
                moved = (centers_at[m] - centers) @ directions.T
                passed = times[m] - times[k]
                allowed = go_on(closing, accel[:, None], speed[:, None], passed) + error[:, None]
                tightest = max(tightest, float((moved - allowed).max()))
    assert tightest <= 1e-12
    assert not told.problems
    assert np.median(narrowed) < 0.85, "else nothing is gained"
    assert max(narrowed) <= 1.0 + 1e-9


def steady(speed, **changes):
    """A plan in which joint 1 turns at a steady speed, longer than it is promised."""
    times = np.arange(4) * 0.2
    first = np.eye(7)[0]
    q, v = HOME + np.outer(times * speed, first), np.tile(speed * first, (4, 1))
    fields = {"stamp": START, "times": times, "q": q, "v": v, "tracking_error": np.full(7, 1e-3)}
    fields |= {"velocity_tracking_error": np.full(7, TRACKING)}
    return armguard.Plan(**fields | changes)


def test_ceilings_hold_the_whole_curve_whatever_is_between_the_samples():
    generator = np.random.default_rng(5)
    for _ in range(8):
        times = np.concatenate([[0.0], np.cumsum(generator.uniform(0.01, 0.3, 60))])
        q, v = generator.uniform(-1.0, 1.0, (61, 2)), generator.uniform(-1.0, 1.0, (61, 2))
        plan = armguard.Plan(7.0, times, q, v, np.ones(2), np.full(2, 0.1))
        shared = read_shared_plan(plan, 7.0 + times[-1], np.full(2, np.inf))
        fastest = np.zeros((2, 2))
        for k in range(60):
            h = times[k + 1] - times[k]
            for u in np.linspace(0.0, 1.0, 20):
                # The derivative of the cubic Hermite curve, written out.
                speed = (q[k + 1] - q[k]) / h * 6.0 * u * (1.0 - u)
                speed += v[k] * (1.0 - u) * (1.0 - 3.0 * u) + v[k + 1] * u * (3.0 * u - 2.0)
                fastest = np.maximum(fastest, [speed + 0.1, 0.1 - speed])
                step = np.flatnonzero(shared.begins <= 7.0 + times[k] + u * h)[-1]
                assert (shared.ceilings[step] >= fastest - 1e-12).all()


def test_a_continuous_joint_may_wrap_between_samples():
    times, bend = np.array([0.0, 1.0]), math.pi - 0.1
    q, v, errors = np.array([[bend], [-bend]]), np.zeros((2, 1)), np.full(1, 1e-3)
    plan = armguard.Plan(7.0, times, q, v, errors, errors)
    wrapped = read_shared_plan(plan, 8.0, np.array([3.0]))
    assert wrapped.ceilings[-1, 0] == pytest.approx(3.0 * 0.2 + 1e-3), "the short way, forwards"
    assert wrapped.ceilings[-1, 1] == pytest.approx(1e-3)
    written = read_shared_plan(plan, 8.0, np.array([np.inf]))
    assert written.ceilings[-1, 1] == pytest.approx(3.0 * 2.0 * bend + 1e-3)


def test_the_line_is_above_every_bound_and_below_that_without_a_plan():
    velocity, acceleration = np.full(7, 0.4), np.full(7, 1.5)
    shared = read_shared_plan(steady(0.2), START + 0.5, NO_TURNS)
    for stamp in (START, START + 0.21, START + 0.49):
        fastest = np.zeros((2, 7)) + 0.02
        fastest[0, 0] = 0.22
        lift, slope = shared.narrow(stamp, fastest, velocity, acceleration)
        assert (slope <= acceleration).all()
        assert (lift >= 0.0).all()
        for t in np.linspace(0.0, 1.5, 300):
            at, joint_law = stamp + t, fastest + acceleration * t
            ceiling = np.array([[0.2 + TRACKING] + [TRACKING] * 6, [TRACKING] * 7])
            if at > START + 0.5:
                ceiling = ceiling + acceleration * (at - START - 0.5)
            true = np.minimum(np.minimum(joint_law, ceiling), velocity)
            assert (fastest + lift + slope * t >= true - 1e-12).all()
    _, early = shared.narrow(START, fastest, velocity, acceleration)
    assert (early < 0.6 * acceleration).all(), "else nothing is gained"


def test_a_plan_counts_from_its_beginning_until_its_end_and_not_beyond():
    robot, told = panda(), Told()
    other = armguard.ArmObstacles(robot, operating=limits_of(robot))
    speed = 0.2 * np.eye(7)[0]
    accels = {}
    other.take_plan(steady(0.2), START + 0.5)
    for stamp in (START - 0.1, START, START + 0.3, START + 0.5):
        other.publish(told, stamp, HOME, speed)
        accels[stamp] = told.fields[3][-1]
    without = accels[START - 0.1]
    assert accels[START + 0.5] == without
    assert accels[START] < accels[START + 0.3] < without
    assert not told.problems


@pytest.mark.parametrize("order", [(0.3, 0.5), (0.5, 0.3)])
def test_of_two_plans_that_count_the_one_that_lasts_longer_says_what_balls_can_do(order):
    """It narrows most, whichever of them came first."""
    robot, told, alone = panda(), Told(), Told()
    other, single = (armguard.ArmObstacles(robot, operating=limits_of(robot)) for _ in range(2))
    for lasting in order:
        other.take_plan(steady(0.2), START + lasting)
    single.take_plan(steady(0.2), START + 0.5)
    for stamp in (START + 0.1, START + 0.4):
        for one, table in ((other, told), (single, alone)):
            one.publish(table, stamp, HOME, 0.2 * np.eye(7)[0])
        assert (told.fields[3] == alone.fields[3]).all()


@pytest.mark.parametrize(("speed", "is_broken"), [(0.2, False), (0.25, True), (-0.05, True)])
def test_a_joint_that_is_faster_than_its_plan_is_a_break_and_ends_what_was_promised(
    speed, is_broken
):
    robot, table = panda(), armguard.Obstacles()
    other = armguard.ArmObstacles(robot, "right", operating=limits_of(robot))
    other.take_plan(steady(0.2), START + 0.5)
    other.publish(table, START + 0.1, HOME, speed * np.eye(7)[0])
    faults = table.take_faults()
    assert bool(faults) == is_broken
    row = table.row(other.ids[-1])
    assert (table.table.speed[row] > 5.0) == is_broken, "in m/s: what the hardware can do"
    for fault in faults:
        assert (fault.kind, fault.source) == (FaultKind.PROMISE_BROKEN, "right")
        assert fault.field == "panda_joint1"
        assert "leaves the plan that was shared" in fault.value


@pytest.mark.parametrize("speed", [0.02, 0.05, 0.08])
def test_a_joint_that_has_stopped_and_goes_on_at_once_stays_where_its_row_allows(speed):
    """From rest up to the plan's speed by the operating acceleration, and on from there."""
    robot, told = armguard.Robot.load("panda"), Told()
    # So small that balls get no room from them.
    robot.velocity_error, robot.position_error = np.full(7, 1e-4), np.full(7, 1e-5)
    limits = limits_of(robot).resolve(robot)
    arm = TrueArm(robot, pinocchio.SE3.Identity(), HOME, *limits)
    levels = [robot.cover.spheres(one, min(1, robot.cover.levels(one) - 1)) for one in robot.links]
    other = armguard.ArmObstacles(robot, operating=limits_of(robot))
    times = np.arange(11.0)
    q = HOME + np.outer(speed * times, np.eye(7)[0])
    plan = steady(speed, times=times, q=q, v=np.tile(speed * np.eye(7)[0], (11, 1)))
    quiet = np.full(7, 1e-4)
    other.take_plan(plan._replace(velocity_tracking_error=quiet), START + 9.0)
    other.publish(told, START + 0.01, HOME, STILL)
    centers, velocities, _, accels, speeds, errors, velocity_errors = told.fields
    assert not velocities.any()
    closest, ramp = 0.0, speed / limits[1][0]
    for time in np.linspace(0.01, 0.45, 23):
        on = min(time, ramp)
        turned = 0.5 * limits[1][0] * on**2 + speed * (time - on)
        places = np.concatenate(
            [
                arm.points_at(HOME + turned * np.eye(7)[0], robot.joint_index(link), some[:, :3])
                for link, some in zip(robot.links, levels, strict=True)
            ]
        )
        moved = np.linalg.norm(places - centers, axis=1)
        allowed = go_on(velocity_errors, accels, speeds, time) + errors
        assert (moved <= allowed).all()
        closest = max(closest, (moved / allowed).max())
    assert closest > 0.3, "else nothing is narrow"


def test_what_velocities_may_be_off_by_counts_to_how_fast_joints_are_under_a_plan():
    """Where the plan leaves more room than joints can use, they go on from what was measured."""
    accels = []
    for error in (0.0, 0.1):
        robot, told = armguard.Robot.load("panda"), Told()
        robot.velocity_error = np.full(7, error)
        other = armguard.ArmObstacles(robot, operating=limits_of(robot))
        other.take_plan(steady(0.4), START + 0.5)
        other.publish(told, START + 0.01, HOME, 0.1 * np.eye(7)[0])
        accels.append(told.fields[3])
    exact, vague = accels
    assert vague[-1] > exact[-1]


def test_what_was_promised_before_a_break_does_not_count_again_when_that_is_over():
    robot, told = panda(), [Told(), Told()]
    others = [armguard.ArmObstacles(robot, operating=limits_of(robot)) for _ in told]
    others[0].take_plan(steady(0.0), START + 9.0)
    for stamp, speed in ((0.1, 0.05), (3.0, 0.0)):
        for other, table in zip(others, told, strict=True):
            other.publish(table, START + stamp, HOME, speed * np.eye(7)[0])
    assert [len(table.problems) for table in told] == [1, 0]
    assert (told[0].fields[3] == told[1].fields[3]).all()


@pytest.mark.parametrize("error", [-0.01, math.nan, math.inf])
def test_a_clock_that_is_off_by_no_length_of_time_is_refused(error):
    other = armguard.ArmObstacles(panda())
    with pytest.raises(armguard.ArmguardError, match="clock_error: is "):
        other.take_plan(steady(0.2), START + 0.5, error)


def test_a_clock_that_is_off_shortens_what_is_promised_at_both_ends():
    shared = read_shared_plan(steady(0.2), START + 0.5, NO_TURNS, clock_error=0.01)
    assert (shared.start, shared.until) == (START + 0.01, START + 0.49)
    assert shared.begins[0] == START - 0.01, "the arm may be further along than it seems"


@pytest.mark.parametrize(
    ("plan", "until", "words"),
    [
        ("plan", START + 0.5, "expected an armguard.Plan"),
        (steady(math.nan), START + 0.5, "shared plan: q: is not finite"),
        (steady(0.2, velocity_tracking_error=None), START + 0.5, "no velocity_tracking_error"),
        (steady(0.2), START, "until: is 100.0"),
        (steady(0.2), math.inf, "until: is inf"),
        (steady(0.2), "soon", "until: is 'soon'"),
        (steady(0.2), 10**400, "until: is 1000"),
        (
            steady(0.2, times=np.arange(2001.0), q=np.zeros((2001, 7)), v=np.zeros((2001, 7))),
            START + 0.5,
            "has 2001 samples; expected 2000 at most",
        ),
        (steady(0.2), START + 0.7, "before `until`, and not at rest"),
    ],
)
def test_what_is_no_promise_is_refused_by_name_and_the_one_before_counts_on(plan, until, words):
    robot, told = panda(), Told()
    other = armguard.ArmObstacles(robot, operating=limits_of(robot))
    other.take_plan(steady(0.0), START + 9.0)
    with pytest.raises(ArmguardError, match=words):
        other.take_plan(plan, until)
    other.publish(told, START + 1.0, HOME, STILL)
    with_plan = told.fields[3][-1]
    armguard.ArmObstacles(robot, operating=limits_of(robot)).publish(told, START + 1.0, HOME, STILL)
    assert with_plan < 0.5 * told.fields[3][-1]
