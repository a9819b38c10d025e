"""Rules that say, tick by tick, whether an arm must stop: side by side, on the same scene.

Each is put together from the library's motion models and the kernels that prove an interval free.
All of them evaluate every pair in every tick, descend each link's tree of spheres no further than
it takes, and reckon with refused samples as well as accepted ones.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from armguard.bounds import (
    BrakingMotion,
    IsotropicMotion,
    JointMotion,
    Plan,
    PlannedMotion,
    ReachMotion,
    Refusal,
    append_stop,
    check_plan,
    table_contact_time,
)
from armguard.contact.advancement import row_contact_time
from armguard.jit import kernel, pack
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.obstacles.possible_states import is_known, possible_states, state_at
from armguard.pairs import SeparationRule
from armguard.pairs.scene import thread_tree
from armguard.pairs.separation_margin import SeparationMargin
from armguard.robot import Kinematics, Robot
from armguard.robot.stop_time import compute_stop_time
from armguard.verdict import Level

ADVANCES = 8
ROUNDING = 1e-11
PLAN_STEP = 0.01
TRACKING_ERROR, VELOCITY_TRACKING_ERROR = 1e-3, 0.01


class Timing(NamedTuple):
    """What passes between a tick and braking torque, in [s]."""

    period: float
    latency: float
    reaction: float

    @property
    def horizon(self) -> float:
        """Until the verdict after this one is obeyed."""
        return self.period + self.latency


class Spheres(NamedTuple):
    """The arm's spheres as free bodies, and what their bounds in joint space rest on."""

    centers: Any
    velocities: Any
    accel: Any
    speed: Any
    position_error: Any
    velocity_error: Any
    lever: Any
    slope_error: Any
    jacobian: Any
    balls: Any


class Parts(NamedTuple):
    """One scene for compiled code."""

    tree: Any
    arm: Any
    bodies: Any
    refused: Any
    marks: Any


class Scene:
    """An arm among obstacles, at one tick.

    Args:
        robot: The arm.
        timing: Of its monitor.

    Attributes:
        worker: The `WorkingArm` that is judged.
        q: Its joint positions. Shape (nv,).
        v: Its joint velocities. Shape (nv,).
        now: In [s].
    """

    arm_age = 0.0

    def __init__(self, robot: Robot, timing: Timing) -> None:
        self.robot, self.timing = robot, timing
        self.kinematics = Kinematics(robot)
        self.isotropic = IsotropicMotion(robot)
        self._joint = JointMotion(robot)
        self._reach = ReachMotion(robot)
        self.tree = thread_tree(self.kinematics.spheres)
        self.worker: Any = None
        self.v = np.zeros(len(robot.joints))
        self.q = np.clip(self.v, robot.lower_position_limit, robot.upper_position_limit)
        self.now = 0.0
        self.watch(Obstacles())

    def watch(self, obstacles: Obstacles) -> None:
        """Read another table from now on."""
        self.obstacles = obstacles
        self.parts: Parts | None = None
        self.view()

    def view(self) -> None:
        """Take the table's arrays, which are replaced when it grows."""
        table = self.obstacles.table
        if self.parts is not None and self.parts.bodies is table.accepted:
            return
        motion = self.isotropic
        arm = Spheres(
            self.kinematics.centers, self.kinematics.velocities, motion.accel, motion.speed,
            motion.position_error, motion.velocity_error, self._joint.lever,
            self._joint.slope_error, self.kinematics.data.J, self._reach.link_balls,
        )  # fmt: skip
        self.parts = Parts(self.tree, arm, table.accepted, table.refused_states, table.marks)
        self.handle = pack(self.parts)

    def place(self, worker: Any, now: float) -> None:
        """Place the arm for a tick."""
        self.worker, self.q, self.v, self.now = worker, worker.q, worker.v, now
        self.kinematics.compute(self.q, self.v)
        self.isotropic.update(self.v)
        self.view()

    def stop_time(self) -> float:
        """In which every joint surely rests, in [s] from now."""
        robot, timing = self.robot, self.timing
        return compute_stop_time(
            self.v, robot.velocity_error, robot.velocity_limit, robot.acceleration_limit,
            robot.brakes.make_curves(), 0.0, timing.horizon, timing.reaction,
            robot.acceleration_limit,
        )  # fmt: skip


