"""Operating limits: velocities and accelerations that the controller enforces while it works.

The hardware's limits hold also in emergencies. With operating limits, a joint accelerates at most
at the operating acceleration and up to the operating velocity; it decelerates at most at its
acceleration limit. They are a premise, which the controller must enforce.
`armguard.bounds.operating_history` detects a violation with some delay. After a violation, the
hardware's limits are in force until the operating limits have been kept for a while.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike

from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
from armguard.robot.robot import Robot

PUBLISHED = "published"
"""Instead of limits: the published ones of the robot's description."""


class OperatingLimits:
    """Operating limits of the joints; a limit that is left out is the hardware's.

    Attributes:
        velocity: Operating velocities in [rad]/[s] or [m]/[s]. One number, shape (nv,), or None:
            the velocity limits.
        acceleration: Greatest acceleration when joints get faster, in [rad]/[s²] or [m]/[s²].
            Deceleration is only limited by the robot's acceleration limits. One number, shape
            (nv,), or None.
    """

    def __init__(
        self, velocity: ArrayLike | None = None, acceleration: ArrayLike | None = None
    ) -> None:
        """Check what can be checked without a robot.

        Args:
            velocity: One number for all joints or one for each, in [rad]/[s] or [m]/[s].
            acceleration: The same for accelerations, in [rad]/[s²] or [m]/[s²].

        Raises:
            ArmguardError: Neither is given, or one is not a finite number above 0.
        """
        if velocity is None and acceleration is None:
            raise ArmguardError(
                "operating limits",
                "are none: neither velocity nor acceleration is given",
                remedy="leave them out altogether if there are none",
            )
        self.velocity = _read("operating velocity", velocity)
        self.acceleration = _read("operating acceleration", acceleration)

    @classmethod
    def fraction(
        cls, robot: Robot, *, velocity: float = 1.0, acceleration: float = 1.0
    ) -> OperatingLimits:
        """Operating limits that are fractions of the robot's, the same for all joints.

        Args:
            robot: The robot whose limits are used.
            velocity: Fraction of its velocity limits, in (0, 1].
            acceleration: Fraction of its acceleration limits, in (0, 1].

        Raises:
            ArmguardError: A fraction is not a number above 0 and at most 1.
        """
        limits = []
        for name, fraction, hardware in (
            ("operating velocity", velocity, robot.velocity_limit),
            ("operating acceleration", acceleration, robot.acceleration_limit),
        ):
            number = _read(name, fraction)
            if number is None or number.ndim or not number <= 1.0:
                raise ArmguardError(
                    name, f"is the fraction {fraction!r}", expected="a number above 0, at most 1"
                )
            limits.append(float(number) * hardware)
        return cls(*limits)

    @classmethod
    def published(cls, robot: Robot) -> OperatingLimits:
        """The published operating limits of the robot's description.

        Raises:
            ArmguardError: It has none.
        """
        found = robot.published_operating_limits
        if found is None:
            raise ArmguardError(
                "operating limits",
                f"of {robot.name} are not published, as far as its description says",
                remedy="state velocity and acceleration yourself, or leave operating limits out",
            )
        return cls(found.velocity, found.acceleration)

    def resolve(self, robot: Robot) -> tuple[FloatArray, FloatArray]:
        """Velocity and acceleration of each joint, as new arrays. Shape (nv,) each.

        Raises:
            ArmguardError: There is not one for each joint, or one is above the robot's limit.
        """
        return (
            _fit("operating velocity", self.velocity, robot.velocity_limit, robot.joints),
            _fit(
                "operating acceleration", self.acceleration, robot.acceleration_limit, robot.joints
            ),
        )


