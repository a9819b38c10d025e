"""Geoms are contained and move as told, joints are read by name, and the arm is the same arm."""

import types

import numpy as np
import pinocchio
import pytest

from armguard import Monitor, Obstacles, Robot
from armguard.exceptions import ArmguardError
from armguard.verdict import Level

mujoco = pytest.importorskip("mujoco", reason="the extra mujoco is not installed")
from armguard.bridges.mujoco import (  # noqa: E402
    MujocoJoints,
    MujocoObstacles,
    add_arm,
    enclose_geom,
    find_renderer,
)

G = mujoco.mjtGeom
READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
RANDOM = np.random.default_rng(1)
PYRAMID = np.array([[0, 0, 0], [0.4, 0, 0], [0, 0.3, 0], [0.1, 0.1, 0.5]], float)
CLOUD = RANDOM.normal(size=(40, 3)) * [0.3, 0.1, 0.2]

SHAPES = {
    "ball": (G.mjGEOM_SPHERE, [0.1, 0, 0]),
    "capsule": (G.mjGEOM_CAPSULE, [0.1, 0.3, 0]),
    "crate": (G.mjGEOM_BOX, [0.1, 0.2, 0.3]),
    "egg": (G.mjGEOM_ELLIPSOID, [0.1, 0.2, 0.3]),
    "pipe": (G.mjGEOM_CYLINDER, [0.05, 0.5, 0]),
    "disc": (G.mjGEOM_CYLINDER, [0.3, 0.02, 0]),
    "pyramid": (G.mjGEOM_MESH, None),
    "rock": (G.mjGEOM_MESH, None),
}


@pytest.fixture(scope="module")
def panda():
    return Robot.load("panda")


def make_bodies(spec):
    """One free body for each shape, and one on a mocap body, one that is fixed."""
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.add_mesh(name="pyramid", uservert=PYRAMID.ravel())
    spec.add_mesh(name="rock", uservert=CLOUD.ravel())
    for place, (name, (kind, size)) in enumerate(SHAPES.items()):
        body = spec.worldbody.add_body(
            name=name, pos=[2.0 * place, 5.0, 1.0]
        )  # clear of the others
        body.add_freejoint()
        shape = {"meshname": name} if size is None else {"size": size}
        body.add_geom(name=name, type=kind, pos=[0.1, 0.2, -0.1], quat=[0.8, 0.6, 0, 0], **shape)
    placed = spec.worldbody.add_body(name="placed", mocap=True, pos=[3.0, 0.0, 0.0])
    placed.add_geom(type=G.mjGEOM_SPHERE, size=[0.1, 0, 0])
    wall = spec.worldbody.add_body(name="wall", pos=[0.0, 3.0, 0.0])
    wall.add_geom(type=G.mjGEOM_BOX, size=[1.0, 0.1, 1.0])
    return [*SHAPES, "placed", "wall"]


@pytest.fixture(scope="module")
def bodies():
    spec = mujoco.MjSpec()
    names = make_bodies(spec)
    return spec.compile(), names


def support(model, geom, directions):
    """How far a geom reaches along directions in its own frame, from its definition, in [m]."""
    kind, size = G(model.geom_type[geom]), model.geom_size[geom]
    if kind == G.mjGEOM_SPHERE:
        return np.full(len(directions), size[0])
    if kind == G.mjGEOM_CAPSULE:
        return size[0] + size[1] * np.abs(directions[:, 2])
    if kind == G.mjGEOM_BOX:
        return np.abs(directions) @ size
    if kind == G.mjGEOM_ELLIPSOID:
        return np.linalg.norm(directions * size, axis=1)
    if kind == G.mjGEOM_CYLINDER:
        return size[0] * np.hypot(*directions[:, :2].T) + size[1] * np.abs(directions[:, 2])
    first = model.mesh_vertadr[model.geom_dataid[geom]]
    count = model.mesh_vertnum[model.geom_dataid[geom]]
    return (directions @ model.mesh_vert[first : first + count].T).max(axis=1)


@pytest.mark.parametrize("name", SHAPES)
def test_a_shape_contains_its_geom(bodies, name):
    """A convex body lies in another one if it reaches no farther along any direction."""
    model, _ = bodies
    geom = model.geom(name).id
    shape = enclose_geom(model, geom)
    assert 1 <= len(shape.points) <= 8
    axes = np.vstack([np.eye(3), -np.eye(3)])
    directions = np.vstack([axes, RANDOM.normal(size=(5000, 3))])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    reach = (directions @ shape.points.T).max(axis=1) + shape.radius
    told = support(model, geom, directions)
    assert (reach >= told).all()
    if name in ("ball", "capsule", "crate", "pyramid"):  # which are such hulls themselves
        assert (reach <= told + 1e-8).all()
    assert (reach <= 2.0 * told.max()).all()


def test_a_pipe_is_a_capsule_and_a_disc_a_box(bodies):
    model, _ = bodies
    counts = [len(enclose_geom(model, model.geom(name).id).points) for name in ("pipe", "disc")]
    assert counts == [2, 8]


