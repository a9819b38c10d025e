import math

import coal
import numpy as np
import pinocchio
import pytest

from armguard.cover.cover import Cover
from armguard.exceptions import RobotError
from armguard.robot import Robot
from armguard.robot.description import read_description
from armguard.robot.mjcf import read_mjcf
from armguard.robot.robot import read_described
from support.mjcf_arms import COMPILER, JOINTS, LOCKED, write_mjcf
from support.urdf_arms import limits_for


def make_limits():
    limits = limits_for(*JOINTS, locked=LOCKED)
    del limits["joints"]["roll"]["position"]
    return limits


@pytest.mark.parametrize(
    "compiler",
    [
        COMPILER,
        '<compiler meshdir="assets"/>',
        '<compiler angle="radian" meshdir="assets" eulerseq="XYz"/>',
        '<compiler angle="degree"/><compiler assetdir="assets" strippath="true" eulerseq="zxz"/>',
    ],
)
def test_bodies_and_geoms_are_where_mujoco_has_them(tmp_path, compiler):
    mujoco = pytest.importorskip("mujoco")
    path = write_mjcf(tmp_path, compiler=compiler)
    ours = read_mjcf(path)
    reference = mujoco.MjModel.from_xml_path(str(path))
    state, data = mujoco.MjData(reference), ours.model.createData()
    geometry_data = pinocchio.GeometryData(ours.collision_model)
    solid = [g for g in range(reference.ngeom) if reference.geom_contype[g]]
    assert len(solid) == ours.collision_model.ngeoms == 9
    rng = np.random.default_rng(1)
    for _ in range(20):
        q = rng.uniform(-3.0, 3.0, ours.model.nq)
        for i, name in enumerate(list(ours.model.names)[1:]):
            state.qpos[reference.joint(name).qposadr[0]] = q[i]
        mujoco.mj_kinematics(reference, state)
        pinocchio.framesForwardKinematics(ours.model, data, q)
        pinocchio.updateGeometryPlacements(ours.model, data, ours.collision_model, geometry_data)
        for body in range(1, reference.nbody):
            frame = ours.model.getFrameId(reference.body(body).name, pinocchio.FrameType.BODY)
            np.testing.assert_allclose(data.oMf[frame].translation, state.xpos[body], atol=1e-9)
            np.testing.assert_allclose(
                data.oMf[frame].rotation, state.xmat[body].reshape(3, 3), atol=1e-9
            )
        for geom, one in zip(solid, ours.collision_model.geometryObjects, strict=True):
            found = geometry_data.oMg[ours.collision_model.getGeometryId(one.name)]
            if reference.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
                # MuJoCo moves meshes to their centre: what counts is where vertices are.
                mesh = reference.geom_dataid[geom]
                first = reference.mesh_vertadr[mesh]
                corners = reference.mesh_vert[first : first + reference.mesh_vertnum[mesh]]
                turned = state.geom_xmat[geom].reshape(3, 3)
                expected = corners @ turned.T + state.geom_xpos[geom]
                vertices = (
                    one.geometry.points()
                    if isinstance(one.geometry, coal.ConvexBase)
                    else one.geometry.vertices()
                )
                actual = np.asarray(vertices) @ found.rotation.T + found.translation
                gaps = np.linalg.norm(expected[:, None] - actual, axis=2)
                assert max(gaps.min(axis=1).max(), gaps.min(axis=0).max()) < 1e-6
                continue
            np.testing.assert_allclose(found.translation, state.geom_xpos[geom], atol=1e-9)
            np.testing.assert_allclose(
                found.rotation, state.geom_xmat[geom].reshape(3, 3), atol=1e-9
            )
            size = reference.geom_size[geom]
            if isinstance(one.geometry, coal.Box):
                np.testing.assert_allclose(one.geometry.halfSide, size)
            else:
                assert one.geometry.radius == pytest.approx(size[0])
                if not isinstance(one.geometry, coal.Sphere):
                    assert one.geometry.halfLength == pytest.approx(size[1])


def test_limits_and_couplings_are_kept_and_what_the_format_lacks_stays_unknown(tmp_path):
    ours = read_mjcf(write_mjcf(tmp_path))
    assert ours.read_range("lift") == pytest.approx((math.radians(-100.0), math.radians(90.0)))
    assert ours.read_range("pan") == pytest.approx((math.radians(-170.0), math.radians(170.0)))
    assert ours.read_range("left_finger") == (0.0, 0.04)  # metres are no degrees
    assert ours.continuous == {"roll"}
    assert ours.mimics["right_finger"].leader == "left_finger"
    assert not np.any(ours.model.velocityLimit)
    efforts = {
        str(name): ours.model.effortLimit[i] for i, name in enumerate(list(ours.model.names)[1:])
    }
    assert efforts == {"pan": 5, "lift": 120, "roll": 0, "left_finger": 0, "right_finger": 0}


