"""What is stated of brakes: what is refused, and what follows from an entry."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armguard.exceptions import RobotError
from armguard.robot.brakes import (
    BrakeEntry,
    Brakes,
    Stop,
    braked_displacement,
    find_stop,
    rest_time,
    scale_that_rests,
    scale_within_range,
)
from armguard.robot.description import read_description
from support.urdf_arms import brakes_for, limits_for


def row(load=1.0, speed=1.0, **values):
    return {"load": load, "speed": speed, "source": "a test"} | values


def stops(load, speed, time, distance):
    return row(load, speed, stopping_time=time, stopping_distance=distance)


def holds(load, speed, deceleration):
    return row(load, speed, deceleration=deceleration)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([], r"shoulder: has no brakes with a stated range.*\[\[brakes\]\]"),
        ([row()], r"brakes\[0\]: joint shoulder: says a range and nothing of the brakes"),
        ([row(stopping_time=0.5)], "has one of stopping_time and stopping_distance"),
        ([row(stopping_distance=0.5)], "has one of stopping_time and stopping_distance"),
        ([holds(1.0, 1.0, 0.0)], r"deceleration = 0\.0.*positive and finite"),
        ([holds(1.0, 1.0, math.nan)], "deceleration = nan"),
        ([holds(1.0, 1.0, math.inf)], "deceleration = inf"),
        ([holds(1.0, 1.0, 5.5)], r"deceleration = 5\.5.*at 1 kg.*acceleration = 5"),
        ([holds(1.0, 0.0, 1.0)], r"speed = 0\.0"),
        ([holds(1.0, math.inf, 1.0)], "speed = inf"),
        ([holds(-1.0, 1.0, 1.0)], r"load = -1\.0.*non-negative"),
        ([holds(math.nan, 1.0, 1.0)], "load = nan"),
        ([stops(1.0, 1.0, math.nan, 0.2)], "stopping_time = nan"),
        ([stops(1.0, 1.0, 0.5, 0.0)], r"stopping_distance = 0\.0"),
        ([stops(1.0, 1.0, 0.5, 0.51)], r"stopping_distance = 0\.51.*at most 0\.5, speed times"),
        (
            [stops(1.0, 1.0, 0.1, 0.1)],
            "stopping_time = 0.1 .*no harder a stop than by acceleration",
        ),
        ([stops(1.0, 1.0, 0.5, 0.05)], "stopping_distance = 0.05 .*no harder a stop"),
        ([row(speed={}, deceleration=3.0)], "speed: names no joint"),
        ([row(speed={"elbow": 1.0}, deceleration=1.0)], "speed: names elbow.*shoulder"),
        ([holds(1.0, 1.0, 1.0) | {"jerk": 3.0}], "jerk"),
        ([holds(1.0, 1.0, 1.0) | {"source": " "}], "its braking limit has no source"),
        ([holds(1.0, 1.0, 1.0), holds(1.0, 1.0, 2.0)], "deceleration = 2 at 1 kg.*than 1 at 1"),
        # A joint that is braked harder under more load, or from more speed.
        ([holds(0.0, 1.0, 1.0), holds(1.0, 1.0, 2.0)], "deceleration = 2 at 1 kg.*than 1 at 0"),
        (
            [holds(1.0, 1.0, 1.0), holds(1.0, 2.0, 2.0)],
            "speed of 2 is a harder stop than 1 at",
        ),
        # One that stops sooner.
        (
            [stops(0.0, 1.0, 0.5, 0.3), stops(1.0, 1.0, 0.4, 0.3)],
            r"stopping_time = 0\.4 at 1 kg.*than 0\.5 at 0 kg",
        ),
        (
            [stops(1.0, 1.0, 0.5, 0.3), stops(1.0, 2.0, 0.6, 0.29 + 0.2 * 0.02)],
            r"stopping_distance = 0\.2",
        ),
    ],
)
def test_what_cannot_be_is_refused_by_name(rows, message):
    with pytest.raises(RobotError, match=message):
        read_description(limits_for("shoulder") | {"brakes": rows, "sources": SOURCES})


SOURCES = dict.fromkeys(("position", "velocity", "acceleration"), "a test")


def test_every_joint_has_brakes_and_a_row_is_complete():
    limits = limits_for("shoulder", "elbow")
    with pytest.raises(RobotError, match="joint elbow: has no brakes"):
        read_description(limits | {"brakes": [brakes_for("shoulder")]})
    torn = row(speed={"shoulder": 1.0, "elbow": 1.0}, deceleration={"shoulder": 1.0})
    with pytest.raises(RobotError, match=r"brakes\[0\]: deceleration: names shoulder;.*the same"):
        read_description(limits | {"brakes": [torn]})
    # One number stands for all joints.
    found = read_description(limits | {"brakes": [holds(2, 3, 1)]}).brake_entries()
    assert (
        found["elbow"] == found["shoulder"] == [BrakeEntry(2.0, 3.0, np.inf, np.inf, 1.0, "a test")]
    )


def table():
    """0 and 2 kg, 1 and 2 rad/s; a deceleration for the slow ones, and for 5 kg a time alone."""
    entries = [
        BrakeEntry(0.0, 1.0, 0.3, 0.2, 4.0, "one"),
        BrakeEntry(0.0, 2.0, 0.5, 0.6, 0.0, "one"),
        BrakeEntry(2.0, 1.0, 0.4, 0.3, 2.0, "two"),
        BrakeEntry(2.0, 2.0, 0.6, 0.9, 0.0, "two"),
        BrakeEntry(5.0, 1.0, 0.9, 0.8, 0.0, "two"),
    ]
    return Brakes(["shoulder"], {"shoulder": entries})


@pytest.mark.parametrize(
    ("payload", "speed", "expected"),
    [
        (0.0, 0.0, (4.0, 0.3, 0.2)),
        (0.0, 1.0, (4.0, 0.3, 0.2)),
        # The next entry up, in speed and in load.
        (0.0, np.nextafter(1.0, 2.0), (0.0, 0.5, 0.6)),
        (np.nextafter(0.0, 1.0), 1.0, (2.0, 0.4, 0.3)),
        (2.0, 2.0, (0.0, 0.6, 0.9)),
        (2.1, 0.5, (0.0, 0.9, 0.8)),
        (None, 0.5, (0.0, 0.9, 0.8)),
    ],
)
def test_the_next_entry_up_counts(payload, speed, expected):
    assert tuple(find_stop(table().make_curves(payload), 0, speed)) == expected


@pytest.mark.parametrize("payload", [-0.1, 5.1, np.nan, np.inf, "1", True, None.__class__, 1j])
def test_payloads_that_cannot_be_are_refused_by_name(payload):
    brakes = table()
    curves = brakes.make_curves(2.0)
    before = [array.copy() for array in curves]
    with pytest.raises(RobotError, match=r"payload: is .*kilograms from 0 to 5"):
        brakes.fill_curves(curves, payload)
    for array, old in zip(curves, before, strict=True):
        np.testing.assert_array_equal(array, old)


ROUNDED = 1.0 + 1e-12
entries = st.tuples(
    st.floats(0.0, 8.0), st.one_of(st.just(np.inf), st.floats(0.05, 1.0)), st.floats(0.05, 2.0)
).map(lambda one: Stop(one[0], one[1], one[2] if one[1] < np.inf else np.inf))
speed_values = st.floats(0.0, 4.0)


@given(entries, speed_values, speed_values, st.floats(0.0, 3.0), st.floats(0.0, 3.0))
def test_a_stop_is_monotone_in_time_and_speed_and_ends_with_rest(stop, one, other, s, later):
    slow, fast = sorted((one, other))
    soon, late = sorted((s, later))
    here = braked_displacement(fast, stop, soon)
    assert braked_displacement(slow, stop, soon) <= here * ROUNDED
    assert here <= braked_displacement(fast, stop, late) * ROUNDED
    assert rest_time(stop, slow) <= rest_time(stop, fast)
    rest = rest_time(stop, fast)
    if rest < np.inf:
        at_rest = braked_displacement(fast, stop, rest)
        assert braked_displacement(fast, stop, rest + 1.0) <= at_rest * (1.0 + 1e-12)


@given(
    st.floats(0.0, 5.0), st.floats(0.0, 5.0), st.floats(0.0, 2.0), st.floats(0.0, 2.0),
    st.floats(0.0, 3.0),
)  # fmt: skip
def test_less_load_and_less_speed_never_stop_later(load, other_load, one, other, s):
    light, heavy = sorted((load, other_load))
    slow, fast = sorted((one, other))
    brakes = table()
    if fast > 1.0 and heavy > 2.0:
        # Beyond the range: nothing is known.
        return
    loaded, unloaded = brakes.make_curves(heavy), brakes.make_curves(light)
    hard = find_stop(loaded, 0, fast)
    for easy in (find_stop(unloaded, 0, slow), find_stop(loaded, 0, slow)):
        assert rest_time(easy, slow) <= rest_time(hard, fast)
        assert braked_displacement(slow, easy, s) <= braked_displacement(fast, hard, s) * ROUNDED


@given(st.floats(0.0, 5.0), st.floats(0.0, 1.5))
def test_the_fastest_that_rests_in_time_does_and_a_faster_one_does_not(load, within):
    curves = table().make_curves(load)
    fastest = scale_that_rests(curves, np.full(1, 4.0), within) * 4.0
    assert rest_time(find_stop(curves, 0, fastest), fastest) <= within * (1.0 + 1e-12)
    faster = fastest * (1.0 + 1e-9) + 1e-9
    if faster < curves.speed[0, -1]:
        assert rest_time(find_stop(curves, 0, faster), faster) > within


def test_a_scale_within_the_range_leaves_room_for_speeding_up():
    curves = table().make_curves(2.0)
    one = np.ones(1)
    for velocity, delay in ((4.0, 0.0), (4.0, 0.1), (2.5, 0.3), (2.0, 0.1), (1.0, 9.0)):
        scale = scale_within_range(curves, velocity * one, 0.02 * one, 3.0 * one, delay)
        # Of a joint that gets no faster than the range, whatever it does, nothing is taken off.
        expected = 1.0 if velocity <= 2.0 else (2.0 - 0.02 - 3.0 * delay) / velocity
        assert scale == pytest.approx(expected)
    assert scale_within_range(curves, 4.0 * one, 0.02 * one, 3.0 * one, 1.0) == 0.0
    assert scale_that_rests(curves, 4.0 * one, 9.0) == pytest.approx(0.5)
    assert scale_that_rests(curves, 4.0 * one, 0.0) == 0.0


def test_the_gentlest_stop_keeps_what_is_stated():
    entries = [
        BrakeEntry(1.0, 1.0, np.inf, np.inf, 2.0, "held"),
        BrakeEntry(1.0, 3.0, 0.5, 0.7, 0.0, "measured"),
    ]
    brakes = Brakes(["a"], {"a": entries})
    for speed in (0.3, 1.0, -2.0, 3.0):
        rate = brakes.gentlest_stop(np.array([speed]))[0]
        stop = find_stop(brakes.make_curves(), 0, abs(speed))
        assert abs(speed) / rate <= rest_time(stop, abs(speed)) * ROUNDED
        assert 0.5 * speed**2 / rate <= stop.distance * ROUNDED
        assert rate >= stop.deceleration
    for rest in (0.0, 5e-324, -1e-9):
        assert brakes.gentlest_stop(np.array([rest]))[0] == 2.0
    timed = Brakes(["a"], {"a": entries[1:]})
    for rest in (0.0, 5e-324, -1e-9):
        assert timed.gentlest_stop(np.array([rest]))[0] == 6.0
