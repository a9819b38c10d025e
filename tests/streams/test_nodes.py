import contextlib
import math
import socket
import subprocess
import sys
import time

import msgspec
import numpy as np
import pytest
import zmq

from armguard.clock import MonotonicClock
from armguard.exceptions import StreamError
from armguard.messages.answers import encode_verdict
from armguard.messages.incoming import decode
from armguard.obstacles import FaultKind, Obstacles
from armguard.streams import (
    Edge,
    FaultLog,
    Publisher,
    SocketInput,
    VerdictPublisher,
    VerdictReader,
)
from armguard.streams.cloud_intake import OwnPoints
from armguard.streams.edge import EdgeSettings
from armguard.streams.stamp_clocks import StampClock
from armguard.verdict import Level, PlanVerdict, Reason, ReasonKind, ResetVerdict, Verdict
from support.commands_made import COMMAND
from support.stream_sockets import PATIENCE, attend


def make_verdict(sequence, level=Level.CLEAR, valid_for=10.0, scale=1.0):
    now = time.monotonic()
    reasons = (Reason(ReasonKind.NO_SOURCES),)
    valid = now + valid_for
    return Verdict(now, sequence, level, 1.0, 0.1, scale, None, None, True, 0, reasons, valid)


class Side:
    """An edge behind a real socket, and a publisher that it listens to."""

    def __init__(self, address, joints=("a", "b"), source="cam0", **settings):
        clock = MonotonicClock()
        self.obstacles, self.faults = Obstacles(), FaultLog(clock.now)
        self.edge = Edge(self.obstacles, joints, clock, self.faults, EdgeSettings(**settings))
        self.input = SocketInput(address)
        self.publisher = Publisher(self.input.address, source)

    def __enter__(self):
        attend(self.input, lambda: self.publisher.wait(0.001))
        return self

    def drain_until(self, is_enough):
        end = time.monotonic() + PATIENCE
        while not is_enough(self.edge) and time.monotonic() < end:
            self.edge.drain([self.input])
            yield self.edge.requests

    def take(self, is_enough):
        for _ in self.drain_until(is_enough):
            pass

    def to_monitor(self, stamp):
        return pytest.approx(stamp - self.edge.times.offset, abs=1e-9)

    def __exit__(self, *_):
        self.publisher.close()
        self.input.close()


# Publisher


def test_what_is_published_arrives_in_the_table(address):
    stamp = time.monotonic()
    box = np.random.default_rng(0).normal(size=(2, 8, 3))
    with Side(address) as side:
        publisher, obstacles = side.publisher, side.obstacles
        publisher.update(
            ["x", "y"], stamp, box, 0 * box, [0.1, 0.2], speed=3.0, position_error=0.01
        )
        publisher.update([], stamp, [])
        publisher.update(["z"], stamp, [[1, 2, 3]], radius=0.0)
        publisher.remove(["z"], stamp + 1e-3)
        publisher.joints(stamp, ["b", "a"], [1.0, 2.0], [3.0, 4.0])
        side.take(lambda edge: edge.joints.state is not None)
    assert side.edge.received == 5
    assert side.faults.total == 0
    assert len(obstacles) == 2
    row, accepted = obstacles.row("y"), obstacles.table.accepted
    assert (accepted.points[row] == box[1]).all()
    assert (accepted.radius[row], accepted.speed[row]) == (0.2, 3.0)
    assert accepted.stamp[row] == side.to_monitor(stamp)
    assert side.edge.joints.state.q.tolist() == [2.0, 1.0]
    assert side.edge.joints.state.v.tolist() == [4.0, 3.0]


@pytest.mark.parametrize(
    "fields",
    [
        {"position": [[1, 2]]},
        {"position": [1, 2, 3]},
        {"position": [[1, 2, 3], [4, 5, 6]]},
        {"velocity": [[[1, 2, 3, 4]]]},
        {"radius": [0.1, 0.1]},
        {"position_error": [[0.1]]},
    ],
)
def test_what_does_not_fit_is_not_published(tmp_path, fields):
    arguments = {"position": [[1, 2, 3]], "radius": 0.1, **fields}
    with Publisher(f"ipc://{tmp_path}/in") as publisher:
        with pytest.raises(StreamError, match="shape"):
            publisher.update(["a"], 0.0, **arguments)
        with pytest.raises(StreamError, match="q: has shape"):
            publisher.joints(0.0, ["a"], [1.0, 2.0], [1.0])


