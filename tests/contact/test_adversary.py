"""Contact times against bodies that make for each other as hard as their bounds allow."""

from __future__ import annotations

import math

import numpy as np

from armguard.contact import earliest_contact_pair
from support.contact_cases import CONVERGED, ordinary_case


def _pursuit(v, accel, speed, heading, t):
    """Displacement at `t` of a body in the plane that makes for `heading` as hard as it may.

    Full acceleration along the heading until the speed bound is met, then at that speed with all
    the acceleration spent on turning, then straight on: feasible at every moment.
    """
    along, across = v @ heading, abs(v[0] * heading[1] - v[1] * heading[0])
    side = np.array([-heading[1], heading[0]])
    if v @ side < 0.0:
        side = -side
    limit = math.sqrt(max(speed**2 - across**2, 0.0))
    meet = max(0.0, (limit - along) / accel)
    first = np.minimum(t, meet)
    forward = along * first + 0.5 * accel * first**2
    sideward = across * first
    angle = math.atan2(across, along + accel * meet)
    turning = np.clip(t - meet, 0.0, angle * speed / accel)
    left = angle - turning * accel / speed
    forward += speed**2 / accel * (math.sin(angle) - np.sin(left))
    sideward += speed**2 / accel * (np.cos(left) - math.cos(angle))
    forward += speed * np.maximum(t - meet - angle * speed / accel, 0.0)
    return forward[:, None] * heading + sideward[:, None] * side


def test_an_adversary_within_bounds_comes_just_after():
    """Never before tau: soundness. Soon after: tightness, with speed bounds."""
    rng = np.random.default_rng(11)
    ratios = []
    while len(ratios) < 120:
        case = ordinary_case(rng)
        case |= {"age1": 0.0, "age2": 0.0, "velocity_error1": 0.0, "velocity_error2": 0.0}
        case |= {"clock_error1": 0.0, "clock_error2": 0.0}
        for name in ("p1", "v1", "p2", "v2"):
            case[name] = case[name] * [1.0, 1.0, 0.0]
        for i in "12":
            case["a" + i] = float(rng.uniform(1.0, 20.0))
            speed = float(np.linalg.norm(case["v" + i]))
            case["s" + i] = speed * float(rng.choice([1.0 + 1e-12, 1.2, 3.0])) + 1e-3
        tau = earliest_contact_pair(**case, advances=CONVERGED)
        if not 0.0 < tau < 10.0:
            continue
        away = case["p1"] - case["p2"]
        centre, span = math.atan2(away[1], away[0]), 0.75 * math.pi
        for _ in range(5):
            headings = centre + span * np.linspace(-1.0, 1.0, 25)
            centre = min(headings, key=lambda heading: _miss(case, heading, tau))
            span /= 6.0
        best = _arrival(case, centre, tau)
        assert best >= tau * (1.0 - 1e-9), case
        ratios.append(tau / best)
    assert min(ratios) > 0.95
    assert np.median(ratios) > 0.99


def _apart(case, heading, t):
    """Distance from contact at `t`, both making for each other along the heading."""
    way = np.array([math.cos(heading), math.sin(heading)])
    one = _pursuit(case["v1"][:2], case["a1"], case["s1"], -way, t)
    other = _pursuit(case["v2"][:2], case["a2"], case["s2"], way, t)
    gap = (case["p2"] - case["p1"])[:2] + other - one
    return np.hypot(gap[:, 0], gap[:, 1]) - case["contact_distance"]


def _miss(case, heading, tau):
    """How soon the two touch, as the step of a grid; if they do not, how closely they miss."""
    distances = _apart(case, heading, tau * np.linspace(0.9, 1.06, 33))
    touching = np.flatnonzero(distances <= 0.0)
    if not touching.size:
        return 100.0 + float(distances.min())
    first = int(touching[0])
    return first - float(distances[first]) / (float(distances[first - 1] - distances[first]))


def _arrival(case, heading, tau):
    grid = tau * np.linspace(0.9, 1.2, 3_001)
    touching = np.flatnonzero(_apart(case, heading, grid) <= 0.0)
    if not touching.size:
        return math.inf
    low, high = grid[max(touching[0] - 1, 0)], grid[touching[0]]
    for _ in range(40):
        middle = 0.5 * (low + high)
        if _apart(case, heading, np.array([middle]))[0] <= 0.0:
            high = middle
        else:
            low = middle
    return float(high)
