import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot import Robot
from armguard.shield import Path, Shield
from armguard.shield.shield import LEAST_GRAIN
from armguard.verdict import BRAKE, FINISH, Level
from support.shielded_arm import HOME, JERK, RATE, ShieldedArm

NEAR = np.array([0.5, 0.1, 0.0, 0.1, 0.0, 0.2, 0.0])


def make_path(random=None, count=4):
    """A way from home through some places near it."""
    random = np.random.default_rng(1) if random is None else random
    return Path(np.concatenate([[HOME], HOME + random.uniform(-0.4, 0.4, (count, 7))]))


def check_limits(arm, jerk_slack=1.02):
    """That what the arm did keeps its limits and never jumps."""
    limits = arm.shield.limits
    q, v, a = (np.array([state[k] for state in arm.moved]) for k in range(3))
    assert np.abs(np.diff(q, axis=0)).max() <= 1e-3 * limits.velocity.max() + 1e-9
    assert (np.abs(v) <= limits.velocity + 1e-6).all()
    speeding = np.where(v * a > 0.0, np.abs(a), 0.0)
    assert (speeding <= limits.acceleration + 1e-3).all()
    assert (np.abs(a) <= np.maximum(limits.braking, limits.acceleration) + 1e-3).all()
    # Over 10 ms, so that what rounding does to differences does not count.
    jerks = np.abs(a[10:] - a[:-10]) / 0.01
    assert (jerks <= limits.jerk * jerk_slack).all(), (jerks / limits.jerk).max()


def test_an_arm_that_nothing_hinders_follows_its_path_to_the_end():
    arm = ShieldedArm(0, balls=0)
    path = make_path()
    arm.shield.set_path(path)
    for _ in range(3000):
        command = arm.step()
        if arm.shield.progress == 1.0 and not command.moving:
            break
    assert arm.shield.progress == 1.0
    assert arm.q == pytest.approx(path.q[-1], abs=1e-6)
    assert arm.now < 20.0
    check_limits(arm)


def test_a_latency_of_one_period_refuses_nothing():
    """The last motion begins just when the next piece does, but for rounding."""
    arm = ShieldedArm(0, balls=0, settings={"latency": 1.0 / RATE})
    arm.shield.set_path(make_path())
    reasons = set()
    for tick in range(200):
        arm.now = tick / RATE
        reasons.add(str(arm.step().reason))
    assert arm.shield.progress > 0.1
    assert reasons == {"None"}


@pytest.mark.parametrize("seed", range(6))
def test_whatever_is_asked_the_arm_touches_nothing_and_keeps_its_limits(seed):
    random = np.random.default_rng(seed)
    arm = ShieldedArm(seed, balls=1 + seed % 2)
    arm.shield.set_path(make_path(random))
    wish = {}
    moved = 0.0
    for tick in range(600):
        if tick % 40 == 0:
            kind = random.integers(4)
            if kind == 0:
                wish = {}
            elif kind == 1:
                wish = {"velocity": random.uniform(-2.0, 2.0, 7)}
            elif kind == 2:
                wish = {}
                start = arm.q + np.zeros((20, 1))
                points = start + np.cumsum(random.uniform(-0.01, 0.01, (20, 7)), axis=0)
                arm.step(chunk=points)
            else:
                wish = {"velocity": random.choice([np.nan, np.inf, "no", None], 7)}
        silent = 100 < tick % 200 < 104
        before = arm.q
        arm.step(sees=random.random() > 0.05, asks=not silent, **wish)
        moved += float(np.abs(arm.q - before).max())
    assert arm.contacts == 0
    assert moved > 0.03
    check_limits(arm)


def test_a_silent_caller_is_left_on_a_motion_that_rests():
    arm = ShieldedArm(3)
    for _ in range(40):
        command = arm.step(velocity=NEAR)
    assert command.moving
    for _ in range(200):
        arm.step(asks=False)
    assert arm.now > command.valid_until
    assert arm.v == pytest.approx(np.zeros(7), abs=1e-12)
    assert arm.q == pytest.approx(command.q[-1])
    assert arm.contacts == 0