def test_publishing_to_nobody_neither_waits_nor_fails(address):
    with contextlib.closing(socket.socket()) as taken:
        if address.startswith("tcp:"):
            # Nothing listens at a port that is bound and no more, nor can another process.
            taken.bind(("127.0.0.1", 0))
            address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        with Publisher(address) as publisher:
            assert not publisher.wait(0.0)
            for _ in range(10_000):
                publisher.update([], 0.0, [])


def test_nothing_waits_for_a_monitor_that_is_not_there(address):
    """A monitor that is restarted hears what is sent from then on, and nothing older."""
    source = SocketInput(address)
    bound = source.address
    with Publisher(bound, "cam0") as publisher:
        attend(source, lambda: publisher.wait(0.001))
        source.close()
        end = time.monotonic() + 0.5  # by then the publisher knows that it has gone
        sent = 0
        while time.monotonic() < end:
            publisher.joints(0.0, ["a"], [0.0], [0.0])
            sent += 1
            time.sleep(0.001)
        source = bind_again(bound)
        end = time.monotonic() + PATIENCE
        received = None
        while received is None and time.monotonic() < end:
            publisher.joints(1.0, ["a"], [0.0], [0.0])
            sent += 1
            received = source.receive()
            time.sleep(0.001)
        source.close()
    assert sent > 100
    assert decode(received).stamp == 1.0


def bind_again(address):
    """The input of a monitor that was restarted; its address may take a moment to be free."""
    end = time.monotonic() + PATIENCE
    while True:
        try:
            return SocketInput(address)
        except StreamError:
            assert time.monotonic() < end
            time.sleep(0.01)


def test_a_cloud_that_is_published_becomes_voxels_without_the_arm(address):
    seen = []

    def find_others(points, q, frame, origin):
        seen.append((q.tolist(), frame))
        return points[:, 0] > 1.0  # the arm is nearer than that

    points = np.array([[0.52, 0.0, 0.01], [2.02, 0.02, 0.02], [math.nan, 0, 0], [2.02, 1.02, 0.02]])
    with Side(address, source="depth", own_points=OwnPoints(find_others, 10.0)) as side:
        publisher, obstacles = side.publisher, side.obstacles
        stamp = time.monotonic()
        publisher.joints(stamp, ["b", "a"], [1.0, 2.0], [0.0, 0.0])
        mask = [True, True, True, False]
        publisher.cloud(points, stamp, [0, 0, 0], occupied=mask, position_error=0.01, speed=1.5)
        publisher.cloud([], stamp, [0, 0, 0])
        with pytest.raises(StreamError, match="occupied"):
            publisher.cloud(points, stamp, [0, 0, 0], occupied=[True])
        side.take(lambda edge: edge.received == 3)
    assert seen == [([2.0, 1.0], "world")]
    assert [name for name in obstacles.ids if name] == ["voxel 40 0 0"]
    row, accepted = obstacles.row("voxel 40 0 0", "depth"), obstacles.table.accepted
    assert accepted.stamp[row] == side.to_monitor(stamp)
    assert (accepted.speed[row], accepted.position_error[row]) == (1.5, 0.01)
    # One point is no number: left out, told by the table, and no reason to refuse the others.
    assert not side.faults.counts
    assert [fault.kind for fault in obstacles.take_faults()] == [FaultKind.POINTS_DROPPED]


def test_a_reset_is_sent_as_the_edge_expects_it(address):
    with Side(address, reset_token="sesame") as side:
        number = side.publisher.reset("sesame")
        side.take(lambda edge: edge.requests.is_reset)
    assert side.edge.requests.is_reset
    assert side.edge.requests.reset_verdicts == [(number, ResetVerdict(True, ""))]


