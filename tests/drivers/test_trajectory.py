"""Commands as trajectories: what is sent, and that no arm jumps by them."""

import os

import msgspec
import numpy as np
import pytest

from armguard.drivers.arm import ArmState, Program
from armguard.drivers.latencies import Latencies
from armguard.drivers.link import Link
from armguard.drivers.moment import Moment
from armguard.drivers.motion import APPROACH, QUIET
from armguard.drivers.session import Session
from armguard.drivers.trajectory import TrajectoryConduct, make_points
from armguard.verdict import Level
from support.driven_cell import OPTIONS
from support.fake_arms import FakeMotionArm
from support.shield_commands import DURATION, HOME, NAMES, command, move
from support.verdict_samples import verdict

ORDER = np.arange(6)


class TrajectoryArm(FakeMotionArm):
    """Keeps what it is sent, and is where the newest trajectory has it."""

    def __init__(self):
        super().__init__(HOME)
        self.sent, self.reports = [], []

    def follow(self, q):
        """Nothing."""

    def send(self, stamp, times, q, v):
        self.sent.append((stamp, times, q, v))

    def report(self, verdict, problem):
        self.reports.append((verdict, problem))

    def at(self, now):
        """Where a cubic through the points has it."""
        stamp, times, q, v = self.sent[-1]
        return cubic(times, q, v, now - stamp)


def cubic(times, q, v, t):
    """Hermite's cubic through points, resting before and after them."""
    k = int(np.clip(np.searchsorted(times, t), 1, len(times) - 1))
    h = times[k] - times[k - 1]
    u = np.clip((t - times[k - 1]) / h, 0.0, 1.0)
    basis = [2 * u**3 - 3 * u**2 + 1, u**3 - 2 * u**2 + u, 3 * u**2 - 2 * u**3, u**3 - u**2]
    return basis[0] * q[k - 1] + basis[1] * h * v[k - 1] + basis[2] * q[k] + basis[3] * h * v[k]


class Made:
    """A conduct that knows an old goal, its arm, and time that a test sets."""

    def __init__(self):
        _, writing = os.pipe()
        self.arm, self.now = TrajectoryArm(), 100.0
        options = msgspec.structs.replace(OPTIONS, names=NAMES, stop_within=0.5)
        session = Session(options, Latencies(0.0), Link(writing))
        self.conduct = TrajectoryConduct(self.arm, session)
        self.verdict = None
        for _ in range(3):
            self.act(rest(self.now, 0), after=0.5 * QUIET)

    def act(self, newest, after=0.01, hindrance=""):
        self.now += after
        q, v = list(self.arm.q), list(self.arm.v)
        state = ArmState(self.now, q, v, Program.RUNNING, "", 1.0)
        self.conduct.act(Moment(self.now, self.verdict, newest, state, True, hindrance))


def rest(now, sequence, goal=1, home=HOME):
    """A command whose arm rests at `home`, at the end of a motion that is over."""
    begun = now - 2.0 * DURATION
    start = home - np.array([move(9.0)[0], 0, 0, 0, 0, 0])
    return command(now, sequence, goal, begun, home=start, moving=False, valid_until=now)


def test_each_motion_is_sent_as_it_is_and_rest_is_not_repeated():
    made = Made()
    for k in range(5):
        made.act(rest(made.now + 0.01, k + 1))
    begun = made.now + 0.01
    while made.now < begun + DURATION - 0.02:
        made.act(command(made.now + 0.01, round(1e3 * made.now), 2, begun))
        place = made.arm.at(made.now)[0] - HOME[0]
        assert place == pytest.approx(move(made.now - begun)[0], abs=1e-6)
    sent = len(made.arm.sent)
    assert sent == pytest.approx(DURATION / 0.01, abs=4)
    end = HOME + np.array([move(9.0)[0], 0, 0, 0, 0, 0])
    made.arm.q = end
    made.now = begun + DURATION
    for k in range(20):
        made.act(rest(made.now + 0.01, 10**6 + k, 2, end))
    assert len(made.arm.sent) == sent, "an arm that rests is told nothing"


def test_a_pause_of_the_states_shifts_no_motion():
    made = Made()
    made.act(rest(made.now + 0.01, 1))
    begun = made.now + 0.01
    for k, after in enumerate((0.01, 0.01, 0.3, 0.01)):
        made.act(command(made.now + after, 2 + k, 2, begun), after)
        assert made.arm.at(made.now)[0] == pytest.approx(HOME[0] + move(made.now - begun)[0])
    assert len(made.arm.sent) == 4


def test_an_arm_that_rests_off_a_command_is_led_to_it_without_a_jump():
    made = Made()
    made.act(rest(made.now + 0.01, 1))
    made.arm.q = list(HOME + np.array([0.02, -0.01, 0.0, 0.005, 0.0, 0.0]))
    made.act(rest(made.now + 0.01, 2, 2))
    assert len(made.arm.sent) == 1
    before = np.array(made.arm.q)
    begun = made.now
    for k in range(300):
        made.act(rest(made.now + 0.01, 3 + k, 2))
        now = made.arm.at(made.now)
        assert np.abs(now - before).max() <= 1.5 * APPROACH * 0.01 + 1e-9
        before = now
    assert np.abs(before - HOME).max() < 1e-9
    assert made.now - begun > 0.02 / APPROACH


def test_an_order_to_brake_and_a_hindrance_brake():
    for trouble in ({"stop": "brake"}, {}):
        made = Made()
        made.act(rest(made.now + 0.01, 1))
        begun = made.now + 0.01
        made.act(command(begun, 2, 2, begun))
        newest = command(begun + 0.01, 3, 2, begun, **trouble)
        made.act(newest, hindrance="" if trouble else "the robot is silent")
        assert made.arm.orders.count("brake") == 1


def test_a_verdict_is_shown_while_it_is_valid():
    made = Made()
    made.act(None)
    assert made.arm.reports[-1] == (None, "no verdict yet")
    made.verdict = verdict(
        Level.CLEAR, speed_scale=1.0, stamp=made.now, valid_until=made.now + 0.015
    )
    made.act(None)
    assert made.arm.reports[-1][0] is made.verdict
    made.act(None, 0.0, hindrance="the robot is silent")
    assert made.arm.reports[-1] == (None, "the robot is silent")
    made.act(None)
    assert made.arm.reports[-1] == (None, "no valid verdict")


@pytest.mark.parametrize("seed", range(20))
def test_points_lead_an_offset_to_nothing_as_fast_as_is_stated(seed):
    """Against the motion itself and an offset that shrinks joint by joint."""
    random = np.random.default_rng(seed)
    order = random.permutation(6)
    one = command(50.0, begun=50.0 - random.uniform(0.0, DURATION))
    offset = random.uniform(-0.05, 0.05, 6) * random.integers(0, 2, 6)
    since = random.uniform(0.0, 0.1)
    times, q, v = make_points(one, order, offset, since)
    assert (np.diff(times) > 0.0).all()
    assert np.abs(v[-1]).max() < 1e-12, "it comes to rest"
    gap = np.diff(times).max()
    for t in random.uniform(since, times[-1], 50):
        gone = APPROACH * (t - since)
        expected = one.at(50.0 + t)[0][order] + offset - np.clip(offset, -gone, gone)
        # A cubic that ends at rest in place of going on is off by 4/27 of what it would go.
        assert np.abs(cubic(times, q, v, t) - expected).max() <= 4 / 27 * APPROACH * gap + 1e-9
