"""The demo's perception and robot, each in its own process, on the public streams.

Both begin when the monitor's first verdict arrives, so that nothing is missed while it starts, and
both end by themselves when their parent has gone.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from armguard.lab.demo.places import Place, find_place
from armguard.lab.simulation.arm import SimulatedArm
from armguard.lab.simulation.balls import WanderingBalls
from armguard.lab.simulation.person import DURATIONS, ProceduralPerson
from armguard.lab.simulation.processes import run_device
from armguard.lab.simulation.recordings import place_recording
from armguard.lab.simulation.sources import ObstacleSource
from armguard.lab.simulation.trajectory import JointTrajectory, plan_work
from armguard.messages.command import CommandMessage
from armguard.robot.operating_limits import OperatingLimits
from armguard.robot.robot import Robot
from armguard.streams.nodes import Publisher, VerdictReader

ROBOT_PERIOD = 0.001
"""Between two joint states, in [s]."""

PERCEPTION_PERIOD = 0.005
"""Between two checks of what is due, in [s]."""

SPEED_FRACTION = 0.2
"""Share of its velocity limits that the arm works at."""

SHIELDED_SPEED_FRACTION = 0.6
"""Alike, of an arm that a shield moves: it is slowed down only where that has to be."""

ACCELERATION_FRACTION = 0.5
"""Share of what joints and brakes can that the arm works at, at most."""

GOAL_PATIENCE = 0.5
"""Until a goal that no command has taken is sent again, in [s]."""

WORK_CYCLE = 30.0
"""Until the arm's motion repeats, at least, in [s]."""

BALL_CLEARANCE = 2.5
"""Distance that wandering balls keep from the arm's axis, in [m]."""


def make_sources(duration: float, person: str, ball_count: int, seed: int) -> list[ObstacleSource]:
    """What moves about the arm.

    Args:
        duration: Of the demo, in [s].
        person: Vicon CSV of a person; empty: a simulated one.
        ball_count: Wandering balls besides.
        seed: Of all motions.
    """
    sources: list[ObstacleSource] = []
    if not person:
        shortest, longest = DURATIONS
        sources.append(ProceduralPerson(seed, min(max(duration, shortest), longest)))
    else:
        sources.append(place_recording(person))
    if ball_count:
        sources.append(WanderingBalls(ball_count, seed, clearance=BALL_CLEARANCE))
    return sources


class Perception(msgspec.Struct, frozen=True, tag=True, kw_only=True):
    """Publish what moves about the arm."""

    obstacles: str
    """Address of the monitor's obstacles."""
    verdicts: str
    """Address of its verdicts."""
    duration: float
    """Of the demo, in seconds."""
    seed: int
    """Of all motions."""
    person: str
    """Vicon CSV of a person; empty: a simulated one."""
    balls: int
    """How many wander about besides."""

    def run(self) -> None:
        """Publish until ended."""
        sources = make_sources(self.duration, self.person, self.balls, self.seed)
        publishers = [Publisher(self.obstacles, source.name) for source in sources]
        _wait_for_monitor(self.verdicts)
        start = time.monotonic()
        sinks = [_Restamped(publisher, start) for publisher in publishers]
        tick = 0
        while True:
            for source, sink in zip(sources, sinks, strict=True):
                source.publish(sink, time.monotonic() - start)
            tick += 1
            time.sleep(max(0.0, start + tick * PERCEPTION_PERIOD - time.monotonic()))


class RobotNode(msgspec.Struct, frozen=True, tag=True, kw_only=True):
    """Move the arm as the verdicts allow, and publish its joint states."""

    joints: str
    """Address of the monitor's joint states."""
    verdicts: str
    """Address of its verdicts."""
    seed: int
    """Of the arm's motion."""
    robot: str
    """Which arm."""

    def run(self) -> None:
        """Move until ended."""
        robot = Robot.load(self.robot)
        published = robot.published_operating_limits
        arm = SimulatedArm(
            make_trajectory(robot, find_place(self.robot), self.seed),
            None if published is None else OperatingLimits.published(robot),
        )
        with Publisher(self.joints) as publisher, VerdictReader(self.verdicts) as reader:
            _wait_for_monitor(self.verdicts)
            start = stamp = time.monotonic()
            tick = 0
            while True:
                now = time.monotonic()
                reader.latest()
                # Silence beyond `valid_until` is a scale of 0: it brakes, as on STOP.
                q, v = arm.step(max(now - stamp, 1e-9), reader.speed_scale(now))
                stamp = now
                publisher.joints(now, robot.joints, q, v)
                tick = max(tick + 1, math.floor((now - start) / ROBOT_PERIOD))
                time.sleep(max(0.0, start + tick * ROBOT_PERIOD - time.monotonic()))


