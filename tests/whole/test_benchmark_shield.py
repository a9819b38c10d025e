"""The benchmark of a shield beside recorded people runs, and its rival is what it claims to be."""

import itertools

import numpy as np
import pytest

from armguard.robot import Robot

PERIOD = 0.01


def test_a_short_run(load, recordings, tmp_path):
    page = tmp_path / "page.md"
    short = "--speeds 0.8 --reactions 0.02 --ages 0 --seconds 1 --placements 1 --recordings 1"
    found = load("bench_shield").main([*short.split(), "--out", str(page)])
    tables = sorted((tmp_path / "page").iterdir())
    text = "".join(one.read_text(encoding="utf-8") for one in (page, *tables))
    assert {row.setting.bounds for row in found} == {"10 m/s², 2 m/s", "by body part"}
    for row in found:
        assert row.name in text
        assert 0.0 <= row.outcome.progress <= row.free * (1.0 + 1e-6), row.name
        assert row.outcome.jerk is None or row.outcome.jerk <= 1.0 + 1e-6, row.name
        if row.name.startswith("shield") and row.name != "shield, contact limits":
            assert row.outcome.missed == 0, row.name
    ticks = [row.outcome.ticks for row in found if row.outcome.shielded is not None]
    assert ticks[0] > 0
    assert len(set(ticks)) == 1
    assert "{" not in text


@pytest.fixture
def make_failsafe(load, recordings):
    """The rival, at a place where people stand about the arm."""
    place = load("bench_recordings").place_base(0.2, -0.6, -90.0)
    people = load("scene.recorded_people").People(recordings[0], place, {"some": (10.0, 2.0)})
    trajectory = load("bench_recordings").make_trajectory(
        Robot.load("panda"), 0.1, recordings[0], 0, 4.0
    )

    def play(**options):
        robot, shielded = Robot.load("panda"), load("scene.shielded")
        leaves = load("scene.clearance").Leaves(robot)
        limits = load("armguard.shield").MotionLimits(
            0.3 * np.ones(7), 3.0 * np.ones(7), 5.0 * np.ones(7), 500.0 * np.ones(7)
        )
        setting = load("scene.stop_rules").Setting(0.02, 0.0, "some")
        mover = load("scene.failsafe").FailsafeMover(leaves, limits, setting, PERIOD, **options)
        commands = []
        step = mover.step
        mover.step = lambda *given: commands.append(step(*given)) or commands[-1]
        arm = shielded.ExactArm(leaves)
        shown = shielded.play(mover, arm, people, trajectory, PERIOD, 0.0, 3.0)
        return shown, commands

    return play


def test_every_failsafe_motion_ends_at_rest_and_begins_where_the_last_one_is(load, make_failsafe):
    shown, commands = make_failsafe()
    assert shown.jerk <= 1.0 + 1e-6
    for command in commands:
        assert np.abs(command.v[-1]).max() <= 1e-9
    place_at = load("scene.shielded").place_at
    for last, command in itertools.pairwise(commands):
        begin = float(command.times[0])
        q, v = place_at(last, begin)
        np.testing.assert_allclose(q, command.q[0], atol=1e-6)
        np.testing.assert_allclose(v, command.v[0], atol=1e-6)


def test_beside_people_it_does_less_than_an_arm_that_obeys_nobody(make_failsafe):
    assert make_failsafe()[0].progress < make_failsafe(goes_on=True)[0].progress
