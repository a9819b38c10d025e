"""Exceptions of armguard: one base class, and a subclass for each area.

Every error names the offender, what is wrong with it, what was expected and what to do, both as
fields for programs and spelled out in one line for people.
"""

from __future__ import annotations


class ArmguardError(Exception):
    """Base of all errors that armguard raises on purpose.

    Attributes:
        offender: The joint, link, file, key or argument at fault.
        problem: What is wrong with it, with the value found.
        expected: The expected value; empty if the problem says it already.
        remedy: What to do about it; empty if that is obvious.
    """

    def __init__(
        self, offender: str, problem: str, *, expected: str = "", remedy: str = ""
    ) -> None:
        self.offender = offender
        self.problem = problem
        self.expected = expected
        self.remedy = remedy
        message = f"{offender}: {problem}"
        if expected:
            message += f"; expected {expected}"
        if remedy:
            message += f"; {remedy}"
        super().__init__(message)


class RobotError(ArmguardError):
    """A robot, one of its limits or its geometry cannot be used."""


class CoverError(ArmguardError):
    """A sphere cover is malformed, unproved, or belongs to other geometry."""


class ObstacleError(ArmguardError):
    """A call on the obstacle table is malformed."""


class CellError(ArmguardError):
    """A cell file is unreadable, or a value in it cannot be used."""


class StreamError(ArmguardError):
    """An address cannot be used, or a message cannot be sent."""


class KeyFileError(StreamError):
    """A key file cannot be used, or others can read a secret key."""
