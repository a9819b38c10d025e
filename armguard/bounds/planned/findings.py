"""Faults of a plan that compiled code finds, and their text.

Kernels hand over the fields of a `Finding`, not that itself: Numba would look up its class at each
call, which takes as long as all that they do.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from armguard.bounds.planned.plan import Refusal

FINE, POSITION, VELOCITY, RATE, CURVE, ENDS, PLACE, PACE, APART, DRIFTS, UNCOVERED, HARD = range(12)
"""Kinds of findings; FINE is none."""

WORDS = {
    POSITION: "goes to {found:.6g} after {when:.6g} s; "
    "limits with errors are {least:.6g} to {most:.6g}",
    VELOCITY: "goes at {found:.4g} after {when:.6g} s; limit with error is {most:.4g}",
    RATE: "accelerates at {found:.4g} after {when:.6g} s; limit is {most:.4g}",
    CURVE: "positions and velocities do not agree after {when:.6g} s; "
    "joining them takes an acceleration of {found:.4g}, limit is {most:.4g}",
    ENDS: "ends at velocity {found:.4g}, expected at rest; Monitor.with_stop appends a stop",
    PLACE: "at {found:.6g} {moment} where the plan has it at {least:.6g}, "
    "expected within {most:.3g}",
    PACE: "at velocity {found:.4g} {moment} where the plan has {least:.4g}, "
    "expected within {most:.3g}",
    APART: "off the committed piece by {found:.4g} at {when:.6g} s, expected within {most:.3g}",
    DRIFTS: "goes off the committed piece by {found:.4g} at {when:.6g} s, "
    "expected within {most:.3g}",
    UNCOVERED: "goes at {found:.4g}, brakes are stated up to {most:.4g}",
    HARD: "comes to rest at {found:.4g} from {when:.6g} s on, brakes guarantee {most:.4g}",
}


class Finding(NamedTuple):
    """What is wrong with one joint of a plan, or of an arm that is to follow it."""

    kind: int
    joint: int
    found: float
    """A position, velocity or acceleration, in [rad] or [m] and [s]."""
    least: float
    """What it may be at the least, or, of PLACE and PACE, what the plan has; alike."""
    most: float
    """What it, or its difference from that, may be at the most; alike."""
    when: float
    """In [s] from the plan's begin; of two plans that differ, on the clock of their stamps."""


def describe(finding: Sequence[float], joints: Sequence[str]) -> Refusal:
    """The refusal that says what a kernel has found, in the fields of a `Finding`."""
    found = Finding(*finding)  # type: ignore[arg-type]  # kind and joint are whole numbers
    when = found.when
    moment = f"when it begins, {-when:.3g} s on," if when < 0.0 else f"{when:.3g} s into the plan"
    detail = WORDS[found.kind].format(moment=moment, **found._asdict())
    return Refusal(joints[found.joint], detail)