def test_a_robot_is_made_of_it_with_its_mimic_fingers_swept(tmp_path):
    path = write_mjcf(tmp_path)
    description = read_description(make_limits())
    bare = Robot("arm", read_described(path, (), description), description, list(JOINTS))
    cover = tmp_path / "cover.json"
    Cover.fit(bare, spheres=1).save(cover)
    robot = Robot.from_mjcf(path, limits=make_limits(), cover=cover)
    assert robot.joints == JOINTS
    assert robot.links == ("shoulder", "wrist", "left", "right")
    reached = robot.triangles("left").reshape(-1, 3)
    assert np.ptp(reached, axis=0)[2] == pytest.approx(0.12)  # its own 0.08 and its travel
    without = make_limits()
    del without["joints"]["pan"]["velocity"]
    with pytest.raises(RobotError, match=r"velocity.*joints\.pan"):
        Robot.from_mjcf(path, limits=without, cover=cover)


def test_includes_are_read_and_a_circle_is_refused(tmp_path):
    part = tmp_path / "part.xml"
    part.write_text('<mujocoinclude><geom class="box_class" size="0.1 0.1 0.1"/></mujocoinclude>')
    ours = read_mjcf(write_mjcf(tmp_path, inside='<include file="part.xml"/>'))
    assert ours.collision_model.ngeoms == 10
    with pytest.raises(RobotError, match=r"gone\.xml: cannot be read"):
        read_mjcf(write_mjcf(tmp_path, inside='<include file="gone.xml"/>'))
    with pytest.raises(RobotError, match="included twice"):
        read_mjcf(write_mjcf(tmp_path, inside='<include file="arm.xml"/>'))


def test_a_link_that_is_only_drawn_is_bare_until_it_collides_as_drawn(tmp_path):
    path = write_mjcf(
        tmp_path,
        inside='<body name="camera"><geom class="visual" mesh="fin"/></body>',
    )
    assert read_mjcf(path).bare == ("camera",)
    assert read_mjcf(path, drawn=["camera"]).bare == ()
    assert read_mjcf(path, drawn=["camera"]).collision_model.ngeoms == 10
    for link, words in (("wrist", "of its own"), ("nobody", "is not in the MJCF")):
        with pytest.raises(RobotError, match=words):
            read_mjcf(path, drawn=[link])
    paired = write_mjcf(
        tmp_path,
        inside='<body name="camera"><geom name="lens" class="visual" mesh="fin"/></body>',
        extra='<contact><pair geom1="lens" geom2="lens"/></contact>',
    )
    assert read_mjcf(paired).bare == ()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"beside": '<body name="loose"><freejoint/></body>'}, "'loose': is of type 'free'"),
        ({"beside": '<body name="m" mocap="true"/>'}, "'m': is a mocap body"),
        ({"beside": '<geom name="floor" type="plane" size="1 1 1"/>'}, "floor.*type 'plane'"),
        ({"beside": "<frame/>"}, "'world': has a <frame>"),
        ({"beside": '<body name="wrist"/>'}, "'wrist': is there twice"),
        ({"beside": '<body><joint name="pan"/></body>'}, "'pan': is there twice"),
        ({"inside": '<body><joint name="b" type="ball"/></body>'}, "'b': is of type 'ball'"),
        ({"inside": '<geom name="e" type="ellipsoid" size="1 1 1"/>'}, "'e' of.*'ellipsoid'"),
        ({"inside": '<geom name="f" type="box" mesh="fin"/>'}, "'f' of.*fitted to a mesh"),
        ({"inside": '<geom name="g" type="mesh" mesh="none"/>'}, "'g' of.*mesh='none'"),
        ({"inside": '<geom name="s" size="nan"/>'}, "'s' of.*size='nan'"),
        ({"inside": '<geom name="s" size="1" pos="0 0"/>'}, "'s' of.*pos='0 0'.*3 finite"),
        ({"inside": '<geom name="s" size="1" class="lost"/>'}, "'lost', which no <default>"),
        ({"inside": '<body><joint name="r" ref="1"/></body>'}, "'r': has ref='1'"),
        ({"inside": '<body><joint name="r" axis="0 0 0"/></body>'}, "'r': has axis of length 0"),
        ({"inside": '<body><joint name="r" range="2 1"/></body>'}, "'r': has range='2 1'"),
        ({"inside": "<composite/>"}, "'wrist': has a <composite>.*mj_saveLastXML"),
        ({"extra": "<deformable/>"}, "deformable"),
        ({"compiler": ""}, "'fin': was not found.*meshdir"),
        ({"compiler": COMPILER.replace("zYx", "abc")}, "eulerseq='abc'"),
        ({"compiler": COMPILER[:-2] + ' autolimits="false"/>'}, "'pan': has a range"),
        (
            {"extra": '<equality><joint joint1="pan" joint2="lift" polycoef="1"/></equality>'},
            "equality of joint 'pan'.*finite",
        ),
        (
            {"extra": '<asset><mesh name="k" file="k.msh"/></asset>',
             "inside": '<geom type="mesh" mesh="k"/>'},
            "'k': is in k.msh; expected STL or OBJ",
        ),
    ],
)  # fmt: skip
def test_what_is_not_supported_is_refused_by_name(tmp_path, changes, words):
    with pytest.raises(RobotError, match=words):
        read_mjcf(write_mjcf(tmp_path, **changes))


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "arm.xml"
    for content, words in (
        ("<mujoco", "is not XML"),
        ("<robot/>", "root <robot>"),
        ("<mujoco/>", "no body"),
    ):
        path.write_text(content)
        with pytest.raises(RobotError, match=words):
            read_mjcf(path)
