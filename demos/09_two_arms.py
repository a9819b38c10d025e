"""Two arms that share a table, each with a monitor, each the other's obstacle.

Both arms move between their own side and the middle, and obey: they slow down near each other, and
brake on STOP. They exchange only joint states. The right arm gives way: if it is stopped for too
long, it moves home first. With `main(is_obeying=False)` the arms ignore the monitors.
`main(show=True)` shows each monitor's view in the browser.
"""

import contextlib
import time
from typing import NamedTuple

import coal
import numpy as np
import pinocchio

import armguard
from armguard.app.loop import Durations
from armguard.app.view_feed import MonitorFeed
from armguard.lab.simulation import JointTrajectory, SimulatedArm
from armguard.view.process import launch
from armguard.view.publisher import FramePublisher

PERIOD, CHECK_TICKS, TELL_TICKS = 0.004, 5, 2  # [s], of a tick; distances, states of the other arm
HOME, MIDDLE = [0.9, -0.3, 0.0, -2.0, 0.0, 1.7, 0.8], [0.0, 0.5, 0.0, -1.8, 0.0, 2.2, 0.8]  # [rad]
SPEED, ACCELERATION = 0.15, 0.1  # shares of the joints' limits that both controllers keep to
HELD_UP, PATIENCE = 0.8, 0.2  # speed scale, and [s] below it before the right arm gives way
FACING = pinocchio.SE3(pinocchio.utils.rotate("z", np.pi), np.array([1.35, 0.0, 0.0]))
PLACES = {"left": pinocchio.SE3.Identity(), "right": FACING}
OTHER = {"left": "right", "right": "left"}


class Outcome(NamedTuple):
    """What happened."""

    least_moving_distance: float
    """Between the hulls of two links while either arm moved, in [m]; below 0 they overlap."""
    trips: dict[str, int]
    """How often each arm came to the middle."""
    levels: dict[str, dict[str, int]]
    """Ticks in each level, by arm."""


class Worker:
    """An arm that goes to and fro, where it is told to give way, by way of its home."""

    def __init__(self, robot: armguard.Robot, base: pinocchio.SE3, operating):
        self.robot, self.base, self.operating = robot, base, operating
        self.goes_home, self.is_giving_way, self.trips, self.held_up = True, False, 0, 0.0
        self.arm = self._go(HOME, HOME)
        self.hulls = []
        for link in robot.links:
            points = coal.StdVec_Vec3s()
            for point in robot.hull(link):
                points.append(point)
            self.hulls.append((robot.joint_index(link), coal.Convex.convexHull(points, True, "Qt")))
        self.data = robot.model.createData()

    def _go(self, target, start=None) -> SimulatedArm:
        way = JointTrajectory(
            self.robot,
            [self.arm.q if start is None else start, target],
            speed_fraction=0.9 * SPEED,
            acceleration_fraction=0.3,
        )
        self.end = np.array(target)
        return SimulatedArm(way, self.operating)

    def step(self, scale: float, *, gives_way: bool) -> None:
        """Move for a tick; at the end of its way, or held up for too long, it turns round."""
        self.held_up = self.held_up + PERIOD if scale < HELD_UP else 0.0
        self.is_giving_way |= gives_way and self.held_up > PATIENCE and not self.goes_home
        self.arm.step(PERIOD, 0.0 if self.is_giving_way else scale)
        if self.arm.v.any():
            return
        if self.is_giving_way or np.allclose(self.arm.q, self.end):
            self.trips += not self.goes_home and not self.is_giving_way
            self.goes_home, self.is_giving_way, self.held_up = not self.goes_home, False, 0.0
            self.arm = self._go(HOME if self.goes_home else MIDDLE)

    def place(self) -> list:
        """Hulls of its links, in the world."""
        pinocchio.forwardKinematics(self.robot.model, self.data, self.arm.q)
        places = (self.base * self.data.oMi[joint] for joint, _ in self.hulls)
        shapes = (hull for _, hull in self.hulls)
        return [
            (hull, coal.Transform3s(place.rotation, place.translation))
            for hull, place in zip(shapes, places, strict=True)
        ]


def measure(first: Worker, second: Worker) -> float:
    """Least distance between two arms, by Coal, in [m]."""
    request = coal.DistanceRequest()
    others = second.place()
    return min(
        coal.distance(*one, *other, request, coal.DistanceResult())
        for one in first.place()
        for other in others
    )


def main(duration: float = 20.0, is_obeying: bool = True, show: bool = False) -> Outcome:
    """Let both work for `duration` seconds; what happened."""
    robot = armguard.Robot.load("panda")
    operating = armguard.OperatingLimits.fraction(robot, velocity=SPEED, acceleration=ACCELERATION)
    workers = {arm: Worker(robot, base, operating) for arm, base in PLACES.items()}
    tables, monitors, others = {}, {}, {}
    for arm, other in OTHER.items():
        tables[arm] = armguard.Obstacles(sources=[other])
        others[arm] = armguard.ArmObstacles(
            robot, other, base_placement=PLACES[other], operating=operating
        )
        others[arm].add_fixed(tables[arm])
        monitors[arm] = armguard.Monitor(
            robot,
            tables[arm],
            rate=1.0 / PERIOD,
            operating=operating,
            base_placement=PLACES[arm],
            joint_timeout=0.5,
            source_timeout=0.5,
        )
    least, levels = np.inf, {arm: {} for arm in PLACES}
    with contextlib.ExitStack() as resources:
        feeds = {}
        for arm, monitor in monitors.items() if show else ():
            publisher = resources.enter_context(FramePublisher("tcp://127.0.0.1:*"))
            feeds[arm] = MonitorFeed(monitor, publisher)
            page = resources.enter_context(launch(publisher.address, 0))
            print(f"what the monitor of the {arm} arm sees: {page.url}")
        start = time.monotonic()
        for tick in range(round(duration / PERIOD)):
            now, scale = tick * PERIOD, {}
            for arm, worker in workers.items():
                if tick % TELL_TICKS == 0:
                    state = workers[OTHER[arm]].arm
                    others[arm].publish(tables[arm], now, state.q, state.v)
                verdict = monitors[arm].step(now, worker.arm.q, worker.arm.v)
                scale[arm] = verdict.speed_scale if is_obeying else 1.0
                name = verdict.level.name
                levels[arm][name] = levels[arm].get(name, 0) + 1
                if arm in feeds:
                    feeds[arm].observe(verdict, now, Durations(), 0)
            for arm, worker in workers.items():
                worker.step(scale[arm], gives_way=arm == "right")
            if tick % CHECK_TICKS == 0 and any(one.arm.v.any() for one in workers.values()):
                least = min(least, measure(*workers.values()))
            if show:
                time.sleep(max(0.0, start + now - time.monotonic()))
    trips = {arm: worker.trips for arm, worker in workers.items()}
    print(f"least distance while an arm moved: {1000 * least:.0f} mm; trips: {trips}")
    for arm, counts in levels.items():
        print(f"{arm}: " + ", ".join(f"{name} {n / (tick + 1):.0%}" for name, n in counts.items()))
    return Outcome(least, trips, levels)


if __name__ == "__main__":
    main(show=True)
