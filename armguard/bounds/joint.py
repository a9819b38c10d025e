"""What joint limits allow: every joint anywhere within its own bounds, all at once."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pinocchio

from armguard.bounds.joint_box import JointTable
from armguard.bounds.joint_space import JointSpaceMotion
from armguard.exceptions import ArmguardError
from armguard.robot.robot import Robot

Floats = npt.NDArray[np.float64]

SLICES = 32
"""Steps of the table unless asked for others."""

END = 1.024
"""When the table ends, in [s] from now: by then an arm can be anywhere."""


class JointMotion(JointSpaceMotion):
    """Each joint moves freely within its position, velocity and acceleration limits.

    A tick fills one table for the whole arm, which `armguard.bounds.table_contact_time` turns
    into contact times for any number of pairs of sphere and obstacle.
    """

    interpolates = True

    def __init__(
        self,
        robot: Robot,
        base_placement: pinocchio.SE3 | None = None,
        *,
        slices: int = SLICES,
    ) -> None:
        """Compute the levers of all spheres.

        Args:
            robot: The arm.
            base_placement: Placement of the robot's base in the world; None: they coincide.
            slices: Steps of the table in time, at least 1: what is free of contact is proved step
                by step, so more of them see later contacts and take longer; any number is safe.

        Raises:
            ArmguardError: A limit of the robot is missing or unusable, or `slices` is no whole
                number above 0.
        """
        if isinstance(slices, bool) or not isinstance(slices, int) or not slices >= 1:
            raise ArmguardError("slices", f"is {slices!r}", expected="a whole number, at least 1")
        super().__init__(robot, base_placement)
        # Dense where displacements grow like t².
        self.table = self._make_table(END * (np.arange(slices + 1) / slices) ** 2.0)

    def tabulate(self, q: Floats, v: Floats, age: float) -> JointTable:
        """Fill the table of one tick.

        Args:
            q: Measured joint positions, in [rad] or [m]. Shape (nv,), float64.
            v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,), float64.
            age: Now minus the stamp of the state, in [s]; negative where that is newer.

        Returns:
            The table; always the same one, filled anew.

        Raises:
            ArmguardError: A vector has the wrong length, the state is not finite or beyond its
                limits by more than its errors, or the age is not finite.
        """
        self._check_tick(q, v, age)
        self._fill(q, v, age, np.inf, self.table)
        return self.table

    def _free_time(self) -> float:
        return np.inf
