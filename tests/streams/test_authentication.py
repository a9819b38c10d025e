"""Real sockets with keys: who is let in, and in whose name a message counts."""

import time

import msgspec
import pytest
import zmq

from armguard.clock import MonotonicClock
from armguard.exceptions import StreamError
from armguard.messages.incoming import decode
from armguard.obstacles import Obstacles, Source
from armguard.streams import (
    Edge,
    FaultLog,
    Publisher,
    SocketInput,
    SourceLimits,
    VerdictPublisher,
    VerdictReader,
)
from armguard.streams.authentication import SenderError, check_sender
from armguard.streams.edge import EdgeSettings
from armguard.streams.other_arm_intake import OtherArm
from armguard.verdict import Level
from support.key_rings import KeyRing
from support.stream_messages import World, joints, obstacles, pack, plan
from support.stream_sockets import PATIENCE
from support.verdict_samples import verdict

REST = 0.3
"""Seconds after which a stranger would have been heard."""


class Side:
    """The monitor's side: an input, an edge and its table."""

    def __init__(self, address, ring, **options):
        self.authenticator = ring.authenticator()
        self.input = SocketInput(address, self.authenticator)
        clock = MonotonicClock()
        self.lines = []
        self.faults = FaultLog(clock.now, self.lines.append)
        self.obstacles = Obstacles(sources=[Source("camera"), Source("lidar")])
        self.edge = Edge(self.obstacles, ["a"], clock, self.faults, EdgeSettings(**options))

    def drain(self, condition=None, patience=PATIENCE):
        end = time.monotonic() + patience
        while not (condition and condition()):
            self.edge.drain([self.input])
            if time.monotonic() > end:
                assert condition is None
                return
            time.sleep(0.001)

    def publisher(self, source, keys):
        publisher = Publisher(self.input.address, source, keys)
        self.drain(lambda: publisher.wait(0.0))
        return publisher

    def kinds(self):
        return {(key.kind, key.source) for key in self.faults.counts}

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.input.close()
        self.authenticator.close()


@pytest.fixture
def ring():
    return KeyRing(
        camera=["obstacles"],
        lidar=["obstacles"],
        controller=["joints", "verdicts"],
        desk=["reset"],
    )


def show_ball(publisher):
    publisher.update(["ball"], time.monotonic(), [[1.0, 0.0, 0.0]], radius=0.1)


def test_a_known_client_speaks_in_its_own_name(address, ring):
    with Side(address, ring) as side, side.publisher("camera", ring.keys("camera")) as publisher:
        show_ball(publisher)
        side.drain(lambda: side.edge.received)
        assert side.faults.total == 0
        assert side.obstacles.source_of(side.obstacles.row("ball")) == "camera"


@pytest.mark.hazard("H-22")
def test_a_message_in_the_name_of_another_is_refused_named_and_a_stop(address, ring):
    """Two publishers of one source are told apart: one of them has not its key."""
    with Side(address, ring) as side:
        with (
            side.publisher("camera", ring.keys("lidar")) as impostor,
            side.publisher("camera", ring.keys("camera")) as camera,
        ):
            show_ball(impostor)
            impostor.remove(["ball"], time.monotonic())
            side.drain(lambda: side.faults.total == 2)
            show_ball(camera)
            side.drain(lambda: len(side.obstacles))
        assert side.kinds() == {("sender refused", "lidar")}
        assert "'camera' in a message with the key of 'lidar'" in side.lines[0]
        faults = side.obstacles.take_faults()
        assert {fault.source for fault in faults} == {"lidar"}
        assert faults[0].field == "source"
        # The numbers of the impostor's messages are nothing to those of the source.
        assert side.faults.count("sequence went back") == side.faults.count("two publishers") == 0


def test_each_client_may_send_what_the_cell_says_and_nothing_else(address, ring):
    with Side(address, ring, reset_token="sesame") as side:
        with side.publisher("camera", ring.keys("camera")) as camera:
            camera.joints(time.monotonic(), ["a"], [0.0], [0.0])
            camera.plan("commit", 0.0, ["a"], [0.0, 1.0], [[0.0]] * 2, [[0.0]] * 2, 0.1)
            camera.reset("sesame")
            side.drain(lambda: side.faults.total == 3)
        with side.publisher("controller", ring.keys("controller")) as controller:
            show_ball(controller)
            side.drain(lambda: side.faults.total == 4)
            assert side.edge.joints.state is None
            assert not side.edge.requests.is_reset
            assert side.edge.requests.plans == []
            assert len(side.obstacles) == 0
            controller.joints(time.monotonic(), ["a"], [0.0], [0.0])
            side.drain(lambda: side.edge.joints.state is not None)
        assert side.kinds() == {("sender refused", "camera"), ("sender refused", "controller")}
        with side.publisher("desk", ring.keys("desk")) as desk:
            desk.reset("sesame")
            side.drain(lambda: side.edge.requests.is_reset)


