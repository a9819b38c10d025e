"""What a plan buys beside joint bounds, and what it costs to ask.

    python benchmarks/bench_planned.py panda --scenes 200

lets the robot swing at up to a share of its velocity limits, a ball with the bounds of a person
(10 m/s², 2 m/s) beside it, and prints for several tracking errors, of velocities stated or not:

- contact: the earliest contact that is possible on the piece, its own stop included, beside what
  joint bounds say, both cut off at the end of the table of joint bounds;
- whole: the share of scenes in which there is none before the arm rests at the piece's end;
- left: the share in which there is none before the arm rests if each joint may leave the piece at
  any moment, to brake by itself, beside what braking bounds, which know of no path, say of an arm
  that is told to stop.

Then the price in µs: of checking a plan, of laying it out, and of one evaluation of all pairs.
"""

from __future__ import annotations

import argparse
import time
from typing import NamedTuple

import numpy as np
import pinocchio
from numpy.typing import NDArray

from armguard.bounds import (
    BrakingMotion,
    CheckedPlan,
    JointMotion,
    Plan,
    PlannedCourse,
    PlannedMotion,
    Refusal,
    append_stop,
    check_plan,
    table_contact_time,
)
from armguard.bounds.joint_table import JointTable
from armguard.bounds.table_time import ArmSphere
from armguard.contact.bodies import Bounds, Hull
from armguard.obstacles import Obstacles
from armguard.robot import Kinematics, Robot

Floats = NDArray[np.float64]

REACTION, HORIZON = 0.02, 0.003
DURATION, SAMPLES = 0.2, 41
ERRORS = [(5e-4, None), (2e-3, None), (2e-3, 0.05), (1e-2, None), (1e-2, 0.05)]
"""Tracking errors in [rad] or [m], and of velocities in [rad]/[s] or [m]/[s]."""


class Swing(NamedTuple):
    """A smooth motion of all joints about a middle, from time 0 on."""

    middle: Floats
    size: Floats
    rate: Floats
    phase: Floats

    def sample(self, times: Floats) -> tuple[Floats, Floats]:
        """Positions and velocities at times, each of shape (k, nv)."""
        turn = np.outer(times, self.rate) + self.phase
        return self.middle + self.size * np.sin(turn), self.size * self.rate * np.cos(turn)


def draw_swing(robot: Robot, speed: float, random: np.random.Generator) -> Swing:
    """A motion within limits, at up to a share of the velocity limits."""
    lower = np.maximum(robot.lower_position_limit, -np.pi)
    upper = np.minimum(robot.upper_position_limit, np.pi)
    rate = random.uniform(1.0, 6.0, len(lower))
    fits = np.minimum(0.9 * robot.acceleration_limit / rate**2, 0.45 * (upper - lower))
    size = np.minimum(speed * robot.velocity_limit / rate, fits)
    # There is room to stop beyond.
    room = size + np.square(size * rate) / (2.0 * robot.braking_deceleration)
    room = np.minimum(room, 0.5 * (upper - lower))
    middle = random.uniform(lower + room, upper - room)
    return Swing(middle, size, rate, random.uniform(0.0, 2.0 * np.pi, len(lower)))


def scatter(center: Floats, count: int, least: float, most: float, random: np.random.Generator):
    """Balls of 10 cm around a place, at distances in [m], in any motion."""
    way = random.normal(size=(2, count, 3))
    way /= np.linalg.norm(way, axis=2, keepdims=True)
    obstacles = Obstacles(accel=10.0, speed=2.0)
    obstacles.update(
        [f"ball{k}" for k in range(count)],
        0.0,
        center + way[0] * random.uniform(least, most, (count, 1)),
        way[1] * random.uniform(0.0, 1.6, (count, 1)),
        radius=0.1,
    )
    return obstacles


def list_pairs(obstacles: Obstacles, links: int) -> NDArray[np.int64]:
    """All pairs of the obstacles and so many links."""
    rows = np.flatnonzero(obstacles.table.alive)
    return (rows[:, None] * links + np.arange(links)).ravel()


class JointAnswer:
    """Contact times by tables of joint displacements, from all leaves of the arm's cover."""

    def __init__(self, robot: Robot) -> None:
        self.kinematics = Kinematics(robot)
        self.motion, self.braking = JointMotion(robot), BrakingMotion(robot, REACTION)
        self.leaves = np.flatnonzero(self.kinematics.spheres.child_count == 0)

    def contact_time(self, table: JointTable, q: Floats, v: Floats, obstacles: Obstacles) -> float:
        """Earliest contact in [s]; at most the end of the table."""
        motion, kinematics, body = self.motion, self.kinematics, obstacles.table.accepted
        kinematics.compute(q, v)
        jacobian = pinocchio.computeJointJacobians(kinematics.model, kinematics.data, q)
        best = float(table.time[-1])
        for row in np.flatnonzero(obstacles.table.alive):
            bounds = Bounds(body.accel[row], body.speed[row], body.velocity_error[row], 0.0)
            hull = Hull(body.points[row], body.velocities[row], body.point_count[row], bounds)
            for leaf in self.leaves:
                reach = kinematics.spheres.radius[leaf] + body.radius[row]
                reach += motion.position_error[leaf]
                lever, slope_error = motion.lever[leaf], motion.slope_error[leaf]
                sphere = ArmSphere(*kinematics.centers[leaf], jacobian, lever, slope_error)
                best = min(best, table_contact_time(sphere, table, hull, reach, 0.0))
        return best