class LimitsInForce:
    """The limits and brakes that all bounds on the arm's motion use now; written in place.

    Attributes:
        velocity: In [rad]/[s] or [m]/[s]. Shape (nv,).
        acceleration: With which joints speed up, in [rad]/[s²] or [m]/[s²]. Shape (nv,).
        operating_velocity: What `velocity` is while the operating limits are in force. (nv,).
        operating_acceleration: What `acceleration` is then. (nv,).
        brakes: How joints stop under the payload, by speed.
        payload: Greatest payload, in [kg].
        is_suspended: Whether the hardware's limits are in force instead of the operating ones.
        revision: How often any of this has changed.
    """

    def __init__(
        self,
        robot: Robot,
        operating: OperatingLimits | str | None,
        payload: float | None = None,
    ) -> None:
        """Put the operating limits in force, or the robot's own if there are none.

        Args:
            robot: Whose limits and brakes.
            operating: Operating limits of its controller, or "published"; None: the robot's limits.
            payload: What it carries at most, in [kg]; None: the heaviest that its brakes are stated
                for.

        Raises:
            ArmguardError: The operating limits do not fit the robot, or the payload its brakes.
        """
        self._robot, self._brakes = robot, robot.brakes
        self.payload = self._brakes.check_payload(payload)
        self.brakes = self._brakes.make_curves(self.payload)
        self._hardware = (
            np.array(robot.velocity_limit, dtype=np.float64),
            np.array(robot.acceleration_limit, dtype=np.float64),
        )
        operating = read_operating(robot, operating)
        limits = self._hardware if operating is None else operating.resolve(robot)
        self.operating_velocity, self.operating_acceleration = limits
        self.velocity = self.operating_velocity.copy()
        self.acceleration = self.operating_acceleration.copy()
        self.is_suspended = False
        self.revision = 0

    def load(self, payload: float | None) -> None:
        """Put the brakes under another payload in force, in [kg]; None: the heaviest.

        Raises:
            RobotError: The payload is no number, negative, or above what the brakes are stated for.
        """
        number = self._brakes.check_payload(payload)
        self._brakes.fill_curves(self.brakes, number)
        self.payload = number
        self.revision += 1

    @contextlib.contextmanager
    def pretend(
        self, *, payload: float | None = None, operating: OperatingLimits | None = None
    ) -> Iterator[None]:
        """Count with another payload or other operating limits, for a question between ticks.

        Args:
            payload: In [kg]; None: as it is.
            operating: Operating limits of the controller; None: unchanged.

        Raises:
            ArmguardError: They do not fit the robot.
        """
        velocity, acceleration = self.velocity.copy(), self.acceleration.copy()
        try:
            if payload is not None:
                self._brakes.fill_curves(self.brakes, payload)
            if operating is not None:
                self.velocity[:], self.acceleration[:] = operating.resolve(self._robot)
            yield
        finally:
            self._brakes.fill_curves(self.brakes, self.payload)
            self.velocity[:], self.acceleration[:] = velocity, acceleration

    def suspend(self, suspended: bool = True) -> None:
        """Put the hardware's limits in force, or the operating limits again."""
        operating = self.operating_velocity, self.operating_acceleration
        self.velocity[:], self.acceleration[:] = self._hardware if suspended else operating
        self.is_suspended = suspended
        self.revision += 1

    def resume(self) -> None:
        """Put the operating limits in force again."""
        self.suspend(False)


def put_in_force(robot: Robot, operating: OperatingLimits | LimitsInForce | None) -> LimitsInForce:
    """The limits that motion models count with: shared ones as they are, others anew.

    Raises:
        ArmguardError: The operating limits do not fit the robot, or are something else.
    """
    if isinstance(operating, LimitsInForce):
        return operating
    return LimitsInForce(robot, operating)


def read_operating(robot: Robot, operating: object) -> OperatingLimits | None:
    """The operating limits that a user asks for; the word "published" stands for the robot's.

    Raises:
        ArmguardError: They are something else, do not fit the robot, or it has none published.
    """
    if operating is None:
        return None
    if isinstance(operating, str) and operating == PUBLISHED:
        operating = OperatingLimits.published(robot)
    if not isinstance(operating, OperatingLimits):
        raise ArmguardError(
            "operating",
            f"is {operating!r}",
            expected='an armguard.OperatingLimits, "published", or None',
        )
    operating.resolve(robot)
    return operating


def _read(name: str, values: ArrayLike | None) -> FloatArray | None:
    """Numbers above 0 as an array that cannot be changed."""
    if values is None:
        return None
    try:
        array = np.asarray(values)
    except Exception:  # whatever a foreign object raises here, it is no array
        array = np.array([])
    is_numeric = array.dtype.kind in "fiu" and not isinstance(values, np.ma.MaskedArray)
    if not (is_numeric and array.ndim <= 1 and array.size):
        raise ArmguardError(name, f"is {values!r}", expected="one number, or one for each joint")
    numbers = np.array(array, dtype=np.float64)
    if not ((numbers > 0.0) & (numbers < np.inf)).all():
        raise ArmguardError(name, f"is {values!r}", expected="finite numbers above 0")
    numbers.flags.writeable = False
    return numbers


def _fit(
    name: str, values: FloatArray | None, hardware: FloatArray, joints: Sequence[str]
) -> FloatArray:
    if values is None:
        return np.array(hardware, dtype=np.float64)
    if values.ndim and values.shape != hardware.shape:
        raise ArmguardError(
            name, f"has {len(values)} values", expected=f"one number, or {len(joints)} of them"
        )
    fitted = np.broadcast_to(values, hardware.shape).copy()
    for joint, value, limit in zip(joints, fitted, hardware, strict=True):
        if not 0.0 < value <= limit:
            raise ArmguardError(
                f"{name} of joint {joint!r}",
                f"is {value:.6g}",
                expected=f"above 0 and no more than the robot's limit of {limit:.6g}",
            )
    return fitted
