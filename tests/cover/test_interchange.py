import coal
import msgspec
import numpy as np
import pinocchio
import pytest

from armguard.cover import Cover
from armguard.cover.interchange import (
    place_spheres,
    read_spheres,
    write_curobo,
    write_spherized_urdf,
)
from armguard.exceptions import CoverError
from armguard.robot.links import UrdfLinks
from support.sphere_files import as_curobo
from support.urdf_arms import joint_xml, link_xml, write_urdf

SPHERES = {"upper": [[0.0, 0.0, 0.0, 0.07]], "tool": [[0.01, 0.0, 0.02, 0.06], [0, 0.02, 0, 0.05]]}
TURNED = """<joint name="flange" type="fixed"><parent link="upper"/><child link="tool"/>
    <origin xyz="0 0.1 0.2" rpy="1.5707963 0 0.4"/></joint>"""


def write_arm(folder):
    """A link on a joint, and a tool that is fixed to it, turned and shifted."""
    return write_urdf(
        folder,
        *(link_xml(name) for name in ("base", "upper", "tool")),
        joint_xml("shoulder", "base", "upper"),
        TURNED,
    )


@pytest.fixture(scope="module")
def arm_file(tmp_path_factory):
    return write_arm(tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def arm(arm_file):
    return UrdfLinks(arm_file)


def write_yaml(path, content):
    path.write_bytes(msgspec.yaml.encode(content))
    return path


def write_spherized(path, spheres):
    links = "".join(
        f'<link name="{link}">'
        + "".join(
            f'<collision><geometry><sphere radius="{radius}"/></geometry>'
            f'<origin xyz="{x} {y} {z}" rpy="0.1 0 0"/></collision>'
            for x, y, z, radius in rows
        )
        + "</link>"
        for link, rows in spheres.items()
    )
    path.write_text(f'<robot name="arm">{links}</robot>')
    return path


@pytest.mark.parametrize("kind", ["yml", "yaml", "urdf"])
def test_spheres_are_read_as_they_are(tmp_path, kind):
    path = tmp_path / f"spheres.{kind}"
    if kind == "urdf":
        write_spherized(path, SPHERES)
    else:
        write_yaml(path, as_curobo(SPHERES))
    read = read_spheres(path)
    assert set(read) == set(SPHERES)
    for link, rows in SPHERES.items():
        np.testing.assert_allclose(read[link], rows)


def test_a_robots_configuration_gives_its_buffer_and_may_name_a_list(tmp_path):
    write_yaml(tmp_path / "list.yml", as_curobo(SPHERES))
    kinematics = {"collision_spheres": "list.yml", "collision_sphere_buffer": 0.005}
    path = write_yaml(tmp_path / "arm.yml", {"robot_cfg": {"kinematics": kinematics}})
    np.testing.assert_allclose(read_spheres(path)["upper"][:, 3], [0.075])
    own = as_curobo(SPHERES) | {"collision_sphere_buffer": {"tool": -0.01}}
    path = write_yaml(tmp_path / "arm.yml", {"robot_cfg": {"kinematics": own}})
    read = read_spheres(path)
    np.testing.assert_allclose(read["tool"][:, 3], [0.05, 0.04])
    np.testing.assert_allclose(read["upper"][:, 3], [0.07])


def test_places_for_held_parts_are_no_spheres(tmp_path):
    path = tmp_path / "spheres.yml"
    path.write_text(
        "collision_spheres:\n  held:\n  - {center: [0, 0, 0], radius: -10}\n"
        "  upper:\n  - {center: [0, 0, 1e-3], radius: 7e-2}\n"
    )
    read = read_spheres(path)
    assert set(read) == {"upper"}
    np.testing.assert_allclose(read["upper"], [[0.0, 0.0, 0.001, 0.07]])


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.yml", "", "a.yml"),
        ("a.yml", "collision_spheres: {}", "no spheres"),
        ("a.yml", "something: else", "neither collision_spheres"),
        ("a.yml", "collision_spheres: {upper: [{center: [0, 0], radius: 1}]}", r"length 3"),
        ("a.yml", "collision_spheres: {upper: [{center: [0, 0, x], radius: 1}]}", "center"),
        ("a.yml", "collision_spheres: {upper: [{center: [0, 0, .nan], radius: 1}]}", "not finite"),
        ("a.yml", "collision_spheres: {upper: [{center: [0, 0, 0], radius: .nan}]}", "not finite"),
        ("a.yml", "collision_spheres: {upper: [{center: [0, 0, 0]}]}", "radius"),
        ("a.yml", "{", "a.yml"),
        ("a.yml", "robot_cfg: {kinematics: {collision_spheres: none.yml}}", "none.yml"),
        ("a.yml", 'robot_cfg: {kinematics: {collision_spheres: "a\\0b"}}', r"a\\0b: embedded null"),
        ("a.yml", "collision_spheres: {u: [{center: [0, 0, 0], radius: 1.0e+200}]}", "beyond"),
        ("a.yml", "collision_spheres: {u: [{center: [500, 0, 0], radius: 9}]}", "expected metres"),
        ("a.urdf", "<robot", "cannot be read"),
        ("a.urdf", '<?xml version="1.0" encoding="sumerian"?><robot/>', "cannot be read"),
        ("a.urdf", '<robot><link name="upper"/></robot>', "no spheres"),
        ("a.txt", "0 0 0 1", r"\.yml"),
    ],
)
def test_unusable_files_are_refused_in_one_line(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(CoverError, match=message) as caught:
        read_spheres(path)
    assert "\n" not in str(caught.value)
    with pytest.raises(CoverError, match="cannot be read"):
        read_spheres(tmp_path / "none.yml")


@pytest.mark.parametrize("row", [("0", "0", "0", "-1"), ("0", "x", "0", "1"), ("0", "0", "0", "")])
def test_malformed_spheres_of_a_urdf_are_refused(tmp_path, row):
    with pytest.raises(CoverError, match="link 'upper': has a sphere of radius"):
        read_spheres(write_spherized(tmp_path / "a.urdf", {"upper": [row]}))


def test_spheres_stand_where_pinocchio_puts_them(tmp_path, arm):
    """Against Pinocchio's own reading of spheres as collision geometry."""
    elements = [
        link_xml(
            name,
            "".join(
                f'<origin xyz="{x} {y} {z}"/><geometry><sphere radius="{radius}"/></geometry>'
                for x, y, z, radius in SPHERES.get(name, [])[:1]
            ),
        )
        for name in ("base", "upper", "tool")
    ]
    path = write_urdf(tmp_path, *elements, joint_xml("shoulder", "base", "upper"), TURNED)
    model = pinocchio.buildModelFromUrdf(str(path))
    read = pinocchio.buildGeomFromUrdf(model, str(path), pinocchio.GeometryType.COLLISION)
    placed = place_spheres(arm, read_spheres(path))
    assert set(placed) == {"upper", "tool"}
    for geometry in read.geometryObjects:
        assert isinstance(geometry.geometry, coal.Sphere)
        (sphere,) = placed[str(model.frames[geometry.parentFrame].name)]
        np.testing.assert_allclose(sphere[:3], geometry.placement.translation, atol=1e-12)
        assert sphere[3] == geometry.geometry.radius


@pytest.mark.parametrize("kind", ["yml", "urdf"])
def test_what_is_written_comes_back(tmp_path, arm, arm_file, kind):
    cover = Cover.fit(arm, spheres=3)
    path = tmp_path / f"spheres.{kind}"
    if kind == "yml":
        write_curobo(path, arm, cover)
    else:
        write_spherized_urdf(path, arm, cover, arm_file)
    placed = place_spheres(arm, read_spheres(path))
    for link in arm.links:
        np.testing.assert_allclose(placed[link], cover.spheres(link), atol=2e-9)
