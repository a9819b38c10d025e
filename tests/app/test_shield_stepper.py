"""A shield in a loop: goals in, commands out; in one process by hand, and as real processes."""

import contextlib
import json
import math
import signal
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import numpy as np
import pytest

from armguard.app.cell import Cell
from armguard.app.cli import main
from armguard.app.loop import RateLoop
from armguard.app.shield_stepper import ShieldStepper
from armguard.streams import Edge, EdgeSettings, FaultLog, Publisher, VerdictReader
from armguard.verdict import Level
from support.manual_clock import ManualClock
from support.scripted_loop import NAMES, READY, ball

ARMGUARD = Path(sys.executable).with_name("armguard")
PATIENCE = 300.0  # a cold start compiles
PERIOD = 0.01
CELL = """
[robot]
name = "panda"
operating = { velocity = 0.4, acceleration = 0.25 }
[sources.camera]
[monitor]
rate = 100.0
motion = "planned"
[shield]
jerk = 500.0
"""
THERE = [0.3, -0.685, *READY[2:]]


class Messages:
    """What is sent to the loop in the next tick."""

    ended = False

    def __init__(self):
        self.waiting, self.packed = [], []

    def receive(self):
        if self.packed:
            return self.packed.pop(0)
        return json.dumps(self.waiting.pop(0)).encode() if self.waiting else None

    def close(self):
        pass


class MovedArm:
    """An arm that follows the commands of a loop, beside a ball."""

    def __init__(self, text=CELL, **options):
        cell = Cell.from_text(text)
        robot, obstacles, monitor = cell.build()
        self.clock, self.messages, self.lines = ManualClock(1.0), Messages(), []
        self.commands, self.answers, self.verdicts = [], [], []
        faults = FaultLog(self.clock.now, self.lines.append)
        settings = EdgeSettings(monotonic=self.clock.now, **options)
        edge = Edge(obstacles, robot.joints, self.clock, faults, settings)
        stepper = ShieldStepper(cell.make_shield(monitor), monitor, edge, self)
        self.loop = RateLoop(
            stepper, edge, [self.messages], self.clock, self.verdicts.append, self.answer
        )
        self.q, self.v, self.place = np.array(READY), np.zeros(7), 9.0
        self.followed = None
        self.missed = 0

    # What a publisher does

    def command(self, command):
        self.commands.append(command)

    def answer(self, number, verdict):
        self.answers.append((number, verdict))

    def tick(self, *messages, hears=True, speaks=True):
        """One period; the last command."""
        now = self.clock.now()
        if self.followed is not None:
            self.q, self.v, _ = self.followed.at(now)
        state = {"names": NAMES, "q": self.q.tolist(), "v": self.v.tolist()}
        if speaks:
            self.messages.waiting += [{"type": "joints", "stamp": now, **state}]
        self.messages.waiting += [ball(now, self.place), *messages]
        self.loop.tick()
        command = self.commands[-1] if self.commands else None
        if command is not None and hears:
            is_joined = command.joins(self.q, self.v, now)
            self.missed += not is_joined and command.stamp == now
            self.followed = command if is_joined else self.followed
        self.clock.sleep_until(now + PERIOD)
        return command

    def goal(self, number, **changes):
        message = {"type": "goal", "number": number, "until": self.clock.now() + 0.5}
        return {**message, "names": NAMES, **changes}

    def path(self, number=1, **changes):
        return self.goal(number, paths=[{"q": [self.q.tolist(), THERE]}], **changes)


@pytest.fixture
def arm():
    arm = MovedArm(reset_token="sesame")
    for _ in range(3):
        arm.tick()
    return arm


def test_a_path_is_followed_to_its_end(arm):
    assert (arm.commands[-1].goal, arm.commands[-1].moving) == (None, False)
    command = arm.tick(arm.path(17))
    while command.progress < 1.0 or command.moving:
        command = arm.tick()
        assert len(arm.commands) < 500
    assert (command.goal, command.refused, command.stop) == (17, None, None)
    assert arm.q == pytest.approx(THERE, abs=1e-6)
    assert arm.missed == 0
    assert max(one.scale for one in arm.commands) == pytest.approx(1.0, abs=1e-6)
    assert [one.sequence for one in arm.commands] == [one.sequence for one in arm.verdicts]
    assert all(one.take_up_by == pytest.approx(one.stamp + 0.002) for one in arm.commands)


