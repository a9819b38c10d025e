"""What is said of widened bounds, refused samples and hidden bodies, and what it costs an arm."""

import numpy as np
import pytest

from armguard.monitor.second_look import SecondLook
from armguard.obstacles import Obstacles
from armguard.verdict import Level, ReasonKind
from support.panda_monitor import HOME, kinds, make_monitor, subjects

PERIOD = 0.01
SETTLED = 0.6  # [s], after which levels rest on nothing but what is seen
TURN = np.array([0.3, 0, 0, 0, 0, 0, 0])


def watch(period, places, *, seconds=1.2, still=False, **fields):
    """Verdicts of a Panda that turns slowly beside bodies.

    Args:
        period: Of the camera, in [s].
        places: Where it sees each body at a time in [s], with its velocity, by name; None: it does
            not see it.
        seconds: How long.
        still: Whether the arm rests.
        fields: What the camera says of the bodies beside that.
    """
    obstacles = Obstacles(sources=["camera"])
    _, monitor = make_monitor(obstacles=obstacles, rate=1.0 / PERIOD, source_timeout=1.0)
    told = {"radius": 0.05, "position_error": 2e-3, "velocity_error": 0.05} | fields
    next_look, q, v = 0.0, HOME.copy(), np.zeros(7) if still else TURN
    for tick in range(round(seconds / PERIOD)):
        now = tick * PERIOD
        if now >= next_look - 1e-9:
            next_look += period
            seen = {name: place(now) for name, place in places.items()}
            seen = {name: state for name, state in seen.items() if state is not None}
            states = np.array(list(seen.values())).reshape(-1, 2, 3)
            obstacles.update(list(seen), now, states[:, 0], states[:, 1], source="camera", **told)
        yield now, monitor.step(now, q, v), monitor
        q = q + PERIOD * v


def swap(apart, at, hidden_from):
    """A body beside the arm that jumps away and is lost a little later."""

    def place(now):
        if now >= hidden_from:
            return None
        x = 1.5 if now < at - 1e-9 else 1.5 - apart
        return [[x, 0.0, 0.6], [0.0, 0.0, 0.0]]

    return place


@pytest.mark.parametrize(("period", "most"), [(0.01, 0), (0.033, 10)])
def test_a_body_that_jumps_and_is_lost_costs_few_stops(period, most):
    """0.2 m; the arm is about 0.7 m away from where the body is seen then."""
    stops = 0
    for now, verdict, _ in watch(period, {"a": swap(0.2, 0.66, 0.76)}, seconds=0.9):
        if now > SETTLED:
            stops += verdict.level is Level.STOP and verdict.held is None
    assert stops <= most


def punch(now, begins=0.7, accel=60.0, speed=5.0):
    """A body that is at rest, and then comes at the arm."""
    since = max(now - begins, 0.0)
    ramp = min(since, speed / accel)
    moved = 0.5 * accel * ramp**2 + speed * (since - ramp)
    return [[1.6 - moved, 0.0, 0.6], [-accel * ramp, 0.0, 0.0]]


@pytest.mark.hazard("H-21")
@pytest.mark.parametrize("period", [0.01, 0.033])
def test_a_punch_ends_in_stop_and_in_a_broken_premise(period):
    stop_at, named_at, late_by = None, None, 0.0
    for now, verdict, _ in watch(period, {"fist": punch}, seconds=1.0):
        if now < 0.7:
            continue
        if named_at is None and ReasonKind.OBSTACLE_REFUSED in kinds(verdict):
            named_at = now
        if stop_at is None and verdict.level is Level.STOP:
            stop_at, late_by = now, verdict.stop_time - verdict.contact_time
            place = punch(now)[0][0]
    assert named_at is not None
    assert named_at - 0.7 <= period + PERIOD + 1e-9
    assert stop_at is not None
    # The fist is still well before the arm, and the arm at rest before it could come.
    assert place > 0.75
    assert late_by < 0.1


def test_a_body_that_is_hidden_is_named_with_its_time_and_distance():
    def place(now):
        return [[1.5, 0.0, 0.6], [0.0, 0.0, 0.0]] if now < 0.7 else None

    def other(now):
        return [[5.0, 0.0, 0.6], [0.0, 0.0, 0.0]]

    found = []
    for _, verdict, _ in watch(0.01, {"hand": place, "other": other}, seconds=1.4):
        if ReasonKind.HIDDEN in kinds(verdict):
            assert subjects(verdict, ReasonKind.HIDDEN) == {"hand"}
            found += [one.detail for one in verdict.reasons if one.kind is ReasonKind.HIDDEN]
            assert verdict.level < Level.CLEAR
    assert found
    assert found[0].startswith("hidden for 0.")
    assert "m away" in found[0]


def test_a_refused_sample_that_stops_the_arm_is_named():
    def place(now):
        x = 0.9 if 0.7 - 1e-9 <= now < 0.705 else 2.5
        return [[x, 0.0, 0.6], [0.0, 0.0, 0.0]]

    found = []
    for _, verdict, _ in watch(0.01, {"hand": place}, seconds=0.9):
        found += [one for one in verdict.reasons if one.kind is ReasonKind.REFUSED_ALTERNATIVE]
    assert found
    assert found[0].subject == "hand"
    assert "1.60 m off" in found[0].detail


@pytest.mark.hazard("H-21")
@pytest.mark.parametrize("nearer", [0.1, 0.2])
def test_widened_bounds_are_named_with_what_was_seen(nearer):
    def place(now):
        (x, y, z), velocity = punch(now, speed=1.5)
        return [[x - nearer, y, z], velocity]

    found = []
    for now, verdict, _ in watch(0.01, {"fist": place}, seconds=0.8):
        found += [one for one in verdict.reasons if one.kind is ReasonKind.WIDENED_BOUNDS]
        if now < 0.69:
            assert not found
    assert found
    assert "counts with " in found[0].detail
    assert " m/s²" in found[0].detail


def test_without_doubts_nothing_is_looked_at_twice(monkeypatch):
    """Beside a body that is seen well, in each tick below CLEAR."""
    looks, find_near = [], SecondLook.find_near

    def count(self, tick):
        looks.append(tick.now)
        return find_near(self, tick)

    monkeypatch.setattr(SecondLook, "find_near", count)
    levels = {
        verdict.level
        for now, verdict, _ in watch(0.01, {"a": lambda now: [[1.0, 0.0, 0.6], [0.0] * 3]})
        if now > SETTLED
    }
    assert levels
    assert Level.CLEAR not in levels
    assert not [now for now in looks if now > SETTLED]