def test_goals_arrive_in_the_order_of_the_watched_joints(address):
    names, goals = ["b", "a"], []
    with Side(address) as side:
        publisher, until = side.publisher, time.monotonic() + 0.9
        q = np.arange(6.0).reshape(3, 2)
        numbers = [
            publisher.goal(until, names, paths=[(q, None), (q, [0.0, 1.0, 2.0])]),
            publisher.goal(until, names, velocity=[0.1, 0.2]),
            publisher.goal(until, names, chunk=q),
        ]
        publisher.joints(until, names, [1.0, 2.0], [3.0, 4.0])
        for bad in ({"velocity": [1.0]}, {"chunk": [1.0, 2.0]}, {"paths": [(q[:, :1], None)]}):
            with pytest.raises(StreamError, match="has shape"):
                publisher.goal(until, names, **bad)
        for requests in side.drain_until(lambda edge: edge.joints.state is not None):
            goals += requests.goals
    assert side.faults.total == 0
    assert [(one.number, one.problem) for one in goals] == [(number, "") for number in numbers]
    assert goals[0].until == side.to_monitor(until)
    (bare, none), (_, times) = goals[0].paths
    assert (bare.tolist(), none, times.tolist()) == (q[:, ::-1].tolist(), None, [0.0, 1.0, 2.0])
    assert goals[1].velocity.tolist() == [0.2, 0.1]
    assert goals[2].chunk.tolist() == q[:, ::-1].tolist()


@pytest.mark.parametrize("as_json", [False, True])
def test_a_reader_keeps_the_newest_command(address, as_json):
    publisher = VerdictPublisher(address, 100.0, as_json=as_json)
    with VerdictReader(publisher.address) as reader:
        assert reader.command is None
        end, sequence = time.monotonic() + PATIENCE, 0
        while reader.command is None and time.monotonic() < end:
            sequence += 1
            publisher.publish(make_verdict(sequence))
            publisher.command(msgspec.structs.replace(COMMAND, sequence=sequence))
            reader.latest(0.01)
        assert reader.command.stamp == COMMAND.stamp + 100.0
        assert reader.command.goal == COMMAND.goal
        assert reader.refused == 0
    publisher.close()


def test_verdicts_and_commands_name_their_arm_and_each_start_another_run(tmp_path):
    runs = []
    for name in ("first", "second"):
        address = f"ipc://{tmp_path}/{name}"
        publisher = VerdictPublisher(address, 0.0, arm="left")
        with VerdictReader(address) as reader:
            ends = time.monotonic() + 10.0
            while reader.command is None or reader.latest() is None:
                assert time.monotonic() < ends
                publisher.publish(make_verdict(1))
                publisher.command(COMMAND)
                reader.latest(0.01)
            assert reader.command.run == reader.latest().run
            assert reader.command.arm == reader.latest().arm == "left"
            runs.append(reader.latest().run)
        publisher.close()
    assert len({"", *runs}) == 3


def test_a_plan_arrives_in_the_order_of_the_watched_joints(address):
    stamp, plans = time.monotonic(), []
    times, q, v = [0.0, 0.5, 1.0], np.arange(6.0).reshape(3, 2), np.ones((3, 2))
    with Side(address, joint_clock=StampClock(latency=0.004)) as side:
        publisher = side.publisher
        numbers = [
            publisher.plan("commit", stamp, ["b", "a"], times, q, v, 0.01),
            publisher.plan("commit", stamp, ["b", "a"], times, q, v, [0.1, 0.2], [0.3, 0.4]),
        ]
        publisher.joints(stamp, ["b", "a"], [1.0, 2.0], [3.0, 4.0])
        with pytest.raises(StreamError, match="ask: is 'follow'; expected \"commit\""):
            publisher.plan("follow", stamp, ["b", "a"], times, q, v, 0.01)
        with pytest.raises(StreamError, match="q: has shape"):
            publisher.plan("commit", stamp, ["b", "a"], times, q[:2], v, 0.01)
        for requests in side.drain_until(lambda edge: edge.joints.state is not None):
            plans += requests.plans
    assert side.faults.total == 0
    assert [(one.number, one.ask, one.problem) for one in plans] == [
        (numbers[0], "commit", ""),
        (numbers[1], "commit", ""),
    ]
    piece, other = plans
    assert piece.q.tolist() == q[:, ::-1].tolist()
    assert piece.times.tolist() == times
    assert piece.tracking_error.tolist() == [0.01, 0.01]
    assert piece.velocity_tracking_error is None
    assert other.tracking_error.tolist() == [0.2, 0.1]
    assert other.velocity_tracking_error.tolist() == [0.4, 0.3]
    # A state was measured before its stamp by the latency; a plan says where the arm will be.
    assert piece.stamp - side.edge.joints.state.stamp == pytest.approx(0.004, abs=1e-9)


