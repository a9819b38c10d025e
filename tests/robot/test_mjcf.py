import math
import sys
from pathlib import Path

import numpy as np
import pinocchio
import pytest

from armguard.cover.triangulation import triangulate
from armguard.exceptions import RobotError
from armguard.robot.mjcf import read_mjcf
from support.mjcf_arms import COMPILER, write_mjcf

mujoco = pytest.importorskip("mujoco")


def test_bodies_and_geoms_are_where_mujoco_has_them(tmp_path):
    path = write_mjcf(tmp_path)
    ours, reference = read_mjcf(path), mujoco.MjModel.from_xml_path(str(path))
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
        for geom, found in zip(solid, geometry_data.oMg, strict=True):
            turned = state.geom_xmat[geom].reshape(3, 3)
            np.testing.assert_allclose(found.translation, state.geom_xpos[geom], atol=1e-9)
            np.testing.assert_allclose(found.rotation, turned, atol=1e-9)


def test_shapes_have_their_sizes_and_meshes_the_corners_of_their_files(tmp_path):
    ours = read_mjcf(write_mjcf(tmp_path))
    shapes = [one.geometry for one in ours.collision_model.geometryObjects]
    base, upper, fin, box, cylinder, ball, wedge, left, _ = shapes
    assert (base.radius, base.halfLength) == pytest.approx((0.06, 0.05))
    assert (upper.radius, upper.halfLength) == pytest.approx((0.05, math.sqrt(0.1025) / 2))
    assert box.halfSide[:2] == pytest.approx([0.02, 0.02])
    assert box.halfSide[2] == pytest.approx(math.sqrt(0.09) / 2)
    assert (cylinder.radius, cylinder.halfLength) == pytest.approx((0.04, 0.1))
    assert ball.radius == pytest.approx(0.05)
    assert left.halfSide == pytest.approx([0.01, 0.01, 0.04])
    # The file's unit is the millimetre, doubled along y; MuJoCo moves meshes to their centre.
    for mesh, sides in ((fin, [0.1, 0.2, 0.2]), (wedge, [0.1, 0.1, 0.1])):
        corners = np.unique(triangulate("mesh", mesh).reshape(-1, 3), axis=0)
        expected = np.concatenate([np.zeros((1, 3)), np.diag(sides)])
        gaps = np.linalg.norm(corners[:, None] - corners, axis=2)
        wanted = np.linalg.norm(expected[:, None] - expected, axis=2)
        np.testing.assert_allclose(np.sort(gaps.ravel()), np.sort(wanted.ravel()), atol=1e-6)


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
    guessed = read_mjcf(write_mjcf(tmp_path, inside='<body><geom size="0.1"/></body>'))
    assert not np.any(guessed.model.effortLimit)  # one inertia is MuJoCo's guess
    assert efforts == {"pan": 5, "lift": 120, "roll": 0, "left_finger": 0, "right_finger": 0}


def test_a_link_that_is_only_drawn_is_bare_until_it_collides_as_drawn(tmp_path):
    path = write_mjcf(
        tmp_path,
        inside='<body name="camera"><geom class="visual" mesh="fin"/></body>',
    )
    assert read_mjcf(path).bare == ("camera",)
    assert read_mjcf(path, drawn=["camera"]).bare == ()
    assert read_mjcf(path, drawn=["camera"]).collision_model.ngeoms == 10
    for link, words in (("wrist", "of its own"), ("nobody", "is not in the model")):
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
        ({"beside": '<body><freejoint name="f"/><geom size="1"/></body>'}, "'f'.*'free'"),
        ({"beside": '<body name="m" mocap="true"/>'}, "'m': is a mocap body"),
        ({"beside": '<geom name="floor" type="plane" size="1 1 1"/>'}, "floor.*type 'plane'"),
        ({"inside": '<geom name="e" type="ellipsoid" size="1 1 1"/>'}, "'e' of.*'ellipsoid'"),
        ({"inside": '<body><geom size="1"/><joint name="r" ref="1"/></body>'}, "'r': has ref=0"),
        ({"beside": '<body name="wrist"/>'}, "cannot be read.*wrist"),
        ({"beside": '<body name="wrist_body0"/>', "inside": "<body/>"}, "body.*is there twice"),
        (
            {"beside": '<body name="b"><joint name="b_joint1" axis="1 0 0"/><joint/>'
                       '<geom size="1"/></body>'},
            "joint 'b_joint1': is there twice.*name every joint",
        ),
        (
            {"inside": '<body><joint name="universe"/><geom size="1"/></body>'},
            "joint 'universe': is there twice",
        ),
        (
            {"inside": '<flexcomp name="rope" type="grid" count="3 3 1" spacing="1 1 1" '
                       'dim="2" mass="1" radius="0.1" rigid="true"/>'},
            "flex 'rope': is flexible.*rigid",
        ),
        (
            {"extra": '<deformable><flex name="hose" dim="1" body="wrist wrist" '
                      'vertex="0 0 0 1 0 0" element="0 1" radius="0.1"/></deformable>'},
            "flex 'hose': is flexible",
        ),
        ({"inside": '<geom name="s" size="1" class="lost"/>'}, "cannot be read.*lost"),
        ({"compiler": ""}, "cannot be read.*fin.stl"),
        (
            {"extra": '<equality><joint joint1="pan" joint2="lift" polycoef="0 1 2 0 0"/>'
                      '</equality>'},
            "equality of joint 'pan'.*linear",
        ),
        ({"extra": '<equality><joint joint1="pan"/></equality>'}, "'pan'.*linear"),
    ],
)  # fmt: skip
def test_what_is_not_supported_is_refused_by_name(tmp_path, changes, words):
    with pytest.raises(RobotError, match=words):
        read_mjcf(write_mjcf(tmp_path, **changes))


