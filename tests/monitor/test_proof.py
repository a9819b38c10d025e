import json

import numpy as np
import pytest

from armguard.monitor import Monitor
from armguard.monitor.proof import Prover
from armguard.obstacles import Obstacles
from armguard.robot import Robot
from armguard.verdict import BRAKE, FINISH, Level
from armguard_check import verify
from support.panda_monitor import HOME, PERIOD, STILL, panda, ranged_panda
from support.permitted_contact import Encounter
from support.proof_scenes import make_scene
from support.urdf_arms import limits_for, two_links


def check(proof):
    return verify(json.loads(proof.to_json()))


def make(**settings):
    obstacles = Obstacles(sources=["camera"], accel=10.0, speed=1.6)
    return Monitor(panda(), obstacles, rise_delay=0.0, **settings), obstacles


def see(obstacles, tick, x, *, speed=0.0):
    obstacles.update(
        ["hand"], tick * PERIOD, [[x, 0.0, 0.5]], [[-speed, 0.0, 0.0]], source="camera", radius=0.1
    )


@pytest.mark.parametrize(
    ("x", "level", "told"),
    [(2.2, "CLEAR", "next"), (1.25, "AWARE", "next"), (0.58, "STOP", "this")],
)
def test_each_level_is_proved(x, level, told):
    monitor, obstacles = make()
    see(obstacles, 0, x)
    verdict = monitor.step(0.0, HOME, np.full(7, 0.05))
    assert verdict.level.name == level
    proof = monitor.prove(verdict)
    assert (proof.level, proof.link, proof.obstacle) == (level, verdict.link, verdict.obstacle)
    free, stop = proof.motions
    assert (free.told, stop.told) == ("never", told)
    proved = check(proof)
    # Other intervals of time, and a second at most.
    assert proved.contact_time >= 0.9 * min(verdict.contact_time, 1.0)
    assert proved.in_time or level == "STOP"
    if told == "next":
        assert stop.times[-1] == pytest.approx(verdict.stop_time, rel=1e-6)
    else:
        assert stop.times[-1] <= verdict.stop_time - monitor.period


def test_proofs_change_nothing_that_follows():
    verdicts = []
    for proves in (False, True):
        monitor, obstacles = make()
        said = []
        for tick in range(200):
            if tick % 10 == 0:
                see(obstacles, tick, 1.6 - 0.004 * tick, speed=0.4)
            said.append(monitor.step(tick * PERIOD, HOME, STILL))
            if proves and tick % 7 == 0:
                assert check(monitor.prove(said[-1])).contact_time > 0.0
            said.append(str(monitor.pairs(4)))
        verdicts.append(said)
    assert verdicts[0] == verdicts[1]


def test_a_body_that_passes_by_is_kept_apart():
    # It could turn round well before the arm rests, but not reach it.
    # Not the scene that random ones share: its table has later times.
    monitor, obstacles, _ = make_scene.__wrapped__("tiago", touches=False)
    obstacles.update(
        ["it"],
        1.0,
        [[[-1.09, 1.551, -0.291], [-1.245, 1.47, -0.293]]],
        [[[0.104, 0.829, 1.162]] * 2],
        source="camera",
        radius=0.2,
        accel=2.0,
        speed=1.6,
    )
    q = np.array([0.349, 2.4, -0.11, -2.245, 1.345, -1.85, -0.199, -0.22])
    verdict = monitor.step(1.02, q, np.zeros(8))
    assert verdict.level.name in ("AWARE", "CLEAR")
    assert check(monitor.prove(verdict)).in_time


def test_a_slow_surface_is_proved_to_be_slow():
    encounter = Encounter(0.03)
    encounter.v = np.full(7, 0.02)
    encounter.see()
    verdict = encounter.step()
    assert verdict.contact_speed > 0.0
    proof = encounter.monitor.prove(verdict)
    assert proof.max_speed == pytest.approx(0.8, rel=0.01)
    assert check(proof).in_time


def test_nothing_is_proved_where_nothing_is_said():
    monitor, obstacles = make()
    verdict = monitor.step(0.0, HOME, STILL)
    assert monitor.prove(verdict) is None  # no pair
    see(obstacles, 0, 1.5)
    verdict = monitor.step(PERIOD, HOME, STILL)
    assert monitor.prove(verdict._replace(sequence=7)) is None
    assert monitor.prove(verdict) is not None
    obstacles.remove(["hand"], source="camera")
    assert monitor.prove(verdict) is None
    see(obstacles, 2, 1.5)
    verdict = monitor.step(3 * PERIOD, HOME, STILL, 2 * PERIOD)
    assert monitor.prove(verdict) is None  # newer than its tick
    verdict = monitor.step(4 * PERIOD, HOME * np.nan, STILL)
    assert monitor.prove(verdict) is None
    monitor.reset()
    assert monitor.prove(verdict) is None


