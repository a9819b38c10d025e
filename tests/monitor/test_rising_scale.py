"""A speed scale falls at once and rises slowly, and the arm that obeys it moves smoothly."""

import functools
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armguard.exceptions import ArmguardError
from armguard.lab.simulation.arm import SimulatedArm
from armguard.lab.simulation.bodies import POINTS, publish_person
from armguard.lab.simulation.trajectory import JointTrajectory
from armguard.monitor import Monitor
from armguard.monitor.rising_scale import STEADY_TIME, RisingScale
from armguard.obstacles import Obstacles
from armguard.robot import Robot
from armguard.verdict import Level
from support.panda_monitor import HOME, PERIOD, STILL, make_monitor, see, steps

RATE, CAMERA, LATENCY = 1000.0, 30.0, 0.01


@given(
    st.lists(st.tuples(st.floats(1e-4, 0.1), st.floats(0.0, 1.0)), max_size=60),
    st.floats(0.1, 50.0),
)
def test_a_scale_falls_at_once_and_rises_no_faster_than_it_may(wanted, rise):
    rising, now = RisingScale(rise), 0.0
    for passed, proved in wanted:
        now, before = now + passed, rising.given
        most = rising.find_most(now)
        assert before <= most <= 1.0
        assert most <= before + rise * passed * (1.0 + 1e-9) + 1e-12 or now == passed
        assert rising.follow(now, proved) == rising.given == min(proved, most)


def test_a_scale_that_fell_does_not_rise_to_where_it_was_for_a_while():
    rising = RisingScale(10.0)
    rising.give(0.0, 0.8)
    rising.give(0.01, 0.3)
    assert rising.find_most(0.01 + 0.9 * STEADY_TIME) < 0.8
    assert rising.find_most(0.01 + STEADY_TIME) == 1.0
    # Not even from 1, which a piece of trajectory that ends meanwhile was run at.
    rising.give(0.02, 1.0)
    assert rising.follow(0.03, 1.0) == 0.85 * 0.8
    # No such fall is that to 0: the level holds a STOP for long enough.
    rising.give(2.0, 0.0)
    assert rising.find_most(2.1) == pytest.approx(1.0)


def test_after_a_reset_nothing_holds_a_scale_down():
    rising = RisingScale(1.0)
    rising.give(5.0, 0.1)
    rising.reset()
    assert rising.find_most(0.0) == 1.0


@pytest.mark.parametrize("rate", [0.0, -1.0, math.inf, math.nan, "1", True])
def test_a_rate_is_a_finite_number_above_zero(rate):
    with pytest.raises(ArmguardError, match="scale_rise"):
        Monitor(Robot.load("panda"), Obstacles(), scale_rise=rate)


@functools.cache
def work(seconds=6.0, camera=CAMERA, rise=1.0, phase=0.0):
    """An arm that swings its first joint beside somebody at 0.8 m, its scale as a speed override.

    Returns verdicts, and the arm's rate along its path by tick.
    """
    robot = Robot.load("panda")
    middle = np.array([0.0, -0.3, 0.0, -2.1, 0.0, 1.8, 0.785])
    swing = np.eye(7)[0] * 1.2
    way = JointTrajectory(
        robot, [middle - swing, middle + swing], speed_fraction=0.35, acceleration_fraction=0.3,
        loop=True,
    )  # fmt: skip
    obstacles = Obstacles(sources=["camera"])
    monitor = Monitor(robot, obstacles, rate=RATE, operating="published", scale_rise=rise)
    arm, frame, verdicts, rates = SimulatedArm(way, monitor.settings.operating), 0, [], []
    heights = {"head": 0.88, "collar": 0.6, "hip": 0.2}
    place = np.array([[0.0, -0.8, heights.get(name, 0.3)] for name in POINTS])
    for k in range(round(seconds * RATE)):
        now = k / RATE
        while frame == 0 or frame / camera + LATENCY <= now + 1e-12:
            angle = 1.5 * frame / camera + phase
            sway, pace = 0.03 * math.sin(angle), 0.045 * math.cos(angle)
            publish_person(
                obstacles, "camera", frame / camera, place + np.array([0.0, sway, 0.0]),
                np.tile([0.0, pace, 0.0], (len(POINTS), 1)), np.zeros(len(POINTS)),
                accel=10.0, speed=2.0,
            )  # fmt: skip
            frame += 1
        verdicts.append(monitor.step(now, arm.q, arm.v))
        arm.step(1.0 / RATE, verdicts[-1].speed_scale)
        rates.append(arm._rate)
    return verdicts, np.array(rates)


