"""The watched arm for the evaluation of pairs: placement, bounds, and arrays for compiled code."""

from __future__ import annotations

import copy
import functools
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from armguard.bounds.arm import ArmMotion
from armguard.jit.arrays import FloatArray
from armguard.obstacles.obstacles import Obstacles
from armguard.obstacles.regions import RegionLimits
from armguard.pairs.evaluate import TickState
from armguard.pairs.exemptions import Exemptions
from armguard.pairs.ignored import IgnoredPairs
from armguard.robot.kinematics import Kinematics
from armguard.robot.operating_limits import LimitsInForce
from armguard.robot.robot import Robot
from armguard.settings.settings import Settings

if TYPE_CHECKING:
    from armguard.contact.earliest import Certificate
    from armguard.pairs.hull_distance import HullDistance


class WatchedArm:
    """Kinematics, motion models, hull distances and the tick's numbers of one arm.

    Args:
        robot: The arm.
        obstacles: The table.
        ignored: Pairs that are not watched.
        settings: Where the arm stands, and which bounds count.
        in_force: The limits and brakes in force, shared; None: the robot's limits.
        exemptions: Pairs that are not watched for the time being; None: there are none.

    Attributes:
        links: Names of the links, as of the revision below.
        revision: Of the robot.
    """

    def __init__(
        self,
        robot: Robot,
        obstacles: Obstacles,
        ignored: IgnoredPairs,
        settings: Settings,
        in_force: LimitsInForce | None = None,
        exemptions: Exemptions | None = None,
    ) -> None:
        # What is attached meanwhile, in another thread, does not reach the copy.
        self._robot = robot = copy.copy(robot)
        self.revision = robot.revision
        self.links = robot.links
        self.obstacles = obstacles
        self._ignored = ignored
        self._exemptions = exemptions
        self.kinematics = Kinematics(robot, settings.base_placement)
        self.motion = ArmMotion(
            robot,
            settings.reaction_time,
            settings.base_placement,
            with_joints=settings.with_joints,
            with_plans=settings.with_plans,
            in_force=in_force,
            with_velocities=settings.permits_contact,
        )
        self.state = TickState(
            self.kinematics,
            self.motion,
            obstacles,
            margin=settings.margin,
            contact_limits=RegionLimits(*settings.tabulate_contact_limits()),
        )
        # Compiled now: joints beyond their limits must not wait for it in their tick.
        self.follow_limits(np.zeros(len(robot.joints)))

    @functools.cached_property
    def hull_distance(self) -> HullDistance:
        """Distances of its links' true geometry; made for those who ask for closest points."""
        from armguard.pairs.hull_distance import HullDistance

        return HullDistance(self._robot, self.kinematics)

    def fits(self, robot: Robot) -> bool:
        """Whether it was laid out for all links that a robot has now, in order, and as they are."""
        own = self._robot
        return own.links == robot.links and all(
            own.joint_index(link) == robot.joint_index(link)
            and _is_same(own.triangles(link), robot.triangles(link))
            and _is_same(own.surface(link), robot.surface(link))
            and all(map(np.array_equal, own.cover.tree(link), robot.cover.tree(link)))
            for link in own.links
        )

    def take_over(self, robot: Robot) -> None:
        """Begin to be the arm, laid out some time ago for what the robot is now."""
        self.revision = robot.revision
        self.state.view_table()
        self.state.sphere_time.fill(np.inf)
        # Others may be in force by now.
        self.follow_limits(np.zeros(len(robot.joints)))

    def follow_limits(self, v: NDArray[np.float64]) -> bool:
        """Widen the bounds if joints are measured faster than the limits in force, (nv,).

        Returns:
            Whether a bound grew, so that nothing that was proved before holds.
        """
        return self.motion.isotropic.update(v)

    def watched_links(self, row: int) -> NDArray[np.bool_]:
        """Which links are watched against the obstacle in `row`. Shape (links,)."""
        obstacles, exemptions = self.obstacles, self._exemptions
        name, source = obstacles.ids[row], obstacles.source_of(row)
        watched = self._ignored.watched_links(name, source, self.links)
        return watched if exemptions is None else exemptions.leave_out(row, watched, self.links)

    def names(self, pair: int) -> tuple[str, str]:
        """Of the link and the obstacle of a pair, row × links + link."""
        row, link = divmod(pair, len(self.links))
        return self.links[link], self.obstacles.ids[row]

    def prove(self, pair: int, sphere: int) -> tuple[Certificate, dict[str, Any]] | None:
        """A certificate of one pair in this tick and what it is about; see `prove_pair`."""
        from armguard.pairs.proof import prove_pair

        return prove_pair(self.state, sphere, pair // len(self.links))


def _is_same(one: FloatArray, other: FloatArray) -> bool:
    """Whether two arrays are one, or equal: a body that came out of a pickle is another object."""
    return one is other or np.array_equal(one, other)
