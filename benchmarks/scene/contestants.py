"""Who takes part in the comparison beside recorded people."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from armguard.robot import OperatingLimits, Robot
from scene.example_limits import LIMITS
from scene.least_rule import LeastRule
from scene.stop_rules import (
    ContactTimeRule,
    ForgetfulSeparation,
    MonitorRule,
    Oracle,
    PieceRule,
    Rule,
    Separation,
    Setting,
)

ORACLE, SEPARATION, BRAKING = "knows the future", "separation distance", "braking"
ISOTROPIC, JOINT = "isotropic", "joint, no braking"
OPERATING = "operating limits"
LEAST = "least of any sound rule"
PIECES = "pieces with their own stop"
LEFT = ", leave=any"
NO_LOAD = ", no load"
AS_THEY_COME = ", data as they come"
TETHERED = AS_THEY_COME + ", tethered"
MEASURED = TETHERED + ", lengths measured"
FORGETFUL = AS_THEY_COME + ", hidden bodies left out"
WITH_ERRORS = ", errors included"
WITH_LIMITS = ", contact limits"

OPERATING_VELOCITY = 1.05
"""Operating velocities, as shares of the top speeds of the arm's trajectories."""
OPERATING_ACCELERATION = 0.27
"""Operating accelerations, as shares of the acceleration limits."""


DESCRIPTIONS = {
    OPERATING: f"a monitor with `operating=`, {OPERATING_ACCELERATION:g} of the acceleration limits"
    f" and {OPERATING_VELOCITY:g} of the top speeds",
    PIECES: "each tick commits the next piece, which ends in a stop",
}
"""What is particular about monitors with settings."""


ORDER = (
    ORACLE, ORACLE + NO_LOAD, LEAST, LEAST + WITH_ERRORS, SEPARATION, SEPARATION + NO_LOAD,
    ISOTROPIC, JOINT, BRAKING, OPERATING, OPERATING + NO_LOAD, PIECES, PIECES + LEFT,
    PIECES + NO_LOAD, OPERATING + WITH_LIMITS, PIECES + WITH_LIMITS, SEPARATION + FORGETFUL,
    SEPARATION + AS_THEY_COME, OPERATING + AS_THEY_COME, OPERATING + TETHERED,
    OPERATING + MEASURED, PIECES + AS_THEY_COME, PIECES + TETHERED,
)  # fmt: skip
"""All rules, as tables have them."""

MAIN = (SEPARATION, OPERATING, PIECES)
"""What is compared in every setting beside clean data."""

MAIN_RAW = (
    SEPARATION + AS_THEY_COME, OPERATING + AS_THEY_COME, OPERATING + TETHERED,
    PIECES + AS_THEY_COME, PIECES + TETHERED,
)  # fmt: skip
"""What is compared in every setting beside data as they come."""

NOT_OBEYED = (
    ORACLE + NO_LOAD, LEAST, LEAST + WITH_ERRORS, SEPARATION + NO_LOAD, ISOTROPIC, JOINT,
    OPERATING + NO_LOAD, OPERATING + MEASURED, PIECES + NO_LOAD,
)  # fmt: skip
"""Rules that are judged only: there is another one of the kind to obey."""