def test_of_several_paths_one_without_a_person_is_taken(arm):
    arm.place = 0.75  # in front of the arm, at rest
    there, back = [arm.q.tolist(), THERE], [arm.q.tolist(), (2 * arm.q - THERE).tolist()]
    arm.tick(arm.goal(1, paths=[{"q": there}, {"q": back}]))
    for _ in range(30):
        command = arm.tick()
    assert command.goal == 1
    assert arm.missed == 0


def test_a_velocity_ends_by_itself(arm):
    arm.tick(arm.goal(1, velocity=[0.2] + [0.0] * 6))
    speeds = []
    for _ in range(80):
        arm.tick()
        speeds.append(arm.v[0])
    assert max(speeds) == pytest.approx(0.2, abs=1e-3)
    assert speeds[45] > 0.19
    assert speeds[-1] == pytest.approx(0.0, abs=1e-9)
    assert not arm.commands[-1].moving


def test_a_chunk_is_followed_as_far_as_it_goes(arm):
    points = [[0.0005 * k, *READY[1:]] for k in range(1, 9)]
    arm.tick(arm.goal(4, chunk=points))
    executed = max(arm.tick().executed for _ in range(40))
    assert executed >= 1
    assert arm.q[0] == pytest.approx(points[-1][0], abs=1e-3)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"velocity": ["x"] * 7}, ""),
        ({"velocity": [0.2] * 6}, "6 values"),
        ({"velocity": [0.2] * 7, "until": 0.5}, "s ago"),
        ({"paths": [{"q": [READY]}]}, "2 to"),
        ({"paths": [{"q": [READY, THERE], "times": [1.0, 0.0]}]}, "rising"),
        ({"paths": [{"q": [READY, THERE], "times": [0.0, 0.1]}]}, "rest"),
        ({"paths": [{"q": [READY, [9e99] * 7]}]}, "panda_joint1 at 9e+99"),
    ],
)
def test_garbage_and_late_goals_never_move_the_arm(arm, changes, words):
    arm.tick(arm.goal(5, **changes))
    for _ in range(30):
        command = arm.tick()
    assert command.goal is None
    assert words in command.problem
    assert (command.refused == 5) == bool(command.problem)
    assert arm.q == pytest.approx(READY)
    assert sum(arm.loop.report().faults.values()) == 1
    assert len(arm.lines) == 1


NASTY = [math.nan, math.inf, -math.inf, 0.0, -0.0, 1e308, -1e308, 5e-324, 1e-12, 1.0, -2.0, 9.0]


@pytest.mark.parametrize("seed", range(3))
def test_whatever_is_asked_nothing_raises_and_the_arm_keeps_its_limits(seed):
    random, arm = np.random.default_rng(seed), MovedArm()
    arm.tick()

    def to_plain(value):
        return value.tolist()

    def pick(*shape):
        close = np.array(READY) + random.normal(0.0, 0.2, (*shape, 7))
        odd = random.choice(NASTY, (*shape, 7))
        return np.where(random.random((*shape, 7)) < random.choice([0.0, 0.1, 1.0]), odd, close)

    def ask():
        count = int(random.integers(0, 5))
        asked = [
            {"velocity": pick()},
            {"chunk": pick(count)},
            {"paths": [{"q": pick(count)}, {"q": pick(count), "times": pick()[:count]}]},
            {"paths": [{"q": pick(2), "times": sorted(pick()[:2].tolist())}]},
        ][int(random.integers(4))]
        until = arm.clock.now() + random.choice([*NASTY, 0.3, 0.3, 0.3])
        return arm.goal(int(random.integers(2**63)), **asked) | {"until": until}

    before, robot = arm.q, arm.loop.monitor.robot
    for _ in range(150):
        wish = [ask()] if random.random() < 0.3 else []
        arm.messages.packed = [msgspec.msgpack.encode(one, enc_hook=to_plain) for one in wish]
        arm.tick()
        assert np.isfinite(arm.q).all()
        assert (np.abs(arm.q - before) <= 0.4 * robot.velocity_limit * PERIOD * 1.01).all()
        before = arm.q
    assert arm.missed == 0