class ShieldedRobotNode(RobotNode, frozen=True, tag=True, kw_only=True):
    """Ask a shield for one way after the other, follow its commands, and publish joint states."""

    def run(self) -> None:
        """Move until ended."""
        robot = Robot.load(self.robot)
        waypoints = make_trajectory(robot, find_place(self.robot), self.seed).waypoints
        q, v = waypoints[0], np.zeros(len(robot.joints))
        followed: CommandMessage | None = None
        ways, goal, asked = 0, -1, -math.inf
        with Publisher(self.joints) as publisher, VerdictReader(self.verdicts) as reader:
            _wait_for_monitor(self.verdicts)
            start, tick = time.monotonic(), 0
            while True:
                now = time.monotonic()
                if followed is not None:
                    q, v, _ = followed.at(now)
                publisher.joints(now, robot.joints, q, v)
                reader.latest()
                command = reader.command
                if command is not None and command is not followed and command.joins(q, v, now):
                    followed = command
                is_taken = is_done = False
                if command is not None and command.goal == goal:
                    is_taken, is_done = True, command.progress == 1.0 and not command.moving
                if is_done or (not is_taken and now > asked + GOAL_PATIENCE):
                    ways += is_done
                    target = waypoints[(ways + 1) % len(waypoints)]
                    until = now + GOAL_PATIENCE
                    goal = publisher.goal(
                        until, robot.joints, paths=[(np.stack([q, target]), None)]
                    )
                    asked = now
                tick = max(tick + 1, math.floor((now - start) / ROBOT_PERIOD))
                time.sleep(max(0.0, start + tick * ROBOT_PERIOD - time.monotonic()))


def make_trajectory(robot: Robot, place: Place, seed: int) -> JointTrajectory:
    """What the arm does: ways through random postures, all of it in its place if that can be."""
    # An arm of somebody's own may be larger than the place that is meant for those on a table.
    return plan_work(
        robot,
        seed,
        WORK_CYCLE,
        [(place.lower, place.upper)],
        speed_fraction=SPEED_FRACTION,
        acceleration_fraction=choose_acceleration(robot),
    )


def choose_acceleration(robot: Robot) -> float:
    """Share of what joints and brakes can that the arm works at; its controller keeps to less."""
    published = robot.published_operating_limits
    if published is None:
        return ACCELERATION_FRACTION
    gentlest = robot.brakes.gentlest_stop(np.zeros(len(robot.joints)))
    able = np.minimum(robot.acceleration_limit, gentlest)
    # A quarter of what the controller allows is left for speeding up again after a slowdown.
    return min(ACCELERATION_FRACTION, 0.75 * float(np.min(published.acceleration / able)))


class _Restamped:
    """Hands a simulated source's samples on, stamped with the machine's clock."""

    def __init__(self, publisher: Publisher, start: float) -> None:
        self._publisher = publisher
        self._start = start

    def update(
        self, ids: Sequence[str], stamp: float, *states: Any, source: str = "", **bounds: Any
    ) -> None:
        """As `Publisher.update`; the source is the publisher's own."""
        self._publisher.update(ids, self._start + stamp, *states, **bounds)


def _wait_for_monitor(verdicts: str) -> None:
    """Return when a verdict has arrived, however long the monitor compiles."""
    with VerdictReader(verdicts) as reader:
        while reader.latest(timeout=0.1) is None:
            pass


if __name__ == "__main__":
    run_device(Perception | RobotNode | ShieldedRobotNode)
