"""A simulated arm follows a shield's commands, and its contacts are found."""

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the extra `mujoco` simulates the arm")

from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.pairs.hull_distance import HullDistance
from armguard.robot import Kinematics, OperatingLimits, Robot
from armguard.shield import Path, Shield
from support.panda_monitor import HOME

PERIOD = 0.004


@pytest.fixture
def benchmark(load, recordings):
    return load("bench_shield_loop")


def make_arm(load, *, position, velocity):
    stated = load("scene.shielded").Following(PERIOD, position, velocity)
    return load("scene.simulated_arm").SimulatedArm(Robot.load("panda"), PERIOD, stated, [0])


def follow(arm, *, seconds, way=0.5):
    """Go along a path with nobody near: how far that is, and velocities after each step."""
    robot = Robot.load("panda")
    operating = OperatingLimits.fraction(robot, velocity=0.4, acceleration=0.25)
    monitor = Monitor(
        robot, Obstacles(sources=[]), rate=1.0 / PERIOD, latency=PERIOD, motion="planned",
        operating=operating,
    )  # fmt: skip
    shield = Shield(
        monitor, jerk=500.0, rate=1.0 / PERIOD, tracking_error=0.05, velocity_tracking_error=1.0
    )
    shield.set_path(Path([HOME, HOME + way]))
    arm.start(HOME)
    speeds = []
    for tick in range(round(seconds / PERIOD)):
        arm.take(shield.step(tick * PERIOD, *arm.measured), tick * PERIOD)
        for look in range(arm.looks):
            arm.advance(tick * PERIOD + (look + 1) * PERIOD / arm.looks)
        speeds.append(arm.state[1])
    return shield.progress, np.array(speeds)


def test_an_arm_with_a_mass_follows_its_commands(load):
    arm = make_arm(load, position=0.01, velocity=0.1)
    progress, speeds = follow(arm, seconds=1.5)
    assert progress > 0.3
    assert np.abs(speeds).max() > 0.2
    assert arm.moves
    # As closely as its encoders tell it, and no more closely: it does not know all of its forces.
    robot = Robot.load("panda")
    assert (arm.seen[0] > 0.5 * robot.position_error).all()
    assert arm.share < 1.0
    assert arm.steps_off == 0


def test_an_arm_that_has_come_to_rest_does_not_move(load):
    """Though its controller answers what its encoders are off by."""
    arm = make_arm(load, position=0.01, velocity=0.1)
    progress, speeds = follow(arm, seconds=1.0, way=0.02)
    assert progress == 1.0
    assert not arm.moves
    assert speeds[-1].any()


def test_steps_with_greater_errors_than_stated_are_counted(load):
    arm = make_arm(load, position=1e-6, velocity=1e-6)
    follow(arm, seconds=1.5)
    assert arm.share > 1.0
    assert arm.steps_off > 0


def test_an_arm_takes_up_a_command_after_its_latency(load):
    arm = make_arm(load, position=0.01, velocity=0.1)
    _, speeds = follow(arm, seconds=0.2)
    still = make_arm(load, position=0.01, velocity=0.1)
    still.start(HOME)
    for look in range(arm.looks):
        still.advance((look + 1) * PERIOD / arm.looks)
    assert not still.moves
    # In the first step nothing has arrived yet.
    np.testing.assert_allclose(speeds[0], still.state[1])
    assert np.abs(speeds[-1]).max() > 0.01


def test_distances_are_those_of_exact_hulls(load):
    arm, robot = make_arm(load, position=0.01, velocity=0.1), Robot.load("panda")
    people, near = load("scene.recorded_people"), load("scene.simulated_arm").NEAR
    random, kinematics = np.random.default_rng(0), Kinematics(robot)
    exact = HullDistance(robot, kinematics)
    apart = touching = 0
    for _ in range(40):
        q = random.uniform(robot.lower_position_limit, robot.upper_position_limit)
        arm.start(q)
        kinematics.compute(q, np.zeros(len(q)))
        low, high = [-0.7, -0.7, -0.3], [0.7, 0.7, 1.1]
        middles = random.uniform(low, high, (len(people.NAMES), 1, 3))
        ends = middles + random.normal(scale=0.1, size=(len(people.NAMES), 2, 3))
        for gap, points, radius in zip(arm.find_gaps(ends), ends, people.RADII, strict=True):
            true = min(exact.distance(link, points, radius)[0] for link in range(len(robot.links)))
            apart += 0.0 < true < near
            touching += true <= 0.0
            if true > 0.0:
                assert gap == pytest.approx(min(true, near), abs=1e-4)
            else:
                assert gap <= 0.0
    assert min(apart, touching) > 10


def test_a_short_run(benchmark, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(benchmark, "PLACES", ((0.5, 0.0),))
    monkeypatch.setattr(benchmark, "DRILLS", 1)
    monkeypatch.setattr(benchmark, "DRILL_SECONDS", 1.0)
    page = tmp_path / "page.md"
    short = "--arms panda --speeds 0.8 --ages 0 --seconds 1 --placements 1 --recordings 1 --out"
    kept = tmp_path / "rows"
    arguments = [*short.split(), str(page), "--rows", str(kept)]
    rows = benchmark.main(arguments)
    text = page.read_text(encoding="utf-8")
    control, *shown = rows
    assert control.setting is None
    assert len(shown) == 2
    assert control.played.contacts
    for row in shown:
        assert row.played.missed == row.steps_off == 0
        assert 0.0 < row.share < 1.0
        assert row.played.progress < row.free
    # What was found already is not played again.
    monkeypatch.setattr(benchmark, "play_case", None)
    assert len(benchmark.main(arguments)) == len(rows)
    told, tables = text.split("\nAll figures: ")
    assert told in capsys.readouterr().out
    assert "shown-nobody.csv" in tables