def test_every_command_is_what_the_monitor_has_committed_last():
    arm = ShieldedArm(4)
    arm.shield.set_path(make_path())
    shown = []
    fastest = arm.monitor.fastest

    def note(candidates):
        candidates = list(candidates)
        choice = fastest(candidates)
        if choice.number is not None:
            shown.append(candidates[choice.number])
        return choice

    arm.monitor.fastest = note
    for _ in range(300):
        count = len(shown)
        command = arm.step()
        assert command.is_new == (len(shown) > count)
        if shown:
            assert command.times == pytest.approx(shown[-1].stamp + shown[-1].times, abs=1e-9)
            assert command.q == pytest.approx(shown[-1].q, abs=0.0)
            assert not command.v[-1].any()
            assert (np.diff(command.times) >= LEAST_GRAIN).all()
    assert shown


@pytest.mark.parametrize("seed", range(3))
def test_on_proved_pieces_no_verdict_asks_an_arm_to_slow_down(seed):
    """One that obeys levels and scales as documented is as fast as one that ignores them."""
    arm = ShieldedArm(seed, balls=2, settings={"reaction_time": 0.1})
    arm.shield.set_path(make_path(np.random.default_rng(seed)))
    proved = 0
    for _ in range(300):
        verdict = arm.step(velocity=NEAR if seed == 2 else None).verdict
        if verdict.proved_until is None:
            assert verdict.stop in (None, BRAKE)
            continue
        proved += 1
        if verdict.level is Level.STOP:
            assert verdict.stop == FINISH
        else:
            assert verdict.level >= Level.AWARE
            assert verdict.speed_scale == 1.0
    assert proved > 200


def test_a_jog_keeps_the_velocity_and_stops_before_position_limits():
    arm = ShieldedArm(0, balls=0)
    robot = arm.monitor.robot
    wanted = np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0, -0.2])
    for _ in range(150):
        command = arm.step(velocity=wanted)
    assert arm.v == pytest.approx(wanted, abs=1e-6)
    assert command.scale == pytest.approx(1.0)
    for _ in range(1500):
        arm.step(velocity=wanted)
    assert (arm.q < robot.upper_position_limit).all()
    assert (arm.q > robot.lower_position_limit).all()
    assert arm.q[0] > robot.upper_position_limit[0] - 0.05
    check_limits(arm)


@pytest.mark.parametrize("steps", range(2, 30, 3))
def test_an_arm_stops_when_it_is_asked_to_whenever_its_motion_changes(steps):
    """Without a latency motions change at steps, up to what rounding does to their times."""
    arm = ShieldedArm(0, balls=0, settings={"latency": 0.0})
    for _ in range(steps):
        arm.step(velocity=0.6 * NEAR)
    for _ in range(40):
        command = arm.step(velocity=np.zeros(7))
    assert command.reason is None
    assert arm.v == pytest.approx(np.zeros(7), abs=1e-9)
    check_limits(arm)


def test_a_chunk_is_followed_and_told_how_far():
    arm = ShieldedArm(0, balls=0, chunk_period=0.04)
    for _ in range(5):
        arm.step()
    points = HOME + 0.002 * np.arange(1, 21)[:, None] ** 1.5 * np.eye(7)[0]
    command = arm.step(chunk=points)
    assert 0 <= command.executed <= 3
    for _ in range(200):
        command = arm.step()
    assert arm.q == pytest.approx(points[-1], abs=1e-3)
    check_limits(arm)


def test_nonsense_is_told_and_stops_the_arm():
    arm = ShieldedArm(0, balls=0)
    for _ in range(50):
        arm.step(velocity=NEAR)
    command = arm.step(velocity=[np.nan] * 7)
    assert "velocity" in command.reason.subject
    for _ in range(100):
        arm.step(velocity="what")
    assert arm.v == pytest.approx(np.zeros(7), abs=1e-12)
    command = arm.step(chunk=np.full((3, 2), 1.0))
    assert "chunk" in command.reason.subject
    check_limits(arm)


@pytest.mark.parametrize("wish", ["velocity", "chunk"])
def test_numbers_beyond_all_floats_are_told_and_stop_the_arm(wish):
    arm = ShieldedArm(0, balls=0)
    values = [10**400] * 7
    command = arm.step(**{wish: values if wish == "velocity" else [values]})
    assert wish in command.reason.subject
    assert not command.moving