def test_what_is_asked_of_contact_arrives(address):
    until, corners, found = time.monotonic() + 60.0, np.vstack([np.zeros(3), np.eye(3)]), []
    with Side(address, reset_token="sesame") as side:
        publisher = side.publisher
        numbers = [
            publisher.ignore("sesame", "hand", "part*", "camera", until=until),
            publisher.ignore("sesame", "*", "bin", zone=corners),
        ]
        publisher.watch(numbers[0])
        with pytest.raises(StreamError, match="zone: has shape"):
            publisher.ignore("sesame", "*", "bin", zone=corners[:, :2])
        for requests in side.drain_until(lambda _: len(found) == 3):
            found.extend(requests.exemptions)
    assert side.faults.total == 0
    timed, zoned, ended = found
    assert timed[:5] == (numbers[0], False, "hand", "part*", "camera")
    assert timed.until == pytest.approx(until - side.edge.times.offset, abs=1e-3)
    assert zoned.number == numbers[1] != numbers[0]
    assert np.array_equal(zoned.zone, corners)
    assert ended[:2] == (numbers[0], True)


def test_no_two_publishers_give_plans_the_same_number(tmp_path):
    """Nor does one that starts anew: an answer to the old plan would be taken for the new one's."""
    numbers = set()
    for _ in range(3):
        with Publisher(f"ipc://{tmp_path}/joints") as publisher:
            rest = ["a"], [0.0, 1.0], [[0.0]] * 2, [[0.0]] * 2
            numbers |= {publisher.plan("commit", 0.0, *rest, 0.1) for _ in range(2)}
    assert len(numbers) == 6


# Verdicts


def test_an_answer_is_found_by_its_number_among_verdicts(address):
    publisher = VerdictPublisher(address, 0.0)
    reason = Reason(ReasonKind.PLAN_UNSAFE, "hand and person", "contact possible in 0.2 s")
    no = PlanVerdict(False, 0.2, "hand", "person", (reason,))
    yes = PlanVerdict(True, math.inf, None, None, ())
    with VerdictReader(publisher.address) as reader:
        assert reader.answer(1) is None
        end = time.monotonic() + PATIENCE
        while reader.latest() is None and time.monotonic() < end:
            publisher.publish(make_verdict(1))
        publisher.answer(1, no)
        publisher.publish(make_verdict(2))
        publisher.answer(2, yes)
        assert reader.answer(2, timeout=PATIENCE) == yes
        assert reader.answer(1) == no
        assert reader.reset_answer(1) is None
        publisher.answer(1, ResetVerdict(False, "no"))
        assert reader.reset_answer(1, timeout=PATIENCE) == ResetVerdict(False, "no")
        assert reader.answer(1) == no
        assert reader.latest().sequence == 2
        assert reader.answer(3, timeout=0.05) is None
        assert reader.refused == 0
    publisher.close()


def test_a_controller_brakes_on_silence_and_on_stop(address):
    publisher = VerdictPublisher(address, 0.0)
    with VerdictReader(publisher.address) as reader:
        assert reader.latest() is None
        assert reader.silent()
        assert reader.speed_scale() == 0.0
        verdict = None
        for sequence in range(1000):
            publisher.publish(make_verdict(sequence, scale=0.7))
            verdict = reader.latest(0.01)
            if verdict is not None:
                break
        assert verdict.level is Level.CLEAR
        now = time.monotonic()
        assert not reader.silent(now)
        assert reader.speed_scale(now) == 0.7
        assert reader.silent(verdict.valid_until + 1e-6)
        assert reader.speed_scale(verdict.valid_until + 1e-6) == 0.0
        assert reader.silent(math.nan)
        publisher.publish(make_verdict(5000, Level.STOP, scale=0.7))
        publisher.publish(make_verdict(5001, Level.STOP, scale=0.7))
        while reader.latest(PATIENCE).sequence < 5001:
            pass
        assert not reader.silent()
        assert reader.speed_scale() == 0.0
        publisher.publish(make_verdict(5002, scale=math.nan))
        while reader.latest(PATIENCE).sequence < 5002:
            pass
        assert reader.speed_scale() == 0.0
    publisher.close()


def test_a_reader_iterates_over_every_verdict():
    publisher = VerdictPublisher("tcp://127.0.0.1:*", 0.0)
    with VerdictReader(publisher.address) as reader:
        while reader.latest(0.01) is None:
            publisher.publish(make_verdict(0))
        while reader.latest(0.05) is not reader.latest(0.05):
            pass
        for sequence in range(1, 501):
            publisher.publish(make_verdict(sequence))
        verdicts = iter(reader)
        assert [next(verdicts).sequence for _ in range(500)] == list(range(1, 501))
    publisher.close()


