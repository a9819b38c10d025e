"""A wheel stands by itself: the robots are in it, and are found."""

import subprocess
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_robots_are_found_in_a_wheel(tmp_path):
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "unpacked")
    script = (
        "import armguard.robot as r, armguard.robot.description as d;"
        "print(d.robots_directory(), r.Robot.load('panda').links[0])"
    )
    result = subprocess.run(
        [sys.executable, "-c", script],
        cwd=tmp_path / "unpacked",
        env={"PYTHONPATH": str(tmp_path / "unpacked")},
        check=True,
        capture_output=True,
        text=True,
    )
    assert result.stdout.split() == [str(tmp_path / "unpacked/armguard/robots"), "panda_link1"]
    # What the console script imports.
    assert (tmp_path / "unpacked/armguard_command.py").is_file()
    assert (tmp_path / "unpacked/armguard_check/__main__.py").is_file()