def test_garbage_leaves_the_arm_on_its_path(arm):
    arm.tick(arm.path(1))
    for _ in range(10):
        arm.tick()
    arm.tick(arm.goal(2, velocity=[0.2] * 6), arm.goal(3, velocity=[-0.2] * 7, until=0.1))
    for _ in range(5):
        command = arm.tick()
    assert (command.goal, command.refused) == (1, 3)
    assert command.moving
    assert arm.v[0] > 0.05


def test_of_goals_that_come_together_the_newest_usable_one_is_taken(arm):
    jog = {"velocity": [0.2] + [0.0] * 6}
    arm.tick(arm.path(1), arm.goal(2, **jog), arm.goal(3, velocity=[0.0] * 6))
    command = arm.tick()
    assert (command.goal, command.refused) == (2, 3)
    arm.tick(arm.goal(4, paths=[{"q": [READY]}]), arm.goal(5, velocity=[0.0] * 6))
    command = arm.tick()
    assert (command.goal, command.refused) == (2, 5)


def test_whoever_is_silent_the_arm_rests_where_its_last_piece_ends(arm):
    arm.tick(arm.path(1))
    for _ in range(40):
        arm.tick()
    assert arm.v[0] > 0.1
    rest = arm.followed.at(arm.followed.valid_until)[0]
    moved = [arm.tick(hears=False) and arm.q for _ in range(60)]
    assert moved[-1] == pytest.approx(rest, abs=1e-9)
    # Heard again, it goes on from where it rests, without a jump.
    before = arm.q
    for _ in range(400):
        arm.tick()
        assert np.abs(arm.q - before).max() < 0.01
        before = arm.q
    assert arm.q == pytest.approx(THERE, abs=1e-3)


@pytest.mark.parametrize(("seed", "share"), [(0, 0.95), (1, 0.8), (2, 0.5)])
def test_an_arm_that_hears_some_commands_alone_is_always_on_a_proved_motion(arm, seed, share):
    random, before = np.random.default_rng(seed), arm.q
    arm.tick(arm.path(1))
    for tick in range(1500):
        command = arm.tick(hears=tick > 900 or random.random() < share)
        assert command.stop is None
        assert arm.verdicts[-1].proved_until is not None or np.abs(arm.v).max() < 1e-9
        assert np.abs(arm.q - before).max() < 0.4 * 2.61 * PERIOD
        before = arm.q
    assert arm.q == pytest.approx(THERE, abs=3e-3)


def test_an_arm_that_rests_a_little_off_its_goal_takes_up_the_next_one(arm):
    """It missed the last commands, and is as near as the arm may be off them."""
    arm.tick(arm.path(1))
    while np.abs(np.array(THERE) - arm.q).max() > 0.04:
        arm.tick()
    while arm.commands[-1].moving or np.abs(arm.v).max() > 1e-9:
        arm.tick(hears=np.abs(np.array(THERE) - arm.q).max() > 0.004)
    off = np.abs(np.array(THERE) - arm.q).max()
    assert off > 1e-4
    target = [0.0, *READY[1:]]
    arm.tick(arm.goal(2, paths=[{"q": [arm.q.tolist(), target]}]))
    for _ in range(600):
        arm.tick()
    assert arm.q == pytest.approx(target, abs=1e-3)


def test_where_joint_states_end_so_does_the_motion(arm):
    arm.tick(arm.path(1))
    for _ in range(40):
        arm.tick()
    for _ in range(60):
        command = arm.tick(speaks=False)
    assert not command.moving
    assert command.stop == "brake"
    assert arm.verdicts[-1].level is Level.STOP
    assert arm.v == pytest.approx(np.zeros(7))


def test_no_motion_goes_on_by_itself_after_a_reset(arm):
    arm.tick(arm.path(1))
    for _ in range(20):
        arm.tick()
    for _ in range(60):
        arm.tick(speaks=False)
    arm.tick({"type": "reset", "token": "sesame"})
    rest = arm.q
    for _ in range(60):
        command = arm.tick()
    assert (command.goal, command.stop) == (None, None)
    assert arm.q == pytest.approx(rest, abs=1e-9)
    arm.tick(arm.path(2))
    for _ in range(20):
        command = arm.tick()
    assert command.moving


def test_a_plan_of_somebody_else_is_refused(arm):
    rest = {"times": [0.0, 0.5], "q": [READY] * 2, "v": [[0.0] * 7] * 2, "tracking_error": 0.01}
    message = {"type": "plan", "ask": "commit", "number": 7, "stamp": arm.clock.now()}
    arm.tick({**message, "names": NAMES, **rest})
    ((number, answer),) = arm.answers
    assert (number, answer.safe) == (7, False)
    assert "goals" in str(answer.reasons[0])


