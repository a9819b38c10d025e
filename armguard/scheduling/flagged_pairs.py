"""The exact check of flagged pairs: those that could come too near before their next visit.

It uses the link's true geometry instead of its spheres, and speed bounds only: coarser in time, but
a whole link costs one distance. The bound holds for every point of the link, also where a sphere's
centre stands still while the link turns inside it.
"""

from __future__ import annotations

import math

from armguard.bounds.isotropic import IsotropicMotion
from armguard.pairs.evaluate import TickState
from armguard.pairs.hull_distance import HullDistance


class FlaggedCheck:
    """Contact times of single pairs from true distance and fastest closing speed.

    Args:
        exact: Measures the links where they are.
        motion: Whose bounds on the links' surfaces are read.
        state: The tick's numbers.
    """

    def __init__(self, exact: HullDistance, motion: IsotropicMotion, state: TickState) -> None:
        self._exact = exact
        self._motion = motion
        self._state = state

    def contact_time(self, row: int, link: int) -> float:
        """Time from now in [s] before which there is no contact; 0 where that is unknown.

        Args:
            row: Of the obstacle in its table.
            link: Index in `robot.links`.
        """
        state, motion, marks = self._state, self._motion, self._state.marks
        if not marks.has_state[row] or marks.refused[row]:
            return 0.0
        bodies = state.bodies
        count = int(bodies.point_count[row])
        radius = float(bodies.radius[row])
        distance, _, _ = self._exact.distance(link, bodies.points[row, :count], radius)
        measured = max(math.hypot(*velocity) for velocity in bodies.velocities[row, :count])
        speed = max(float(bodies.speed[row]), measured + float(bodies.velocity_error[row]))
        arm_speed = float(motion.surface_speed[link])
        age = 0.0 if marks.static[row] else abs(state.now - float(bodies.stamp[row]))
        grown = arm_speed * abs(state.arm_age)
        if age > 0.0:
            grown += speed * age
        errors = float(bodies.position_error[row]) + float(motion.surface_position_error[link])
        gap = float(distance) - state.scene.settings.margin - errors - grown
        if not gap > 0.0:
            return 0.0
        return gap / (speed + arm_speed) if speed + arm_speed > 0.0 else math.inf
