"""Laws of following a shield, with an arm and commands that a test can hold in its hands."""

import os
import time

import msgspec
import numpy as np
import pytest

from armguard.drivers.arm import ArmLostError, ArmState, Program
from armguard.drivers.latencies import Latencies
from armguard.drivers.link import Link
from armguard.drivers.moment import Moment
from armguard.drivers.motion import APPROACH, QUIET, MotionConduct
from armguard.drivers.session import Session
from armguard.messages.command import CommandMessage, pack
from support.driven_cell import OPTIONS
from support.fake_arms import FakeMotionArm
from support.shield_commands import DURATION, HOME, NAMES, SPEED, command, move


class Made:
    """A conduct, its arm, and time that a test sets."""

    def __init__(self):
        self._reading, writing = os.pipe()
        self.arm = FakeMotionArm(HOME)
        self.latencies = Latencies(0.0)
        options = msgspec.structs.replace(OPTIONS, names=NAMES, stop_within=0.5)
        session = Session(options, self.latencies, Link(writing))
        self.conduct = MotionConduct(self.arm, session)
        self.now, self.newest = 100.0, None

    def act(self, newest=None, after=0.002, hindrance="", trouble=""):
        self.now += after
        self.newest = newest or self.newest
        state = ArmState(self.now, self.arm.q, self.arm.v, Program.RUNNING, trouble, 1.0)
        self.conduct.act(Moment(self.now, None, self.newest, state, True, hindrance or trouble))

    def begin(self, goal=2, **changes):
        """Goal 1 is there before the driver; then comes another one."""
        self.act(command(self.now, 1, goal=1))
        self.wait()
        one = command(self.now + 0.002, 2, goal=goal, **changes)
        self.act(one)
        return one

    def wait(self):
        """No goal comes for a while."""
        for _ in range(2):
            self.act(msgspec.structs.replace(self.newest), after=0.5 * QUIET)

    def read(self):
        os.set_blocking(self._reading, False)
        try:
            return os.read(self._reading, 100_000).decode()
        except BlockingIOError:
            return ""


@pytest.fixture
def made():
    return Made()


def place(made):
    return made.arm.q[0] - HOME[0]


def test_a_goal_that_was_there_before_the_driver_moves_nothing(made):
    for k in range(20):
        made.act(command(made.now + 0.002, k + 1, goal=1))
    assert made.arm.followed == []
    assert set(made.arm.orders) == {"hold"}
    assert made.latencies.counts.commands == 20


def test_a_motion_is_followed_to_its_end_whatever_is_silent(made):
    one = made.begin()
    while made.now < one.valid_until + 0.1:
        made.act()
        assert place(made) == pytest.approx(move(made.now - one.stamp)[0], abs=1e-5)
    assert place(made) == pytest.approx(SPEED * DURATION)
    assert "brake" not in made.arm.orders


def test_each_command_that_joins_takes_the_place_of_the_one_before(made):
    one = made.begin()
    for k in range(200):
        made.act(command(made.now + 0.002, 3 + k, begun=one.stamp))
    assert made.latencies.counts.missed == 0
    assert place(made) == pytest.approx(move(made.now - one.stamp)[0], abs=1e-5)


@pytest.mark.parametrize(
    "late",
    [
        {"take_up_by": 0.0},
        {"times": b"", "q": b"", "v": b"", "a": b""},
        {"q": pack(np.full((200, 6), 3.0))},
        {"v": pack(np.full((200, 6), 3.0))},
        {"q": pack(np.full((200, 6), np.nan))},
        {"q": b"nonsense"},
        {"times": pack(np.zeros(3))},
        {"names": list("abcdex")},
    ],
)
def test_what_is_late_elsewhere_or_malformed_is_not_taken_up(made, late):
    one = made.begin()
    for k in range(20):
        newest = command(made.now + 0.002, 3 + k, begun=one.stamp)
        made.act(msgspec.structs.replace(newest, **late))
    assert place(made) == pytest.approx(move(made.now - one.stamp)[0], abs=1e-5)
    assert np.isfinite(made.arm.followed).all()


def test_a_motion_that_begins_elsewhere_moves_no_resting_arm(made):
    made.arm.q = list(HOME + 0.01)
    made.begin()
    for k in range(20):
        made.act(command(made.now + 0.002, 3 + k))
    assert made.arm.followed == []


