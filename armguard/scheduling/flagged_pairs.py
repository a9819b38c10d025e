"""The exact check of flagged pairs: those that could come too near before their next visit.

It uses the link's true geometry instead of its spheres, and speed bounds only: coarser in time, but
a whole link costs one distance. The bound holds for every point of the link, also where a sphere's
centre stands still while the link turns inside it.
"""

from __future__ import annotations

import math

from armguard.bounds.isotropic import IsotropicMotion
from armguard.obstacles.possible_states import list_states
from armguard.obstacles.table import States
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
        state = self._state
        states = list_states(state.bodies, state.refused_bodies, state.marks, row, state.now)
        return min((self._state_time(link, *each) for each in states), default=0.0)

    def _state_time(self, link: int, bodies: States, place: int, age: float) -> float:
        """The same for one state of the obstacle."""
        state, motion = self._state, self._motion
        count = int(bodies.point_count[place])
        radius = float(bodies.radius[place])
        distance, _, _ = self._exact.distance(link, bodies.points[place, :count], radius)
        measured = max(math.hypot(*velocity) for velocity in bodies.velocities[place, :count])
        speed = max(float(bodies.speed[place]), measured + float(bodies.velocity_error[place]))
        arm_speed = float(motion.surface_speed[link])
        grown = arm_speed * abs(state.arm_age)
        if age != 0.0:
            grown += speed * abs(float(age))
        errors = float(bodies.position_error[place]) + float(motion.surface_position_error[link])
        gap = float(distance) - state.scene.settings.margin - errors - grown
        if not gap > 0.0:
            return 0.0
        return gap / (speed + arm_speed) if speed + arm_speed > 0.0 else math.inf
