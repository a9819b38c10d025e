"""What takes part in `bench_schedules.py`: armguard, the sweeps, and what users pick today.

All are shown the same balls and joint states. What each is asked differs: contact times by armguard
and the sweeps; distances by Pinocchio and MuJoCo, whose least over the speed bounds is a time too;
and by the broad phases only whether anything is so near that the arm might not stop in time, which
in a scene that is GO it is not.

Where a package is missing or this armguard lacks a name, `UnavailableError` says so.
"""

from __future__ import annotations

import math

import numpy as np

from armguard.bounds import IsotropicMotion, ReachMotion
from armguard.exceptions import ArmguardError
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot import Kinematics
from armguard.verdict import Level
from scene import crowds, sweeps
from scene.crowds import Answer, UnavailableError
from scene.engines import CoalBroadPhase, MujocoContacts, MujocoDistances, PinocchioDistances


class Watch:
    """armguard's monitor with one schedule and one motion model."""

    def __init__(self, work: crowds.Work, count: int, schedule: str, motion: str) -> None:
        self._obstacles = Obstacles()
        try:
            self._monitor = Monitor(
                work.robot, self._obstacles, rate=crowds.RATE, schedule=schedule, motion=motion
            )
        except ArmguardError as error:
            raise UnavailableError(str(error)) from None

    def update(self, rows: slice, names, stamp: float, position, velocity) -> None:
        """Publish measurements to the obstacle table."""
        crowds.publish(self._obstacles, names, stamp, position, velocity)

    def step(self, stamp: float, q, v, stop_time: float) -> None:
        """One tick."""
        self._verdict = self._monitor.step(stamp, q, v)

    def read(self) -> Answer:
        """The verdict."""
        verdict = self._verdict
        return Answer(verdict.contact_time, verdict.evaluated, verdict.level > Level.STOP)


class Sweep:
    """One of the sweeps, over obstacles that keep their places.

    Those over bounds and by reach see each link as its enclosing ball, the root of its tree; that
    over spheres is the one over bounds with all leaves of the cover, the finest spheres that there
    are, in place of these balls.
    """

    def __init__(self, work: crowds.Work, count: int, rung: str) -> None:
        robot = work.robot
        self._sweep = sweeps.SWEEPS[rung]
        self._kinematics = Kinematics(robot)
        spheres, placement = self._kinematics.spheres, self._kinematics.placement
        chosen = np.flatnonzero(spheres.child_count == 0) if rung == "spheres" else spheres.root
        motion, reach = IsotropicMotion(robot), ReachMotion(robot)
        rate, floor = motion.velocity_errors.rate[chosen], motion.velocity_errors.at_rest[chosen]
        joint_count, joint = len(robot.joints), spheres.joint[chosen]
        self._links = np.zeros((sweeps.RATE + 2 * joint_count, len(chosen)))
        self._links[sweeps.LSIZE] = (spheres.radius + motion.position_error)[chosen]
        self._links[sweeps.LACCEL] = motion.accel[chosen]
        self._links[sweeps.LSPEED] = motion.speed[chosen]
        self._links[sweeps.LOCAL : sweeps.LOCAL + 3] = spheres.local[chosen].T
        self._links[sweeps.JOINT], self._links[sweeps.FLOOR] = joint, floor
        self._links[sweeps.RATE : sweeps.RATE + joint_count] = rate.T
        self._links[sweeps.RATE + joint_count :] = placement.moves[joint].T
        self._reach = np.zeros((10, len(reach.link_balls) + 1))
        still = np.vstack([reach.link_balls, reach.arm_ball])
        self._reach[[sweeps.LX, sweeps.LY, sweeps.LZ, sweeps.LSIZE]] = still.T
        self._bodies = np.zeros((11, count))
        single = rung == "reach32"
        kept = count if rung in ("reach", "reach32") else 0
        self._near = np.zeros((6, kept), dtype=np.float32 if single else np.float64)
        self._answer = np.zeros(6)
        self._answer[sweeps.WIDEN] = sweeps.ROOM_SINGLE if single else sweeps.ROOM
        self._arrays = placement.rotation, placement.translation, placement.jacobian.T
        self._room = np.ones((6, sweeps.BLOCK))

    def update(self, rows: slice, names, stamp: float, position, velocity) -> None:
        """Write measurements to the sweep's arrays."""
        sweeps.take_measurements(
            self._bodies, self._near, rows.start, stamp, position, velocity,
            crowds.RADIUS, crowds.ACCEL, crowds.SPEED, self._answer,
        )  # fmt: skip

    def step(self, stamp: float, q, v, stop_time: float) -> None:
        """One sweep."""
        self._kinematics.place(q)
        self._sweep(
            *self._arrays, v, self._links, self._reach, self._bodies, self._near, self._room,
            self._answer, stamp,
        )  # fmt: skip
        self._stop_time = stop_time

    def read(self) -> Answer:
        """Its earliest contact."""
        time, spent = self._answer[sweeps.TIME], self._answer[sweeps.SPENT]
        return Answer(float(time), float(spent), bool(time > self._stop_time))


# Name, what it is asked, the most obstacles that it is asked about unless told otherwise (beyond
# that a tick or the making of it takes seconds or minutes), and how it is made.
CONTESTANTS = (
    ("deadline, joint", "contact times", math.inf, Watch, ("deadline", "joint")),
    ("deadline, isotropic", "contact times", math.inf, Watch, ("deadline", "isotropic")),
    ("daa, joint", "contact times", 10_000, Watch, ("daa", "joint")),
    ("daa, isotropic", "contact times", 10_000, Watch, ("daa", "isotropic")),
    ("full, joint", "contact times", 10_000, Watch, ("full", "joint")),
    ("full, isotropic", "contact times", math.inf, Watch, ("full", "isotropic")),
    ("sweep, spheres", "contact times", math.inf, Sweep, ("spheres",)),
    ("sweep, bounds", "contact times", math.inf, Sweep, ("bounds",)),
    ("sweep, reach", "contact times", math.inf, Sweep, ("reach",)),
    ("sweep, reach32", "contact times", math.inf, Sweep, ("reach32",)),
    ("Pinocchio, meshes", "distances", 1_000, PinocchioDistances, (False,)),
    ("Pinocchio, hulls", "distances", 1_000, PinocchioDistances, (True,)),
    ("Coal, broad phase", "anything too near?", math.inf, CoalBroadPhase, ()),
    ("MuJoCo, distances", "distances", 10_000, MujocoDistances, ()),
    ("MuJoCo, contacts", "anything too near?", 10_000, MujocoContacts, ()),
)
