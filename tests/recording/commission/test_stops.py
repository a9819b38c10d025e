"""Arms whose latency and brakes are known: found within a tenth, and never on the unsafe side."""

import numpy as np
import pytest

from armguard.recording.commission.observations import StopCommand
from armguard.recording.commission.stops import measure_stops
from support.commissioned_arms import Arm, sample

STOPS = [0.7, 2.3, 4.0, 5.6]  # while both joints keep their speed


def make(latency, braking=(5.0, 4.0), **more):
    return Arm([0.6, 1.0], [2.0, 3.0], braking, latency, **more)


@pytest.mark.parametrize("latency", [0.02, 0.05, 0.12])
@pytest.mark.parametrize("braking", [(5.0, 4.0), (1.5, 9.0)])
@pytest.mark.parametrize(
    "seen",
    [
        {},
        {"velocity_noise": 0.003, "noise": 5e-5},
        {"quantum": 2e-4, "velocity_noise": 0.003},
        {"period": 2e-3, "velocity_noise": 0.001},
    ],
    ids=["exact", "noisy", "encoder", "500 Hz"],
)
def test_latency_and_brakes_are_found(latency, braking, seen):
    arm = make(latency, braking)
    stops, problems = measure_stops(sample(arm, STOPS, 7.5, **seen))
    # A STOP while a joint is slowing down at work says nothing, and is told.
    assert len(stops) >= 6
    assert len(stops) + len(problems) <= 2 * len(STOPS)
    assert latency <= max(stop.response for stop in stops) <= 1.1 * latency
    for stop in stops:
        held = arm.braking[int(stop.joint[-1])]
        assert 0.99 * latency <= stop.response <= 1.1 * latency + 1e-3
        assert 1.0 <= stop.stopping_time / (stop.speed / held) <= 1.1
        assert 1.0 <= stop.stopping_distance / (0.5 * stop.speed**2 / held) <= 1.1
        assert 0.9 <= stop.deceleration / held <= 1.0


@pytest.mark.parametrize("seed", range(6))
def test_with_much_noise_figures_are_wider_and_still_safe(seed):
    arm = make(0.03)
    noisy = sample(arm, STOPS, 7.5, velocity_noise=0.02, noise=5e-4, seed=seed)
    stops, _ = measure_stops(noisy)
    worst = {
        joint: [max(values) for values in zip(*rows, strict=True)]
        for joint in ("joint0", "joint1")
        for rows in [
            [
                (stop.response, stop.stopping_time, stop.stopping_distance, -stop.deceleration)
                for stop in stops
                if stop.joint == joint
            ]
        ]
    }
    for joint, (response, time, distance, negative) in worst.items():
        held, speed = arm.braking[int(joint[-1])], arm.velocity[int(joint[-1])]
        assert 0.03 <= response <= 1.3 * 0.03
        assert 1.0 <= time / (speed / held) <= 1.2
        assert 1.0 <= distance / (0.5 * speed**2 / held) <= 1.2
        assert 0.8 <= -negative / held <= 1.0


def test_brakes_that_come_slowly_have_time_and_distance_and_no_deceleration():
    """They are not guaranteed at each instant; what is stated covers the whole stop."""
    latency, ramp, hardest = 0.03, 0.1, 6.0
    arm = make(latency, (hardest, hardest), ramp=ramp)
    stops, _ = measure_stops(sample(arm, STOPS, 7.5, velocity_noise=0.001))
    assert stops
    for stop in stops:
        assert np.isnan(stop.deceleration)
        # From the verdict to rest: while the brakes come they take away 0.3 rad/s.
        whole = latency + ramp + (arm.velocity[int(stop.joint[-1])] - 0.3) / hardest
        assert whole <= stop.response + stop.stopping_time <= 1.1 * whole


def test_a_joint_that_hardly_moves_tells_nothing():
    arm = Arm([0.02, 1.0], [2.0, 3.0], [5.0, 4.0], 0.03)
    stops, problems = measure_stops(sample(arm, STOPS, 7.5))
    assert {stop.joint for stop in stops} == {"joint1"}
    assert not any("joint0" in problem for problem in problems)


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (StopCommand(0.7, 0.75), "ends before the joint is slow"),
        (StopCommand(0.7, 0.95), "ends before the joint rests"),
        (StopCommand(-1.0, 5.0), "no joint state before it"),
    ],
)
def test_what_cannot_be_measured_is_told(command, words):
    seen = sample(make(0.03), [0.7], 3.0)
    stops, problems = measure_stops(seen._replace(stops=[command]))
    told = [problem for problem in problems if problem.startswith("joint1")]
    assert not any(stop.joint == "joint1" for stop in stops)
    assert words in told[0]


def test_too_few_joint_states_are_told():
    seen = sample(make(0.03), [0.7], 3.0, period=0.05)
    stops, problems = measure_stops(seen)
    assert not stops
    assert "joint states while it slows down" in problems[0]
