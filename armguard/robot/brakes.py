"""The brakes of a robot, by load and speed, as manufacturers publish them.

ISO 10218-1, annex B, requires manufacturers to state stopping time and stopping distance of a joint
for several loads and speeds. Such an entry does not state the deceleration at each instant. For a
joint up to the entry's speed it implies only: after the brakes engage, the joint gets no faster,
does not reverse, moves no farther than the distance, and is at rest after the time. An entry can
also state a deceleration that is guaranteed at each instant; each of the two is a proof by itself.
For a load or a speed between two entries, the next higher entry counts: a heavier or faster arm
stops no sooner.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from armguard.exceptions import RobotError
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import LIMIT_SLACK, SUM_ROUNDING

Amounts = float | dict[str, float]
"""One number for all joints of a row, or one for each by name."""

RANGE_REMEDY = (
    "state what is known of its brakes under [[brakes]]: load, speed, and deceleration or "
    "stopping_time and stopping_distance, which hold up to both"
)


class BrakeRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[[brakes]]`: the braking of the named joints under one load, from one speed.

    It applies to the joints that its mappings name, or to all joints if each value is one number.
    """

    load: float
    """Greatest load for which it holds, in [kg]."""
    speed: Amounts
    """Greatest speed for which it holds, in [rad]/[s] or [m]/[s]."""
    stopping_time: Amounts | None = None
    """Longest time from engaged brakes until the joint is at rest, in [s]."""
    stopping_distance: Amounts | None = None
    """Greatest distance in this time, in [rad] or [m]."""
    deceleration: Amounts | None = None
    """Deceleration that is guaranteed at each instant until the joint is at rest, in [rad]/[s²] or
    [m]/[s²]."""
    source: str = ""
    """Source of the row."""


class BrakeEntry(NamedTuple):
    """One row as it applies to one joint, in [kg], [rad] or [m], and [s]."""

    load: float
    speed: float
    stopping_time: float
    """inf where none is stated."""
    stopping_distance: float
    """inf where none is stated."""
    deceleration: float
    """0 where none is guaranteed."""
    source: str


class BrakeCurves(NamedTuple):
    """Braking under one payload, for compiled code: each of shape (nv, steps).

    The columns of a joint rise in speed; those that it does not need repeat its last.
    """

    speed: FloatArray
    """Up to which a column holds, in [rad]/[s] or [m]/[s]."""
    deceleration: FloatArray
    """Guaranteed at each instant, in [rad]/[s²] or [m]/[s²]; 0 where none is."""
    time: FloatArray
    """Time from engaged brakes until rest, in [s]; inf where none is stated."""
    distance: FloatArray
    """How far it is from there to rest, in [rad] or [m]; inf where none is stated."""


class Stop(NamedTuple):
    """How one joint stops from a speed; from any lower one as well."""

    deceleration: float
    """At least, at each instant, in [rad]/[s²] or [m]/[s²]; 0 where none is guaranteed."""
    time: float
    """Until it rests, in [s]; inf where none is stated."""
    distance: float
    """Until it rests, in [rad] or [m]; inf where none is stated."""


@kernel
def find_stop(brakes: BrakeCurves, joint: int, speed: float) -> Stop:
    """The stop of a joint from a speed of at most `speed`, by the next higher entry.

    Beyond the range of its brakes nothing is known. The last entry is returned then, so that
    results stay finite, but they prove nothing. `compute_stop_time` reports this case.
    """
    last = brakes.speed.shape[1] - 1
    step = 0
    while step < last and not speed <= brakes.speed[joint, step]:
        step += 1
    return Stop(
        brakes.deceleration[joint, step], brakes.time[joint, step], brakes.distance[joint, step]
    )


@kernel
def rest_time(stop: Stop, speed: float) -> float:
    """Upper bound on the time until a joint that brakes from at most `speed` is at rest, in [s]."""
    if not speed > 0.0:
        return 0.0
    if stop.deceleration > 0.0:
        return min(stop.time, speed / stop.deceleration)
    return stop.time