def spoil(one, name, row, value):
    """The same command with one number, or one row, in place of another."""
    rows = np.frombuffer(getattr(one, name)).reshape(len(one.times) // 8, -1).copy()
    rows[row] = value
    return msgspec.structs.replace(one, **{name: pack(rows)})


@pytest.mark.parametrize("is_moving", [False, True])
@pytest.mark.parametrize(
    ("name", "row", "value"),
    [
        ("times", slice(100, 102), 0.25),
        ("times", 199, 0.1),
        ("times", 199, float("nan")),
        ("q", 199, float("nan")),
        ("v", 150, float("inf")),
        ("a", 199, float("-inf")),
    ],
)
def test_a_motion_that_is_none_in_its_end_is_not_begun(made, is_moving, name, row, value):
    if is_moving:
        one = made.begin()
        made.act(spoil(command(made.now + 0.002, 3, begun=one.stamp), name, row, value))
    else:
        made.act(command(made.now, 1, goal=1))
        made.wait()
        made.act(spoil(command(made.now + 0.002, 2), name, row, value))
    assert "tell a command cannot be read: motion is not finite or not rising" in made.read()
    before = len(made.arm.followed)
    for _ in range(600):
        made.act()
    assert "brake" not in made.arm.orders
    if is_moving:
        assert made.arm.q[0] == pytest.approx(HOME[0] + SPEED * DURATION), "along the one before"
    else:
        assert before == len(made.arm.followed) == 0


def test_a_motion_whose_numbers_are_too_great_is_braked(made):
    one = made.begin()
    made.act(spoil(command(made.now + 0.002, 3, begun=one.stamp), "q", slice(150, 200), 1e308))
    with np.errstate(all="ignore"):
        for _ in range(600):
            made.act()
    assert np.isfinite(made.arm.followed).all()
    assert made.arm.orders.count("brake") == 1


def test_joints_may_stand_in_any_order(made):
    one = made.begin(names=tuple("fedcba"))
    for _ in range(100):
        made.act()
    assert made.arm.q[0] == pytest.approx(move(made.now - one.stamp)[0], abs=1e-5)
    assert made.arm.q[1:] == pytest.approx(HOME[1:])


def test_a_motion_that_is_not_proved_any_more_is_braked_once(made):
    one = made.begin()
    for k in range(5):
        made.act(command(made.now + 0.002, 3 + k, begun=one.stamp, stop="brake"))
    assert made.arm.orders.count("brake") == 1
    assert made.latencies.counts.stops == 1


def test_an_arm_that_nothing_is_known_of_is_braked_while_it_moves(made):
    made.arm.brake = lambda: made.arm.orders.append("brake")  # is never sent
    made.arm.v = [0.4] * len(NAMES)
    for k in range(3):
        made.act(command(made.now + 0.002, k + 1, goal=1, stop="brake"))
    assert made.arm.orders.count("brake") == 3
    with pytest.raises(ArmLostError, match="does not brake"):
        made.act(after=0.6)
    made.arm.v = [0.0] * len(NAMES)
    made.act(command(made.now + 0.002, 9, goal=1, stop="brake"))
    assert made.arm.orders.count("brake") == 3


@pytest.mark.parametrize("is_new", [True, False])
def test_an_arm_that_rests_off_a_resting_command_is_led_to_it_slowly(made, is_new):
    off = np.array([0.01, 0.0, -0.02, 0.0, 0.0, 0.0])
    if is_new:
        made.arm.q = list(HOME + off)
        made.act(command(made.now, 1, goal=1))
        made.wait()
        rest = HOME
    else:
        one = made.begin()
        while made.now < one.valid_until + 0.1:
            made.act()
        rest = np.array(made.arm.q) - off
    flat = {"v": pack(np.zeros((200, 6))), "a": pack(np.zeros((200, 6))), "moving": False}
    flat["q"] = pack(np.tile(rest, (200, 1)))
    before = np.array(made.arm.q)
    for k in range(1500):
        made.act(command(made.now + 0.002, 3 + k, **flat))
        step = np.abs(np.array(made.arm.q) - before).max()
        assert step <= 0.002 * APPROACH + 1e-12
        before = np.array(made.arm.q)
    assert made.arm.q == pytest.approx(list(rest), abs=1e-9)
    assert made.latencies.counts.missed == 0


def test_an_arm_that_rests_far_off_is_led_nowhere(made):
    made.arm.q = list(HOME + 0.06)
    made.act(command(made.now, 1, goal=1))
    made.wait()
    for k in range(20):
        made.act(command(made.now + 0.002, 3 + k, moving=False))
    assert made.arm.followed == []


@pytest.mark.parametrize("pause", [0.004, 0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.25])
@pytest.mark.parametrize("is_joined", [False, True])
def test_after_a_pause_the_arm_jumps_nowhere(made, pause, is_joined):
    one = made.begin(goal=2)
    fastest, usual = 2.0 * SPEED, 0.002
    while move(made.now - one.stamp)[1] < 0.9 * fastest:
        made.act()
    last = place(made)
    made.act(command(made.now + pause, 3, begun=one.stamp) if is_joined else None, after=pause)
    assert place(made) - last <= fastest * min(pause, 0.01) + 1e-9
    is_braked = "brake" in made.arm.orders
    assert is_braked == (pause >= 0.1), "it is too far behind"
    assert ("too far behind its motion" in made.read()) == is_braked
    for k in range(int(0.5 / usual)):
        last = place(made)
        made.act(command(made.now + usual, 4 + k, begun=one.stamp))
        assert place(made) - last <= usual * (fastest + APPROACH) + 1e-9
    if is_braked:
        assert made.arm.orders.count("brake") == 1
        assert place(made) == last, "it waits for another goal"
    else:
        for _ in range(2000):
            made.act()
        assert place(made) == pytest.approx(SPEED * DURATION), "it gets there all the same"


@pytest.mark.hazard("H-19")
def test_an_arm_that_does_not_brake_is_lost(made):
    made.begin()
    made.act(command(made.now + 0.002, 3, stop="brake"))
    made.arm.v = [0.3] * 6
    for _ in range(200):
        made.act()
    with pytest.raises(ArmLostError, match="does not brake"):
        made.act(after=0.2)


def test_after_braking_it_goes_on_only_from_where_it_rests(made):
    one = made.begin()
    made.act(command(made.now + 0.002, 3, begun=one.stamp, stop="brake"))
    made.arm.is_braking = True
    before = len(made.arm.followed)
    made.act(command(made.now + 0.002, 4))
    assert len(made.arm.followed) == before
    made.arm.is_braking, made.arm.v = False, [0.1] * 6
    made.act(command(made.now + 0.002, 5))
    assert len(made.arm.followed) == before
    made.arm.v, made.arm.q = [0.0] * 6, list(HOME)
    made.act(command(made.now + 0.002, 6))
    assert len(made.arm.followed) == before + 1


@pytest.mark.parametrize("kind", ["hindrance", "trouble"])
def test_after_trouble_it_waits_for_another_goal(made, kind):
    made.begin(goal=2)
    made.act(**{kind: "protective stop"})
    assert made.arm.orders.count("brake") == 1
    made.arm.q = list(HOME)
    before = len(made.arm.followed)
    for k in range(10):
        made.act(command(made.now + 0.002, 3 + k, goal=2))
    assert len(made.arm.followed) == before
    made.wait()
    made.act(command(made.now + 0.002, 20, goal=3))
    assert len(made.arm.followed) == before + 1


@pytest.mark.hazard("H-24")
@pytest.mark.parametrize("fault", ["beginning", "hindrance", "restart"])
def test_a_stream_of_goals_moves_nothing_after_a_fault_before_it_pauses(made, fault):
    run = "first"
    if fault != "beginning":
        made.begin(goal=2)
        made.act(command(made.now + 0.002, 3, goal=3), hindrance="protective stop")
        assert made.arm.orders.count("brake") == 1
        made.arm.q = list(HOME)
        if fault == "restart":
            made.wait()
            run = "second"
    before, _ = len(made.arm.followed), made.read()
    for k in range(300):
        made.act(command(made.now + 0.01, 4 + k, goal=4 + k, run=run), after=0.01)
    assert len(made.arm.followed) == before
    assert made.read().count("pause their stream") == 1
    made.wait()
    made.act(command(made.now + 0.002, 2000, goal=999, run=run))
    made.act(command(made.now + 0.002, 2001, goal=1000, begun=made.now, run=run))
    assert len(made.arm.followed) == before + 2, "from then on a stream is followed"


def test_a_silence_of_commands_is_no_pause_of_goals(made):
    made.begin(goal=2)
    made.act(hindrance="protective stop")
    made.arm.q = list(HOME)
    before = len(made.arm.followed)
    for k in range(3):
        made.act(command(made.now + 2.0, 3 + k, goal=3 + k), after=2.0)
    assert len(made.arm.followed) == before
    made.wait()
    made.act(command(made.now + 0.002, 9, goal=9))
    assert len(made.arm.followed) == before + 1


def test_a_goal_that_comes_during_a_fault_moves_nothing_after_it(made):
    made.begin(goal=2)
    made.act(hindrance="protective stop")
    made.wait()
    made.arm.q = list(HOME)
    made.act(command(made.now + 0.002, 3, goal=3), hindrance="protective stop")
    before = len(made.arm.followed)
    for k in range(10):
        made.act(command(made.now + 0.2, 4 + k, goal=3), after=0.2)
    assert len(made.arm.followed) == before


@pytest.mark.hazard("H-24")
def test_a_shield_that_was_started_anew_needs_another_goal(made):
    made.begin(goal=2)
    made.act(command(made.now + 0.002, 3000, goal=7, run="second"))
    assert made.arm.orders.count("brake") == 1
    assert "restarted" in made.read()
    made.arm.q = list(HOME)
    before = len(made.arm.followed)
    made.act(command(made.now + 0.002, 3001, goal=7, run="second"))
    assert len(made.arm.followed) == before
    made.wait()
    made.act(command(made.now + 0.002, 3002, goal=8, run="second"))
    assert len(made.arm.followed) == before + 1


def test_without_a_goal_nothing_moves(made):
    made.act(command(made.now, 1, goal=None))
    for k in range(10):
        made.act(command(made.now + 0.002, 2 + k, goal=None))
    assert made.arm.followed == []
    made.wait()
    made.act(command(made.now + 0.002, 20, goal=1))
    assert made.arm.followed


def test_a_command_is_plain_data():
    one = command(time.monotonic())
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(one), type=CommandMessage) == one
