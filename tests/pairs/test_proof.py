import numpy as np
import pytest

import armguard
from armguard.contact import verify

READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]


@pytest.fixture(scope="module")
def robot():
    return armguard.Robot.load("panda")


def judge(robot, schedule, position, velocity, **options):
    obstacles = armguard.Obstacles()
    monitor = armguard.Monitor(robot, obstacles, certify=True, schedule=schedule)
    obstacles.update(["it"], -0.004, position, velocity, radius=0.1, **options)
    return monitor, monitor.step(0.0, READY, np.full(7, 0.1), 0.001)


@pytest.mark.parametrize("schedule", ["deadline", "full", "daa"])
@pytest.mark.parametrize(
    ("position", "velocity"),
    [
        ([[1.8, 0.2, 0.6]], [[-1.0, 0.0, 0.0]]),
        ([[-1.5, 1.0, 0.2]], [[0.5, 0.0, 1.0]]),
        ([[[1.8, 0.2, 0.6], [1.8, 0.4, 0.9]]], [[[-1.0, 0.0, 0.0], [-1.0, 0.1, 0.0]]]),
        ([[6.0, 0.0, 0.5]], [[0.0, 0.0, 0.0]]),
    ],
)
def test_the_certificate_proves_the_verdicts_time(robot, schedule, position, velocity):
    monitor, verdict = judge(robot, schedule, position, velocity, velocity_error=0.05)
    assert verify(verdict.certificate, **monitor.certificate_inputs)
    # Deadlines end a little early, and daa may prove a later time by an exact distance.
    assert verdict.certificate.contact_time >= verdict.contact_time * (1.0 - 1e-9) > 0.0
    later = verdict.certificate._replace(contact_time=1.5 * verdict.certificate.contact_time)
    assert not verify(later, **monitor.certificate_inputs)


def test_nothing_is_attached_unless_asked_for(robot):
    obstacles = armguard.Obstacles()
    monitor = armguard.Monitor(robot, obstacles)
    obstacles.update(["it"], 0.0, [[3.0, 0.0, 0.5]], [[0.0, 0.0, 0.0]], radius=0.1)
    assert monitor.step(0.0, READY, np.zeros(7)).certificate is None
    assert monitor.certificate_inputs is None


def test_nothing_is_attached_where_nothing_can_be_proved(robot):
    obstacles = armguard.Obstacles()
    monitor = armguard.Monitor(robot, obstacles, certify=True)
    assert monitor.step(0.0, READY, np.zeros(7)).certificate is None
    obstacles.update(["it"], 0.0, [[np.nan, 0.0, 0.5]], [[0.0, 0.0, 0.0]], radius=0.1)
    assert monitor.step(0.001, READY, np.zeros(7)).certificate is None
    assert monitor.step(np.nan, READY, np.zeros(7)).certificate is None
    assert monitor.certificate_inputs is None


@pytest.mark.parametrize("place", [[1.2, 0.2, 0.6], [4.0, 0.2, 0.6]])
def test_of_tracks_that_may_be_true_the_sooner_one_is_proved(robot, place):
    monitor, verdict = judge(robot, "deadline", [[1.8, 0.2, 0.6]], [[0.0, 0.0, 0.0]])
    assert verdict.certificate is not None
    monitor.obstacles.update(["it"], 0.001, [place], [[0.0, 0.0, 0.0]], radius=0.1)
    later = monitor.step(0.001, READY, np.full(7, 0.1))
    assert later.obstacle == "it"
    assert monitor.certificate_inputs["p2"].tolist() == [[min(1.8, place[0]), 0.2, 0.6]]
    assert verify(later.certificate, **monitor.certificate_inputs)
    assert later.certificate.contact_time <= verdict.certificate.contact_time


def own_radius(state, about):
    """Of what is certified, a sphere or a ball that cannot be left, with the arm's own error."""
    arm = state.arm
    balls = np.vstack([arm.link_balls, arm.arm_ball])
    places = np.vstack([arm.centers, balls[:, :3]])
    radii = np.concatenate([state.tree.radius + arm.position_error, balls[:, 3]])
    return radii[np.abs(places - about["p1"]).sum(axis=1).argmin()]


@pytest.mark.parametrize(("distance", "moves"), [(1.0, True), (4.0, False)])
def test_errors_ages_and_margin_are_part_of_what_is_proved(robot, distance, moves):
    """Against a sphere of the arm, or against a ball that the arm cannot leave."""
    for margin, radius, error in ((0.0, 0.0, 0.05), (0.0, 0.05, 0.0), (0.05, 0.0, 0.0)):
        obstacles = armguard.Obstacles()
        monitor = armguard.Monitor(robot, obstacles, certify=True, margin=margin)
        obstacles.update(
            ["it"], -0.004, [[distance, 0.2, 0.6]], [[-1.0, 0.0, 0.0]],
            radius=radius, position_error=error, velocity_error=0.03,
        )  # fmt: skip
        monitor.step(0.0, READY, np.full(7, 0.1), 0.001)
        about = monitor.certificate_inputs
        assert (about["s1"] > 0.0) == moves
        assert about["age1"] == (pytest.approx(0.001) if moves else 0.0)
        assert about["age2"] == pytest.approx(0.005)
        assert about["velocity_error2"] == 0.03
        # An error that is stated as 0 counts as a nanometre.
        needed = own_radius(monitor._scheduler.arm.state, about) + 0.05 + max(1e-9 - error, 0.0)
        assert about["contact_distance"] == pytest.approx(needed, rel=1e-12)


def test_what_never_moves_does_not_age_in_a_proof(robot):
    obstacles = armguard.Obstacles()
    monitor = armguard.Monitor(robot, obstacles, certify=True)
    obstacles.add_static("post", [0.9, 0.1, 0.6], 0.05)
    verdicts = [monitor.step(now, READY, np.full(7, 0.1)) for now in (0.0, 0.001)]
    for verdict in verdicts:
        assert verdict.obstacle == "post"
        assert verdict.certificate.contact_time > 0.0
    assert monitor.certificate_inputs["age2"] == 0.0
    assert verify(verdicts[-1].certificate, **monitor.certificate_inputs)