@kernel
def braked_displacement(speed: float, stop: Stop, s: float) -> float:
    """Greatest displacement of a joint `s` >= 0 seconds after its brakes engaged, rounded up.

    All bounds on a braking arm use this one bound on a braking joint. It is the lesser of the
    bounds by stopping distance and by deceleration, and never decreases with time or speed, apart
    from rounding.

    Args:
        speed: Greatest speed when brakes engage, in [rad]/[s] or [m]/[s]; >= 0.
        stop: How it stops from that speed.
        s: Time since the brakes engaged, in [s].
    """
    moving = min(s, stop.time)
    distance = min(speed * moving, stop.distance)
    if stop.deceleration > 0.0:
        until = min(moving, speed / stop.deceleration)
        distance = min(distance, until * (speed - 0.5 * stop.deceleration * until))
    return distance * (1.0 + SUM_ROUNDING)


@kernel
def scale_that_rests(brakes: BrakeCurves, velocity: FloatArray, within: float) -> float:
    """The greatest fraction of some velocities, (nv,), from which all joints rest within a time."""
    scale = 1.0
    for joint in range(velocity.shape[0]):
        fastest = 0.0
        for step in range(brakes.speed.shape[1]):
            top = brakes.speed[joint, step]
            if not brakes.time[joint, step] <= within:
                top = min(top, within * brakes.deceleration[joint, step])
            fastest = max(fastest, top)
            if top < brakes.speed[joint, step]:
                break
        scale = min(scale, fastest / velocity[joint])
    return scale


@kernel
def scale_within_range(
    brakes: BrakeCurves,
    velocity: FloatArray,
    velocity_error: FloatArray,
    acceleration: FloatArray,
    delay: float,
) -> float:
    """The greatest fraction of their velocities at which brakes are stated for all joints.

    A joint below this fraction that accelerates until its brakes engage is still within their
    range.

    Args:
        brakes: How joints stop.
        velocity: Operating velocities of the joints, in [rad]/[s] or [m]/[s]. Shape (nv,).
        velocity_error: What measured velocities may be off by. Shape (nv,).
        acceleration: Operating accelerations, in [rad]/[s²] or [m]/[s²]. Shape (nv,).
        delay: Time from a joint state until brakes engage, in [s].
    """
    scale = 1.0
    last = brakes.speed.shape[1] - 1
    for joint in range(velocity.shape[0]):
        fastest = brakes.speed[joint, last]
        if fastest < velocity[joint]:
            room = fastest - velocity_error[joint] - acceleration[joint] * delay
            scale = min(scale, max(room, 0.0) / velocity[joint])
    return scale


@kernel
def find_gentlest_stop(brakes: BrakeCurves, speeds: FloatArray) -> FloatArray:
    """The least constant decelerations that keep what is stated of a stop from some speeds.

    Args:
        brakes: How these stop.
        speeds: Of the joints, in [rad]/[s] or [m]/[s]; of either sign. Shape (nv,).

    Returns:
        In [rad]/[s²] or [m]/[s²], above 0; of a joint at rest, within `LIMIT_SLACK`, what its first
        entry says, in the mean where that has no deceleration. Shape (nv,).
    """
    rates = np.zeros(speeds.shape[0])
    for j in range(speeds.shape[0]):
        speed = abs(speeds[j])
        stop = find_stop(brakes, j, speed)
        rates[j] = stop.deceleration
        if speed > LIMIT_SLACK:
            for rate in (speed / stop.time, 0.5 * speed * speed / stop.distance):
                # One that is no number, of a speed beyond all bounds, counts for nothing.
                if rate > rates[j]:
                    rates[j] = rate
        elif stop.deceleration == 0.0:
            rates[j] = brakes.speed[j, 0] / stop.time
    return rates


