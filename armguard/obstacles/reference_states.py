"""Reference states: the obstacle states behind certificates, and the expiry of certificates.

A certificate states "no contact before `expire`, whatever happens within the bounds". It stays
valid while every newer state of its obstacle is within what its reference state allowed.
"""

from __future__ import annotations

import numpy as np

from armguard.jit.kernels import kernel, merged_kernel
from armguard.jit.numerics import ALLOWED, TIME_ROUNDING
from armguard.obstacles.consistency import body_allows
from armguard.obstacles.record import Record
from armguard.obstacles.table import Marks, States, copy_state


@kernel
def expire(now: float, contact_time: float) -> float:
    """When a certificate ends, in [s]: early by more than rounding costs up to its last use."""
    if contact_time == np.inf:
        return np.inf
    return now + contact_time - TIME_ROUNDING * (abs(now) + contact_time)


@kernel
def keep_reference_state(
    bodies: States, reference_states: States, marks: Marks, row: int, place: int
) -> None:
    """Keep the record that a fresh certificate rests on; no points where there is no record."""
    if not marks.has_state[row]:
        reference_states.point_count[place] = 0
        return
    copy_state(bodies, row, reference_states, place)


@merged_kernel
def allows_reference_state(
    bodies: States, reference_states: States, row: int, place: int
) -> tuple[bool, bool]:
    """Whether a state of an obstacle can be true if its reference state is, and its bounds grew.

    A larger error is no growth. Both states hold within their errors, so the truth lies in what
    both allow: a vaguer state takes nothing from what the reference state proves. A larger radius
    or bound is growth, since the reference state says nothing of such a body.

    Where there is no reference state the bounds grew: there was no accepted state when the obstacle
    was evaluated, and there is one now.
    """
    if reference_states.point_count[place] == 0:
        return True, True
    grown = (
        bodies.radius[row] > reference_states.radius[place]
        or bodies.accel[row] > reference_states.accel[place]
        or bodies.speed[row] > reference_states.speed[place]
    )
    # A larger radius is another description, no motion: it has been seen to above.
    radius = min(bodies.radius[row], reference_states.radius[place])
    accel, speed = reference_states.accel[place], reference_states.speed[place]
    code = body_allows(
        Record(reference_states, place, reference_states.radius[place], accel, speed),
        Record(bodies, row, radius, bodies.accel[row], bodies.speed[row]),
    )
    return code == ALLOWED, grown
