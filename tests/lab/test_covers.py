import re

import msgspec
import numpy as np
import pytest

from armguard.app.cli import main
from armguard.cover import Cover
from armguard.cover.interchange import read_spheres
from armguard.robot import Robot
from armguard.robot.links import UrdfLinks
from support.sphere_files import as_curobo
from support.urdf_arms import BOX, joint_xml, limits_for, mesh_xml, two_links, write_stl


def run(arguments, capsys):
    """Exit code, standard output and standard error."""
    try:
        code = main([str(argument) for argument in arguments])
    except SystemExit as end:
        code = end.code
    return code, *capsys.readouterr()


def write_spheres(path, spheres):
    path.write_bytes(msgspec.yaml.encode(as_curobo(spheres)))
    return path


def test_a_urdf_without_limits_gets_a_proved_cover(tmp_path, capsys):
    urdf = two_links(tmp_path)
    code, out, _ = run(["cover", urdf, "--protrusion", "15", "--out", tmp_path / "new"], capsys)
    assert code == 0
    assert re.search(r"upper .* yes", out)
    assert re.search(r"all .* yes", out)
    links = UrdfLinks(urdf)
    cover = Cover.load(tmp_path / "new" / "cover.json")
    cover.verify(links)
    report = cover.check(links)
    assert report.proved
    assert report.max_protrusion < 0.0151
    # It also serves the robot that the URDF is once limits are known.
    path = tmp_path / "new" / "cover.json"
    Robot.from_urdf(urdf, limits=limits_for("shoulder"), cover=path)


def test_limits_say_what_moves_and_the_count_is_kept(tmp_path, capsys):
    urdf, limits = two_links(tmp_path), tmp_path / "robot.toml"
    limits.write_text(
        "[sources]\nposition = 'a'\nvelocity = 'a'\nacceleration = 'a'\nbraking = 'a'\n"
        "[joints.shoulder]\nposition = [-1, 1]\nvelocity = 1\nacceleration = 2\n"
        "[[brakes]]\nload = 1\nspeed = 1\ndeceleration = 1\n"
    )
    arguments = ["cover", urdf, "--limits", limits, "--spheres", "2", "--out", tmp_path]
    code, out, _ = run(arguments, capsys)
    assert code == 0
    assert len(Cover.load(tmp_path / "cover.json").spheres("upper")) == 2
    assert "volume ratio" in out


def test_a_known_robots_cover_is_proved_again(capsys):
    code, out, err = run(["cover", "--check", "panda"], capsys)
    assert (code, err) == (0, "")
    assert len(re.findall(r" yes ", out)) == 11
    assert "NO" not in out


def test_imported_spheres_show_what_they_leave_out_and_are_inflated(tmp_path, capsys):
    urdf = two_links(tmp_path)
    file = write_spheres(tmp_path / "few.yml", {"upper": [[0.0, 0.0, 0.0, 0.05]]})
    code, out, _ = run(["cover", "--import", file, urdf], capsys)
    assert code == 1
    assert re.search(r"upper .* [1-9][\d.]* % .* NO", out)
    assert "does not cover the robot" in out
    code, out, _ = run(["cover", "--import", file, urdf, "--inflate", "--out", tmp_path], capsys)
    assert code == 0
    cover = Cover.load(tmp_path / "cover.json")
    np.testing.assert_allclose(
        cover.spheres("upper")[:, 3], np.linalg.norm([0.05, 0.03, 0.02]), 1e-3
    )
    assert cover.check(UrdfLinks(urdf)).proved


@pytest.mark.parametrize("ending", ["yml", "urdf"])
def test_a_known_cover_goes_out_and_comes_back_as_a_cover(tmp_path, capsys, ending):
    path = tmp_path / f"panda.{ending}"
    code, out, _ = run(["cover", "panda", "--export", path], capsys)
    assert code == 0
    assert str(path) in out
    moving = set(Robot.load("panda").links)
    assert set(read_spheres(path)) == moving
    code, out, _ = run(["cover", "panda", "--import", path], capsys)
    assert code == 0
    assert "covers the robot: proved" in out


def test_robots_are_listed_with_what_their_files_say(capsys):
    code, out, _ = run(["robots"], capsys)
    assert code == 0
    robot = Robot.load("panda")
    count = sum(len(robot.cover.spheres(link)) for link in robot.links)
    assert re.search(rf"panda +7 +10 +{count} +Franka", out)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["panda"], "--out"),
        (["nobody", "--out", "x"], "nobody: is neither a URDF nor a robot"),
        (["none.urdf", "--out", "x"], "none.urdf: cannot be read"),
        (["--check", "panda", "--export", "x.yml"], "--check and --export: exclude each other"),
        (["--check", "panda", "--spheres", "3"], "--check: fits nothing"),
        (["--check", "panda", "--out", "x"], "--out: has nothing"),
        (["panda", "--inflate", "--out", "x"], "--inflate: needs spheres"),
        (["panda", "--export", "x.json"], "x.json: is of no known kind"),
        (["panda", "--export", "none/x.yml"], "cannot be written"),
        (["panda", "--import", "none.yml"], "none.yml: cannot be read"),
        (["panda", "--spheres", "3", "--protrusion", "20", "--out", "x"], "exclude each other"),
        (["panda", "--spheres", "501", "--out", "x"], "spheres: is 501; expected 1 to 500"),
        (["n" * 5000, "--out", "x"], "is neither a URDF nor a robot"),
        (["panda", "--protrusion", "nan", "--out", "x"], "protrusion: is nan"),
        (["panda", "--out", "/dev/null/x"], "/dev/null/x"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_mistake_is_one_line_and_exit_code_2(arguments, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(["cover", *arguments], capsys)
    assert code == 2
    assert out == ""
    assert words in err.splitlines()[-1]
    assert err.splitlines()[-1].startswith("armguard: ")
    assert not (tmp_path / "x" / "cover.json").exists()


@pytest.mark.parametrize(
    ("triangles", "words"),
    [
        ([], "link 'upper'"),
        ([[[0, 0, 0], [np.nan, 0, 0], [0, 1, 0]]], "link 'upper': has a vertex that is not finite"),
        ([[[0, 0, 0], [120, 0, 0], [0, 80, 5]]], "link 'upper': is 120 m across"),
        ([[[0, 0, 0], [1e-4, 0, 0], [0, 1e-4, 0]]], "link 'upper': is 0.0001 m across"),
    ],
    ids=["empty", "nan", "millimetres", "speck"],
)
def test_unusable_meshes_are_refused_by_name(tmp_path, capsys, triangles, words):
    write_stl(tmp_path / "mesh.stl", triangles)
    urdf = two_links(tmp_path, mesh_xml("mesh.stl"))
    code, _, err = run(["cover", urdf, "--out", tmp_path / "x"], capsys)
    assert code == 2
    assert words in err.splitlines()[-1] or ("mesh.stl" in err and triangles == [])
    assert not (tmp_path / "x" / "cover.json").exists()


def test_what_is_drawn_but_not_covered_is_said(tmp_path, capsys):
    urdf = two_links(tmp_path)
    hand = f'<link name="hand"><visual>{BOX}</visual></link>'
    grip = joint_xml("grip", "upper", "hand", "fixed")
    urdf.write_text(urdf.read_text().replace("</robot>", f"{hand}{grip}</robot>"))
    code, out, _ = run(["cover", urdf, "--spheres", "1", "--out", tmp_path], capsys)
    assert code == 0
    assert "drawn without collision geometry, NOT covered: hand" in out
