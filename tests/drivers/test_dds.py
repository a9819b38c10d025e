"""Types and topics against `rosbags`, which writes as ROS 2 does; test_ros2.py has a peer."""

import math
import time

import msgspec
import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed")

from armguard.bridges.ros2_types import FIELDS
from armguard.drivers import ros2 as module
from armguard.drivers.dds import Graph, find_type
from armguard.drivers.options import ObstacleTopic, Ros2Options
from armguard.drivers.ros2 import TRAJECTORY, Ros2Arm
from support import bags_made as made
from support.driven_cell import OPTIONS
from support.ros2_arm import LOOPBACK, find_domain
from support.waiting import wait_until


@pytest.mark.parametrize(
    "message",
    [
        made.joint_state(0.0),
        made.pose_array(0.0, [(1, 2, 3)] * 3, "eye"),
        made.people(0.0, [("ada", (1, 2, 3))]),
        made.detections(0.0, [("box", (1, 2, 3), (4, 5, 6))]),
        made.markers(made.marker(0.0, 5, 1, ns="a", points=[(1, 2, 3), (4, 5, 6)])),
        made.transforms((0.0, "world", "eye", (1, 2, 3))),
    ],
    ids=lambda message: message.__msgtype__,
)
def test_bytes_on_the_wire_are_those_of_ros(message):
    kind = message.__msgtype__
    data = bytes(made.STORE.serialize_cdr(message, kind))
    assert find_type(kind).deserialize(data).serialize() == data
    package, _, name = kind.split("/")
    assert find_type(kind).__idl_typename__ == f"{package}.msg.dds_.{name}_"


def test_all_types_can_be_made():
    for name in FIELDS:
        find_type(name).__idl__.populate()


def make_message(message):
    """The same message as the graph has it."""
    kind = message.__msgtype__
    return find_type(kind).deserialize(bytes(made.STORE.serialize_cdr(message, kind)))


class Kept:
    """Keeps what would go to a monitor."""

    def __init__(self, *_):
        self.updates, self.removals = [], []

    def update(self, ids, stamp, position, **more):
        self.updates.append((ids, stamp, np.array(position), more))

    def remove(self, ids, stamp):
        self.removals.append((ids, stamp))


def make_options(domain, **changes):
    """Of an arm of two joints, with markers for obstacles."""
    markers = ObstacleTopic(
        topic="/things", kind="visualization_msgs/msg/MarkerArray", radius=None, snapshot=False
    )
    ros2 = Ros2Options(
        domain=domain,
        joint_states="/joint_states",
        speed_override="/armguard/speed_override",
        acknowledge="/armguard/acknowledge",
        trajectory="/trajectory",
        obstacles={"camera": markers},
        obstacle_address="ipc:///nowhere",
        frames=("world", "base"),
        frame_errors={},
        acceleration_limit=(10.0, 10.0),
        position_error=(1e-4, 1e-4),
        velocity_error=(1e-3, 1e-3),
        is_continuous=(False, False),
    )
    return msgspec.structs.replace(
        OPTIONS,
        driver="ros2",
        names=("a", "b"),
        deceleration=2.0,
        timeout=0.2,
        ros2=ros2,
        **changes,
    )


class Bench:
    """An arm in a graph, and another participant that hears and tells it everything."""

    def __init__(self, monkeypatch, **changes):
        monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
        monkeypatch.setattr(module, "Publisher", Kept)
        domain = find_domain()
        self.lines = []
        self.arm = Ros2Arm(make_options(domain, **changes), self.lines.append)
        self.camera = self.arm._sources[0].publisher
        graph = self.graph = Graph(domain)
        self.states = graph.publish("/joint_states", "sensor_msgs/msg/JointState")
        self.things = graph.publish("/things", "visualization_msgs/msg/MarkerArray")
        self.trajectories = graph.subscribe("/trajectory", TRAJECTORY, 8)
        self.speeds = graph.subscribe("/armguard/speed_override", "std_msgs/msg/Float64", 8)
        self.reports = graph.subscribe("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", 8)

    def tell(self, outlet, message, is_there):
        """Send a message until something is there that the arm has made of it."""

        def is_taken():
            outlet.send(make_message(message))
            time.sleep(0.005)
            state = self.arm.read()
            return is_there(state)

        wait_until(is_taken)

    def tell_state(self, q, v):
        """Send a joint state of now, and take it."""
        self.tell(self.states, made.joint_state(since(), ["b", "a"], q, v), lambda one: one)


def since():
    """Now, as `bags_made` has it."""
    return time.time() - 1e-9 * made.START


@pytest.fixture
def bench(monkeypatch):
    return Bench(monkeypatch)


def hear(arm, inlet):
    """The newest message of a topic."""
    heard = []

    def is_there():
        arm.read()
        heard.extend(inlet.take())
        return heard

    wait_until(is_there)
    return heard[-1]


def test_before_the_first_joint_state_the_speed_is_0_and_says_why(bench):
    assert hear(bench.arm, bench.speeds).data == 0.0
    status = hear(bench.arm, bench.reports).status[0]
    assert (status.level, status.message) == (2, "STOP: no joint state has arrived yet")


