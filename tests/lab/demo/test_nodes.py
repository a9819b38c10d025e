"""The scene that the demo's nodes play, judged in one process with a clock that a test sets."""

import os
from pathlib import Path

import msgspec
import numpy as np
import pytest

from armguard import Monitor, Obstacles, Robot
from armguard.exceptions import ArmguardError
from armguard.lab.demo import nodes
from armguard.lab.demo.places import find_place
from armguard.lab.simulation import SimulatedArm, keeps_within, random_trajectory
from armguard.verdict import Level, ReasonKind

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


def test_the_same_seed_is_the_same_scene():
    first, again = ([verdict.contact_time for verdict in play(9.0, seed=3)] for _ in range(2))
    assert first == again


@pytest.mark.skipif(
    not (RECORDINGS / "hammering-0.csv").exists(),
    reason="no recordings there: set ARMGUARD_RECORDINGS to their folder",
)
def test_glitches_of_a_recording_are_refused_rows():
    verdicts = play(20.0, str(RECORDINGS / "hammering-0.csv"))
    kinds = {reason.kind for verdict in verdicts for reason in verdict.reasons}
    assert ReasonKind.OBSTACLE_REFUSED in kinds
    assert ReasonKind.INTERNAL_ERROR not in kinds


def test_nodes_go_over_the_command_line_whole():
    for node in (
        nodes.Perception(obstacles="a", verdicts="b", duration=1.5, seed=2, person="ü", balls=3),
        nodes.RobotNode(joints="a", verdicts="b", seed=1, robot="ur5"),
    ):
        wire = msgspec.json.encode(node)
        assert msgspec.json.decode(wire, type=nodes.Perception | nodes.RobotNode) == node


def test_sources_are_those_that_were_asked_for():
    assert [source.name for source in nodes.make_sources(20.0, "", 0, 0)] == ["person"]
    assert len(nodes.make_sources(20.0, "", 5, 0)) == 2
    with pytest.raises(ArmguardError, match="nowhere"):
        nodes.make_sources(20.0, "/nowhere.csv", 0, 0)


def test_an_arm_that_does_not_fit_its_place_moves_all_the_same():
    robot = Robot.load("panda")
    far = find_place("panda")._replace(lower=(8.0, 8.0, 8.0), upper=(9.0, 9.0, 9.0))
    trajectory = nodes.make_trajectory(robot, far, 0)
    assert trajectory.duration >= nodes.WORK_CYCLE
    assert (trajectory.waypoints >= robot.lower_position_limit).all()
    assert (trajectory.waypoints <= robot.upper_position_limit).all()
