"""A setting is written once, in `armguard.Settings`: all else reads its declaration."""

import ast
import functools
import os
import subprocess
import sys
from pathlib import Path

import pytest

from armguard.settings import Settings, settings

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "armguard"

FIELD = '''
    caution: Annotated[float, Meta(ge=1.0, le=3.0, extra={"table": "thresholds"})] = 1.5
    """By how much more than needed the arm keeps away, in [m/s]."""
'''

# Finds the record in another file, before anything of armguard is loaded.
ELSEWHERE = """
import importlib.util, sys
class Elsewhere:
    def find_spec(self, name, path=None, target=None):
        if name == "armguard.settings.settings":
            return importlib.util.spec_from_file_location(name, sys.argv[1])
sys.meta_path.insert(0, Elsewhere())
"""

EVERYWHERE = """
import armguard
from armguard.app.cell import Cell
from armguard.monitor.portable import describe_settings
from armguard.recording.settings import change_settings, make_monitor
text = '[robot]\\nname = "panda"\\n[sources]\\n[thresholds]\\ncaution = '
robot, obstacles, monitor = Cell.from_text(text + "2.5").build()
assert monitor.settings.caution == 2.5
try:
    Cell.from_text(text + "4.0")
except armguard.ArmguardError as error:
    assert str(error).startswith("cell: thresholds.caution: is 4.0; expected a finite number")
else:
    raise AssertionError
described = describe_settings(monitor)
assert described["monitor"]["caution"] == 2.5
assert make_monitor(described["monitor"], robot, armguard.Obstacles()).settings.caution == 2.5
change_settings(described, {"caution": "1.25"}, robot)
assert described["monitor"]["caution"] == 1.25
assert armguard.Monitor(robot, armguard.Obstacles(), caution=2.0).settings.caution == 2.0
try:
    armguard.Monitor(robot, armguard.Obstacles(), caution=0.0)
except armguard.ArmguardError as error:
    assert str(error) == "caution: is 0.0; expected a finite number from 1 on and up to 3"
else:
    raise AssertionError
import make_cell
text = "By how much more than needed the arm keeps away."
assert f"- `caution` (≥1 ≤3 m/s, 1.5): {text}" in make_cell.write_page()
"""


def run(*arguments, **more):
    path = os.pathsep.join(map(str, (ROOT, ROOT / "docs")))
    environment = os.environ | {"PYTHONPATH": path}
    command = [sys.executable, *map(str, arguments)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, **more)


def test_a_field_more_is_found_everywhere_without_another_edit(tmp_path):
    source = Path(settings.__file__).read_text(encoding="utf-8")
    place = "\n    def __post_init__"
    assert source.count(place) == 1
    copy = tmp_path / "settings.py"
    copy.write_text(source.replace(place, FIELD + place), encoding="utf-8")
    done = run("-c", ELSEWHERE + EVERYWHERE, copy)
    assert done.returncode == 0, done.stderr


KEYWORDS = """
from armguard import Monitor, Obstacles, Robot, Settings

def make(robot: Robot, obstacles: Obstacles) -> None:
    Monitor(robot, obstacles)
    Monitor(robot, obstacles, Settings(rate=500.0))
    Monitor(robot, obstacles, rate=500.0, margin=0.01, motion="planned", budget=500)
    Monitor(robot, obstacles, rates=500.0)
    Settings(marginn=0.01)
    Monitor(robot, obstacles, margin="wide")
    Monitor(robot, obstacles, motion="walk")
"""


def test_a_checker_of_types_knows_the_keywords_of_a_monitor(tmp_path):
    script = tmp_path / "keywords.py"
    script.write_text(KEYWORDS)
    found = run("-m", "mypy", "--strict", "--follow-imports=silent", script, cwd=ROOT)
    wrong = {int(line.split(":")[1]) for line in found.stdout.splitlines() if ": error:" in line}
    assert wrong == {8, 9, 10, 11}, found.stdout + found.stderr
    assert 'Unexpected keyword argument "rates"' in found.stdout


SCENES = ("scene.settings", "table.settings")
"""Records that are called so, and are other ones."""


@functools.cache
def find_uses():
    """The settings of a record that each module reads."""
    return {
        str(path.relative_to(PACKAGE)): {
            node.attr
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.Attribute)
            and ast.unparse(node.value).endswith("settings")
            and not ast.unparse(node.value).endswith(SCENES)
        }
        for path in sorted(PACKAGE.rglob("*.py"))
    }


@pytest.mark.parametrize("name", Settings.__struct_fields__)
def test_few_modules_beside_the_record_know_a_setting(name):
    found = [module for module, names in find_uses().items() if name in names]
    assert len(found) <= 4, found


def test_a_name_that_nothing_else_has_stands_in_four_files():
    found = [path for path in PACKAGE.rglob("*.py") if "max_staleness" in path.read_text("utf-8")]
    assert len(found) <= 4, found
