"""armguard is built in floors: a module imports only from below, so data can flow one way only.

The table here is the law; docs/architecture.md tells it in words.
"""

import ast
import graphlib
import importlib.util
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "armguard"

# Floor, step on that floor, and the modules and packages that stand there. Steps part what one
# module of a floor is made of; a package stands on one step as a whole.
FLOORS = [
    (0, 1, "exceptions clock compilation ending latency plan_reading"),
    (0, 2, "garbage realtime separation enclosing_ball handle hull patches plan_curve records"),
    (0, 2, "soonest turns"),
    (0, 2, "surface_distance witness"),
    (0, 3, "hull_advancement plausibility sphere_tree"),
    (0, 4, "advancement contact_arguments fitting joint_history"),
    (0, 5, "contact contact_batch containment"),
    (0, 6, "cover_report"),
    (1, 1, "certificate cover frames obstacle_faults obstacle_table people sources verdict"),
    (1, 2, "anchors inflation obstacle_call obstacle_register"),
    (1, 3, "obstacle_rule"),
    (1, 4, "obstacle_bounds"),
    (1, 5, "obstacles"),
    (2, 1, "interchange levers robot_description surfaces urdf"),
    (2, 2, "link_surfaces"),
    (2, 3, "attached_bodies urdf_links watched_joints"),
    (2, 4, "robot"),
    (2, 5, "lever_report"),
    (3, 1, "ignored_pairs joint_acceptance kinematics plans"),
    (3, 2, "bounds joint_states"),
    (4, 1, "arm_motion exact scene"),
    (4, 2, "link_times"),
    (4, 3, "pairs"),
    (4, 4, "separation_margin"),
    (5, 1, "flagged ledger obstacle_reasons pair_proof schedules what_if"),
    (5, 2, "monitor_arguments obstacle_book watched_arm"),
    (5, 3, "obstacle_looks obstacle_suspects watch"),
    (5, 4, "committed_plan explain foresight obstacle_tick pair_reports pair_watch"),
    (5, 4, "snapshot stop_decision"),
    (5, 5, "judgement obstacle_watch"),
    (5, 6, "watches"),
    (6, 1, "monitor_answers"),
    (6, 2, "monitor"),
    (7, 1, "armguard cell_schema simulation streams"),
    (7, 2, "announcer cell_frames cell_tool tally"),
    (7, 3, "cell"),
    (8, 1, "cover_command loop view"),
    (8, 2, "summary"),
    (8, 3, "demo supervision"),
    (9, 1, "cli"),
    (9, 2, "__main__"),
]
FLOOR_OF = {name: (floor, step) for floor, step, names in FLOORS for name in names.split()}


def read_modules(package=PACKAGE):
    """Syntax trees of all modules under `package`, by dotted name without `armguard.`."""
    trees = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package.parent).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        trees[name] = (ast.parse(path.read_text(encoding="utf-8")), path.name == "__init__.py")
    return trees


MODULES = read_modules()


def read_imports(name, modules=MODULES):
    """Names of the armguard modules that one module imports, wherever in it the import stands."""
    tree, is_package = modules[name]
    parent = name if is_package else name.rpartition(".")[0]
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            relative = "." * node.level + (node.module or "")
            base = importlib.util.resolve_name(relative, parent) if node.level else node.module
            # `from package import module` imports the module, `from module import name` its home.
            found |= {
                f"{base}.{alias.name}" if f"{base}.{alias.name}" in modules else base
                for alias in node.names
            }
    return {one for one in found if one.split(".")[0] == "armguard"}


def read_room(name):
    """What stands on a floor: a top-level module, a package as a whole, or armguard itself."""
    parts = name.split(".")
    return parts[1] if len(parts) > 1 else parts[0]


@pytest.mark.parametrize("name", MODULES)
def test_a_module_imports_only_from_lower_floors(name):
    room = read_room(name)
    assert room in FLOOR_OF, (
        f"{room} has no floor: add it to FLOORS in tests/test_floors.py, above all that it "
        "imports, and say in docs/architecture.md what it holds"
    )
    for imported in read_imports(name):
        other = read_room(imported)
        if other == room:
            continue  # within a package: held by the test of cycles
        assert other in FLOOR_OF, f"{name} imports {imported}, which has no floor"
        assert FLOOR_OF[other] < FLOOR_OF[room], (
            f"{name} (floor {FLOOR_OF[room]}) imports {imported} (floor {FLOOR_OF[other]}): "
            "move what both need to a lower floor, or hand it over as an argument"
        )


def test_the_table_names_nothing_twice_and_nothing_that_is_gone():
    assert len(FLOOR_OF) == sum(len(names.split()) for _, _, names in FLOORS)
    assert not set(FLOOR_OF) - {read_room(name) for name in MODULES}


def test_no_module_imports_itself_by_way_of_others():
    graph = {name: read_imports(name) for name in MODULES}
    list(graphlib.TopologicalSorter(graph).static_order())  # raises CycleError with the cycle


@pytest.mark.parametrize("name", MODULES)
def test_no_import_hides(name):
    tree, _ = MODULES[name]
    words = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    words |= {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    words |= {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert not words & {"TYPE_CHECKING", "import_module", "__import__"}


@pytest.mark.parametrize(
    "name", [name for name, (_, is_package) in MODULES.items() if not is_package]
)
def test_each_module_has_tests_of_its_own(name):
    *folders, module = name.split(".")[1:]
    twin = ROOT.joinpath("tests", *folders, f"test_{module}.py")
    assert module == "__main__" or twin.exists(), f"{name} has no {twin.relative_to(ROOT)}"


def test_what_the_reader_of_imports_sees(tmp_path):
    package = tmp_path / "armguard"
    (package / "rooms").mkdir(parents=True)
    (package / "__init__.py").write_text("from armguard import lamp")
    (package / "lamp.py").write_text("import numpy\ndef late():\n    import armguard.rooms.door")
    (package / "rooms" / "__init__.py").write_text("from . import door\nfrom ..lamp import late")
    (package / "rooms" / "door.py").write_text("from armguard.rooms import hinge")
    modules = read_modules(package)
    assert {name: read_imports(name, modules) for name in modules} == {
        "armguard": {"armguard.lamp"},
        "armguard.lamp": {"armguard.rooms.door"},
        "armguard.rooms": {"armguard.rooms.door", "armguard.lamp"},
        "armguard.rooms.door": {"armguard.rooms"},
    }


def test_the_architecture_page_tells_the_same_floors():
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    told = {}
    for floor, rooms in re.findall(r"^\| (\d) \| ([^|]+) \|", page, flags=re.MULTILINE):
        told |= {name: int(floor) for name in re.findall(r"`(\w+)(?:\.py|/)`", rooms)}
    assert told == {name: floor for name, (floor, _) in FLOOR_OF.items() if name != "armguard"}