class Brakes:
    """The table of a robot's brakes, checked; one list of entries for each watched joint.

    Attributes:
        joints: Names of the joints, in the robot's order.
        entries: Of each joint, in rising order of load and speed.
        most_payload: The heaviest load for which every joint has an entry, in [kg].
    """

    def __init__(self, joints: Sequence[str], entries: Mapping[str, Sequence[BrakeEntry]]) -> None:
        """Store entries that `check_entries` has accepted."""
        self.joints = tuple(joints)
        self.entries = {joint: tuple(sorted(entries[joint])) for joint in self.joints}
        self.most_payload = min(max(one.load for one in row) for row in self.entries.values())
        self._steps = max(len({one.speed for one in row}) for row in self.entries.values())

    @classmethod
    def constant(cls, joints: Sequence[str], deceleration: Iterable[float]) -> Brakes:
        """Brakes that hold one deceleration of each joint, whatever its speed and the load."""
        held = zip(joints, deceleration, strict=True)
        return cls(
            joints,
            {
                joint: [BrakeEntry(math.inf, math.inf, math.inf, math.inf, float(rate), "")]
                for joint, rate in held
            },
        )

    def check_payload(self, payload: object) -> float:
        """The payload in [kg]; None stands for the heaviest of the table.

        Raises:
            RobotError: It is no number, negative, or above what the table covers.
        """
        if payload is None:
            return self.most_payload
        is_number = isinstance(payload, numbers.Real) and not isinstance(payload, bool)
        number = float(payload) if is_number else math.nan  # type: ignore[arg-type]
        if not 0.0 <= number <= self.most_payload:
            raise RobotError(
                "payload",
                f"is {payload!r}",
                expected=f"a number of kilograms from 0 to {self.most_payload:g}, the heaviest "
                "load that the robot's brakes are stated for",
            )
        return number

    def make_curves(self, payload: float | None = None) -> BrakeCurves:
        """What brakes do under a payload; None: the heaviest of the table.

        Raises:
            RobotError: The payload is no number, negative, or above what the table covers.
        """
        shape = len(self.joints), self._steps
        curves = BrakeCurves(*(np.zeros(shape) for _ in BrakeCurves._fields))
        self.fill_curves(curves, payload)
        return curves

    def fill_curves(self, curves: BrakeCurves, payload: float | None) -> None:
        """Fill the arrays of `make_curves` anew, in place: what was compiled with them sees it.

        Raises:
            RobotError: As `make_curves` does; the arrays are as they were then.
        """
        load = self.check_payload(payload)
        for j, joint in enumerate(self.joints):
            # What holds under more load, or from a higher speed, holds under less as well.
            known = [one for one in self.entries[joint] if one.load >= load]
            speeds = sorted({one.speed for one in known})
            speeds += [speeds[-1]] * (self._steps - len(speeds))
            for step, speed in enumerate(speeds):
                above = [one for one in known if one.speed >= speed]
                curves.speed[j, step] = speed
                curves.deceleration[j, step] = max(one.deceleration for one in above)
                curves.time[j, step] = min(one.stopping_time for one in above)
                curves.distance[j, step] = min(one.stopping_distance for one in above)

    def gentlest_stop(self, speeds: FloatArray) -> FloatArray:
        """The least constant decelerations that keep what is stated of a stop from some speeds.

        For simulations: what is stated under the heaviest load is all that they may rely on.

        Args:
            speeds: Of the joints, in [rad]/[s] or [m]/[s]; of either sign. Shape (nv,).

        Returns:
            In [rad]/[s²] or [m]/[s²], above 0; of a joint at rest what its first entry says, in the
            mean where that has no deceleration. Shape (nv,).
        """
        return find_gentlest_stop(self.make_curves(), speeds)

    def sources(self, joint: str) -> str:
        """Where the entries of a joint come from, each source once."""
        return "; ".join(dict.fromkeys(one.source for one in self.entries[joint]))


def read_rows(
    place: str, rows: Sequence[BrakeRow], joints: Mapping[str, str], accelerations: FloatArray
) -> dict[str, list[BrakeEntry]]:
    """The entries of each joint, checked.

    Args:
        place: What to call the file in errors.
        rows: As they were read.
        joints: Names of all joints, each with the source of its braking where a row has none.
        accelerations: Limits of the joints, in [rad]/[s²] or [m]/[s²]. Shape (joints,).

    Raises:
        RobotError: An entry is missing or unusable, or the table of a joint falls.
    """
    entries: dict[str, list[BrakeEntry]] = {joint: [] for joint in joints}
    for number, row in enumerate(rows):
        where = f"{place}: brakes[{number}]"
        if not 0.0 <= row.load < math.inf:
            raise RobotError(where, f"load = {row.load}", expected="non-negative and finite")
        for joint in _name_joints(where, row, list(joints)):
            entries[joint].append(_read_entry(f"{where}: joint {joint}", row, joint, joints[joint]))
    for joint, limit in zip(joints, accelerations, strict=True):
        where = f"{place}: joint {joint}"
        if not entries[joint]:
            raise RobotError(where, "has no brakes with a stated range", remedy=RANGE_REMEDY)
        _check_entries(where, entries[joint], float(limit))
    return entries