def test_a_stranger_in_place_of_the_monitor_is_silence():
    server = zmq.Context.instance().socket(zmq.XPUB)
    server.set(zmq.LINGER, 0)
    port = server.bind_to_random_port("tcp://127.0.0.1")
    with VerdictReader(f"tcp://127.0.0.1:{port}") as reader:
        assert server.poll(1000 * PATIENCE)
        for data in (b"", b"nonsense", b'{"type": "verdict"}'):
            server.send(data)
        end = time.monotonic() + PATIENCE
        while reader.refused < 3 and time.monotonic() < end:
            assert reader.latest(0.01) is None
        assert reader.refused == 3
        assert reader.speed_scale() == 0.0
    server.close()


def test_a_subscriber_that_never_reads_holds_up_nobody():
    publisher = VerdictPublisher("tcp://127.0.0.1:*", 0.0)
    with VerdictReader(publisher.address) as lazy, VerdictReader(publisher.address) as keen:
        while lazy.latest(0.01) is None or keen.latest(0.01) is None:
            publisher.publish(make_verdict(0))
        # Far more than every buffer on the way holds; a blocking send would never end.
        for sequence in range(1, 60_001):
            publisher.publish(make_verdict(sequence))
            if sequence % 100 == 0:
                keen.latest(0.001)
        while keen.latest(1.0).sequence < 60_000:
            publisher.publish(make_verdict(60_000))
    publisher.close()


class Flood:
    """A socket that has a verdict each time it is asked."""

    def __init__(self):
        self.taken = 0
        self.message = encode_verdict(make_verdict(1), 0.0)

    def poll(self, timeout):
        return True

    def recv_multipart(self, flags):
        self.taken += 1
        assert self.taken < 100_000, "held for ever"
        return [self.message]

    def close(self):
        pass


@pytest.mark.parametrize("timeout", [0.0, 0.02])
def test_a_flood_of_verdicts_does_not_hold_who_waits_for_an_answer(tmp_path, timeout):
    with VerdictReader(f"ipc://{tmp_path}/out") as reader:
        reader._socket.close()
        reader._socket = flood = Flood()
        assert reader.answer(1, timeout) is None
        assert flood.taken > 10
        if timeout == 0.0:
            assert flood.taken <= 64


PERCEPTION = """
import sys, time
import numpy as np
from armguard.streams import Publisher
address, count, messages = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
ids = [f"obstacle {i}" for i in range(count)]
start = np.random.default_rng(1).uniform(-5.0, 5.0, (count, 3))
velocity = np.random.default_rng(2).uniform(-1.0, 1.0, (count, 3))
with Publisher(address, "cam0") as publisher:
    assert publisher.wait(float(sys.argv[4]))
    begin = tick = time.monotonic()
    for _ in range(messages):
        publisher.update(ids, tick, start + velocity * (tick - begin), velocity, radius=0.1)
        tick += 0.01
        time.sleep(max(0.0, tick - time.monotonic()))
"""

# Two processes


def test_a_thousand_obstacles_at_a_hundred_hertz_from_another_process(address):
    messages = 250
    clock = MonotonicClock()
    obstacles = Obstacles()
    faults = FaultLog(clock.now)
    edge = Edge(obstacles, [], clock, faults)
    source = SocketInput(address)
    arguments = [source.address, "1000", str(messages), str(PATIENCE)]
    process = subprocess.Popen([sys.executable, "-c", PERCEPTION, *arguments])
    ages, stamps = [], []
    deadline = clock.now()
    try:
        while edge.received < messages and deadline < PATIENCE:
            clock.sleep_until(deadline)
            before = edge.received
            edge.drain([source])
            if edge.received > before:
                stamp = float(obstacles.table.accepted.stamp[obstacles.row("obstacle 999")])
                ages.append(clock.now() - stamp)
                stamps.append(stamp)
            deadline = max(deadline + 0.001, clock.now())
    finally:
        process.wait() if edge.received == messages else process.kill()
        process.wait()
        source.close()
    assert edge.received == messages
    assert faults.total == 0
    assert obstacles.take_faults() == []
    assert len(obstacles) == 1000
    # Stamps are 10 ms apart as they were sent, whenever they came: nothing was restamped.
    steps = np.diff(stamps) / 0.01
    assert np.allclose(steps, np.round(steps), atol=1e-5)
    assert min(ages) > 0.0