def test_a_chunk_without_points_is_refused():
    arm = ShieldedArm(0, balls=0)
    assert arm.step(chunk=np.empty((0, 7))).reason.subject == "chunk"


def test_no_chunk_from_before_a_reset_starts_after_it():
    arm = ShieldedArm(0, balls=0)
    nowhere = np.full(7, np.nan)
    arm.shield.step(arm.now, nowhere, nowhere, chunk=np.tile(HOME + 0.02, (5, 1)))
    arm.shield.reset()
    for _ in range(200):
        arm.now += 1.0 / RATE
        assert not arm.step().moving


def test_an_arm_that_was_left_to_brake_goes_back_to_its_path():
    arm = ShieldedArm(0, balls=1)
    arm.shield.set_path(make_path())
    for _ in range(100):
        arm.step()
    assert arm.v.any()
    # A ball appears right beside the arm, where none could have come from: bounds are broken.
    ball = arm.balls[0]
    ball.place = arm.centers[-1] + np.array([0.0, 0.0, 0.25])
    seen = arm.step()
    for _ in range(30):
        seen = arm.step()
        if seen.stop == BRAKE:
            break
    assert seen.stop == BRAKE
    assert seen.reason is not None
    # The arm brakes by its own means, harder than the command.
    arm.obstacles.remove(["ball0"])
    arm.balls.clear()
    was_commanded = seen.q[-1]
    harder = 1.2 * arm.shield.limits.braking
    for _ in range(400):
        arm.see()
        seen = arm.shield.step(arm.now, arm.q, arm.v)
        if seen.is_new:
            break
        for _ in range(10):
            slower = np.maximum(np.abs(arm.v) - 1e-3 * harder, 0.0) * np.sign(arm.v)
            arm.q, arm.v = arm.q + 5e-4 * (arm.v + slower), slower
        arm.now += 1.0 / RATE
    assert seen.is_new
    assert np.abs(arm.q - was_commanded).max() > 1e-3
    assert seen.q[0] == pytest.approx(arm.q, abs=1e-9)
    # It goes back to the path, and along it to the end.
    arm.command = seen
    for _ in range(1500):
        arm.step()
    assert arm.shield.progress == 1.0


def drive_on(arm, steps=3000):
    """Steps until the arm has done its path, or the steps are over; whether it had to leave one."""
    has_left = False
    for _ in range(steps):
        command = arm.step()
        has_left |= command.stop == BRAKE
        if arm.shield.progress == 1.0 and not command.moving:
            break
    return has_left


@pytest.mark.parametrize("moves", [True, False])
@pytest.mark.parametrize(("before", "after"), [(0.0, 1.0), (1.0, 0.0)])
def test_after_a_change_of_payload_the_arm_rests_and_goes_on_with_other_brakes(
    before, after, moves
):
    arm = ShieldedArm(0, balls=0, settings={"payload": before, "joint_timeout": 2.0})
    path = make_path()
    arm.shield.set_path(path)
    for _ in range(100):
        command = arm.step()
    assert command.moving
    if not moves:
        for _ in range(100):
            arm.step(asks=False)
        assert np.abs(arm.v).max() < 1e-12
    old = arm.shield.limits.braking
    came = arm.shield.progress
    arm.monitor.payload = after
    command = arm.step()
    assert (command.stop == BRAKE) is moves
    # It goes on along the path, not back to its beginning.
    assert abs(arm.shield.progress - came) < 0.02
    assert drive_on(arm) is moves
    assert arm.q == pytest.approx(path.q[-1], abs=1e-6)
    new = arm.shield.limits.braking
    assert (new < old).all() if after > before else (new > old).all()
    arm.shield.limits = arm.shield.limits._replace(braking=np.maximum(new, old))
    check_limits(arm)
    # Of all that it was asked for, in all ways.
    for wish in ({"velocity": NEAR}, {"chunk": arm.q + 0.005 * np.arange(1, 9)[:, None]}):
        arm.monitor.payload = before
        moving = 0
        for _ in range(60):
            moving += arm.step(**wish).moving
        assert moving > 20
        arm.monitor.payload = after
        drive_on(arm, 100)