def ask(motion: PlannedMotion, course: PlannedCourse, obstacles: Obstacles, links: int) -> float:
    """Earliest contact on a course, in [s]."""
    table, pairs = obstacles.table, list_pairs(obstacles, links)
    return motion.contact_time(
        course, pairs, 0.0, 0.0, table.accepted, table.refused_states, table.marks
    ).time


def lay_out_left(motion: PlannedMotion, plan: CheckedPlan) -> PlannedCourse:
    """Where the arm can be whose joints may leave a piece at any moment."""
    course = motion.lay_out_left(plan)
    assert course is not None, "brakes are stated for all speeds of the swing"
    return course


def make_plan(robot: Robot, swing: Swing, error: float, pace: float | None) -> CheckedPlan:
    """The next piece of a motion, checked where it begins."""
    times = np.linspace(0.0, DURATION, SAMPLES)
    q, v = swing.sample(times)
    ones = np.ones(len(robot.joints))
    plan = Plan(0.0, times, q, v, error * ones, None if pace is None else pace * ones)
    stopped = append_stop(plan, robot.braking_deceleration)
    if isinstance(stopped, Refusal):
        raise SystemExit(f"refused: {stopped}")
    checked = check_plan(stopped, robot, 0.0, q[0], v[0], 0.0)
    if not isinstance(checked, CheckedPlan):
        raise SystemExit(f"refused: {checked}")
    return checked


def compare(robot: Robot, motion: PlannedMotion, scenes: int, speed: float) -> None:
    """Print the first table."""
    random, joint, links = np.random.default_rng(0), JointAnswer(robot), len(robot.links)
    planned = np.empty((len(ERRORS), scenes))
    braking = np.zeros(len(ERRORS) + 1)
    free, end = np.empty(scenes), 0.0
    for k in range(scenes):
        swing = draw_swing(robot, speed, random)
        q, v = (part[0] for part in swing.sample(np.zeros(1)))
        joint.kinematics.compute(q, v)
        center = joint.kinematics.centers[joint.kinematics.spheres.root[-1]]
        obstacles = scatter(center, 1, 0.2, 1.5, random)
        table = joint.motion.tabulate(q, v, 0.0)
        free[k], end = joint.contact_time(table, q, v, obstacles), float(table.time[-1])
        table = joint.braking.tabulate(q, v, 0.0, HORIZON)
        braking[-1] += joint.contact_time(table, q, v, obstacles) > 0.999 * table.time[-1]
        for row, (error, pace) in enumerate(ERRORS):
            plan = make_plan(robot, swing, error, pace)
            planned[row, k] = ask(motion, motion.lay_out(plan), obstacles, links)
            braking[row] += ask(motion, lay_out_left(motion, plan), obstacles, links) == np.inf
    quantiles = [25, 50, 75]
    print(f"{robot.name}: {scenes} scenes, one ball 0.2 to 1.5 m from the tip, {speed:.0%} speed")
    print(f"{'':>32}{'contact [s] 25/50/75 %':>26}{'whole':>8}{'left':>9}")
    for label, times, whole, brakes in (
        ("joint bounds, braking bounds", free, "", braking[-1] / scenes),
        *(
            (
                f"plan +-{error:g}, rate {'not stated' if pace is None else f'+-{pace:g}'}",
                np.minimum(planned[row], end),
                f"{(planned[row] == np.inf).mean():.0%}",
                braking[row] / scenes,
            )
            for row, (error, pace) in enumerate(ERRORS)
        ),
    ):
        cells = " / ".join(f"{value:.3f}" for value in np.percentile(times, quantiles))
        print(f"{label:>32}{cells:>26}{whole:>8}{brakes:>9.0%}")
    print("share of scenes in which a plan is no earlier:", *(planned >= free).mean(axis=1))


def measure(robot: Robot, motion: PlannedMotion, speed: float) -> None:
    """Print the second table."""
    random, links = np.random.default_rng(1), len(robot.links)
    swing = draw_swing(robot, speed, random)
    plan = make_plan(robot, swing, *ERRORS[2])
    course = motion.lay_out(plan)
    center = course.arm_ball[:3]
    jobs = {
        "check a plan": lambda: make_plan(robot, swing, *ERRORS[2]),
        f"lay out {len(course.start)} slabs": lambda: motion.lay_out(plan),
        "lay out a piece that may be left": lambda: lay_out_left(motion, plan),
    }
    for count in (9, 1000):
        for least, most, where in ((1.6, 4.0, "around"), (0.0, 4.0, "around and in the way")):
            obstacles = scatter(center, count, least, most, random)
            table, pairs = obstacles.table, list_pairs(obstacles, links)

            def look(table=table, pairs=pairs):
                return motion.contact_time(
                    course, pairs, 0.0, 0.0, table.accepted, table.refused_states, table.marks
                )

            found = look()
            jobs[f"{count} obstacles {where} ({found.evaluated} looks)"] = look
    print(f"\n{'[µs]':>56}{'median':>10}{'p99':>10}")
    for label, job in jobs.items():
        spent = []
        for _ in range(200):
            begin = time.perf_counter()
            job()
            spent.append(1e6 * (time.perf_counter() - begin))
        print(f"{label:>56}{np.median(spent):>10.0f}{np.percentile(spent, 99):>10.0f}")


def main() -> None:
    """Print both tables for one robot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robot")
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--speed", type=float, default=0.3, help="share of the velocity limits")
    arguments = parser.parse_args()
    robot = Robot.load(arguments.robot)
    motion = PlannedMotion(robot)
    compare(robot, motion, arguments.scenes, arguments.speed)
    measure(robot, motion, arguments.speed)


if __name__ == "__main__":
    main()
