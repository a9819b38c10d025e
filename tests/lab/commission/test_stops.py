"""Arms whose latency and brakes are known: found within a tenth, and never on the unsafe side."""

import numpy as np
import pytest

from armguard.lab.commission.observations import StopCommand
from armguard.lab.commission.stops import (
    JointStop,
    UnmeasuredStop,
    find_response,
    measure_stops,
)
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
    for joint in range(2):
        own = [stop for stop in stops if stop.joint == f"joint{joint}"]
        held, speed = arm.braking[joint], arm.velocity[joint]
        assert 0.03 <= max(stop.response for stop in own) <= 1.3 * 0.03
        time = max(stop.stopping_time for stop in own)
        assert 1.0 <= time / (speed / held) <= 1.2
        distance = max(stop.stopping_distance for stop in own)
        assert 1.0 <= distance / (0.5 * speed**2 / held) <= 1.2
        assert 0.8 <= min(stop.deceleration for stop in own) / held <= 1.0


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
    assert not any(problem.joint == "joint0" for problem in problems)


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (StopCommand(0.7, 0.75), "ends before the joint is slow"),
        (StopCommand(0.7, 0.95), "ends before the joint is at rest"),
        (StopCommand(-1.0, 5.0), "no joint state before it"),
    ],
)
def test_what_cannot_be_measured_is_told(command, words):
    seen = sample(make(0.03), [0.7], 3.0)
    stops, problems = measure_stops(seen._replace(stops=[command]))
    told = [str(problem) for problem in problems if problem.joint == "joint1"]
    assert not any(stop.joint == "joint1" for stop in stops)
    assert words in told[0]


def test_a_stop_that_ends_while_the_joint_still_creeps_has_a_response():
    seen = sample(make(0.03), [0.7], 3.0)
    _, problems = measure_stops(seen._replace(stops=[StopCommand(0.7, 0.95)]))
    assert [problem.joint for problem in problems] == ["joint1"]
    assert 0.03 <= problems[0].response <= 0.033


def make_creeping(below, creep, noise, seed=0):
    """A joint at 1 rad/s is told to STOP at 0.5 s; the times from its bite, 40 ms later, to rest.

    It slows down by 5 rad/s², and by `creep` [rad/s²] below a speed in [rad/s].
    """
    times = np.arange(0.0, 2.5, 1e-3)
    since = times - 0.54
    early, late = (1.0 - below) / 5.0, below / creep
    v = np.where(since < early, 1.0 - 5.0 * since, below - creep * (since - early))
    v = np.clip(v, 0.0, 1.0)
    q = np.r_[0.0, np.cumsum(0.5e-3 * (v[1:] + v[:-1]))]
    random = np.random.default_rng(seed)
    seen = sample(make(0.04), [], 0.1)
    seen.robot.joints = ("joint0",)
    seen.robot.velocity_limit = np.array([2.0])
    return early + late, seen._replace(
        stamps=times,
        q=(q + random.normal(0.0, 3e-5 * (noise > 0.0), len(q)))[:, None],
        v=(v + random.normal(0.0, noise, len(v)))[:, None],
        stops=[StopCommand(0.5, 2.4)],
    )


@pytest.mark.parametrize(("below", "creep"), [(0.1, 0.5), (0.05, 0.2), (0.03, 0.05)])
@pytest.mark.parametrize("noise", [0.0, 0.002, 0.006, 0.012])
@pytest.mark.parametrize("seed", range(3))
def test_a_joint_that_creeps_to_rest_is_waited_for(below, creep, noise, seed):
    time, seen = make_creeping(below, creep, noise, seed)
    (stop,), problems = measure_stops(seen)
    assert not problems
    assert 0.99 * time <= stop.stopping_time <= 1.2 * time
    # It is far below what it brakes with at first, and no figure of it holds at each instant.
    assert np.isnan(stop.deceleration)


def test_a_joint_that_creeps_until_the_stop_ends_is_not_taken_to_rest():
    _, seen = make_creeping(0.03, 0.05, 0.012)
    stops, (problem,) = measure_stops(seen._replace(stops=[StopCommand(0.5, 1.1)]))
    assert not stops
    assert problem.why == "the STOP ends before the joint is at rest"


def test_a_joint_whose_noise_hides_its_rest_is_told():
    seen = sample(Arm([0.2], [2.0], [2.0], 0.03), [0.7], 3.0, velocity_noise=0.15)
    stops, problems = measure_stops(seen)
    assert not stops
    assert len(problems) == 1


def obey(told, response):
    return JointStop("joint0", told, 1.0, response, 0.2, 0.1, 5.0)


def miss(told, length, response, joint="joint0"):
    return UnmeasuredStop(joint, StopCommand(told, told + length), "it is not known", response)


@pytest.mark.parametrize(
    ("unmeasured", "longest", "is_open"),
    [
        (miss(4.0, 0.3, np.inf), 0.04, True),
        (miss(4.0, 0.03, np.inf), 0.04, False),  # over before the arm had to obey
        (miss(1.0, 0.3, np.inf, "joint1"), 0.04, True),  # another joint obeyed the same one
        (miss(1.0, 0.3, np.nan, "joint1"), 0.04, False),
        (miss(4.0, 0.3, np.nan), 0.04, True),
        (miss(4.0, 0.3, 0.07), 0.07, False),
    ],
)
def test_a_stop_that_may_have_been_ignored_leaves_the_response_open(unmeasured, longest, is_open):
    stops = [obey(1.0, 0.04), obey(2.0, 0.03)]
    assert find_response(stops, [unmeasured]) == (longest, [unmeasured] if is_open else [])


def test_too_few_joint_states_are_told():
    seen = sample(make(0.03), [0.7], 3.0, period=0.05)
    stops, problems = measure_stops(seen)
    assert not stops
    assert "joint states during its deceleration" in problems[0].why
