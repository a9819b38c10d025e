#!/usr/bin/env python3
"""A ROS 2 node that supervises an arm: reads joint states and perception, publishes a speed.

It publishes diagnostics as well. Needs ROS 2 (rclpy, tf2_msgs, diagnostic_msgs).
`armguard.bridges.ros2` is tested with messages that `rosbags` writes, and the node with a stand-in
for rclpy, not with ROS 2 itself. Run it with the Python of ROS 2:

    python3 demos/06_ros2_bridge.py --cell demos/cell.toml \
        --obstacles camera=/people:geometry_msgs/msg/PoseArray --radius 0.4 \
        --moving wrist_camera:0.7:2.5 --ros-args -p use_sim_time:=true

`--moving FRAME:SPEED:TURN_RATE` bounds a frame that moves, in m/s and rad/s. docs/ros2.md has more.
"""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from armguard.app.cell import Cell
from armguard.bridges import (
    AnswerMaker,
    FrameErrors,
    Ros2Cell,
    describe_verdict,
    read_speed_override,
)
from armguard.exceptions import ArmguardError

CELL = Path(__file__).with_name("cell.toml")


def read_topic(text: str) -> tuple[str, str]:
    """A topic and its type, from `[SOURCE=]TOPIC:TYPE`."""
    topic, _, kind = text.rpartition(":")
    if not topic or not kind:
        raise argparse.ArgumentTypeError(f"{text!r} is not [SOURCE=]TOPIC:TYPE")
    return topic, kind


def read_moving(text: str) -> tuple[str, FrameErrors]:
    """A frame and how fast it moves at most, from `FRAME:SPEED:TURN_RATE`."""
    try:
        name, speed, turn_rate = text.rsplit(":", 2)
        return name, FrameErrors(speed=float(speed), turn_rate=float(turn_rate))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not FRAME:SPEED:TURN_RATE, in m/s and rad/s"
        ) from None


def make_parser() -> argparse.ArgumentParser:
    """What the node takes beside the arguments of ROS."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cell", type=Path, default=CELL)
    parser.add_argument("--joints", default="/joint_states")
    parser.add_argument(
        "--obstacles", nargs="*", type=read_topic, default=[], metavar="[SOURCE=]TOPIC:TYPE"
    )
    parser.add_argument(
        "--moving", nargs="*", type=read_moving, default=[], metavar="FRAME:SPEED:TURN_RATE"
    )
    parser.add_argument("--radius", type=float)
    parser.add_argument("--snapshot", action="store_true")
    return parser


def main(arguments: tuple[str, ...] = ()) -> None:
    """Run the node until it is told to end."""
    try:
        import rclpy
        from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
        from rosidl_runtime_py.utilities import get_message
    except ModuleNotFoundError as error:
        raise ArmguardError(
            "ROS 2",
            f"is not there: {error}",
            remedy="source /opt/ros/<distribution>/setup.bash, and use the Python that it names",
        ) from None
    options = make_parser().parse_args(rclpy.utilities.remove_ros_args(["", *arguments])[1:])
    topics = dict(options.obstacles)
    robot, _, monitor = Cell.load(options.cell).build()
    cell = Ros2Cell(
        monitor,
        options.joints,
        topics,
        radius=options.radius,
        snapshot=options.snapshot,
        errors=dict(options.moving),
    )
    answers = AnswerMaker(get_message, lambda level: bytes([level]), robot.name)
    rclpy.init(args=list(arguments))
    node = rclpy.create_node("armguard")
    transform = get_message("tf2_msgs/msg/TFMessage")
    kept = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    diagnostics = node.create_publisher(answers.diagnostics, "/diagnostics", 10)
    speed = node.create_publisher(answers.speed, "/armguard/speed_override", 1)

    def tick() -> None:
        now = node.get_clock().now()
        verdict = cell.step(now.nanoseconds)
        speed.publish(answers.make_speed(read_speed_override(verdict)))
        diagnostics.publish(answers.make_diagnostics(now.to_msg(), describe_verdict(verdict)))

    def take(topic: str) -> Callable[[Any], None]:
        return lambda message: cell.take_obstacles(topic, message)

    subscribe = node.create_subscription
    # Best effort: it gets what publishers of either reliability send, as drivers of sensors do.
    sensed = qos_profile_sensor_data
    subscribe(get_message("sensor_msgs/msg/JointState"), options.joints, cell.take_joints, sensed)
    for name, kind in topics.items():
        topic = name.rpartition("=")[2]
        subscribe(get_message(kind), topic, take(topic), sensed)
    subscribe(transform, "/tf", lambda one: cell.take_transforms(one, is_static=False), 100)
    subscribe(transform, "/tf_static", lambda one: cell.take_transforms(one, is_static=True), kept)
    node.create_timer(monitor.period, tick)
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        speed.publish(answers.make_speed(0.0))
        node.destroy_node()


if __name__ == "__main__":
    try:
        main(tuple(sys.argv[1:]))
    except ArmguardError as error:
        print(error, file=sys.stderr)
        sys.exit(2)