@pytest.mark.parametrize(
    "change",
    [
        lambda monitor, obstacles: see(obstacles, 2, 1.51),
        lambda monitor, obstacles: see(obstacles, 2, 0.9),  # refused, and may be true
        lambda monitor, obstacles: obstacles.update(  # for which the table grows
            ["hand", *map(str, range(300))],
            2 * PERIOD,
            [[1.51, 0.0, 0.5]] * 301,
            source="camera",
            radius=0.1,
        ),
        lambda monitor, obstacles: setattr(monitor, "payload", 0.0),
    ],
)
def test_what_was_learnt_since_is_not_proved_of_the_verdict(change):
    obstacles = Obstacles(sources=["camera"], accel=10.0, speed=1.6)
    monitor = Monitor(ranged_panda(), obstacles, rise_delay=0.0)
    see(obstacles, 1, 1.5)
    verdict = monitor.step(PERIOD, HOME, STILL)
    assert check(monitor.prove(verdict)).contact_time > 0.0
    obstacles.update(["else"], 2 * PERIOD, [[3.0, 0.0, 0.5]], source="camera", radius=0.1)
    assert monitor.prove(verdict) is not None
    change(monitor, obstacles)
    assert monitor.prove(verdict) is None
    assert monitor.prove(monitor.step(2 * PERIOD, HOME, STILL)) is not None


def test_an_arm_that_is_to_finish_its_piece_is_not_proved_to_brake():
    monitor, obstacles = make()
    see(obstacles, 0, 1.5)
    verdict = monitor.step(0.0, HOME, STILL)._replace(level=Level.STOP, stop=BRAKE)
    assert [one.told for one in monitor.prove(verdict).motions] == ["never", "this"]
    verdict = verdict._replace(stop=FINISH)
    assert [one.told for one in monitor.prove(verdict).motions] == ["never"]


def test_each_state_that_may_be_true_is_proved():
    monitor, obstacles = make()
    see(obstacles, 0, 1.5)
    monitor.step(0.0, HOME, STILL)
    obstacles.update(
        ["hand"], PERIOD, [[1.4, 0.4, 0.5]], [[0.0, 0.0, 0.0]], source="camera", radius=0.1
    )
    verdict = monitor.step(PERIOD, HOME, STILL)
    proof = monitor.prove(verdict)
    assert len(proof.states) == 2
    assert {one.state for one in proof.motions[0].separations} == {0, 1}
    assert check(proof).contact_time > 0.0


def test_it_follows_the_payload():
    obstacles = Obstacles(sources=["camera"], accel=10.0, speed=1.6)
    monitor = Monitor(ranged_panda(), obstacles, rise_delay=0.0)
    digests = []
    for tick, payload in enumerate((0.0, None)):
        monitor.payload = payload
        see(obstacles, tick, 1.5)
        proof = monitor.prove(monitor.step(tick * PERIOD, HOME, STILL))
        check(proof)
        digests.append(proof.arm.digest)
    assert digests[0] != digests[1]


def test_it_follows_a_table_that_grows():
    monitor, obstacles = make()
    for tick, count in enumerate((1, 300)):
        places = [[1.5 + 0.01 * k, 0.0, 0.5] for k in range(count)]
        names = [f"it{k}" for k in range(count)]
        obstacles.update(names, tick * PERIOD, places, source="camera", radius=0.1)
        verdict = monitor.step(tick * PERIOD, HOME, STILL)
        proof = monitor.prove(verdict)
        assert proof.obstacle == verdict.obstacle
        assert check(proof).contact_time > 0.0


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_an_arm_of_one_joint_is_proved(kind, tmp_path):
    robot = Robot.from_urdf(two_links(tmp_path, kind=kind), limits=limits_for("shoulder"))
    obstacles = Obstacles(sources=["camera"], accel=10.0, speed=1.6)
    monitor = Monitor(robot, obstacles, rise_delay=0.0)
    q, v = np.array([0.4]), np.array([-0.3])
    levels = set()
    for tick, x in enumerate((3.0, 0.6, 0.3)):
        obstacles.update(["it"], tick * PERIOD, [[x, 0.0, 0.5]], source="camera", radius=0.1)
        verdict = monitor.step(tick * PERIOD, q, v)
        levels.add(verdict.level.name)
        proved = check(monitor.prove(verdict))
        assert proved.in_time or verdict.level.name == "STOP"
        assert proved.contact_time >= 0.8 * min(verdict.contact_time, 1.0)
    assert len(levels) > 1


def test_where_neither_motion_can_be_proved_there_is_no_proof(monkeypatch):
    monitor, obstacles = make()
    see(obstacles, 0, 1.5)
    verdict = monitor.step(0.0, HOME, STILL)
    for name in ("_prove_free", "_prove_stop"):
        assert monitor.prove(verdict) is not None
        monkeypatch.setattr(Prover, name, lambda *_: None)
    assert monitor.prove(verdict) is None