def push(arm):
    """Steps of an arm that is pushed by 0.02 rad within 0.3 s, until it is told to go on then.

    Returns whether it was told that it is on no proved motion.
    """
    has_left, off = False, 0.0
    for k in range(200):
        turn = min(k, 30) * np.pi / 30
        off, speed = 0.01 * (1.0 - np.cos(turn)), 0.01 * np.pi / 0.3 * np.sin(turn)
        command = arm.shield.step(arm.now, arm.q + off, arm.v + speed)
        has_left |= command.stop == BRAKE
        if command.is_new and k > 30:
            break
        # Whatever it is told before is not taken up.
        arm.now += 1.0 / RATE
        arm.q, arm.v, _ = arm.command.at(arm.now)
    arm.q, arm.command = arm.q + off, None
    return has_left


def test_an_arm_that_is_pushed_off_its_motion_is_told_and_goes_on_from_where_it_is():
    arm = ShieldedArm(0, balls=0)
    path = make_path()
    arm.shield.set_path(path)
    for _ in range(100):
        arm.step()
    assert push(arm)
    drive_on(arm)
    assert arm.q == pytest.approx(path.q[-1], abs=1e-6)


def test_an_arm_that_was_pushed_while_it_rested_goes_on_from_where_it_is():
    arm = ShieldedArm(0, balls=0)
    arm.shield.set_path(make_path())
    drive_on(arm)
    push(arm)
    path = Path(np.stack([arm.q, HOME]))
    arm.shield.set_path(path)
    drive_on(arm)
    assert arm.q == pytest.approx(HOME, abs=1e-6)


def test_the_place_of_an_arm_that_rests_does_not_creep_after_it():
    arm = ShieldedArm(0, balls=0)
    for k in range(30):
        # It sags while nothing is asked of it.
        command = arm.shield.step(arm.now, HOME - 5e-5 * k, np.zeros(7))
        arm.now += 1.0 / RATE
        assert command.q[-1] == pytest.approx(HOME, abs=0.0)


def test_an_arm_that_is_measured_a_little_beyond_a_limit_begins_at_the_limit():
    arm = ShieldedArm(0, balls=0)
    lower = arm.monitor.robot.lower_position_limit
    place = HOME.copy()
    place[1] = lower[1]
    arm.see()
    command = arm.shield.step(0.0, place - 5e-4, np.zeros(7), velocity=NEAR)
    assert command.is_new
    assert command.q[0, 1] == lower[1]


def test_an_arm_is_not_taken_to_be_where_it_was_a_while_ago():
    arm = ShieldedArm(0, balls=0)
    still = np.zeros(7)
    for age in (0.3, 0.1):
        arm.see()
        arm.shield.reset()
        command = arm.shield.step(arm.now, HOME, still, arm.now - age, velocity=NEAR)
        assert not command.is_new, age
        assert command.reason is not None
        arm.now += 1.0 / RATE
    arm.see()
    assert arm.shield.step(arm.now, HOME, still, arm.now - 0.01, velocity=NEAR).is_new


def test_an_error_of_the_clock_neither_ages_a_resting_arm_nor_makes_a_moving_one_rest():
    arm = ShieldedArm(0, balls=0)
    robot = arm.monitor.robot
    robot.velocity_error = robot.velocity_error + 1e-3 * robot.acceleration_limit
    arm.shield = Shield(arm.monitor, jerk=JERK, rate=RATE)
    arm.see()
    for age, speed, moves in ((0.004, 0.2, False), (0.3, 0.0, False), (0.004, 0.0, True)):
        arm.shield.reset()
        speeds = np.full(7, speed)
        command = arm.shield.step(arm.now, HOME, speeds, arm.now - age, velocity=NEAR)
        assert command.is_new is moves
        assert ("joint state (is 0.3 s old" in str(command.reason)) is (age == 0.3)


@pytest.mark.parametrize("wrong", [{"off": 1.0}, {"off": np.nan}, {"late": 0.5}])
def test_the_place_of_an_arm_that_rests_follows_no_joint_state_that_is_not_believed(wrong):
    arm = ShieldedArm(0, balls=0)
    path = make_path()
    arm.shield.set_path(path)
    drive_on(arm)
    place = arm.q
    place_said = place + wrong.get("off", 0.0)
    for _ in range(3):
        stamp = arm.now - wrong.get("late", 0.0)
        command = arm.shield.step(arm.now, place_said, np.zeros(7), stamp)
        assert command.verdict.level is Level.STOP
        assert command.at(arm.now)[0] == pytest.approx(place, abs=1e-9)
        arm.now += 1.0 / RATE
    arm.shield.reset()
    arm.shield.set_path(Path(np.stack([place, HOME])))
    drive_on(arm)
    assert arm.q == pytest.approx(HOME, abs=1e-6)