def test_a_client_speaks_for_its_own_arms(address, ring):
    told = []
    others = {
        "right": OtherArm(["a"], lambda *state: told.append(state), lambda *plan: told.append(plan))
    }
    with Side(address, ring, arm="left", others=others, reset_token="sesame") as side:
        clients = side.authenticator.clients
        clients["controller"] = clients["controller"]._replace(arms=frozenset(["left"]))
        with side.publisher("controller", ring.keys("controller")) as controller:
            still = ["a"], [0.0], [0.0]
            piece = ["a"], [0.0, 1.0], [[0.0]] * 2, [[0.0]] * 2, 0.1
            controller.joints(time.monotonic(), *still, arm="right")
            controller.plan("commit", 0.0, *piece, arm="right")
            controller.ignore("sesame", "*", "part", until=1.0, arm="right")
            side.drain(lambda: side.faults.total == 3)
            assert side.kinds() == {("sender refused", "controller")}
            assert "'right'" in side.lines[0]
            controller.joints(time.monotonic(), *still, arm="left")
            side.drain(lambda: side.edge.joints.state is not None)
        assert told == []
        assert side.faults.total == 3


def test_a_malformed_message_is_laid_to_the_key_that_it_came_with(address, ring):
    with Side(address, ring) as side:
        with side.publisher("camera", ring.keys("camera")) as camera:
            camera._socket.send(msgspec.msgpack.encode({"type": "obstacles", "source": "lidar"}))
            side.drain(lambda: side.faults.total)
        assert side.kinds() == {("malformed", "camera")}


def test_what_is_too_long_for_a_key_is_not_even_read(address, ring, monkeypatch):
    read = []
    monkeypatch.setattr("armguard.streams.edge.read_header", read.append)
    monkeypatch.setattr("armguard.streams.edge.decode", read.append)
    with Side(address, ring, limits={"camera": SourceLimits(message_size=1000)}) as side:
        with side.publisher("camera", ring.keys("camera")) as camera:
            camera._socket.send(b"\xc0" * 2000)
            side.drain(lambda: side.faults.total)
        assert side.kinds() == {("beyond limit", "camera")}
        assert side.obstacles.take_faults()[0].source == "camera"
    assert read == []


def test_a_limit_of_a_key_is_kept_whatever_the_message_says(address, ring):
    """Neither may it use up what another has, nor what a made-up name would have."""
    limits = {"camera": SourceLimits(message_rate=2.0)}
    with Side(address, ring, limits=limits) as side:
        with side.publisher("lidar", ring.keys("camera")) as camera:
            for _ in range(5):
                show_ball(camera)
            side.drain(lambda: side.faults.total == 5)
        assert side.faults.counts["sender refused", "camera"] == 2
        assert side.faults.counts["beyond limit", "camera"] == 3


@pytest.mark.hazard("H-22")
def test_unknown_keys_get_nothing_in_and_are_named(address, ring):
    with Side(address, ring) as side:
        stranger = ring.stranger()
        with Publisher(side.input.address, "camera", stranger) as publisher:
            end = time.monotonic() + REST
            while time.monotonic() < end:
                show_ball(publisher)
                side.drain(patience=0.01)
            assert not publisher.wait(0.0)
        assert side.edge.received == 0
        assert ("client refused", "unknown") in side.kinds()
        assert stranger.own.public in side.lines[0]


def test_without_keys_or_with_those_of_another_monitor_nothing_gets_in(address, ring):
    with Side(address, ring) as side:
        other = KeyRing(camera=["obstacles"])
        wrong = other.keys("camera")
        for keys in (None, wrong):
            with Publisher(side.input.address, "camera", keys) as publisher:
                end = time.monotonic() + REST
                while time.monotonic() < end:
                    show_ball(publisher)
                    side.drain(patience=0.01)
                assert not publisher.wait(0.0)
        assert side.edge.received == 0


def test_only_those_that_may_read_verdicts_or_reset_hear_any(address, ring):
    authenticator = ring.authenticator()
    publisher = VerdictPublisher(address, 0.0, authenticator)
    strangers = [None, ring.stranger(), ring.keys("camera"), KeyRing(desk=[]).keys("desk")]
    readers = [VerdictReader(publisher.address, keys) for keys in strangers]
    with (
        VerdictReader(publisher.address, ring.keys("controller")) as controller,
        VerdictReader(publisher.address, ring.keys("desk")) as desk,
    ):
        end = time.monotonic() + PATIENCE
        while None in (controller.latest(), desk.latest()) and time.monotonic() < end:
            publisher.publish(verdict(Level.CLEAR))
            time.sleep(0.001)
        end = time.monotonic() + REST
        while time.monotonic() < end:
            publisher.publish(verdict(Level.CLEAR))
            time.sleep(0.001)
        assert None not in (controller.latest(), desk.latest())
        assert [reader.latest() for reader in readers] == [None] * len(readers)
    for reader in readers:
        reader.close()
    publisher.close()
    authenticator.close()


