"""A robot in a ROS 2 graph: receives joint states and obstacles from the graph, and sends orders.

Stamps of the graph are times of the system clock. They are converted to this machine's monotonic
clock, so a change of the system clock has no effect.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.bridges.messages import JOINTS, JointStateReader, ObstacleReader
from armguard.bridges.ros2 import (
    DIAGNOSTICS,
    SPEED,
    AnswerMaker,
    Transforms,
    describe_verdict,
    read_stamp,
)
from armguard.drivers.arm import ArmState, Program
from armguard.drivers.dds import Graph, Inlet, Outlet, find_type
from armguard.drivers.options import DriveOptions, ObstacleTopic, Ros2Options
from armguard.exceptions import ArmguardError
from armguard.streams.nodes import Publisher
from armguard.streams.stamp_clocks import compare_clocks
from armguard.verdict import Level, Verdict

Array = NDArray[np.float64]

TRANSFORMS, TRAJECTORY = "tf2_msgs/msg/TFMessage", "trajectory_msgs/msg/JointTrajectory"
ACKNOWLEDGE = "std_msgs/msg/Bool"

DEPTH = 32
"""Messages of a topic that wait, at most."""

TRANSFORM_DEPTH = 100

BEAT = 0.01
"""Between two speeds before the first joint state, in [s]."""

REPORT_INTERVAL = 0.1
"""Between two diagnostics of the same level, in [s]."""

COMPLAINT_INTERVAL = 1.0
"""Between two lines about one topic, in [s]."""

SHORTEST_BRAKING = 0.02
"""Of a braking trajectory, in [s]."""

_NANO = 1_000_000_000


class _Joints(NamedTuple):
    """See `WatchedJoints`."""

    joints: tuple[str, ...]
    acceleration_limit: Array
    position_error: Array
    velocity_error: Array
    upper_position_limit: Array


class _Source:
    """Data of a topic of obstacles."""

    def __init__(self, graph: Graph, name: str, topic: ObstacleTopic, options: DriveOptions):
        assert options.ros2 is not None
        self.name, self.snapshot = name, topic.snapshot
        self.inlet = graph.subscribe(topic.topic, topic.kind, DEPTH)
        self.reader = ObstacleReader(topic.topic, topic.kind, topic.radius, snapshot=topic.snapshot)
        self.publisher = Publisher(options.ros2.obstacle_address, name, options.load_keys())


class Ros2Arm:
    """A robot with topics for states and orders; see `OverrideArm` and `TrajectoryArm`.

    Args:
        options: Which topics, and in which domain.
        tell: Takes lines for people.

    Raises:
        ArmLostError: The graph cannot be joined.
        ArmguardError: A type of messages cannot be read.
    """

    comes_back = True
    is_acknowledged = False

    def __init__(self, options: DriveOptions, tell: Callable[[str], None]) -> None:
        assert options.ros2 is not None
        ros2: Ros2Options = options.ros2
        self._names = options.names
        self._deceleration = options.deceleration
        self._timeout = options.timeout
        self._tell = tell
        self._told: dict[str, tuple[str, float]] = {}
        self._answers = AnswerMaker(find_type, int, options.model)
        self._frames = {"world", *ros2.frames}
        self._transforms = Transforms(ros2.frame_errors)
        joints = _Joints(
            options.names,
            np.array(ros2.acceleration_limit),
            np.array(ros2.position_error),
            np.array(ros2.velocity_error),
            np.where(ros2.is_continuous, np.inf, 0.0),
        )
        self._reader = JointStateReader(ros2.joint_states, joints)
        graph = Graph(ros2.domain)
        self._states = graph.subscribe(ros2.joint_states, JOINTS, DEPTH)
        self._moving = graph.subscribe("/tf", TRANSFORMS, TRANSFORM_DEPTH)
        self._standing = graph.subscribe("/tf_static", TRANSFORMS, TRANSFORM_DEPTH, is_kept=True)
        self._sources = [_Source(graph, *one, options) for one in ros2.obstacles.items()]
        self._diagnostics = graph.publish("/diagnostics", DIAGNOSTICS)
        self._speed: Outlet | None = None
        if not options.follows:
            self._speed = graph.publish(ros2.speed_override, SPEED)
        self.acknowledgement = ""
        self._acknowledged: Inlet | None = None
        if ros2.acknowledge and not options.follows:
            self.acknowledgement = f"publish true to {ros2.acknowledge}"
            self._acknowledged = graph.subscribe(ros2.acknowledge, ACKNOWLEDGE, DEPTH)
        self._trajectory: Outlet | None = None
        if ros2.trajectory:
            self._trajectory = graph.publish(ros2.trajectory, TRAJECTORY)
        self._graph = graph
        self._state: ArmState | None = None
        self._scale = 0.0
        self._next_beat = self._next_report = self._braking_until = -math.inf
        self._reported: Level | None = None

    def read(self) -> ArmState | None:
        """The newest state; obstacles that arrived since go to the monitor."""
        self._take_transforms(self._standing, None)
        self._take_transforms(self._moving, self._read_stamp)
        for source in self._sources:
            self._take_obstacles(source)
        found = None
        for message in self._states.take():
            found = self._read_joints(message) or found
        self._note_unreadable("joint states", self._states)
        if self._acknowledged is not None:
            self.is_acknowledged = True in [one.data for one in self._acknowledged.take()]
            self._note_unreadable("acknowledgements", self._acknowledged)
        if found is not None:
            self._state = found
        elif self._state is None and time.monotonic() >= self._next_beat:
            # What is not known must not move.
            self._next_beat = time.monotonic() + BEAT
            self.set_speed(0.0)
            self.report(None, "no joint state has arrived yet")
        return found

    def _read_joints(self, message: Any) -> ArmState | None:
        try:
            stamp = self._read_stamp(message.header)
            values = self._reader.read(message, stamp)
            if values is None:
                return None
            q, v = values
            if not (np.isfinite(q).all() and np.isfinite(v).all()):
                raise ArmguardError("joint states", "are not finite", expected="numbers")
        except ArmguardError as error:
            self._complain("joint states", str(error))
            return None
        program = Program.RUNNING if self._speed is None or self._scale > 0.0 else Program.PAUSED
        scale = 1.0 if self._speed is None else self._scale
        return ArmState(stamp, q.tolist(), v.tolist(), program, "", scale)

    def _take_transforms(self, inlet: Inlet, read: Callable[[Any], float] | None) -> None:
        for message in inlet.take():
            for error in self._transforms.take_message(message, read):
                self._complain("transforms", str(error))

    def _take_obstacles(self, source: _Source) -> None:
        """Process one message at most, so that a verdict waits for no more."""
        unreadable = source.inlet.unreadable
        for message in itertools.islice(source.inlet.take(), 1):
            try:
                gone, shown = source.reader.read(message)
                if gone:
                    source.publisher.remove(gone, time.monotonic())
                for one in shown:
                    stamp = self._read_stamp(one.header)
                    for batch in self._transforms.place(
                        one, source.name, stamp, self._frames, snapshot=source.snapshot
                    ):
                        source.publisher.update(
                            batch.ids,
                            batch.stamp,
                            batch.position,
                            radius=batch.radius,
                            position_error=batch.position_error,
                            frame=batch.frame,
                            snapshot=batch.snapshot,
                        )
            except ArmguardError as error:
                self._complain(source.name, str(error))
                self._say_unreadable(source)
        if source.inlet.unreadable != unreadable:
            self._say_unreadable(source)
        self._note_unreadable(source.name, source.inlet)

    def _say_unreadable(self, source: _Source) -> None:
        """Report that obstacles may be missing, by an invalid time, which the monitor refuses."""
        source.publisher.update([], math.nan, np.zeros((0, 3)))

    def _note_unreadable(self, name: str, inlet: Inlet) -> None:
        if inlet.unreadable:
            self._complain(f"{name}, raw", f"{name}: messages cannot be read")

    def _complain(self, about: str, problem: str) -> None:
        """Report a problem once, and another one of the topic a while later."""
        now = time.monotonic()
        before, told = self._told.get(about, ("", -math.inf))
        if problem != before and now - told >= COMPLAINT_INTERVAL:
            self._told[about] = problem, now
            self._tell(problem)

    def _read_stamp(self, header: Any) -> float:
        """The stamp of a header, in [s] of the monotonic clock."""
        now, unix, _ = compare_clocks(time.monotonic, time.time)
        return now + (read_stamp(header) / _NANO - unix)

    def _make_stamp(self, stamp: float) -> Any:
        """A time of the monotonic clock, in [s], as a stamp of the graph."""
        now, unix, _ = compare_clocks(time.monotonic, time.time)
        sec, nanosec = divmod(round((unix + (stamp - now)) * _NANO), _NANO)
        return find_type("builtin_interfaces/msg/Time")(sec, nanosec)

    def set_speed(self, scale: float) -> None:
        """Send the speed override."""
        self._scale = scale
        if self._speed is not None:
            self._speed.send(self._answers.make_speed(scale))

    def report(self, verdict: Verdict | None, problem: str) -> None:
        """Send a verdict as diagnostics, when its level changes and now and then."""
        now = time.monotonic()
        level = None if verdict is None else verdict.level
        if level is self._reported and now < self._next_report:
            return
        self._reported, self._next_report = level, now + REPORT_INTERVAL
        diagnostic = describe_verdict(verdict, problem)
        stamp = self._make_stamp(now)
        self._diagnostics.send(self._answers.make_diagnostics(stamp, diagnostic))

    def send(self, stamp: float, times: Array, q: Array, v: Array) -> None:
        """Send a trajectory; without accelerations a controller interpolates by cubics."""
        self._send(self._make_stamp(stamp), times, q, v)

    def _send(self, stamp: Any, times: Array, q: Array, v: Array) -> None:
        assert self._trajectory is not None
        make_point = find_type("trajectory_msgs/msg/JointTrajectoryPoint")
        make_duration = find_type("builtin_interfaces/msg/Duration")
        points = [
            make_point(places, speeds, [], [], make_duration(*divmod(after, _NANO)))
            for after, places, speeds in zip(
                np.rint(times * _NANO).astype(np.int64).tolist(),
                q.tolist(),
                v.tolist(),
                strict=True,
            )
        ]
        header = find_type("std_msgs/msg/Header")(stamp, "")
        self._trajectory.send(find_type(TRAJECTORY)(header, list(self._names), points))

    @property
    def is_braking(self) -> bool:
        """Whether a braking trajectory has not ended."""
        return time.monotonic() < self._braking_until

    def brake(self) -> None:
        """Slow down by a trajectory, if one can be sent."""
        self.stop()

    def stop(self) -> bool:
        """Send a trajectory from the arm's state to rest; returns whether it can be sent.

        From one place and velocity to another place and rest, in a time that fits both, a cubic has
        a constant deceleration. The stamp of 0 lets it begin at once. The position of an arm after
        a long silence is unknown, so nothing is sent: it continues to the end of its motion.
        """
        state, now = self._state, time.monotonic()
        if self._trajectory is None or state is None:
            return False
        if not abs(now - state.stamp) <= self._timeout:
            return False
        q, v = np.array(state.q), np.array(state.v)
        duration = max(float(np.abs(v).max()) / self._deceleration, SHORTEST_BRAKING)
        end = q + v * (now - state.stamp + 0.5 * duration)
        at_once = find_type("builtin_interfaces/msg/Time")(0, 0)
        self._send(at_once, np.array([duration]), end[None], np.zeros((1, len(q))))
        self._braking_until = now + duration
        return True

    def follow(self, q: list[float]) -> None:
        """Nothing: the trajectory that was sent is followed."""

    def hold(self) -> None:
        """Nothing: the robot rests at the end of a trajectory."""

    def leave(self) -> None:
        """Do nothing: a motion of a shield is proved until rest, and continues to there."""
        self.set_speed(0.0)
