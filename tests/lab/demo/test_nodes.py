"""The scene that the demo's nodes play, judged in one process with a clock that a test sets."""

import os
from pathlib import Path

import numpy as np
import pytest

from armguard import Monitor, Obstacles, Robot
from armguard.exceptions import ArmguardError
from armguard.lab.demo import nodes
from armguard.lab.demo.places import find_place
from armguard.lab.simulation import SimulatedArm, keeps_within, random_trajectory
from armguard.verdict import Level

RECORDINGS = Path(
    os.environ.get("ARMGUARD_RECORDINGS", Path(__file__).parents[3] / "../shared/data/human-motion")
)


def play(duration, person="", seed=0, period=0.01):
    """Levels and the whole verdicts of a demo, tick by tick, as fast as they can be computed."""
    robot, place = Robot.load("panda"), find_place("panda")
    (source,) = nodes.make_sources(duration, person, 0, seed)
    obstacles = Obstacles(sources=[source.name])
    monitor = Monitor(robot, obstacles, rate=1.0 / period)
    trajectory = random_trajectory(
        robot,
        seed,
        nodes.WORK_CYCLE,
        speed_fraction=nodes.SPEED_FRACTION,
        accept=keeps_within(robot, place.lower, place.upper),
    )
    arm, verdicts, scale = SimulatedArm(trajectory), [], 0.0
    for tick in range(1, round(duration / period)):
        source.publish(obstacles, tick * period)
        q, v = arm.step(period, scale)
        verdicts.append(monitor.step(tick * period, q, v))
        scale = verdicts[-1].speed_scale
    return verdicts


def test_clear_while_he_is_far_stop_at_the_arm_and_clear_again():
    levels = [verdict.level for verdict in play(20.0)]
    assert levels[0] is Level.CLEAR
    first, last = levels.index(Level.STOP), len(levels) - levels[::-1].index(Level.STOP)
    assert set(levels[:first]) == {Level.CLEAR, Level.AWARE, Level.SLOW}
    assert set(levels[last:]) == {Level.CLEAR, Level.AWARE, Level.SLOW}
    assert levels[-1] is Level.CLEAR
    assert np.mean([level is Level.STOP for level in levels]) < 0.6


def test_sources_are_those_that_were_asked_for():
    assert [source.name for source in nodes.make_sources(20.0, "", 0, 0)] == ["person"]
    assert len(nodes.make_sources(20.0, "", 5, 0)) == 2
    with pytest.raises(ArmguardError, match="nowhere"):
        nodes.make_sources(20.0, "/nowhere.csv", 0, 0)
