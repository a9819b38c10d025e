"""Pairs for the tests of contact times: ordinary, extreme and hostile ones, from a seed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armguard.contact import earliest_contact_pair

CONVERGED = 200  # advances, far more than any pair needs

Case = dict[str, Any]  # keyword arguments of certify and verify

ORDINARY: Case = {
    "p1": np.zeros(3), "v1": np.array([0.1, 0.0, 0.0]), "a1": 5.0, "s1": 2.0,
    "p2": np.array([1.0, 0.5, 0.0]), "v2": np.array([0.0, -0.2, 0.0]), "a2": 10.0, "s2": 2.0,
    "contact_distance": 0.2, "age1": 0.01, "age2": -0.005,
    "velocity_error1": 0.01, "velocity_error2": 0.02, "clock_error1": 0.001, "clock_error2": 0.002,
}  # fmt: skip


def _magnitude(rng: np.random.Generator, decades: float) -> float:
    return float(10.0 ** rng.uniform(-decades, decades))


def _bound(rng: np.random.Generator, decades: float) -> float:
    """A bound: mostly ordinary, sometimes 0 or none."""
    kind = rng.integers(8)
    if kind == 0:
        return 0.0
    if kind == 1:
        return math.inf
    return _magnitude(rng, decades)


def _nudge(rng: np.random.Generator, value: float) -> float:
    """`value` or a neighbour of it a few ulp away."""
    for _ in range(int(rng.integers(0, 3))):
        value = float(np.nextafter(value, rng.choice([-math.inf, math.inf])))
    return value


def random_case(rng: np.random.Generator, decades: float, corners: int = 1) -> Case:
    """Any mixture of magnitudes within 10**-decades … 10**decades."""
    case: Case = {
        "p1": rng.normal(size=3) * _magnitude(rng, decades) * rng.integers(0, 2),
        "v1": rng.normal(size=3) * _magnitude(rng, decades) * rng.integers(0, 2),
        "v2": rng.normal(size=3) * _magnitude(rng, decades) * rng.integers(0, 2),
    }
    position = case["p1"] + rng.normal(size=3) * _magnitude(rng, decades)
    case["p2"] = position
    if corners > 1:
        size = _magnitude(rng, decades)
        case["p2"] = position + rng.normal(size=(corners, 3)) * size
        spin = rng.normal(size=(corners, 3)) * _magnitude(rng, decades) * rng.integers(0, 2)
        case["v2"] = case["v2"] + spin
    distance = float(np.linalg.norm(position - case["p1"]))
    for i in "12":
        case["a" + i] = _bound(rng, decades)
        case["s" + i] = _bound(rng, decades)
        if rng.integers(3) == 0:  # the speed bound met, or missed by an ulp
            speed = float(np.linalg.norm(np.atleast_2d(case["v" + i])[0]))
            case["s" + i] = max(0.0, _nudge(rng, speed))
        case["velocity_error" + i] = (
            0.0 if rng.integers(2) else min(_bound(rng, decades), 10.0**decades)
        )
        case["age" + i] = 0.0 if rng.integers(2) else float(rng.normal()) * _magnitude(rng, decades)
        case["clock_error" + i] = 0.0 if rng.integers(4) else _magnitude(rng, decades)
    kind = rng.integers(4)
    case["contact_distance"] = (
        0.0
        if kind == 0
        else max(0.0, _nudge(rng, distance))  # contact, or none, by an ulp
        if kind == 1
        else distance * float(rng.uniform())
    )
    return case


def ordinary_case(rng: np.random.Generator, corners: int = 1) -> Case:
    """What a cell is made of: metres, people, a quick arm, states some milliseconds old."""
    position = rng.normal(size=3) * rng.uniform(0.3, 3.0)
    case: Case = {
        "p1": rng.normal(size=3) * 0.5,
        "v1": rng.normal(size=3) * rng.uniform(0.0, 1.0),
        "p2": position + (rng.normal(size=(corners, 3)) * 0.2 if corners > 1 else 0.0),
        "v2": rng.normal(size=3) * rng.uniform(0.0, 1.5),
        "contact_distance": float(rng.uniform(0.02, 0.4)),
    }
    if corners > 1:
        case["v2"] = case["v2"] + rng.normal(size=(corners, 3)) * 0.3
    for i, accel, speed in (("1", 120.0, 8.0), ("2", 10.0, 2.0)):
        case["a" + i] = float(rng.choice([0.0, math.inf, accel, accel * rng.uniform()]))
        case["s" + i] = float(rng.choice([math.inf, speed, speed * rng.uniform()]))
        case["velocity_error" + i] = float(rng.choice([0.0, 0.05]))
        case["age" + i] = float(rng.choice([0.0, 0.01, -0.002, rng.uniform(-0.3, 0.3)]))
        case["clock_error" + i] = float(rng.choice([0.0, 0.0, 0.0, 0.002]))
    return case


def grazing_case(rng: np.random.Generator) -> Case:
    """A pass that only just misses, or only just touches: three positive roots that nearly meet."""
    miss = _magnitude(rng, 3)
    speed = _magnitude(rng, 3)
    away = miss * _magnitude(rng, 2)
    basis, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    closest = away / speed
    contact_distance = miss * float(rng.uniform())
    # What acceleration would fill the gap just then, and a little less or more of it.
    accel = 2.0 * (miss - contact_distance) / closest**2
    accel *= 1.0 + float(rng.choice([-1.0, 1.0])) * 10.0 ** rng.uniform(-16, -1)
    return {
        "p1": np.zeros(3),
        "v1": np.zeros(3),
        "a1": 0.0,
        "s1": 0.0,
        "p2": basis[0] * away + basis[1] * miss,
        "v2": -basis[0] * speed,
        "a2": accel,
        "s2": float(rng.choice([math.inf, speed, speed * 1.01])),
        "contact_distance": contact_distance,
        "age1": 0.0,
        "age2": 0.0,
        "velocity_error1": 0.0,
        "velocity_error2": 0.0,
        "clock_error1": 0.0,
        "clock_error2": 0.0,
    }


def mixed_case(rng: np.random.Generator) -> Case:
    """One of all of the above."""
    kind = rng.integers(7)
    corners = int(rng.integers(2, 9))
    if kind == 0:
        return grazing_case(rng)
    if kind == 1:
        return ordinary_case(rng)
    if kind == 2:
        return ordinary_case(rng, corners)
    decades = float(rng.choice([0.5, 3.0, 20.0, 150.0]))
    return random_case(rng, decades, corners if kind == 3 else 1)


def free_cases(rng, count, decades):
    """One moving point without speed bound, in any mixture of magnitudes: the quartic's domain."""
    position = rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-decades, decades, (count, 1))
    velocity = rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-decades, decades, (count, 1))
    accel = 10.0 ** rng.uniform(-decades, decades, count)
    distance = np.linalg.norm(position, axis=1) * rng.uniform(0.0, 1.0, count)
    velocity[::17] = 0.0
    accel[5::17] = 0.0
    distance[3::17] = 0.0
    graze = slice(7, None, 4)  # an acceleration that just about fills the gap at its narrowest
    closest = -np.sum(position * velocity, 1)[graze] / np.sum(velocity**2, 1).clip(1e-300)[graze]
    miss = np.linalg.norm(position[graze] + velocity[graze] * closest[:, None], axis=1)
    distance[graze] = miss * rng.uniform(0.0, 1.0, miss.size)
    with np.errstate(all="ignore"):
        filling = 2.0 * (miss - distance[graze]) / closest**2
        filling *= 1.0 + 10.0 ** rng.uniform(-16, -1, miss.size) * rng.choice([-1, 1], miss.size)
        usable = (filling > 1e-150) & (filling < 1e150)
    accel[graze] = np.where(usable, filling, accel[graze])
    return position, velocity, distance, accel


def stack(cases):
    """Many cases of single points as arrays."""
    return {name: np.array([case[name] for case in cases]) for name in cases[0]}


def converged(cases):
    """Their contact times when no advance gains any more."""
    return earliest_contact_pair(**stack(cases), advances=CONVERGED)
