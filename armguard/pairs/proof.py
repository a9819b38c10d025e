"""The certificate of a verdict's deciding pair, and its inputs.

A pair's contact time is the soonest of its spheres', each of which may borrow a later time from a
sphere above it in the tree, which owns its piece as well, or from a ball that the link or the arm
cannot leave. The certificate is the one of these whose time is latest. It is made from the state of
the present tick, whatever tick the pair was last evaluated in, and it is about free bodies: what
joint bounds add to a contact time is proved by them alone, and not part of it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from armguard.contact.earliest import Certificate, certify
from armguard.jit.numerics import SUM_ROUNDING, TERM_ROUNDING
from armguard.obstacles.partners import NO_PARTNER
from armguard.obstacles.possible_states import list_states
from armguard.obstacles.table import States
from armguard.obstacles.tethers import find_length
from armguard.pairs.contact_time import StatePlace
from armguard.pairs.evaluate import TickState, find_partner_row
from armguard.pairs.scene import ADVANCES


def prove_pair(
    state: TickState, sphere: int, row: int
) -> tuple[Certificate, dict[str, Any]] | None:
    """Certify one pair in the present tick.

    Args:
        state: The tick's numbers.
        sphere: The sphere that decided the pair.
        row: Of the obstacle in its table.

    Returns:
        The certificate, and the arguments of `armguard.certificate.verify` that it is about; None
        where the whereabouts of the obstacle are unknown, so that there is nothing to prove.
    """
    # Each state that may be true needs a proof of its own; the soonest of them decides.
    states = list_states(state.bodies, state.refused_bodies, state.marks, row, state.now)
    proofs = (
        _prove_state(state, sphere, bodies, StatePlace(place, False, age, bodies.radius[place]))
        for bodies, place, age in states
    )
    soonest = min(proofs, key=lambda proof: proof[0].contact_time, default=None)
    partner = find_partner_row(state, row)
    if soonest is None or partner == NO_PARTNER:
        return soonest
    # A partner that the obstacle is tethered to may prove more.
    radius = max(float(bodies.radius[place]) for bodies, place, _ in states)
    grown = (find_length(state.scene.tethers, row, partner) + radius) * (1.0 + SUM_ROUNDING)
    age = state.now - float(state.bodies.stamp[partner])
    body = StatePlace(partner, False, age, grown)
    by_partner = _prove_state(state, sphere, state.bodies, body)
    return max(soonest, by_partner, key=lambda proof: proof[0].contact_time)


def _prove_state(
    state: TickState, sphere: int, bodies: States, body: StatePlace
) -> tuple[Certificate, dict[str, Any]]:
    """The latest certificate of one state of an obstacle, or of its partner."""
    proofs = []
    decider = sphere
    while sphere >= 0:
        arm = state.arm
        own = (*arm.centers[sphere], state.tree.radius[sphere] + arm.position_error[sphere])
        inputs = _describe(state, own, bodies, body) | {
            "v1": np.array(arm.velocities[sphere]),
            "a1": float(arm.accel[sphere]),
            "s1": float(arm.speed[sphere]),
            "age1": state.arm_age,
            "velocity_error1": float(arm.velocity_error[sphere]),
        }
        proofs.append((certify(**inputs, advances=ADVANCES), inputs))
        sphere = int(state.tree.parent[sphere])
    for ball in (state.arm.link_balls[state.link_of[decider]], state.arm.arm_ball):
        inputs = _describe(state, tuple(ball), bodies, body)
        proofs.append((certify(**inputs, advances=ADVANCES), inputs))
    return max(proofs, key=lambda proof: proof[0].contact_time)


def compile_proof(state: TickState) -> None:
    """Make a proof once, so that nothing is compiled in a tick."""
    find_partner_row(state, 0)
    place, still = np.zeros(3), np.zeros(3)
    certify(place, still, 1.0, 1.0, np.ones((1, 3)), np.zeros((1, 3)), 1.0, 1.0, 0.1)


def _describe(
    state: TickState, ball: tuple[float, ...], bodies: States, body: StatePlace
) -> dict[str, Any]:
    """Arguments of `certify` for one obstacle and a ball that stands still for ever.

    They are the observer's own to keep.

    Args:
        state: The tick's numbers.
        ball: Centre and radius, with what its place may be off by, in [m].
        bodies: States of obstacles.
        body: Which of them, and with which radius.
    """
    row, age = int(body.place), float(body.age)
    count = int(bodies.point_count[row])
    reach = ball[3] + body.radius + state.scene.settings.margin + bodies.position_error[row]
    return {
        "p1": np.array(ball[:3]),
        "v1": np.zeros(3),
        "a1": 0.0,
        "s1": 0.0,
        "p2": np.array(bodies.points[row, :count]),
        "v2": np.array(bodies.velocities[row, :count]),
        "a2": float(bodies.accel[row]),
        "s2": float(bodies.speed[row]),
        "contact_distance": float(reach) * (1.0 + TERM_ROUNDING),
        "age1": 0.0,
        "age2": age,
        "velocity_error1": 0.0,
        "velocity_error2": float(bodies.velocity_error[row]),
    }
