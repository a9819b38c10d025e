"""The processes of the campaign's cell besides the monitor: the arm's drives, its driver, a camera.

Drives and driver are two, as in a real robot: what tells the monitor of the joints may die while
the drives go on. Each process is told of disturbances by lines of JSON on its standard input, and
ends with the process that started it.
"""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from armguard.lab.faults.disturbance import Disturbance, DisturbedPublisher, make_crowd
from armguard.lab.faults.scene import (
    PEOPLE,
    RADIUS,
    ROBOT,
    make_trajectory,
    sample_people,
    sample_pillar,
    visit_period,
)
from armguard.lab.simulation.arm import SimulatedArm
from armguard.lab.simulation.processes import run_device
from armguard.messages.incoming import ObstaclesMessage
from armguard.robot.operating_limits import OperatingLimits
from armguard.robot.robot import Robot
from armguard.streams.inputs import LineInput
from armguard.streams.nodes import VerdictReader

STEP = 0.001
"""Of the simulated arm, in [s]."""

ARM_PERIOD = 0.002
"""Between two readings of the verdicts, and between two joint states, in [s]."""

CAMERA_PERIOD = 0.01
"""Between two images, in [s]."""

CROWD_SHARE = 10_000
"""Obstacles in one message, at most; a larger one is refused as too long."""


def row_width(joints: int) -> int:
    """Numbers in a row of what the arm did: time, speed scale, whether silent, q, v."""
    return 3 + 2 * joints


def read_rows(path: Path, joints: int, first: int = 0) -> NDArray[np.float64]:
    """What the arm truly did, a row for each step, from row `first` on.

    Returns:
        Time of the machine's monotonic clock in [s], speed scale that it obeyed, 1 where it obeyed
        silence, joint positions and velocities. Shape (n, 3 + 2 nv).
    """
    width = row_width(joints)
    with path.open("rb") as file:
        file.seek(8 * width * first)
        data = file.read()
    usable = len(data) // (8 * width) * width
    return np.frombuffer(data, np.float64, usable).reshape(-1, width)


class Drives(msgspec.Struct, frozen=True, tag=True, kw_only=True):
    """Move the arm as the verdicts allow, and write down what it truly did."""

    verdicts: str
    """Address of the monitor's verdicts."""
    truth: str
    """The file that it writes."""

    def run(self) -> None:
        """Move until ended."""
        robot = Robot.load(ROBOT)
        arm = SimulatedArm(make_trajectory(robot), OperatingLimits.published(robot))
        file = os.open(self.truth, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with VerdictReader(self.verdicts) as reader:
            stamp = time.monotonic()
            while True:
                now = time.monotonic()
                rows = []
                # A hold-up of this process is none of the arm's: it goes by what it has heard, and
                # only until that expires.
                while stamp + STEP <= now:
                    stamp += STEP
                    scale, silent = reader.speed_scale(stamp), reader.silent(stamp)
                    q, v = arm.step(STEP, scale)
                    rows.append(np.concatenate([[stamp, scale, float(silent)], q, v]))
                if rows:
                    os.write(file, np.concatenate(rows).tobytes())
                reader.latest()
                time.sleep(max(0.0, now + ARM_PERIOD - time.monotonic()))


class Driver(msgspec.Struct, frozen=True, tag=True, kw_only=True):
    """Publish joint states of the arm."""

    joints: str
    """Address of the monitor's joint states."""
    truth: str
    """The file that the drives write."""

    def run(self) -> None:
        """Publish until ended."""
        names = Robot.load(ROBOT).joints
        width = row_width(len(names))
        orders = LineInput()
        while not Path(self.truth).exists():
            time.sleep(ARM_PERIOD)
        file = os.open(self.truth, os.O_RDONLY)
        with contextlib.closing(DisturbedPublisher(self.joints)) as publisher:
            while True:
                now = time.monotonic()
                take_order(orders, publisher)
                last = os.fstat(file).st_size // (8 * width) - 1
                if last >= 0:
                    row = np.frombuffer(os.pread(file, 8 * width, 8 * width * last))
                    q, v = np.split(row[3:], 2)
                    publisher.joints(row[0], names, q, v)
                publisher.flush(now)
                time.sleep(max(0.0, now + ARM_PERIOD - time.monotonic()))


class Camera(msgspec.Struct, frozen=True, tag=True, kw_only=True):
    """Publish where the people are."""

    obstacles: str
    """Address of the monitor's obstacles."""
    start: float
    """Of the campaign, on the machine's monotonic clock, in [s]."""

    def run(self) -> None:
        """Publish until ended."""
        period = visit_period(make_trajectory(Robot.load(ROBOT)))
        orders = LineInput()
        due = time.monotonic()
        extra: list[str] = []
        with contextlib.closing(DisturbedPublisher(self.obstacles, "camera")) as publisher:
            while True:
                take_order(orders, publisher)
                now = time.monotonic()
                publisher.flush(now)
                if now >= due:
                    due = max(due + CAMERA_PERIOD, now)
                    position, velocity = sample_people(now - self.start, period)
                    publisher.update(
                        PEOPLE, now, position, velocity, radius=RADIUS, position_error=0.001
                    )
                    extra = self._publish_more(publisher, now, extra)
                time.sleep(0.25 * CAMERA_PERIOD)

    def _publish_more(
        self, publisher: DisturbedPublisher, now: float, extra: list[str]
    ) -> list[str]:
        """Publish what a disturbance adds to the cell; the ids that it has added."""
        disturbance = publisher.disturbance
        if disturbance is None or not disturbance.is_active(now):
            if extra:
                publisher.remove(extra, now)
            return []
        if disturbance.kind == "static":
            position, velocity = sample_pillar(now - disturbance.begin)
            publisher.update(
                ["pillar"], now, position, velocity, radius=RADIUS, position_error=0.001
            )
            return ["pillar"]
        if disturbance.kind == "crowd" and not extra:
            ids, places = make_crowd(int(disturbance.amount))
            share = int(disturbance.field or CROWD_SHARE)
            for first in range(0, len(ids), share):
                some = slice(first, first + share)
                publisher.update(ids[some], now, places[some], radius=0.1)
            return ids
        if disturbance.kind == "flood":
            heartbeat = ObstaclesMessage([], now, publisher.source)
            publisher.flood(heartbeat, disturbance.amount, CAMERA_PERIOD)
        return extra


def take_order(orders: LineInput, publisher: DisturbedPublisher) -> None:
    """Follow the newest disturbance that this process was told of."""
    while (line := orders.receive()) is not None:
        publisher.disturbance = msgspec.json.decode(line, type=Disturbance)


Node = Drives | Driver | Camera


if __name__ == "__main__":
    run_device(Node)
