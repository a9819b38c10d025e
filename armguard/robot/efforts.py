"""Estimates an arm's greatest accelerations and least decelerations from its URDF's efforts.

Manufacturers seldom publish accelerations that hold in every mode, or braking under load. Efforts
and inertias give coarse estimates of both. In small joints the drive's own inertia dominates, which
is not published and in no URDF. Both figures come from samples and prove nothing, so a margin must
be added and the source must be stated.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

import numpy as np
import pinocchio
from numpy.typing import ArrayLike

from armguard.jit.arrays import FloatArray

HARDER = 1.25
"""Acceleration limits are this much above what samples show, for what sampling misses."""

HELD = 0.5
"""Share of the supported deceleration that is taken; the rest is for the inertia of the drives."""


def draw_configuration(model: Any, random: np.random.Generator) -> FloatArray:
    """Joint positions spread evenly over their ranges, a turn where there is none. Shape (nv,)."""
    return random.uniform(
        np.maximum(model.lowerPositionLimit, -np.pi), np.minimum(model.upperPositionLimit, np.pi)
    )


def _sample_motions(
    model: Any, samples: int, speeds: FloatArray
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Random configurations, and in each the torques of gravity and Coriolis forces. (nv,) each."""
    data, random = model.createData(), np.random.default_rng(0)
    for _ in range(samples):
        q = draw_configuration(model, random)
        v = random.choice([-1.0, 1.0], model.nv) * speeds
        yield q, pinocchio.rnea(model, data, q, v, np.zeros(model.nv))


def compute_accelerations(model: Any, samples: int) -> FloatArray:
    """Largest acceleration of each joint when all motors push as hard as they can.

    Over random configurations, with all joints at full speed in random directions:

        max over samples of  sum_j |(M^-1)_ij| effort_j + |(M^-1 (gravity and Coriolis torques))_i|.

    What it leaves out only slows a joint down: the inertia of rotors and gears, friction, the time
    that torque needs to rise. Brakes that grip harder than the motors push are not in it.

    Args:
        model: `pinocchio.Model` with nq = nv, and with limits of efforts and velocities.
        samples: How many configurations.

    Returns:
        In [rad/s²] or [m/s²]; not finite where links have no mass. Shape (nv,).
    """
    data, largest = model.createData(), np.zeros(model.nv)
    with np.errstate(all="ignore"):
        for q, bias in _sample_motions(model, samples, model.velocityLimit):
            inverse = pinocchio.computeMinverse(model, data, q)
            inverse = np.triu(inverse) + np.triu(inverse, 1).T
            pushed = np.abs(inverse) @ model.effortLimit + np.abs(inverse @ bias)
            np.maximum(largest, pushed, out=largest)
    return largest


def compute_supported_shares(
    model: Any,
    shape: FloatArray,
    load: float,
    tool_point: ArrayLike,
    speeds: FloatArray,
    samples: int,
    balanced: Collection[str] = (),
) -> FloatArray:
    """Least share of a deceleration that each joint's effort supports, when all brake at once.

    Over random configurations and directions, with the worst combination of signs:

        min over samples of  (effort_i - |gravity and Coriolis torque_i|) / sum_j |M_ij| shape_j.

    Friction, which helps, is left out, and so are the inertia of the drives and the rate at which
    torque can rise, which do not help.

    Args:
        model: `pinocchio.Model` with nq = nv, and with limits of efforts.
        shape: Decelerations of which a share is sought. Shape (nv,).
        load: Point mass at `tool_point` of each last joint, in [kg].
        tool_point: In the frame of each last joint, in [m]. Shape (3,).
        speeds: Of the joints, in [rad/s] or [m/s]. Shape (nv,).
        samples: How many configurations, each with a random velocity.
        balanced: Joints whose gravity torque something else carries, such as springs.

    Returns:
        Below 0 where efforts do not even hold the arm. Shape (nv,).
    """
    model = model.copy()
    placement = pinocchio.SE3(np.eye(3), np.asarray(tool_point, dtype=np.float64))
    for joint in range(1, model.njoints):
        if joint not in list(model.parents):
            inertia = pinocchio.Inertia(load, np.zeros(3), np.zeros((3, 3)))
            model.appendBodyToJoint(joint, inertia, placement)
    data, shares = model.createData(), np.full(model.nv, np.inf)
    at_rest = np.array([joint in balanced for joint in list(model.names)[1:]])
    with np.errstate(all="ignore"):
        for q, bias in _sample_motions(model, samples, speeds):
            mass = np.abs(pinocchio.crba(model, data, q, pinocchio.Convention.LOCAL))
            mass = np.triu(mass) + np.triu(mass, 1).T
            gravity = pinocchio.computeGeneralizedGravity(model, data, q)
            left = model.effortLimit - np.abs(bias - np.where(at_rest, gravity, 0.0))
            np.minimum(shares, left / (mass @ shape), out=shares)
    return shares


def round_up(value: float) -> float:
    """A value above 0 to two digits, not below."""
    return float(np.ceil(value / _unit(value)) * _unit(value))


def round_down(value: float) -> float:
    """A value above 0 to two digits, not above."""
    return float(np.floor(value / _unit(value)) * _unit(value))


def _unit(value: float) -> float:
    return float(10.0 ** (np.floor(np.log10(value)) - 1.0))