KINDS = ("stopping_time", "stopping_distance", "deceleration")


def _name_joints(where: str, row: BrakeRow, joints: list[str]) -> list[str]:
    """The joints that a row is about."""
    mappings = {
        key: list(value)
        for key in ("speed", *KINDS)
        if isinstance(value := getattr(row, key), dict)
    }
    named = next(iter(mappings.values()), joints)
    for key, found in mappings.items():
        if not (found and set(found) == set(named) and set(found) <= set(joints)):
            raise RobotError(
                f"{where}: {key}",
                f"names {', '.join(found) or 'no joint'}",
                expected=f"one or more of {', '.join(joints)}, and the same in all mappings",
            )
    return named


def _read_entry(where: str, row: BrakeRow, joint: str, general_source: str) -> BrakeEntry:
    found = {}
    for key in ("speed", *KINDS):
        value = getattr(row, key)
        number = value.get(joint) if isinstance(value, dict) else value
        if number is not None:
            if not 0.0 < number < math.inf:
                raise RobotError(where, f"{key} = {number}", expected="positive and finite")
            found[key] = float(number)
    if ("stopping_time" in found) != ("stopping_distance" in found):
        raise RobotError(
            where,
            "has one of stopping_time and stopping_distance",
            expected="both, as makers publish them, or neither",
        )
    if len(found) == 1:
        raise RobotError(
            where,
            "says a range and nothing of the brakes",
            expected="deceleration, or stopping_time and stopping_distance",
        )
    source = row.source or general_source
    if not source.strip():
        raise RobotError(where, "its braking limit has no source")
    return BrakeEntry(
        load=float(row.load),
        speed=found["speed"],
        stopping_time=found.get("stopping_time", math.inf),
        stopping_distance=found.get("stopping_distance", math.inf),
        deceleration=found.get("deceleration", 0.0),
        source=source,
    )


def _check_entries(where: str, entries: list[BrakeEntry], acceleration: float) -> None:
    """Refuse entries that contradict one another, a limit or themselves."""
    for one in entries:
        # Within rounding of what is printed with three digits or more.
        reach = one.speed * one.stopping_time
        if one.stopping_time < math.inf and not one.stopping_distance <= reach * (1.0 + 1e-9):
            raise RobotError(
                where,
                f"stopping_distance = {one.stopping_distance:g} {_spell(one)}",
                expected=f"at most {reach:.6g}, speed times stopping_time",
            )
        shortest = 0.5 * one.speed * one.speed / acceleration
        if not (
            one.deceleration <= acceleration
            and acceleration * one.stopping_time >= one.speed
            and one.stopping_distance >= shortest
        ):
            raise RobotError(
                where,
                f"deceleration = {one.deceleration:g}, stopping_time = {one.stopping_time:g} and "
                f"stopping_distance = {one.stopping_distance:g} {_spell(one)} exceed its limit",
                expected=f"no harder a stop than by acceleration = {acceleration:g}",
                remedy="the acceleration limit holds while braking as well",
            )
    for one in entries:
        for other in entries:
            if one.load <= other.load and one.speed <= other.speed:
                _check_order(where, one, other)


def _check_order(where: str, one: BrakeEntry, other: BrakeEntry) -> None:
    """Refuse a stop that is sooner, shorter or harder under more load or from more speed."""
    for key in KINDS:
        less, more = getattr(one, key), getattr(other, key)
        is_harder = more > less > 0.0 if key == "deceleration" else more < less < math.inf
        if is_harder:
            raise RobotError(
                where,
                f"{key} = {more:g} {_spell(other)} is a harder stop than {less:g} {_spell(one)}",
                expected="no harder a stop under more load or from more speed",
            )


def _spell(entry: BrakeEntry) -> str:
    return f"at {entry.load:g} kg and a speed of {entry.speed:g}"