class Rule:
    """What says whether an arm may go on.

    Attributes:
        name: For tables.
        delay: From a STOP to braking torque, in [s].
        holds: Whether its STOPs last until it believes that they are over.
    """

    name = ""
    holds = False

    def __init__(self, scene: Scene) -> None:
        self.delay = scene.timing.latency + scene.timing.reaction

    def begin(self, scene: Scene) -> None:
        """Start anew, with the table that the scene watches now."""

    def judge(self, scene: Scene) -> bool:
        """Whether the arm may go on."""
        raise NotImplementedError


class IsotropicRule(Rule):
    """No sphere, as a free body, could touch anything before the arm rests."""

    name = "isotropic"

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._table = JointMotion(scene.robot).tabulate(scene.q, scene.v, 0.0)

    def judge(self, scene: Scene) -> bool:
        """Whether the arm may go on."""
        limit = scene.stop_time()
        return is_free(scene.handle, self._table, scene.now, limit, False, True, False)


class JointRule(Rule):
    """The same with all bounds on a moving arm: reach, isotropic and joint."""

    name = "joint, reach"

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._motion = JointMotion(scene.robot)

    def judge(self, scene: Scene) -> bool:
        """Whether the arm may go on."""
        table = self._motion.tabulate(scene.q, scene.v, 0.0)
        return is_free(scene.handle, table, scene.now, scene.stop_time(), True, True, True)


class BrakingRule(Rule):
    """No contact could come before the arm rests, if it braked only after the next tick."""

    name = "braking"

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self._motion = BrakingMotion(scene.robot, scene.timing.reaction)

    def judge(self, scene: Scene) -> bool:
        """Whether the arm may go on."""
        table = self._motion.tabulate(scene.q, scene.v, 0.0, scene.timing.horizon)
        rest = table.time[-1] * (1.0 - ROUNDING)
        return is_free(scene.handle, table, scene.now, rest, True, False, True)


class PlannedRule(Rule):
    """No contact could come before the arm rests, if it did its next piece and its own stop.

    In every tick the controller shows what it will do for the time of one piece. Once a piece is
    accepted the arm is committed to it: after a refusal it goes on to the end of the last piece
    that was accepted, and brakes there.
    """

    def __init__(self, scene: Scene, piece: float) -> None:
        super().__init__(scene)
        timing = scene.timing
        if not piece >= timing.horizon:
            raise ValueError(f"a piece of {piece} s ends before the next verdict is obeyed")
        self.name = f"planned, {1e3 * piece:.0f} ms"
        self.delay = piece - timing.period + timing.reaction
        self._motion = PlannedMotion(scene.robot)
        self._times = np.linspace(0.0, piece, max(2, math.ceil(piece / PLAN_STEP) + 1))
        self._links = np.arange(len(scene.robot.links))

    def judge(self, scene: Scene) -> bool:
        """Whether the next piece is safe to commit."""
        worker, joints = scene.worker, len(scene.q)
        if worker.braking and not worker.rests:
            return False
        q, v = worker.preview(self._times)
        lead = scene.timing.latency if worker.braking else 0.0
        plan = Plan(
            scene.now + lead, self._times, q, v, np.full(joints, TRACKING_ERROR),
            np.full(joints, VELOCITY_TRACKING_ERROR),
        )  # fmt: skip
        plan = append_stop(plan, scene.robot.braking_deceleration, on_path=False)
        checked = check_plan(plan, scene.robot, scene.now, scene.q, scene.v, scene.now)
        if isinstance(checked, Refusal):
            return False
        course = self._motion.lay_out(checked)
        _, _, bodies, refused, marks = scene.parts
        rows = np.flatnonzero(marks.alive)
        pairs = (rows[:, None] * len(self._links) + self._links).ravel()
        found = self._motion.contact_time(course, pairs, scene.now, 0.0, bodies, refused, marks)
        return found.time == math.inf