def test_an_arm_that_missed_commands_goes_on_from_where_it_came_to_rest():
    arm = ShieldedArm(0, balls=0)
    path = make_path()
    arm.shield.set_path(path)
    for _ in range(60):
        arm.step()
    for _ in range(100):
        arm.see()
        arm.shield.step(arm.now, arm.q, arm.v)  # the answer is lost
        arm.step(asks=False)
    assert arm.v == pytest.approx(np.zeros(7), abs=1e-12)
    moved = len(arm.moved)
    drive_on(arm)
    assert arm.q == pytest.approx(path.q[-1], abs=1e-6)
    places = np.array([q for q, *_ in arm.moved[moved:]])
    assert np.abs(np.diff(places, axis=0)).max() < 2e-3


def test_an_arm_without_anything_left_to_do_comes_to_rest():
    arm = ShieldedArm(0, balls=0)
    arm.shield.set_path(make_path())
    for _ in range(60):
        arm.step()
    assert arm.command.moving
    arm.shield.set_path(None)
    for _ in range(60):
        arm.step()
    assert not arm.command.moving
    assert arm.v == pytest.approx(np.zeros(7), abs=1e-12)
    assert arm.shield.progress == 0.0


def test_after_a_reset_of_its_monitor_the_arm_rests_and_goes_on():
    arm = ShieldedArm(0, balls=0)
    path = make_path()
    arm.shield.set_path(path)
    for _ in range(100):
        arm.step()
    arm.monitor.reset()
    assert arm.step().stop == BRAKE
    assert drive_on(arm)
    assert arm.q == pytest.approx(path.q[-1], abs=1e-6)
    check_limits(arm)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"jerk": 0.0}, "jerk"),
        ({"jerk": [1.0, 2.0]}, "jerk"),
        ({"rate": np.nan}, "rate"),
        ({"look_ahead": -1.0}, "look_ahead"),
        ({"tracking_error": "a"}, "tracking_error"),
    ],
)
def test_arguments_out_of_range_are_named(changes, named):
    monitor = Monitor(Robot.load("panda"), Obstacles(sources=[]), motion="planned")
    with pytest.raises(ArmguardError, match=named):
        Shield(monitor, **{"jerk": 100.0, **changes})


def test_a_monitor_of_another_motion_is_refused():
    monitor = Monitor(Robot.load("panda"), Obstacles(sources=[]))
    with pytest.raises(ArmguardError, match="planned"):
        Shield(monitor, jerk=100.0)


@pytest.mark.parametrize("now", [np.nan, np.inf, -np.inf, -1e9, None, "noon"])
@pytest.mark.parametrize("steps", [0, 50])
def test_a_time_that_is_none_leaves_the_arm_on_its_motion(now, steps):
    arm = ShieldedArm(0, balls=0)
    arm.shield.set_path(make_path())
    for _ in range(steps):
        before = arm.step()
    command = arm.shield.step(now, arm.q, arm.v)
    assert not command.is_new
    assert command.stop == BRAKE or now == -1e9
    if steps:
        assert command.moving
        assert command.stop == BRAKE
        assert np.array_equal(command.times, before.times)
    else:
        assert not command.moving


@pytest.mark.parametrize("place", [4.0, 1e5, -1e9, 1e300])
@pytest.mark.parametrize("wish", [{}, {"velocity": NEAR}, {"chunk": [HOME] * 3}])
def test_an_arm_that_says_it_is_where_it_cannot_be_is_not_moved(place, wish):
    arm = ShieldedArm(0, balls=0)
    arm.shield.set_path(make_path())
    for tick in range(3):
        command = arm.shield.step(tick / 250.0, np.full(7, place), np.zeros(7), **wish)
        assert not command.moving
        assert not command.is_new
        assert command.stop == BRAKE
        assert command.verdict.level is Level.STOP
