"""`armguard drive`: connects the robot of a cell file to a running monitor."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from msgspec import UNSET

from armguard.app.announcer import Announcer
from armguard.app.cell.cell import Cell
from armguard.app.cell.schema import MOST_DOMAINS, FrankaTable, Ros2Table, UrTable, make_error
from armguard.app.processes import COMPLAINT, complain, noted_interrupts
from armguard.app.run import read_key_files
from armguard.app.terminal import make_console, print_json
from armguard.bridges.messages import ObstacleReader
from armguard.bridges.ros2 import FrameErrors
from armguard.drivers.latencies import describe_delay
from armguard.drivers.options import DriveOptions, FrankaOptions, ObstacleTopic, Ros2Options
from armguard.drivers.watch import Report, check_library, watch
from armguard.exceptions import ArmguardError
from armguard.robot.description import is_known
from armguard.robot.operating_limits import LimitsInForce
from armguard.robot.robot import Robot
from armguard.settings.settings import Settings
from armguard.streams.addresses import JOINTS_ADDRESS, check_address
from armguard.streams.keys import Keys

if TYPE_CHECKING:
    from armguard.app import cli


def drive(wishes: cli.Drive) -> int:
    """Drive the robot of a cell until the end, and print a summary; returns the exit code.

    Args:
        wishes: What the command line says.

    Raises:
        ArmguardError: The cell has no such robot, the client library is missing, or a value in the
            cell file cannot be used.
    """
    for option, value in (("--duration", wishes.duration), ("--stops", wishes.stops)):
        if not value > 0:
            raise ArmguardError(option, f"is {value}", expected="more than 0")
    options = make_options(wishes)
    check_library(options.driver)
    with Announcer() as announcer, noted_interrupts() as was_interrupted:
        report = watch(options, announcer.tell, was_interrupted, wishes.duration)
    print_json(lambda: msgspec.to_builtins(report))
    if report.problem:
        complain(report.problem)
        return COMPLAINT
    if wishes.measure and not report.measured:
        complain("the measurement was not finished")
        return COMPLAINT
    make_console().print(report.measured or _summarise(report), soft_wrap=True, markup=False)
    return 0


def make_options(wishes: cli.Drive) -> DriveOptions:
    """Options of the driver's process, from a cell file and the command line.

    Raises:
        ArmguardError: The cell cannot be read, has no driver, or does not fit its robot.
    """
    cell = Cell.load(wishes.cell, wishes.arm)
    table = cell.find_driver()
    key_files = read_key_files(wishes.key, wishes.server_key)
    if key_files is not None:
        Keys.load(*key_files)
    joints = wishes.joints or (JOINTS_ADDRESS,)
    for address in (*joints, wishes.verdicts, wishes.obstacles):
        check_address(address, has_keys=key_files is not None)
    follows = cell.tables.shield is not None
    if follows and wishes.measure:
        raise ArmguardError(
            "--measure",
            "is given beside [shield]",
            expected="a cell without it, in which the robot's program moves the arm",
        )
    if follows and not isinstance(table, Ros2Table) and table.speed != 1.0:
        # Its commands say how fast the arm goes.
        raise make_error(
            cell.file, "robot.driver.speed", f"is {table.speed} beside [shield]", "one of them"
        )
    robot = cell.make_robot()
    payload = cell.tables.robot.payload
    if isinstance(table, UrTable):
        own = _describe_ur(table, robot, cell)
    elif isinstance(table, FrankaTable):
        own = _describe_franka(table, robot, cell)
    else:
        own = _describe_ros2(table, robot, cell, wishes)
    return DriveOptions(
        timeout=table.timeout,
        stop_within=table.stop_within,
        deceleration=table.deceleration,
        validity=Settings(**cell.monitor_settings(robot)).response_time,
        payload=robot.brakes.most_payload if payload is UNSET else payload,
        joints=joints,
        verdicts=wishes.verdicts,
        arm=cell.arm,
        follows=follows,
        measure=wishes.stops if wishes.measure else 0,
        key_files=None if key_files is None else (str(key_files[0]), str(key_files[1])),
        is_first=not wishes.again,
        **own,
    )


def _describe_ur(table: UrTable, robot: Robot, cell: Cell) -> dict[str, Any]:
    """Options of the driver for Universal Robots."""
    fastest = 500.0
    if not table.rate <= fastest:
        raise make_error(
            cell.file, "robot.driver.rate", f"is {table.rate}", f"{fastest:g} Hz at most"
        )
    return {
        "driver": "ur",
        "host": table.host,
        "model": table.model,
        "rate": table.rate,
        "names": _name_joints(table, robot.joints, cell),
        "speed": table.speed,
    }


def _describe_franka(table: FrankaTable, robot: Robot, cell: Cell) -> dict[str, Any]:
    """Options of the driver for Franka Robotics."""
    names = _name_joints(table, robot.joints, cell)
    settings = cell.monitor_settings(robot)
    limits = LimitsInForce(robot, settings["operating"])
    contact_limits = settings["contact_limits"]
    forces = [one.force for one in contact_limits.by_region.values()] if contact_limits else []
    franka = FrankaOptions(
        waypoints=_check_waypoints(table, robot, cell),
        velocities=tuple(limits.operating_velocity.tolist()),
        accelerations=tuple(limits.operating_acceleration.tolist()),
        contact_force=min(filter(None, forces), default=None),
    )
    return {
        "driver": "franka",
        "host": table.host,
        "model": table.model,
        "rate": 1000.0,
        "names": names,
        "speed": table.speed,
        "franka": franka,
    }


def _check_waypoints(table: FrankaTable, robot: Robot, cell: Cell) -> tuple[tuple[float, ...], ...]:
    """Check the waypoints, which a robot must have exactly if no shield moves it."""
    waypoints = tuple(map(tuple, table.waypoints))
    key, is_shielded = "robot.driver.waypoints", cell.tables.shield is not None
    if waypoints and is_shielded:
        raise make_error(cell.file, key, "is there beside [shield]", "one of them")
    if len(set(waypoints)) < 2 and not is_shielded:
        raise make_error(cell.file, key, f"has {len(set(waypoints))}", "two different ones")
    lower, upper = robot.lower_position_limit, robot.upper_position_limit
    for number, waypoint in enumerate(waypoints):
        q = np.array(waypoint)
        if q.shape != lower.shape or not ((lower <= q) & (q <= upper)).all():
            raise make_error(
                cell.file,
                f"{key}[{number}]",
                f"is {waypoint}",
                "a position of each joint, from the base on, within its limits",
            )
    return waypoints


def _describe_ros2(table: Ros2Table, robot: Robot, cell: Cell, wishes: cli.Drive) -> dict[str, Any]:
    """Options of the driver for a ROS 2 graph."""
    follows = cell.tables.shield is not None
    if follows and table.trajectory is None:
        raise make_error(
            cell.file, "robot.driver.trajectory", "is missing beside [shield]", "a topic"
        )
    for source, topic in table.obstacles.items():
        key = f"robot.driver.obstacles.{source}"
        if source not in cell.sources:
            raise make_error(cell.file, key, "is no source", f"[sources.{source}] beside it")
        try:
            ObstacleReader(topic.topic, topic.type, topic.radius)
        except ArmguardError as error:
            raise make_error(cell.file, key, error.problem, error.expected or "a radius") from None
    domain = _read_domain(table)
    ros2 = Ros2Options(
        domain=domain,
        joint_states=table.joint_states,
        speed_override=table.speed_override,
        acknowledge=table.acknowledge if table.holds_after_restart else "",
        trajectory=table.trajectory or "",
        obstacles={
            source: ObstacleTopic(
                topic=one.topic, kind=one.type, radius=one.radius, snapshot=one.snapshot
            )
            for source, one in table.obstacles.items()
        },
        obstacle_address=wishes.obstacles,
        frames=tuple(cell.frames),
        frame_errors={
            pattern: FrameErrors(**msgspec.structs.asdict(one))
            for pattern, one in table.frames.items()
        },
        acceleration_limit=tuple(robot.acceleration_limit.tolist()),
        position_error=tuple(robot.position_error.tolist()),
        velocity_error=tuple(robot.velocity_error.tolist()),
        is_continuous=tuple(np.isinf(robot.upper_position_limit).tolist()),
    )
    return {
        "driver": "ros2",
        "host": f"domain {domain}",
        "model": "ROS 2",
        "rate": 0.0,
        "names": robot.joints,
        "speed": 1.0,
        "ros2": ros2,
    }


def _read_domain(table: Ros2Table) -> int:
    """The domain of the cell file, else that of `ROS_DOMAIN_ID`, else 0."""
    if table.domain is not None:
        return table.domain
    text = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not (text.isdecimal() and int(text) <= MOST_DOMAINS):
        raise ArmguardError("ROS_DOMAIN_ID", f"is {text!r}", expected=f"0 to {MOST_DOMAINS}")
    return int(text)


def _name_joints(
    table: UrTable | FrankaTable, watched: tuple[str, ...], cell: Cell
) -> tuple[str, ...]:
    """Names of the robot's joints in the controller's order; they must be the watched joints."""
    from armguard.drivers import franka, ur

    name = cell.tables.robot.name or ""
    if is_known(name) and name != (table.model.lower() if isinstance(table, UrTable) else "panda"):
        raise make_error(
            cell.file,
            "robot.driver.model",
            f"is {table.model!r}, and the monitor watches a {name!r}",
            "the same robot",
        )
    known = franka.JOINTS if isinstance(table, FrankaTable) else (ur.JOINTS,)
    if table.joints is not None:
        known = (tuple(table.joints),)
    if watched in known:  # in the order of the model, from the base on
        return watched
    raise make_error(
        cell.file,
        "robot.driver.joints",
        f"has {', '.join(known[0])}, and the monitor watches {', '.join(watched)}",
        "the same joints, from the base on",
    )


def _summarise(report: Report) -> str:
    """The summary of a drive, in one line."""
    counts = report.counts
    connections = "connection" if report.connections == 1 else "connections"
    return (
        f"{counts.states} joint states by {report.connections} {connections}, longest gap "
        f"{1e3 * counts.longest_gap:.1f} ms; {counts.stops} stops, {counts.silences} of them "
        f"without a valid verdict{describe_delay(counts)}; "
        f"{counts.hard_stops} by another way than the usual one"
    )