class SeparationStop(Rule):
    """The distance is above the protective separation distance."""

    def __init__(self, scene: Scene, intrusion_distance: float) -> None:
        super().__init__(scene)
        self.name = "separation"
        if intrusion_distance > 0.0:
            self.name += f", C {intrusion_distance:g} m"
        rule = SeparationRule(intrusion_distance=intrusion_distance)
        self._margin = SeparationMargin(rule, scene.timing.horizon + scene.timing.reaction)

    def judge(self, scene: Scene) -> bool:
        """Whether the arm may go on."""
        return self._margin.margin(scene, scene.stop_time()) >= 0.0


class MonitorRule(Rule):
    """The monitor as users have it, whatever its STOP is for."""

    name = "the monitor"
    holds = True

    def begin(self, scene: Scene) -> None:
        """Start anew, with the table that the scene watches now."""
        timing = scene.timing
        self._monitor = Monitor(
            scene.robot,
            scene.obstacles,
            rate=1.0 / timing.period,
            latency=timing.latency,
            reaction_time=timing.reaction,
        )

    def judge(self, scene: Scene) -> bool:
        """Whether the arm may go on."""
        return self._monitor.step(scene.now, scene.q, scene.v).level is not Level.STOP


@kernel
def is_free(handle, table, now, limit, by_reach, as_free, by_table):  # type: ignore[no-untyped-def]
    """Whether no sphere and no body could touch before `limit`, by any of the models named."""
    parts = handle.content
    tree, arm, marks = parts.tree, parts.arm, parts.marks
    for row in range(marks.alive.shape[0]):
        if not marks.alive[row]:
            continue
        if not is_known(marks, row):
            return False
        for number in possible_states(marks, row):
            bodies, place, age = state_at(parts.bodies, parts.refused, marks, row, number, now)
            points, paces = bodies.points[place], bodies.velocities[place]
            count = bodies.point_count
            accel, speed = bodies.accel[place], bodies.speed[place]
            error, size = bodies.velocity_error[place], bodies.radius[place]
            size += bodies.position_error[place]
            for link in range(tree.root.shape[0]):
                if by_reach:
                    ball = arm.balls[link]
                    time = row_contact_time(
                        ball[0], ball[1], ball[2], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
                        bodies.points, bodies.velocities, place, count[place], accel, speed, error,
                        age, (ball[3] + size) * (1.0 + ROUNDING), ADVANCES,
                    )  # fmt: skip
                    if time >= limit:
                        continue
                node = tree.root[link]
                while node >= 0:
                    x, y, z = arm.centers[node]
                    distance = tree.radius[node] + arm.position_error[node] + size
                    distance *= 1.0 + ROUNDING
                    time = 0.0
                    if as_free:
                        ux, uy, uz = arm.velocities[node]
                        time = row_contact_time(
                            x, y, z, ux, uy, uz, arm.accel[node], arm.speed[node],
                            arm.velocity_error[node], 0.0, bodies.points, bodies.velocities, place,
                            count[place], accel, speed, error, age, distance, ADVANCES,
                        )  # fmt: skip
                    if by_table and not time >= limit:
                        time = table_contact_time(
                            x, y, z, arm.jacobian, arm.lever[node], arm.slope_error[node], table,
                            points, paces, count[place], accel, speed, error, age, distance, 0.0,
                        )  # fmt: skip
                    if time >= limit:
                        node = tree.skip[node]
                    elif tree.first_child[node] >= 0:
                        node = tree.first_child[node]
                    else:
                        return False
    return True
