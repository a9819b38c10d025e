"""Limits of an arm from its URDF, and default values for missing ones.

What is usual is DERIVED where the model file's efforts and inertias allow it, and CHOSEN otherwise,
as in the robots that armguard knows; the source in robot.toml begins with that word.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio

from armguard.exceptions import RobotError
from armguard.jit.arrays import FloatArray
from armguard.lab.new_robot.questions import Figure, Range
from armguard.robot.description import LimitSources, LockedJoint, RobotDescription
from armguard.robot.efforts import (
    HARDER,
    HELD,
    compute_accelerations,
    compute_supported_shares,
    round_down,
    round_up,
)
from armguard.robot.joints import is_prismatic, reduce_model
from armguard.robot.urdf import UrdfModel

SAMPLES = 5000
"""Number of configurations in which efforts are computed: this takes about a second."""

SLOW = 0.3
"""Share of the velocity limits at which decelerations are derived from efforts."""

MOST_SHARE = 5.0
"""Greatest derived deceleration, as a share of the velocity limit, in [1/s]: a stop takes at least
0.2 s."""

TURN_RANGE = (-2.0 * math.pi, 2.0 * math.pi)
TURN_SPEED, SLIDE_SPEED = math.pi, 2.0
RISE_TIME, REST_TIME = 0.02, 0.65
TURN_ACCELERATION, SLIDE_ACCELERATION = 5.0, 1.0
LOAD = 1.0

POSITION_CHOSEN = "CHOSEN: two turns either way; the model file has no position limits"
TURN_SPEED_CHOSEN = (
    "CHOSEN: 180 °/s, the speed of many such arms; the model file has no velocity limit"
)
SLIDE_SPEED_CHOSEN = "CHOSEN: 2 m/s; the model file has no velocity limit"
ACCELERATION_DERIVED = (
    "DERIVED, not published: largest acceleration that the model file's effort limits allow with "
    "the links alone, over the workspace, and a quarter more"
)
ACCELERATION_CHOSEN = (
    "CHOSEN: full speed within 20 ms, several times the known decelerations of arms; the model "
    "file's efforts "
)
HIDDEN, LESS = "and inertias do not determine it", "would allow less"
"""Why: its last words."""

BRAKES_CHOSEN = (
    "CHOSEN: at rest from full speed within 0.65 s, the longest stop of a whole arm in the "
    "UR10/CB3 user manual; the model file's efforts and inertias do not determine it"
)
LOAD_CHOSEN = "CHOSEN: 1 kg at the tool"
ERROR_CHOSEN = "CHOSEN: armguard's default; the model file states no measurement error of joints"
WORK_SPEED_CHOSEN = "CHOSEN: the velocity limits"
WORK_ACCELERATION_CHOSEN = (
    "CHOSEN: 5 rad/s², the limit in Universal Robots' MoveIt configuration, or 1 m/s²"
)


class JointFacts:
    """Data in a URDF about the watched joints.

    Args:
        urdf: The whole robot.
        watched: Names of the joints that are watched.
        locked: Positions or ranges of the other joints.
        origin: Name of the model file in source texts.

    Attributes:
        joints: The watched joints, in model order.
        model: `pinocchio.Model` reduced to them.
        turning: The revolute ones; the others are prismatic.
        continuous: Those without a range.
        positions: Of those with a usable range in the model file.
        velocities: Of those with a usable limit in the model file.

    Raises:
        RobotError: A joint neither turns nor slides.
    """

    def __init__(
        self,
        urdf: UrdfModel,
        watched: Sequence[str],
        locked: Mapping[str, LockedJoint],
        origin: str,
    ) -> None:
        self.joints = [str(name) for name in urdf.model.names[1:] if name in watched]
        others = [str(name) for name in urdf.model.names[1:] if name not in watched]
        nothing = RobotDescription(sources=LimitSources(), joints={}, locked=dict(locked))
        self.model, _ = reduce_model(urdf, nothing, others)
        self.turning = [
            joint
            for joint in self.joints
            if not is_prismatic(self.model, self.model.getJointId(joint))
        ]
        self.continuous = [joint for joint in self.joints if joint in urdf.continuous]
        self.positions: dict[str, Figure[Range]] = {}
        self.velocities: dict[str, Figure[float]] = {}
        self._no_ranges: dict[str, Range] = {}
        for i, joint in enumerate(self.joints):
            lower, upper = (
                float(limit[i])
                for limit in (self.model.lowerPositionLimit, self.model.upperPositionLimit)
            )
            if -math.inf < lower < upper < math.inf:
                self.positions[joint] = Figure((lower, upper), origin)
            elif joint not in self.continuous and not lower == upper == 0.0:
                self._no_ranges[joint] = lower, upper
            velocity = float(self.model.velocityLimit[i])
            if velocity > 0.0:
                self.velocities[joint] = Figure(velocity, origin)

    def refuse_ranges(self, given: Sequence[str]) -> None:
        """Refuse unusable ranges of the model file whose joint no `--position` names.

        Raises:
            RobotError: There is one.
        """
        said = [item.rpartition("=")[0] for item in given]
        for joint, (lower, upper) in self._no_ranges.items():
            if joint not in said:
                raise RobotError(
                    f"joint {joint!r}",
                    f"has position = [{lower:g}, {upper:g}] in the model file",
                    remedy=f"correct it there, or give --position {joint}=LOWER:UPPER",
                )

    @property
    def usual_positions(self) -> dict[str, Figure[Range]]:
        """Of joints that turn."""
        return dict.fromkeys(self.turning, Figure(TURN_RANGE, POSITION_CHOSEN))

    @property
    def usual_velocities(self) -> dict[str, Figure[float]]:
        """Of all joints, in [rad/s] or [m/s]."""
        turn = Figure(TURN_SPEED, TURN_SPEED_CHOSEN)
        slide = Figure(SLIDE_SPEED, SLIDE_SPEED_CHOSEN)
        return {joint: turn if joint in self.turning else slide for joint in self.joints}

    def put(
        self, positions: Mapping[str, Figure[Range]], velocities: Mapping[str, Figure[float]]
    ) -> None:
        """Give the model these limits, on which the other default values depend."""
        ranges = [
            positions[joint].value if joint in positions else (-math.inf, math.inf)
            for joint in self.joints
        ]
        self.model.lowerPositionLimit = np.array([lower for lower, _ in ranges])
        self.model.upperPositionLimit = np.array([upper for _, upper in ranges])
        self.model.velocityLimit = np.array([velocities[joint].value for joint in self.joints])

    def derive_accelerations(self) -> dict[str, Figure[float]]:
        """Default values, in [rad/s²] or [m/s²], derived where efforts and inertias determine them.

        Efforts that cannot hold the links are not those of this arm and are ignored. Brakes can be
        stronger than weak motors, so the value chosen without efforts is the minimum.
        """
        speeds = self.model.velocityLimit
        chosen = {
            joint: Figure(round_up(speeds[i] / RISE_TIME), ACCELERATION_CHOSEN + HIDDEN)
            for i, joint in enumerate(self.joints)
        }
        if not (self._has_efforts and self._find_least_share(0.0) > 0.0):
            return chosen
        found = compute_accelerations(self.model, SAMPLES)
        figures = {}
        for joint, value in zip(self.joints, found.tolist(), strict=True):
            least = chosen[joint]
            if not 0.0 < value < math.inf:
                figures[joint] = least
            elif (derived := round_up(HARDER * value)) >= least.value:
                figures[joint] = Figure(derived, ACCELERATION_DERIVED)
            else:
                figures[joint] = Figure(least.value, ACCELERATION_CHOSEN + LESS)
        return figures

    def derive_decelerations(
        self, load: float, accelerations: Mapping[str, Figure[float]]
    ) -> dict[str, Figure[float]]:
        """Default values with a load in [kg], in [rad/s²] or [m/s²]; one share for all joints."""
        speeds: FloatArray = self.model.velocityLimit
        share, source = 1.0 / REST_TIME, BRAKES_CHOSEN
        if self._has_efforts:
            least = HELD * self._find_least_share(load)
            if math.isfinite(least) and least > 0.0:
                share = min(least, MOST_SHARE)
                taken = "half of it" if share == least else f"no more than {MOST_SHARE:g}"
                source = (
                    f"DERIVED: the model file's effort limits support {least / HELD:.3f} of the "
                    f"velocity limits per second with {load:g} kg in the frame of the last joint "
                    f"at up to {100.0 * SLOW:g} % speed, and armguard uses {taken}; CHOSEN to hold "
                    f"up to full speed as well"
                )
        return {
            joint: Figure(min(round_down(share * float(speed)), accelerations[joint].value), source)
            for joint, speed in zip(self.joints, speeds, strict=True)
        }

    def choose_work_accelerations(
        self, accelerations: Mapping[str, Figure[float]]
    ) -> dict[str, Figure[float]]:
        """What controllers usually keep to, in [rad/s²] or [m/s²]; never above the limits."""
        return {
            joint: Figure(
                min(
                    TURN_ACCELERATION if joint in self.turning else SLIDE_ACCELERATION,
                    accelerations[joint].value,
                ),
                WORK_ACCELERATION_CHOSEN,
            )
            for joint in self.joints
        }

    def _find_least_share(self, load: float) -> float:
        """Share of the velocity limits that efforts brake per second with a load in [kg]."""
        speeds: FloatArray = self.model.velocityLimit
        shares = compute_supported_shares(
            self.model, speeds, load, np.zeros(3), SLOW * speeds, SAMPLES
        )
        return float(np.min(shares))

    @property
    def _has_efforts(self) -> bool:
        """Whether the model file states effort limits and inertias."""
        efforts = self.model.effortLimit
        masses = [inertia.mass for inertia in self.model.inertias[1:]]
        usable = bool(((efforts > 0.0) & (efforts < np.inf)).all())
        return usable and all(0.0 < mass < math.inf for mass in masses)


def find_coupled(urdf: UrdfModel, watched: Sequence[str]) -> tuple[list[str], list[str]]:
    """Unwatched joints that carry a watched joint, or that a watched joint carries."""
    model: Any = urdf.model
    numbers = {model.getJointId(joint) for joint in watched}
    carriers = {ancestor for joint in numbers for ancestor in model.supports[joint]}
    names = [str(name) for name in model.names[1:] if name not in watched]
    carrying = [name for name in names if model.getJointId(name) in carriers]
    carried = [name for name in names if numbers & set(model.supports[model.getJointId(name)])]
    return carrying, [name for name in carried if name not in carrying]


def find_bare(urdf: UrdfModel, watched: Sequence[str]) -> list[str]:
    """Links with visual but no collision geometry that a watched joint moves."""
    model: Any = urdf.model
    moving = {model.getJointId(joint) for joint in watched}
    bare = []
    for link in urdf.bare:
        frame = model.frames[model.getFrameId(link, pinocchio.FrameType.BODY)]
        if moving & set(model.supports[frame.parentJoint]):
            bare.append(link)
    return bare


def find_travel(urdf: UrdfModel, joint: str) -> Range | None:
    """The range in which a joint can be anywhere; None where no cover can contain it.

    A joint that mimics another may be in its own range and wherever the range of its leader takes
    it: URDFs whose two ranges differ do not say which of them is wrong. Where its leader is no
    joint that moves, its own range is all that is said of it.
    """
    model: Any = urdf.model
    travel = urdf.read_range(joint)
    if travel is None:
        return None
    lower, upper = travel
    mimic = urdf.mimics.get(joint)
    if mimic is not None and model.existJointName(mimic.leader):
        # How far a leader goes that follows a third joint is not said by its own range.
        if mimic.leader in urdf.mimics:
            return None
        leading = urdf.read_range(mimic.leader)
        if leading is None:
            return None
        least, most = mimic.map_range(*leading)
        lower, upper = min(lower, least), max(upper, most)
    if not is_prismatic(model, model.getJointId(joint)) and not upper - lower <= 2.0 * math.pi:
        return None
    return lower, upper
