import tomllib

from hypothesis import given, settings
from hypothesis import strategies as st

from armguard.drivers.arm import ArmState, Program
from armguard.drivers.measurement import RESTING, TIMEOUT, Measurement, describe

PERIOD = 0.004
NAMES = ("first", "second")


def simulate(measurement, speed, reaction, deceleration):
    """An arm whose first joint runs at a speed, until it is told to stop."""
    now, q, v, told = 100.0, 0.0, speed, None
    while not measurement.is_done:
        now += PERIOD
        wants = measurement.wants_stop(now)
        told = (told or now) if wants else None
        brakes = told is not None and now >= told + reaction
        wanted = 0.0 if brakes else speed
        v += max(-PERIOD * deceleration, min(PERIOD * deceleration, wanted - v))
        q += PERIOD * v
        measurement.add(now, ArmState(now, [q, 0.0], [v, 0.0], Program.RUNNING, "", 1.0))


@settings(max_examples=20, deadline=None)
@given(st.floats(0.2, 3.0), st.floats(0.0, 0.1), st.floats(1.0, 10.0))
def test_what_is_measured_is_never_too_short_and_hardly_too_long(speed, reaction, deceleration):
    measurement = Measurement(2)
    simulate(measurement, speed, reaction, deceleration)
    assert not measurement.problem
    assert len(measurement.stops) == 2
    for stop in measurement.stops:
        assert set(stop) == {0}, "the second joint did not move"
        one = stop[0]
        # It may still have been speeding up when it was told to stop.
        v = one.speed
        creep = RESTING / deceleration
        longest = reaction + v / deceleration
        assert 0.1 < v <= speed + 1e-9
        assert reaction - 2 * PERIOD <= one.reaction <= reaction + 0.2 * longest + 3 * PERIOD
        assert longest - creep - 2 * PERIOD <= one.time <= longest + 3 * PERIOD
        assert 0.5 * v**2 / deceleration - PERIOD * v <= one.distance <= v * longest


def test_an_arm_that_does_not_move_is_a_problem():
    measurement = Measurement(1)
    measurement.wants_stop(0.0)
    measurement.add(0.0, ArmState(0.0, [0.0], [0.0], Program.PAUSED, "", 1.0))
    assert not measurement.wants_stop(TIMEOUT - 1.0)
    assert not measurement.is_done
    measurement.wants_stop(TIMEOUT + 1.0)
    assert measurement.is_done
    assert "did not move" in measurement.problem


def test_the_lines_can_be_pasted_and_round_to_the_long_side():
    measurement = Measurement(3)
    simulate(measurement, 0.5, 0.03, 4.0)
    text = describe(measurement.stops, NAMES, 5.0)
    lines = tomllib.loads(text)
    (brakes,) = lines["brakes"]
    worst = [stop[0] for stop in measurement.stops]
    assert lines["thresholds"]["reaction_time"] >= max(one.reaction for one in worst)
    assert brakes["load"] == 5.0
    assert brakes["speed"]["first"] <= max(one.speed for one in worst)
    assert brakes["stopping_time"]["first"] >= max(one.time for one in worst)
    assert brakes["stopping_distance"]["first"] >= max(one.distance for one in worst)
    assert "second" in text.splitlines()[-1], "it is named, since nothing is known of it"
    assert describe([], NAMES, 5.0) == ""
