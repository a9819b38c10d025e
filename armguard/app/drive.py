"""`armguard drive`: joins the robot of a cell file to a running monitor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import numpy as np
from msgspec import UNSET

from armguard.app.announcer import Announcer
from armguard.app.cell.cell import Cell
from armguard.app.cell.schema import DriverTable, make_error
from armguard.app.processes import COMPLAINT, complain, noted_interrupts
from armguard.app.run import read_key_files
from armguard.app.terminal import make_console, print_json
from armguard.drivers.arm import Make
from armguard.drivers.makes import find_make
from armguard.drivers.options import DriveOptions
from armguard.drivers.watch import Report, check_library, watch
from armguard.exceptions import ArmguardError
from armguard.robot.operating_limits import LimitsInForce
from armguard.robot.robot import Robot
from armguard.streams.addresses import check_address
from armguard.streams.keys import Keys

if TYPE_CHECKING:
    from armguard.app import cli


def drive(wishes: cli.Drive) -> int:
    """Drive the robot of a cell until the end, and print what was done; the exit code.

    Args:
        wishes: What the command line says.

    Raises:
        ArmguardError: The cell has no such robot, the client library is missing, or something
            cannot be used.
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
    """What the driver's process has to know, from a cell file and the command line.

    Raises:
        ArmguardError: The cell cannot be read, has no driver, or does not fit its robot.
    """
    cell = Cell.load(wishes.cell, wishes.arm)
    table = cell.tables.robot.driver
    if table is None:
        raise make_error(
            cell.file,
            "robot.driver",
            "is missing",
            '{ name = "ur", host = "…", model = "UR5e" }',
        )
    make = find_make(table.name)
    least, most = make.rates
    rate = most if table.rate is UNSET else table.rate
    if not least <= rate <= most:
        expected = f"{least:g} to {most:g} Hz" if least < most else f"{most:g} Hz"
        raise make_error(cell.file, "robot.driver.rate", f"is {rate}", expected)
    key_files = read_key_files(wishes.key, wishes.server_key)
    if key_files is not None:
        Keys.load(*key_files)
    for address in (wishes.joints, wishes.verdicts):
        check_address(address, has_keys=key_files is not None)
    robot = cell.make_robot()
    names = _name_joints(table, make, robot.joints, cell.file)
    payload = cell.tables.robot.payload
    settings = cell.monitor_settings(robot)
    limits = LimitsInForce(robot, settings["operating"])
    order = [robot.joints.index(name) for name in names]
    contact_limits = settings["contact_limits"]
    forces = [one.force for one in contact_limits.by_region.values()] if contact_limits else []
    return DriveOptions(
        driver=table.name,
        host=table.host,
        model=table.model,
        rate=rate,
        names=names,
        timeout=table.timeout,
        speed=table.speed,
        stop_within=table.stop_within,
        deceleration=table.deceleration,
        payload=robot.brakes.most_payload if payload is UNSET else payload,
        waypoints=_check_waypoints(cell, robot, make, order),
        velocities=tuple(limits.operating_velocity[order].tolist()),
        accelerations=tuple(limits.operating_acceleration[order].tolist()),
        contact_force=min(filter(None, forces), default=None),
        joints=wishes.joints,
        verdicts=wishes.verdicts,
        arm=cell.arm,
        follows=cell.tables.shield is not None,
        measure=wishes.stops if wishes.measure else 0,
        key_files=None if key_files is None else (str(key_files[0]), str(key_files[1])),
    )


def _name_joints(
    table: DriverTable, make: Make, watched: tuple[str, ...], file: str
) -> tuple[str, ...]:
    """Names of the robot's joints in the controller's order; the monitor watches all of them."""
    known = make.joints if table.joints is None else (tuple(table.joints),)
    for names in known:
        if sorted(names) == sorted(watched):
            return names
    raise make_error(
        file,
        "robot.driver.joints",
        f"has {', '.join(known[0])}, and the monitor watches {', '.join(watched)}",
        "the same joints, from the base on",
    )


def _check_waypoints(
    cell: Cell, robot: Robot, make: Make, order: list[int]
) -> tuple[tuple[float, ...], ...]:
    """The waypoints of a robot without a program; no others have any."""
    assert cell.tables.robot.driver is not None
    waypoints = tuple(map(tuple, cell.tables.robot.driver.waypoints))
    key, needs = "robot.driver.waypoints", not (make.has_program or cell.tables.shield)
    if needs and len(set(waypoints)) < 2:
        raise make_error(cell.file, key, f"has {len(set(waypoints))}", "two different ones")
    if waypoints and not needs:
        raise make_error(cell.file, key, "is there, and something else moves the robot", "none")
    lower, upper = robot.lower_position_limit[order], robot.upper_position_limit[order]
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


def _summarise(report: Report) -> str:
    """What was done, in a line."""
    counts = report.counts
    connections = "connection" if report.connections == 1 else "connections"
    return (
        f"{counts.states} joint states by {report.connections} {connections}, longest gap "
        f"{1e3 * counts.longest_gap:.1f} ms; {counts.stops} stops, {counts.silences} of them "
        f"without a valid verdict, ordered within p99 {1e3 * counts.obeyed_p99:.1f} ms; "
        f"{counts.hard_stops} ended the program"
    )
