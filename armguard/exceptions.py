"""What armguard raises: one base class, and a child for each place a mistake can come from.

Every error names the offender, what is wrong with it, what was expected and what to do, both as
fields for programs and spelled out in one line for people.
"""

from __future__ import annotations


class ArmguardError(Exception):
    """Base of all errors that armguard raises on purpose.

    Attributes:
        offender: What is at fault: a joint, a link, a file, a key, an argument.
        problem: What is wrong with it, with the value that was found.
        expected: What would have been right; empty where the problem says so already.
        remedy: What to do about it; empty where that is obvious.
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
    """A call on the obstacle table was malformed."""


class CellError(ArmguardError):
    """A cell file is unreadable or says something impossible."""


class StreamError(ArmguardError):
    """An address cannot be used, or what was to be sent does not fit the wire."""


class KeyFileError(StreamError):
    """A file of keys cannot be used, or must not be: others can read a secret."""