def count_reversals(rates):
    """How often the acceleration along the path changes its sign."""
    signs = np.sign(np.diff(rates))
    signs = signs[signs != 0.0]
    return int((signs[1:] != signs[:-1]).sum())


def test_beside_somebody_a_scale_neither_jumps_up_nor_makes_the_arm_jerk():
    verdicts, rates = work()
    scales = np.array([one.speed_scale for one in verdicts])
    assert np.diff(scales).max() <= 1.0 / RATE + 1e-9
    assert (scales < 1.0).mean() > 0.3, "else this shows nothing"
    # Of what is proved alone, the arm would follow each frame: some 20 reversals a second.
    assert count_reversals(rates) <= 6.0 * 6.0


@functools.cache
def sway(seconds=6.0):
    """Verdicts of an arm that rests, while a ball sways to where it has to be slow, and away."""
    obstacles, monitor = make_monitor("deadline", rise_delay=0.1, scale_rise=20.0)
    verdicts = []
    for k in range(round(seconds / PERIOD)):
        now = k * PERIOD
        angle = 3.0 * now
        place, pace = [1.05 + 0.2 * math.sin(angle), 0.0, 0.6], 0.6 * math.cos(angle)
        see(obstacles, now, place, velocity=[[pace, 0.0, 0.0]])
        verdicts.append(monitor.step(now, HOME, STILL))
    return verdicts


@pytest.mark.parametrize("scene", [sway, work])
def test_slow_is_said_only_where_the_scale_is_below_one(scene):
    verdicts = scene()
    verdicts = verdicts if scene is sway else verdicts[0]
    scales = {level: {one.speed_scale for one in verdicts if one.level is level} for level in Level}
    assert scales[Level.SLOW]
    assert max(scales[Level.SLOW]) < 1.0
    assert scales[Level.STOP] <= {0.0}


def test_levels_do_not_flutter_between_slow_and_aware():
    verdicts = sway()
    assert {one.level for one in verdicts} >= {Level.SLOW, Level.AWARE}
    rises = [two.stamp for one, two in itertools.pairwise(verdicts) if one.level < two.level]
    assert len(rises) > 1
    assert min(b - a for a, b in itertools.pairwise(rises)) > 0.1
    assert np.diff([one.speed_scale for one in verdicts]).max() <= 20.0 * PERIOD + 1e-9


def test_a_scale_rises_from_a_stop_as_slowly():
    obstacles, monitor = make_monitor(
        "deadline", obstacles=Obstacles(sources=[]), rise_delay=0.05, scale_rise=2.0
    )
    obstacles.add_static("post", [0.5, 0.0, 0.6], 0.2)
    (stop,) = steps(monitor, 0, 1)
    assert (stop.level, stop.speed_scale) == (Level.STOP, 0.0)
    obstacles.remove(["post"])
    verdicts = steps(monitor, 1, 800)
    scales = np.array([one.speed_scale for one in verdicts])
    assert np.diff(scales).max() <= 2.0 * PERIOD + 1e-9
    assert (verdicts[-1].level, scales[-1]) == (Level.CLEAR, 1.0)
    assert scales[np.array([one.level for one in verdicts]) == Level.CLEAR][0] < 0.1


def test_a_reset_begins_anew():
    """The same states after a reset get the same scales, whatever was before."""
    said = []
    obstacles, monitor = make_monitor("deadline", obstacles=Obstacles(sources=[]))
    for _ in range(2):
        monitor.reset()
        said.append([one.speed_scale for one in steps(monitor, 0, 500)])
        obstacles.add_static("post", [0.5, 0.0, 0.6], 0.2)
        steps(monitor, 500, 1)
        obstacles.remove(["post"])
    assert said[0] == said[1]
    assert 0.0 < said[0][-1] < 1.0