def test_points_move_as_told(bodies):
    """Velocities are the differences of positions over a short time."""
    model, names = bodies
    data = mujoco.MjData(model)
    data.qvel[:] = np.random.default_rng(2).normal(size=model.nv)
    source = MujocoObstacles(model, names)
    step, later = 1e-6, mujoco.MjData(model)
    later.qpos[:] = data.qpos
    mujoco.mj_integratePos(model, later.qpos, data.qvel, step)
    for now, then in zip(source.read(data), source.read(later), strict=True):
        assert now.ids == then.ids
        if now.ids == ["placed/0"]:
            assert now.velocity is None
        else:
            np.testing.assert_allclose(
                (then.position - now.position) / step, now.velocity, atol=1e-4
            )
            assert np.abs(now.velocity).max() > 0.1


def test_reading_is_of_the_present_and_leaves_the_simulation_alone(bodies):
    model, names = bodies
    source = MujocoObstacles(model, names)
    plain, read = mujoco.MjData(model), mujoco.MjData(model)
    for data in (plain, read):
        data.qvel[:] = np.random.default_rng(3).normal(size=model.nv)
    for _ in range(20):
        mujoco.mj_step(model, plain)
        mujoco.mj_step(model, read)
        stale = read.geom_xpos.copy()
        source.read(read)
    assert (read.qpos == plain.qpos).all()
    assert np.abs(read.geom_xpos - stale).max() > 1e-4
    mujoco.mj_kinematics(model, plain)
    assert (read.geom_xpos == plain.geom_xpos).all()


def test_a_table_takes_all_of_it_for_one_source(bodies):
    model, names = bodies
    data = mujoco.MjData(model)
    data.qvel[:] = 0.2
    obstacles, source = Obstacles(), MujocoObstacles(model, names, source="world")
    source.add_statics(obstacles, data)
    for _ in range(5):
        source.publish(obstacles, data, data.time)
        mujoco.mj_step(model, data)
    assert not obstacles.take_faults()
    assert sorted(source.ids) == sorted([*SHAPES, "placed/0"])
    assert obstacles.count_of("world") == len(source.ids)
    with pytest.raises(ArmguardError, match="wall/0"):
        source.add_statics(obstacles, data)  # it is there already


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda body: body.add_geom(name="floor", type=G.mjGEOM_PLANE, size=[1, 1, 1]), "floor"),
        (lambda body: None, "has no geom that can collide"),
        (
            lambda body: body.add_geom(
                type=G.mjGEOM_SPHERE, size=[1, 0, 0], contype=0, conaffinity=0
            ),
            "has no geom that can collide",
        ),
    ],
)
def test_what_cannot_be_an_obstacle_is_refused_by_name(make, words):
    spec = mujoco.MjSpec()
    make(spec.worldbody.add_body(name="thing"))
    with pytest.raises(ArmguardError, match=words):
        MujocoObstacles(spec.compile(), ["thing"])


def test_the_world_stands_for_what_is_fixed_to_it_alone():
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(name="post", type=G.mjGEOM_BOX, size=[0.1, 0.1, 1.0])
    spec.worldbody.add_body(name="thing").add_geom(type=G.mjGEOM_SPHERE, size=[1, 0, 0])
    model, obstacles = spec.compile(), Obstacles()
    source = MujocoObstacles(model, ["world"])
    source.add_statics(obstacles, mujoco.MjData(model))
    assert source.ids == []
    assert [name for name in obstacles.ids if name] == ["post"]


def test_a_body_that_is_not_there_is_refused_by_name(bodies):
    with pytest.raises(ArmguardError, match=r"'ghost'.*crate"):
        MujocoObstacles(bodies[0], ["ghost"])


@pytest.mark.parametrize("name", ["panda", "ur5", "kinova"])
def test_the_arm_is_the_arm_of_the_robot(name):
    robot = Robot.load(name)
    spec = mujoco.MjSpec()
    add_arm(spec, robot)
    model = spec.compile()
    data, mirror = mujoco.MjData(model), robot.model.createData()
    joints = MujocoJoints(model, robot)
    for _ in range(5):
        low = np.maximum(robot.lower_position_limit, -3.0)
        q = RANDOM.uniform(low, np.minimum(robot.upper_position_limit, 3.0))
        data.qpos[:], data.qvel[:] = q, RANDOM.normal(size=len(q))
        mujoco.mj_forward(model, data)
        assert (joints.read(data)[0] == q).all()
        assert (joints.read(data)[1] == data.qvel).all()
        pinocchio.forwardKinematics(robot.model, mirror, q)
        for joint in range(1, robot.model.njoints):
            place, body = mirror.oMi[joint], data.body(robot.model.names[joint])
            np.testing.assert_allclose(body.xpos, place.translation, atol=1e-6)
            np.testing.assert_allclose(body.xmat.reshape(3, 3), place.rotation, atol=1e-6)
        torque = pinocchio.nonLinearEffects(robot.model, mirror, q, np.array(data.qvel))
        np.testing.assert_allclose(data.qfrc_bias, torque, atol=1e-5, rtol=1e-5)