def test_beyond_this_machine_only_with_keys(ring):
    with pytest.raises(StreamError, match=r"there are no keys.*armguard keys new"):
        SocketInput("tcp://0.0.0.0:*")
    with Side("tcp://0.0.0.0:*", ring) as side:
        port = side.input.address.rsplit(":", 1)[1]
        for user in (Publisher, VerdictReader):
            with pytest.raises(StreamError, match="there are no keys"):
                user(f"tcp://192.0.2.1:{port}")
            user(f"tcp://192.0.2.1:{port}", keys=ring.keys("camera")).close()


@pytest.mark.hazard("H-22")
def test_strangers_without_end_cost_a_tick_a_few_answers(ring, monkeypatch):
    """However many ask to be let in, a tick answers eight of them."""
    with Side("tcp://127.0.0.1:*", ring) as side:
        context, strangers = zmq.Context(), []
        for _ in range(30):
            stranger = context.socket(zmq.PUB)
            strangers.append(stranger)
            stranger.linger = 0
            keys = ring.stranger()
            stranger.curve_publickey = keys.own.public.encode()
            stranger.curve_secretkey = keys.own.secret.encode()
            stranger.curve_serverkey = keys.server.encode()
            stranger.connect(side.input.address)
        time.sleep(REST)
        judged = []
        judge = side.authenticator._judge
        monkeypatch.setattr(
            side.authenticator, "_judge", lambda parts: judged.append(1) or judge(parts)
        )
        for drains in range(1, 4):
            side.edge.drain([side.input])
            assert len(judged) == 8 * drains
            # Each of those that were refused is counted, not the last of them alone.
            assert side.faults.counts["client refused", "unknown"] == len(judged)
        side.drain(lambda: len(judged) == 30)
        assert side.faults.total == 30
        for stranger in strangers:
            stranger.close()
        context.term()


RESET = {"type": "reset", "token": "sesame"}
REMOVE = {"type": "remove", "ids": ["a"], "stamp": 1005.0, "source": "cam0"}


class Rights:
    """What clients may do, as a test has it."""

    def __init__(self, rights, arms=()):
        self._rights, self._arms = rights, arms

    def may(self, name, right):
        return right in self._rights.get(name, ())

    def may_speak_for(self, name, arm):
        return not arm or arm in self._arms


def check(message, sender, rights):
    check_sender(decode(pack(message)), sender, rights)


@pytest.mark.parametrize(
    ("message", "right"),
    [
        (obstacles(), "obstacles"),
        (REMOVE, "obstacles"),
        (joints(), "joints"),
        (plan(), "joints"),
        ({"type": "goal", "number": 7, "until": 9.0, "names": ["a"]}, "joints"),
        ({"type": "watch", "number": 7}, "joints"),
        (RESET, "reset"),
    ],
)
def test_each_message_needs_the_right_for_its_type(message, right):
    check(message, "cam0", Rights({"cam0": [right]}))
    others = {"obstacles", "joints", "reset", "verdicts", "view"} - {right}
    with pytest.raises(SenderError, match=f"may not send {right}"):
        check(message, "cam0", Rights({"cam0": others}))
    with pytest.raises(SenderError, match="may not send"):
        check(message, None, Rights({"cam0": [right]}))


def test_obstacles_in_the_name_of_another_are_refused_and_the_verdict_must_know():
    expected = "'cam0' in a message with the key of 'lidar'"
    with pytest.raises(SenderError, match=expected) as caught:
        check(obstacles(), "lidar", Rights({"lidar": ["obstacles"]}))
    assert caught.value.hides_obstacles
    with pytest.raises(SenderError) as caught:
        check(joints(), "lidar", Rights({"lidar": ["obstacles"]}))
    assert not caught.value.hides_obstacles


def test_a_client_speaks_for_its_arms_and_resets_by_right():
    rights = Rights({"plc": ["joints", "reset"]}, arms=["left"])
    check(joints(arm="left"), "plc", rights)
    check(RESET | {"arm": "right"}, "plc", rights)
    with pytest.raises(SenderError, match="one of the arms of 'plc'"):
        check(joints(arm="right"), "plc", rights)


def test_a_client_that_may_send_no_obstacles_is_charged_for_none():
    """Else what it sends beyond a rate would be a STOP, as of a source that says too much."""
    edge, message = World().edge, decode(pack(obstacles()))
    assert edge._charge(message, 100, "plc", Rights({"plc": ["joints"]})) is None
    assert edge._charge(message, 100, None, Rights({"cam0": ["obstacles"]})) is None
    assert edge._charge(message, 100, "cam0", Rights({"cam0": ["obstacles"]})) is not None