def test_a_goal_before_the_first_joint_state_is_refused():
    arm = MovedArm()
    arm.tick(arm.path(1), speaks=False)
    assert arm.commands == []
    arm.tick()
    assert (arm.tick().refused, arm.commands[-1].goal) == (1, None)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[shield]\njerk = 500.0\n", "", "shield: is missing"),
        ("jerk = 500.0", "", "shield.jerk: is missing"),
        ("jerk = 500.0", "jerk = -1.0", "shield.jerk: is -1.0"),
        ("jerk = 500.0", "jerk = [1.0, 2.0]", "jerk: is [1.0, 2.0]"),
        ("jerk = 500.0", "jerk = 500.0\nlook_ahead = 0.0", "shield.look_ahead: is 0.0"),
        ("jerk = 500.0", "jerk = 500.0\nhaste = 1", "shield.haste: is no key"),
        ("rate = 100.0\n", "", "monitor.rate: is missing"),
        ('motion = "planned"\n', "", 'expected motion="planned"'),
    ],
)
def test_a_cell_that_has_no_shield_says_what_is_missing(old, new, words, tmp_path, capsys):
    text = CELL.replace(old, new)
    path = tmp_path / "cell.toml"
    path.write_text(text)
    addresses = [f"--{name}=ipc://{tmp_path}/{name}" for name in ("obstacles", "joints")]
    options = [*addresses, f"--verdicts=ipc://{tmp_path}/verdicts", "--duration", "0.1"]
    assert main(["shield", str(path), *options]) == 2
    assert words in capsys.readouterr().err


def test_a_process_moves_an_arm_from_goal_to_goal(tmp_path):
    """Real sockets and processes; the arm is in this one."""
    cell = tmp_path / "cell.toml"
    # A busy machine may hold up any of them for a while.
    cell.write_text(CELL + "[thresholds]\nlatency = 0.02\njoint_timeout = 5.0\n")
    names = ("obstacles", "joints", "verdicts")
    addresses = {name: f"ipc://{tmp_path}/{name}" for name in names}
    options = [word for name in names for word in (f"--{name}", addresses[name])]
    q, v, followed, ways = np.array(READY), np.zeros(7), None, []
    with contextlib.ExitStack() as resources:
        process = resources.enter_context(
            subprocess.Popen(
                [ARMGUARD, "shield", cell, *options, "--json", "--no-realtime", "--quiet"],
                stdout=subprocess.PIPE,
                text=True,
            )
        )
        resources.callback(process.kill)
        arm = resources.enter_context(Publisher(addresses["joints"]))
        camera = resources.enter_context(Publisher(addresses["obstacles"], "camera"))
        reader = resources.enter_context(VerdictReader(addresses["verdicts"]))
        end, goal, asked = time.monotonic() + PATIENCE, -1, 0.0
        while len(ways) < 2:
            now = time.monotonic()
            assert now < end, (reader.latest(), reader.command)
            assert process.poll() is None
            if followed is not None:
                before, (q, v, _) = q, followed.at(now)
                assert np.abs(q - before).max() < 0.2
            reader.latest()
            command = reader.command
            if command is not None and command.joins(q, v, now):
                followed = command
            arm.joints(now, NAMES, q, v)
            camera.update(["ball"], now, [[9.0, 0.0, 0.5]], [[0.0] * 3], radius=0.1)
            is_there = command is not None and command.goal == goal and command.progress == 1.0
            if is_there and not command.moving and np.abs(v).max() < 1e-9:
                ways.append(q)
                goal = -1
            if goal < 0 or (command is not None and command.goal != goal and now > asked + 0.5):
                target = READY if len(ways) % 2 else THERE
                goal, asked = arm.goal(now + 0.5, NAMES, paths=[([q, target], None)]), now
            time.sleep(0.001)
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    # As near as an arm may be off commands, where the last ones came too late to be taken up.
    assert ways[0] == pytest.approx(THERE, abs=3e-3)
    assert ways[1] == pytest.approx(READY, abs=3e-3)
    assert reader.refused == 0
    assert "malformed" not in json.loads(out)["message_faults"]