def make_arm(panda, change):
    spec = mujoco.MjSpec()
    add_arm(spec, panda)
    change(spec)
    return spec.compile()


def add_finger(spec):
    hand = spec.body("panda_joint7").add_body(name="finger", mass=1.0, inertia=[1.0, 1.0, 1.0])
    hand.explicitinertial = True
    hand.add_joint(name="finger", type=mujoco.mjtJoint.mjJNT_SLIDE)


def test_joints_that_do_not_fit_are_refused_by_name(panda):
    def rename(spec):
        spec.joint("panda_joint3").name = "third"

    def slide(spec):
        spec.joint("panda_joint3").type = mujoco.mjtJoint.mjJNT_SLIDE

    with pytest.raises(ArmguardError, match=r"'panda_joint3'.*not in the model.*third"):
        MujocoJoints(make_arm(panda, rename), panda)
    with pytest.raises(ArmguardError, match=r"'panda_joint3'.*SLIDE.*HINGE"):
        MujocoJoints(make_arm(panda, slide), panda)
    with pytest.raises(ArmguardError, match=r"'finger'.*lacks it"):
        MujocoJoints(make_arm(panda, add_finger), panda)
    model = make_arm(panda, add_finger)
    q, v = MujocoJoints(model, panda, held=["finger"]).read(mujoco.MjData(model))
    assert q.shape == v.shape == (7,)


def test_an_arm_that_is_elsewhere_is_refused_by_joint(panda):
    def move(spec):
        spec.body("panda_joint1").pos = [5.0, 0.0, 0.333]

    def lengthen(spec):
        spec.body("panda_joint4").pos[0] += 0.002

    def count_from_elsewhere(spec):
        spec.joint("panda_joint2").ref = 0.5  # in degrees

    def turn_back(spec):
        spec.joint("panda_joint7").axis = [0.0, 0.0, -1.0]

    for change, words in (
        (move, r"'panda_joint1'.*axis 5 m and 0 rad off"),
        (lengthen, r"'panda_joint4'.*0.002 m"),
        (count_from_elsewhere, r"'panda_joint3'.*0.00873 rad"),
        (turn_back, r"'panda_joint7'.*3.14 rad"),
    ):
        with pytest.raises(ArmguardError, match=words):
            MujocoJoints(make_arm(panda, change), panda)
    placement = pinocchio.SE3(np.eye(3), np.array([5.0, 0.0, 0.0]))
    MujocoJoints(make_arm(panda, move), panda, base_placement=placement)
    with pytest.raises(ArmguardError, match=r"'panda_joint1'.*5 m"):
        MujocoJoints(make_arm(panda, lambda spec: None), panda, base_placement=placement)


def test_an_arm_on_a_mocap_body_is_refused(panda):
    spec = mujoco.MjSpec()
    cart = spec.worldbody.add_body(name="cart", mocap=True)
    add_arm(types.SimpleNamespace(worldbody=cart, add_mesh=spec.add_mesh), panda)
    with pytest.raises(ArmguardError, match=r"'cart'.*mocap"):
        MujocoJoints(spec.compile(), panda)


def test_bodies_beside_the_arm_are_no_joints_of_it(panda):
    def add_ball(spec):
        spec.worldbody.add_body(name="ball", mass=1.0, inertia=[1, 1, 1]).add_freejoint()

    MujocoJoints(make_arm(panda, add_ball), panda)


def test_a_monitor_stops_an_arm_for_what_a_simulation_throws_at_it(panda):
    spec = mujoco.MjSpec()
    spec.option.gravity = [0.0, 0.0, 0.0]
    add_arm(spec, panda)
    ball = spec.worldbody.add_body(name="ball", pos=[3.0, 0.0, 0.6])
    ball.add_freejoint()
    ball.add_geom(type=G.mjGEOM_SPHERE, size=[0.1, 0, 0])
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:7], data.qvel[7] = READY, -1.5
    joints, source, obstacles = (
        MujocoJoints(model, panda),
        MujocoObstacles(model, ["ball"]),
        Obstacles(),
    )
    monitor = Monitor(panda, obstacles, rate=100.0)
    levels = []
    for _ in range(150):
        source.publish(obstacles, data, data.time)
        levels.append(monitor.step(data.time, *joints.read(data)).level)
        for _ in range(5):
            data.qfrc_applied[:7] = data.qfrc_bias[:7]
            mujoco.mj_step(model, data)
    assert levels[0] == Level.CLEAR
    assert levels[-1] == Level.STOP


def test_a_renderer_is_named_where_there_is_one(monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    assert find_renderer() in ("egl", "osmesa", None)
    monkeypatch.setenv("MUJOCO_GL", "disabled")
    assert find_renderer() is None