def test_a_joint_state_has_the_order_of_the_robot_and_the_clock_of_the_machine(bench):
    found = []
    message = made.joint_state(since(), ["b", "x", "a"], [0.2, 9.0, 0.1], [2.0, 9.0, 1.0])
    before = time.monotonic()
    bench.tell(bench.states, message, lambda one: one and found.append(one) is None)
    assert (found[0].q, found[0].v) == ([0.1, 0.2], [1.0, 2.0])
    assert found[0].stamp == pytest.approx(before, abs=0.05)


@pytest.mark.parametrize(
    ("names", "q", "words"),
    [
        (["a"], [0.0], "lacks b"),
        (["a", "b", "a"], [0.0] * 3, "has a twice"),
        (["a", "b"], [0.0, math.nan], "are not finite"),
        (["a", "b"], [0.0], "1 values of position for 2 joints"),
    ],
)
def test_a_joint_state_that_is_none_is_told_and_left(bench, names, q, words):
    message = made.joint_state(since(), names, q, [0.0] * len(names))
    bench.tell(bench.states, message, lambda state: bench.lines)
    assert words in bench.lines[0]
    assert bench.arm.read() is None
    assert len(bench.lines) == 1


def test_obstacles_come_and_go_and_what_cannot_be_used_is_said(bench):
    updates = bench.camera.updates
    ball = made.marker(since(), 2, 1, at=(1, 2, 3), scale=(0.4,) * 3)
    bench.tell(bench.things, made.markers(ball), lambda state: updates)
    ids, stamp, position, more = updates[-1]
    assert (ids, position.tolist()) == (["1"], [[[1.0, 2.0, 3.0]]])
    assert stamp == pytest.approx(time.monotonic(), abs=1.0)
    assert (more["radius"].tolist(), more["frame"], more["snapshot"]) == ([0.2], "world", False)

    gone = made.marker(since(), 2, 1, action=2)
    bench.tell(bench.things, made.markers(gone), lambda state: bench.camera.removals)
    assert bench.camera.removals[0][0] == ["1"]

    lost = made.marker(since(), 2, 2, frame="nowhere")
    seen = len(updates)
    bench.tell(bench.things, made.markers(lost), lambda state: len(updates) > seen)
    ids, stamp, _, _ = updates[-1]
    assert ids == []
    assert math.isnan(stamp), "the monitor refuses it, and says so"
    assert any("nowhere" in line for line in bench.lines)


def test_a_braking_trajectory_slows_down_evenly_from_where_the_arm_is(bench):
    assert not bench.arm.stop(), "nothing is known of the arm"
    bench.tell_state([0.2, 0.1], [-1.0, 0.4])
    state = bench.arm._state
    assert bench.arm.stop()
    assert bench.arm.is_braking
    message = hear(bench.arm, bench.trajectories)
    assert message.joint_names == ["a", "b"]
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (0, 0)
    (point,) = message.points
    duration = point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec
    assert duration == pytest.approx(1.0 / 2.0)
    assert point.velocities == [0.0, 0.0]
    for end, q, v in zip(point.positions, state.q, state.v, strict=True):
        age = (end - q) / v - 0.5 * duration
        assert 0.0 <= age <= 0.2
    time.sleep(0.25)
    assert not bench.arm.stop(), "where it is now is not known"


@pytest.mark.hazard("H-24")
def test_an_acknowledgement_is_a_true_of_this_moment(bench):
    outlet = bench.graph.publish("/armguard/acknowledge", "std_msgs/msg/Bool")

    def is_taken(data):
        outlet.send(find_type("std_msgs/msg/Bool")(data))
        time.sleep(0.005)
        bench.arm.read()
        return bench.arm.is_acknowledged

    assert bench.arm.acknowledgement == "publish true to /armguard/acknowledge"
    wait_until(lambda: is_taken(True))
    wait_until(lambda: bench.arm.read() or not bench.arm.is_acknowledged)
    assert not any(is_taken(False) for _ in range(20))


@pytest.mark.parametrize("age", [-5.0, 5.0])
def test_a_state_of_another_time_brakes_nothing(bench, age):
    message = made.joint_state(since() - age, ["b", "a"], [0.2, 0.1], [-1.0, 0.4])
    bench.tell(bench.states, message, lambda one: one)
    assert not bench.arm.stop()


def test_a_motion_is_sent_with_the_stamps_of_the_graph(monkeypatch):
    bench = Bench(monkeypatch, follows=True)
    times, q = np.array([0.0, 0.5]), np.array([[0.1, 0.2], [0.3, 0.4]])

    def is_heard():
        bench.arm.send(time.monotonic() + 1.0, times, q, 2.0 * q)
        return [one for one in bench.trajectories.take() if one.points]

    heard = []
    wait_until(lambda: heard.extend(is_heard()) or heard)
    stamp = heard[-1].header.stamp
    assert stamp.sec + 1e-9 * stamp.nanosec == pytest.approx(time.time() + 1.0, abs=0.5)
    last = heard[-1].points[1]
    assert (last.positions, last.velocities, last.accelerations) == ([0.3, 0.4], [0.6, 0.8], [])
    assert (last.time_from_start.sec, last.time_from_start.nanosec) == (0, 500_000_000)
    bench.arm.set_speed(0.5)
    assert not list(bench.speeds.take()), "beside trajectories there is no override"