def test_bodies_and_joints_without_names_are_called_by_their_place(tmp_path):
    unnamed = '<body><joint/><joint axis="1 0 0"/><geom size="0.1"/></body>'
    ours = read_mjcf(write_mjcf(tmp_path, inside=unnamed, beside='<body name="joint3"/>' + unnamed))
    names = [str(name) for name in ours.model.names][1:]
    assert {"wrist_body0_joint0", "wrist_body0_joint1"} < set(names)
    assert {"world_body2_joint0", "world_body2_joint1"} < set(names)
    assert len(set(names)) == len(names) == 9
    # Each geom hangs on the frame of its own body, with the joint that carries it.
    for one in ours.collision_model.geometryObjects:
        assert one.parentJoint == ours.model.frames[one.parentFrame].parentJoint
        assert one.name.startswith(ours.model.frames[one.parentFrame].name)


CHANGED = (
    'inertiafromgeom="true"',
    'boundmass="0.5"',
    'boundinertia="0.5"',
    'settotalmass="3"',
    'balanceinertia="true"',
)


@pytest.mark.filterwarnings("ignore:compiler attribute 'settotalmass':UserWarning")
@pytest.mark.parametrize("change", CHANGED)
@pytest.mark.parametrize("is_attached", [False, True])
def test_no_effort_counts_where_the_compiler_changes_inertias(tmp_path, change, is_attached):
    assert np.any(read_mjcf(write_mjcf(tmp_path)).model.effortLimit)
    changed = COMPILER.replace("/>", f" {change}/>")
    path = write_mjcf(tmp_path, compiler=changed)
    if is_attached:
        path = tmp_path / "scene.xml"
        path.write_text(
            '<mujoco><asset><model name="arm" file="arm.xml"/></asset><worldbody>'
            '<attach model="arm" body="base" prefix="my_"/></worldbody></mujoco>'
        )
    assert not np.any(read_mjcf(path).model.effortLimit)


def test_what_mujoco_warns_of_leaves_no_file_in_the_current_folder(tmp_path, monkeypatch, capfd):
    (tmp_path / "current").mkdir()
    monkeypatch.chdir(tmp_path / "current")
    assert mujoco.MjLogConfig.get().logto_file  # reading leaves it as it was, also before this
    read_mjcf(write_mjcf(tmp_path, inside='<body><joint damping="nan"/><geom size="1"/></body>'))
    assert "NaN" in capfd.readouterr().err
    assert not list(Path().iterdir())
    assert mujoco.MjLogConfig.get().logto_file


def test_other_files_are_refused_and_mujoco_is_asked_for(tmp_path, monkeypatch):
    path = tmp_path / "arm.xml"
    for content, words in (("<mujoco", "cannot be read"), ("<mujoco/>", "no body")):
        path.write_text(content)
        with pytest.raises(RobotError, match=words):
            read_mjcf(path)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(RobotError, match=r"imported: .*; pip install 'armguard\[mujoco\]'"):
        read_mjcf(path)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("raise ImportError('libGL is lost')", "cannot be imported: libGL is lost"),
        ("raise OSError('libmujoco is lost')", "cannot be imported: libmujoco is lost"),
        ("raise RuntimeError('no such GL')", "cannot be imported: no such GL"),
        ("__version__ = '3.1.6'", r"mujoco is 3\.1\.6; expected 3\.17 or later; pip install"),
        ("", r"mujoco is of no version; expected 3\.17 or later"),
    ],
)
def test_a_mujoco_that_does_not_serve_is_told_of(tmp_path, monkeypatch, source, words):
    (tmp_path / "mujoco.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "mujoco")
    with pytest.raises(RobotError, match=words):
        read_mjcf(write_mjcf(tmp_path))
