"""Asks for values that a URDF lacks: on a terminal, by options, or by default values.

Options have priority over the model file. On a terminal, armguard asks for each value that is still
missing, and Enter accepts the default value. Without a terminal, a missing value is an error that
names the option, unless the caller accepts all default values.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from fnmatch import fnmatchcase
from functools import partial
from typing import Any, Generic, NamedTuple, TypeVar

from armguard.exceptions import RobotError

GIVEN = "GIVEN to `armguard robot new`: replace this text with the source of the value"
"""Source of a user's answer."""

Range = tuple[float, float]
Amount = TypeVar("Amount", float, Range)


class Figure(NamedTuple, Generic[Amount]):
    """One figure of one joint, and where it comes from."""

    value: Amount
    source: str


class Kind(NamedTuple):
    """A quantity that each joint of a robot has."""

    name: str
    """In the plural."""
    unit: str
    meaning: str
    """The statement that armguard relies on."""
    read: Callable[[str, str], Any]
    """Reads an amount, named by its first argument, from text."""

    def __str__(self) -> str:
        return f"{self.name} [{self.unit}]"


class Question(NamedTuple, Generic[Amount]):
    """A question about the joints of a robot."""

    option: str
    """With which it is answered on the command line."""
    kind: Kind
    """The quantity."""
    known: Mapping[str, Figure[Amount]]
    """Known values, by joint."""
    usual: Mapping[str, Figure[Amount]]
    """Default values, by joint, where there are any."""


class Asker:
    """Puts questions.

    Args:
        ask: Shows a text and returns the answer of somebody at a terminal; None: there is nobody.
        takes_usual: Whether default values are accepted without a question.
    """

    def __init__(self, ask: Callable[[str], str] | None, *, takes_usual: bool) -> None:
        self._ask = None if takes_usual else ask
        self._takes_usual = takes_usual

    def answer(
        self, question: Question[Amount], joints: Sequence[str], given: Sequence[str]
    ) -> dict[str, Figure[Amount]]:
        """A figure of each joint.

        Args:
            question: The question.
            joints: All joints that need one.
            given: Values from the command line: AMOUNT for all joints that lack one, or
                JOINT=AMOUNT, which replaces a known value; patterns such as "wrist_*" are allowed.

        Raises:
            RobotError: An answer is unusable, or missing.
        """
        found = dict(question.known) | read_answers(question, joints, given)
        lacking = [joint for joint in joints if joint not in found]
        if lacking and self._ask is not None:
            found |= self._put(question, joints, lacking)
        elif lacking and self._takes_usual:
            found |= {joint: one for joint, one in question.usual.items() if joint in lacking}
        lacking = [joint for joint in joints if joint not in found]
        if lacking:
            remedy = ""
            if all(joint in question.usual for joint in lacking):
                remedy = f"--yes accepts the default: {_list(question.usual, lacking)}"
            is_number = question.kind.read is not read_range
            raise RobotError(
                question.option,
                f"is missing: the model file has no {question.kind} of {', '.join(lacking)}",
                expected="a number for all of them, or JOINT=NUMBER"
                if is_number
                else "JOINT=LOWER:UPPER",
                remedy=remedy,
            )
        return {joint: found[joint] for joint in joints}

    def choose(
        self, option: str, what: str, usual: str, given: str | None, *, is_guess: bool = False
    ) -> str:
        """One answer that is not about joints; `usual` if Enter or `--yes` accepts it.

        Args:
            option: The command-line option that answers it.
            what: Text of the question.
            usual: The default value, which Enter accepts.
            given: The answer from the command line.
            is_guess: Whether `usual` may be far from the truth, so that `--yes` does not accept it.

        Raises:
            RobotError: It is missing.
        """
        if given is not None:
            return given
        if self._takes_usual and not is_guess:
            return usual
        if self._ask is None:
            remedy = "measure it; --yes does not guess it"
            raise RobotError(
                option,
                f"is missing: {what}",
                remedy=remedy if is_guess else f"--yes accepts the default: {usual}",
            )
        return self._ask(f"\n{what} ({option})\n  [{usual}] ").strip() or usual

    def _put(
        self, question: Question[Amount], joints: Sequence[str], lacking: Sequence[str]
    ) -> dict[str, Figure[Amount]]:
        """Ask on the terminal until no value is missing."""
        assert self._ask is not None
        kind, names = question.kind, ", ".join(lacking)
        text = f"\n{kind} of {names}: {kind.meaning} ({question.option})"
        usual = {joint: question.usual[joint] for joint in lacking if joint in question.usual}
        for source, members in group_by_source(usual).items():
            text += f"\n  default: {_list(usual, members)} ({source})"
        found: dict[str, Figure[Amount]] = {}
        while len(found) < len(lacking):
            left = [joint for joint in lacking if joint not in found]
            answer = self._ask(f"{text}\n  [{'default' if usual else 'no default'}] ")
            try:
                read = read_answers(question, joints, answer.split())
            except RobotError as error:
                text = f"  {error}"
                continue
            # Enter, or an answer for some of them, leaves the others to what is usual.
            found |= read | {j: usual[j] for j in left if j in usual and j not in read}
            text = f"  still missing: {', '.join(j for j in lacking if j not in found)}"
        return found