class Scope(NamedTuple):
    """In which settings rules are compared."""

    reactions: tuple[float, ...]
    """In [s]."""
    cameras: tuple[float, ...]
    """In [s]; the first one is the usual one."""
    bounds: tuple[str, ...]
    """The first one is the usual one."""

    def settings(self) -> Iterable[Setting]:
        """All bounds at every reaction with the first camera, and at the first one with others."""
        for bounds in self.bounds:
            for camera in self.cameras:
                reactions = self.reactions if camera == self.cameras[0] else self.reactions[:1]
                yield from (Setting(reaction, camera, bounds) for reaction in reactions)

    @property
    def usual(self) -> Setting:
        """With the first of everything."""
        return Setting(self.reactions[0], self.cameras[0], self.bounds[0])

    @property
    def real(self) -> Setting:
        """The one nearest to a real cell: the last bounds, and a camera in the middle."""
        return Setting(self.reactions[0], self.cameras[len(self.cameras) // 2], self.bounds[-1])

    @property
    def extremes(self) -> tuple[float, ...]:
        """The first and the last reaction, once if they are the same."""
        return tuple(dict.fromkeys((self.reactions[0], self.reactions[-1])))

    def is_usual(self, setting: Setting) -> bool:
        """Whether a setting has the usual camera and bounds."""
        return (setting.camera, setting.bounds) == (self.cameras[0], self.bounds[0])


class Target(NamedTuple):
    """What the share of time in STOP of one rule was to be at most, in shares of another's."""

    rule: str
    rival: str
    most: float
    reactions: tuple[float, ...]
    """For which reactions, in [s]."""
    least: str | None = None
    """What stops as little as any sound rule in its place could; None where nothing says so."""


TARGETS = (
    Target(OPERATING, SEPARATION, 1.05, (0.02,), LEAST),
    Target(OPERATING, SEPARATION, 1.6, (0.1,), LEAST),
    Target(PIECES, SEPARATION, 0.95, (0.02, 0.05, 0.1)),
    Target(OPERATING + AS_THEY_COME, SEPARATION + AS_THEY_COME, 1.15, (0.02,)),
    Target(OPERATING + TETHERED, SEPARATION + AS_THEY_COME, 1.15, (0.02,)),
)

LIMIT_TARGETS = (
    (PIECES + WITH_LIMITS, 0.3, 0.35),
    (PIECES + WITH_LIMITS, 0.8, 0.75),
    (OPERATING + WITH_LIMITS, 0.3, 0.5),
    (OPERATING + WITH_LIMITS, 0.8, 0.95),
)
"""Rules, speeds in [rad]/[s], and what their share of STOP outside blocked time was to be at most
at the first reaction, in shares of that of the separation distance."""


def make_operating(robot: Robot, speed_fraction: float) -> OperatingLimits:
    """For trajectories that use a share of the velocity limits at most."""
    return OperatingLimits.fraction(
        robot,
        velocity=min(1.0, OPERATING_VELOCITY * speed_fraction),
        acceleration=OPERATING_ACCELERATION,
    )


def make_rules(
    robot: Robot, speed_fraction: float, scope: Scope, setting: Setting, period: float
) -> list[Rule]:
    """All that take part in one setting.

    Args:
        robot: The arm.
        speed_fraction: What its trajectories use of the velocity limits at most.
        scope: Of the comparison: `MAIN` takes part in each setting, rules beside data as they come
            in those with the first reaction; all others take part in the usual ones.
        setting: What the rules have to live with.
        period: Of ticks, in [s].
    """
    given = robot, setting, period
    operating = make_operating(robot, speed_fraction)
    known = {"motion": "planned", "operating": operating}
    raw = {"clean": False}
    rules: list[Rule] = [
        Separation(*given, SEPARATION),
        MonitorRule(*given, OPERATING, operating=operating),
        PieceRule(*given, PIECES, **known),
    ]
    if setting.reaction == scope.reactions[0]:
        rules += [
            ForgetfulSeparation(*given, SEPARATION + FORGETFUL, clean=False),
            Separation(*given, SEPARATION + AS_THEY_COME, clean=False),
            MonitorRule(*given, OPERATING + AS_THEY_COME, **raw, operating=operating),
            MonitorRule(*given, OPERATING + TETHERED, **raw, tied="anybody", operating=operating),
            MonitorRule(*given, OPERATING + MEASURED, **raw, tied="measured", operating=operating),
            PieceRule(*given, PIECES + AS_THEY_COME, **raw, **known),
            PieceRule(*given, PIECES + TETHERED, **raw, tied="anybody", **known),
        ]
    if setting.camera == scope.cameras[0]:
        rules.append(LeastRule(*given, LEAST))
    if not scope.is_usual(setting):
        return rules
    limited = {"operating": operating, "contact_limits": LIMITS}
    return [
        *rules,
        # What it knows depends on neither camera nor bounds.
        Oracle(*given, ORACLE),
        Oracle(*given, ORACLE + NO_LOAD, payload=0.0),
        LeastRule(*given, LEAST + WITH_ERRORS, fastest=operating.resolve(robot)[0]),
        Separation(*given, SEPARATION + NO_LOAD, payload=0.0),
        MonitorRule(*given, ISOTROPIC, motion="isotropic"),
        ContactTimeRule(*given, JOINT),
        MonitorRule(*given, BRAKING),
        MonitorRule(*given, OPERATING + NO_LOAD, payload=0.0, operating=operating),
        PieceRule(*given, PIECES + LEFT, leave="any", **known),
        PieceRule(*given, PIECES + NO_LOAD, payload=0.0, **known),
        MonitorRule(*given, OPERATING + WITH_LIMITS, **limited),
        PieceRule(*given, PIECES + WITH_LIMITS, motion="planned", **limited),
    ]
