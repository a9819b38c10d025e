import threading
import time

import coal
import numpy as np
import pinocchio
import pytest

from armguard.bounds import IsotropicMotion
from armguard.cover import Cover
from armguard.exceptions import RobotError
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot import Robot
from armguard.robot.attachments import AttachedBody
from armguard.robot.robot import _extend
from armguard.verdict import Level
from support.round_surfaces import surface_points
from support.surface_samples import is_inside, sample

READY = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
REST = np.zeros(7)
FLANGE = pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, 0.2]))


@pytest.fixture
def panda():
    return Robot.load("panda")


def convex():
    points = coal.StdVec_Vec3s()
    points.extend(list(0.05 * np.random.default_rng(2).normal(size=(30, 3))))
    return coal.Convex.convexHull(points, True, "Qt")


SHAPES = {
    "sphere": lambda: coal.Sphere(0.05),
    "box": lambda: coal.Box(0.1, 0.05, 0.2),
    "capsule": lambda: coal.Capsule(0.03, 0.1),
    "convex": convex,
    "triangles": lambda: np.array([[[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]]]),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_an_attached_body_is_a_proved_link(panda, shape):
    before = panda.links
    panda.attach("tool", "panda_hand", SHAPES[shape](), FLANGE)
    assert panda.links == (*before, "tool")
    assert panda.revision == 1
    assert panda.joint_index("tool") == panda.joint_index("panda_hand")
    report = panda.cover.check(panda)
    assert report.proved
    assert report.links["tool"].count <= 12
    points = sample(panda.triangles("tool"), 2000)
    if shape in ("sphere", "capsule"):  # these are covered as what they are
        points = surface_points(SHAPES[shape](), 2000) + FLANGE.translation
    for level in range(panda.cover.levels("tool")):
        assert is_inside(points, panda.cover.spheres("tool", level)).all()
    motion = IsotropicMotion(panda)
    assert np.isfinite(motion.lever).all()
    panda.detach("tool")
    assert panda.links == panda.cover.links == before
    assert panda.revision == 2


def test_a_placement_is_in_the_joints_frame(panda):
    turn = pinocchio.SE3(pinocchio.utils.rotate("x", 0.4), np.array([0.1, -0.2, 0.3]))
    panda.attach("tool", "panda_link3", coal.Box(0.02, 0.04, 0.06), turn.homogeneous)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    expected = (corners * [0.01, 0.02, 0.03]) @ turn.rotation.T + turn.translation
    assert np.abs(panda.hull("tool")[:, None] - expected).sum(axis=2).min(axis=0).max() < 1e-12


@pytest.mark.parametrize(
    ("name", "link", "geometry", "placement", "message"),
    [
        ("", "panda_hand", coal.Sphere(0.1), None, "has no name"),
        (None, "panda_hand", coal.Sphere(0.1), None, "has no name"),
        ("panda_link1", "panda_hand", coal.Sphere(0.1), None, "name of another body"),
        ("panda_link8", "panda_hand", coal.Sphere(0.1), None, "name of another body"),
        ("tool", "elbow", coal.Sphere(0.1), None, "'elbow': is not a link"),
        ("tool", "panda_link0", coal.Sphere(0.1), None, "no collision geometry that a watched"),
        ("tool", "panda_hand", coal.Sphere(-0.1), None, "has radius"),
        ("tool", "panda_hand", coal.Sphere(np.nan), None, "has radius"),
        ("tool", "panda_hand", coal.Box(0.1, 0.0, 0.1), None, "has halfSide"),
        ("tool", "panda_hand", coal.Cone(0.1, 0.1), None, "kind Cone"),
        ("tool", "panda_hand", coal.Sphere(100.0), None, "reaches .* metres"),
        ("tool", "panda_hand", "a box", None, "geometry of type str"),
        ("tool", "panda_hand", np.zeros((0, 3, 3)), None, "triangles of shape"),
        ("tool", "panda_hand", np.zeros((3, 3)), None, "triangles of shape"),
        ("tool", "panda_hand", np.full((1, 3, 3), np.inf), None, "not finite"),
        ("tool", "panda_hand", coal.Sphere(0.1), np.eye(3), "expected finite, of shape"),
        ("tool", "panda_hand", coal.Sphere(0.1), 2.0 * np.eye(4), "a rigid motion"),
        ("tool", "panda_hand", coal.Sphere(0.1), np.diag([1.0, 1, -1, 1]), "a rigid motion"),
        ("tool", "panda_hand", coal.Sphere(0.1), np.full((4, 4), np.nan), "expected finite"),
        ("tool", "panda_hand", np.full((1, 3, 3), 1e308), None, "reaches 1e[+]308 m from"),
        ("tool", "panda_hand", coal.Sphere(0.1), 1e300 * np.eye(4), "a rigid motion"),
        ("tool", ["panda_hand"], coal.Sphere(0.1), None, "is not a link of panda"),
        ("tool", "panda_hand", coal.Sphere(0.1), "up", "has placement 'up'"),
    ],
)
def test_hostile_attachments_are_refused_and_change_nothing(
    panda, name, link, geometry, placement, message
):
    before = panda.links
    with pytest.raises(RobotError, match=message):
        panda.attach(name, link, geometry, placement)
    assert panda.links == panda.cover.links == before
    assert panda.revision == 0


def reach(panda):
    """A monitor beside a wall that only a long tool can be near to."""
    obstacles = Obstacles(sources=[])
    hand = panda.model.createData()
    pinocchio.forwardKinematics(panda.model, hand, READY)
    tip = hand.oMi[7].act(np.array([0.0, 0.0, 1.0]))
    obstacles.add_static("wall", [tip], 0.05)
    return obstacles


@pytest.mark.parametrize("schedule", ["full", "daa"])
def test_a_running_monitor_takes_in_what_is_attached(panda, schedule):
    obstacles = reach(panda)
    monitor = Monitor(panda, obstacles, schedule=schedule, rise_delay=0.0, joint_timeout=10.0)
    alone = [monitor.step(0.001 * tick, READY, REST) for tick in range(4)]
    assert alone[-1].contact_time > 0.0
    bar = pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, 0.6]))
    panda.attach("bar", "panda_hand", coal.Box(0.04, 0.04, 0.9), bar)
    during = monitor.step(0.004, READY, REST)
    assert during.level is Level.STOP
    assert during.complete
    assert (during.link, during.contact_time) == ("bar", 0.0)
    assert during.evaluated >= len(panda.links)
    fresh = Monitor(panda, reach(panda), schedule=schedule, rise_delay=0.0)
    assert fresh.step(0.0, READY, REST).contact_time == 0.0
    snapshot = monitor.snapshot(pair_limit=5, row_limit=5)
    leaves = sum(len(panda.cover.spheres(link)) for link in panda.links)
    assert len(snapshot.sphere_times) == leaves
    panda.detach("bar")
    assert {report.link for report in monitor.pairs()} >= {"bar"}
    after = [monitor.step(0.005 + 0.001 * tick, READY, REST) for tick in range(4)]
    assert after[0].contact_time == pytest.approx(alone[0].contact_time, rel=1e-12)
    assert after[-1].level == alone[-1].level


def test_of_bodies_that_two_threads_attach_at_once_none_is_lost(panda, monkeypatch):
    def linger(cover, other):
        time.sleep(0.05)
        return _extend(cover, other)

    monkeypatch.setattr("armguard.robot.robot._extend", linger)
    fitted = Cover.fit(AttachedBody("any", coal.Box(0.1, 0.1, 0.1), None), spheres=1)

    def fit(body, spheres):
        (name,) = body.links
        return Cover({name: fitted.tree("any")}, {name: fitted.digest("any")})

    monkeypatch.setattr("armguard.robot.robot.Cover.fit", fit)
    before, names = panda.links, [f"part{k}" for k in range(4)]
    box = coal.Box(0.1, 0.1, 0.1)
    threads = [
        threading.Thread(target=panda.attach, args=(name, "panda_hand", box)) for name in names
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert set(panda.links) == set(panda.cover.links) == {*before, *names}
    assert panda.revision == len(names)