def read_answers(
    question: Question[Amount], joints: Sequence[str], given: Sequence[str]
) -> dict[str, Figure[Amount]]:
    """Answers by joint: AMOUNT, for joints that lack one, or JOINT=AMOUNT.

    Raises:
        RobotError: A joint is unknown, or an amount unusable.
    """
    found: dict[str, Figure[Amount]] = {}
    for item in put_general_first(given):
        pattern, has_joint, text = item.rpartition("=")
        value = question.kind.read(f"{question.option} {item}", text)
        if has_joint:
            members = match(f"{question.option} {item}", pattern, joints)
        else:
            members = [joint for joint in joints if joint not in question.known]
        found |= {joint: Figure(value, GIVEN) for joint in members}
    return found


def group_by_source(figures: Mapping[str, Figure[Amount]]) -> dict[str, list[str]]:
    """The joints whose figures have one source, by source."""
    groups: dict[str, list[str]] = {}
    for joint, one in figures.items():
        groups.setdefault(one.source, []).append(joint)
    return groups


def put_general_first(given: Sequence[str]) -> list[str]:
    """Amounts for all joints first; amounts of named joints then replace them."""
    return sorted(given, key=lambda item: "=" in item)


def match_all(option: str, patterns: Sequence[str], names: Collection[str]) -> list[str]:
    """The names that match any of the patterns.

    Raises:
        RobotError: There is none for one of them.
    """
    return [name for one in patterns for name in match(f"{option} {one}", one, names)]


def match(option: str, pattern: str, names: Collection[str]) -> list[str]:
    """The names that match a pattern.

    Raises:
        RobotError: There is none.
    """
    members = [name for name in names if fnmatchcase(name, pattern)]
    if not members:
        raise RobotError(
            option, f"names {pattern!r}", expected=f"one of {', '.join(names) or 'none'}"
        )
    return members


def _read_finite(option: str, text: str, *, least: float, expected: str) -> float:
    """A finite number from the least on.

    Raises:
        RobotError: It is none.
    """
    value = _read(text)
    if not least <= value < math.inf:
        raise RobotError(option, f"is {text!r}", expected=expected)
    return value


read_number = partial(_read_finite, least=math.ulp(0.0), expected="a finite number above 0")
read_amount = partial(_read_finite, least=0.0, expected="a finite number, at least 0")
read_signed = partial(_read_finite, least=-sys.float_info.max, expected="a finite number")


def read_range(option: str, text: str) -> Range:
    """A lower and an upper number, as "-1.5:2".

    Raises:
        RobotError: It is none.
    """
    lower, _, upper = text.partition(":")
    value = _read(lower), _read(upper)
    if not -math.inf < value[0] < value[1] < math.inf:
        raise RobotError(option, f"is {text!r}", expected="LOWER:UPPER, finite, lower < upper")
    return value


def _read(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _list(figures: Mapping[str, Figure[Amount]], joints: Sequence[str]) -> str:
    """Figures of joints in one line, one number where all have the same."""
    values = {joint: _spell(figures[joint].value) for joint in joints}
    if len(set(values.values())) == 1:
        return values[joints[0]]
    return " ".join(f"{joint}={value}" for joint, value in values.items())


def _spell(value: float | Range) -> str:
    return ":".join(f"{one:g}" for one in value) if isinstance(value, tuple) else f"{value:g}"


_SPEED, _ACCELERATION = "rad/s or m/s", "rad/s² or m/s²"

KINDS = {
    "position": Kind(
        "position limits", "rad or m", "no joint ever leaves these limits", read_range
    ),
    "velocity": Kind("velocity limits", _SPEED, "no joint ever exceeds this speed", read_number),
    "acceleration": Kind(
        "acceleration limits",
        _ACCELERATION,
        "no joint ever accelerates or decelerates more, emergency stops included",
        read_number,
    ),
    "position_error": Kind(
        "position errors", "rad or m", "no measured position has a greater error", read_amount
    ),
    "velocity_error": Kind(
        "velocity errors", _SPEED, "no measured velocity has a greater error", read_amount
    ),
    "load": Kind(
        "load of the brakes",
        "kg",
        "the decelerations of the brakes hold up to this load",
        read_amount,
    ),
    "deceleration": Kind(
        "decelerations of the brakes",
        _ACCELERATION,
        "every stop with that load decelerates at least this much, from any speed",
        read_number,
    ),
    "operating_velocity": Kind(
        "operating velocities",
        _SPEED,
        "the controller enforces them",
        read_number,
    ),
    "operating_acceleration": Kind(
        "operating accelerations",
        _ACCELERATION,
        "the controller enforces them",
        read_number,
    ),
}
"""All kinds of figures, by field of the command."""
