"""armguard is built in rooms: each package imports only from those named here, and no circles.

The table is the law; docs/architecture.md tells it in words.
"""

import ast
import functools
import graphlib
import importlib.util
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "armguard"

EVERYTHING = "all"

# Packages and modules of the root, and what each may import beside itself and `exceptions`.
ROOMS = {
    "exceptions": "",
    "clock": "",
    "lazy": "",  # for faces alone
    "verdict": "contact",  # for the type of a certificate
    "body_regions": "",
    "key_files": "",
    "jit": "",
    "contact": "jit",
    "obstacles": "messages jit body_regions",
    "cover": "contact jit",
    "robot": "cover jit",
    "settings": "robot jit body_regions",
    "bounds": "robot cover obstacles contact jit",
    "pairs": "messages settings bounds robot cover obstacles contact jit",
    "scheduling": "settings pairs bounds robot cover obstacles contact jit",
    "monitor": "messages settings scheduling pairs bounds robot cover obstacles contact jit "
    "verdict",
    "shield": "monitor bounds robot jit verdict",
    "messages": "contact verdict",
    "streams": "messages obstacles contact verdict clock key_files",
    "view": "streams bounds robot",
    "recording": "messages bridges monitor settings scheduling pairs bounds robot obstacles "
    "verdict key_files",
    "people": "obstacles jit",
    "bridges": "messages monitor robot obstacles verdict",
    "drivers": "messages bridges streams verdict",
    "gymnasium": "shield monitor robot obstacles jit",
    "app": "all but lab",
    "lab": EVERYTHING,
}

# What leads into the wing `lab`, each when it is called: commands, and names of two faces that are
# loaded when they are first asked for.
DOORS = {
    "armguard": {"lab.choice"},
    "armguard.people": {"lab.people"},
    "armguard.app.cli": {
        "lab.commission.command",
        "lab.covers",
        "lab.demo.launcher",
        "lab.extremes.command",
        "lab.faults.command",
        "lab.new_robot.command",
        "lab.paper.command",
        "lab.show",
        "lab.tracked_people.command",
        "lab.tradeoff.command",
    },
}

# Those that ask the face `armguard` for such names.
ASKING = {"armguard.monitor.monitor", "armguard.app.loop"}


def find_modules(package=PACKAGE):
    """Files of all modules under `package`, by dotted name."""
    found = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package.parent).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def is_face(path):
    return path.name == "__init__.py"


@functools.cache
def parse(path):
    """The syntax tree of a module."""
    return ast.parse(path.read_text(encoding="utf-8"))


MODULES = find_modules()
ABOVE_ALL = {"armguard", "armguard.__main__"}


def read_imports(name, modules=MODULES):
    """Names of the armguard modules that one module imports, wherever in it the import stands."""
    path = modules[name]
    parent = name if is_face(path) else name.rpartition(".")[0]
    found = set()
    for node in ast.walk(parse(path)):
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


def may_import(room, other):
    if ROOMS[room] == "all but lab":
        return other != "lab"
    return ROOMS[room] == EVERYTHING or other in ROOMS[room].split()


def read_room(name):
    """A package as a whole, or a module of the root."""
    parts = name.split(".")
    return parts[1] if len(parts) > 1 else parts[0]


@pytest.mark.parametrize("name", sorted(set(MODULES) - ABOVE_ALL))
def test_a_module_imports_only_what_its_room_may(name):
    room = read_room(name)
    assert room in ROOMS, (
        f"{room} is no room: add it to ROOMS, with what it may import, and say in "
        "docs/architecture.md what it holds"
    )
    for imported in read_imports(name):
        other = read_room(imported)
        if other in (room, "exceptions") or (imported == "armguard" and name in ASKING):
            continue
        if other == "lab" and name in DOORS:
            continue
        if other == "lazy" and is_face(MODULES[name]):
            continue
        assert may_import(room, other), (
            f"{name} imports {imported}, which its room may not: move what both need to a room "
            "that both may import, or hand it over as an argument"
        )


def test_the_table_names_nothing_that_is_not_there():
    assert set(ROOMS) == {read_room(name) for name in set(MODULES) - ABOVE_ALL}
    named = {word for rooms in ROOMS.values() for word in rooms.split()}
    assert named - {EVERYTHING, "but"} <= set(ROOMS)


def test_these_doors_lead_into_the_wing_and_no_others():
    found = {}
    for name in MODULES:
        wing = {one for one in read_imports(name) if read_room(one) == "lab"}
        if wing and read_room(name) != "lab":
            found[name] = {one.removeprefix("armguard.") for one in wing}
    assert found == DOORS
    # Nothing of it is imported as a door's module is: only by functions, and for checkers of types.
    for name in DOORS:
        at_once = [node for node in parse(MODULES[name]).body if isinstance(node, ast.ImportFrom)]
        assert not any(node.module.startswith("armguard.lab") for node in at_once)


def test_no_module_imports_itself_by_way_of_others():
    # What asks the face for a name does so when it is called.
    graph = {
        name: read_imports(name) - ({"armguard"} if name in ASKING else set())
        for name in MODULES
        if name not in DOORS
    }
    list(graphlib.TopologicalSorter(graph).static_order())  # raises CycleError with the cycle


@pytest.mark.parametrize("name", MODULES)
def test_no_import_hides(name):
    tree = parse(MODULES[name])
    words = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    words |= {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    words |= {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert name == "armguard.lazy" or not words & {"import_module", "__import__"}


@pytest.mark.parametrize("name", [name for name, path in MODULES.items() if is_face(path)])
def test_a_face_is_explicit_and_does_nothing_else(name):
    tree = parse(MODULES[name])
    assert ast.get_docstring(tree), f"{name} does not say what it holds"
    body = [*tree.body]
    for lazy in [node for node in body if isinstance(node, ast.If)]:
        # What is loaded when it is first asked for is imported for checkers of types alone.
        assert lazy.test.id == "TYPE_CHECKING"
        (assignment,) = lazy.orelse
        homes = ast.literal_eval(assignment.value.args[1])
        for node in lazy.body:
            for alias in node.names:
                module = f"{node.module}.{alias.name}"
                assert homes.pop(alias.name) == (module if module in MODULES else node.module)
        assert not homes
        body.remove(lazy)
        body += lazy.body
    taken = {
        alias.asname or alias.name
        for node in body
        if isinstance(node, ast.ImportFrom) and node.module not in ("typing", "armguard.lazy")
        for alias in node.names
    }
    shown = [
        ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and node.targets[0].id == "__all__"
    ]
    assert set(*shown) == taken
    assert all(isinstance(node, ast.Expr | ast.ImportFrom | ast.Assign) for node in body)


@pytest.mark.parametrize("name", [name for name, path in MODULES.items() if not is_face(path)])
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
    modules = find_modules(package)
    assert {name: read_imports(name, modules) for name in modules} == {
        "armguard": {"armguard.lamp"},
        "armguard.lamp": {"armguard.rooms.door"},
        "armguard.rooms": {"armguard.rooms.door", "armguard.lamp"},
        "armguard.rooms.door": {"armguard.rooms"},
    }


def test_the_architecture_page_tells_the_same_rooms():
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    told = {}
    for room, imports in re.findall(r"^\| `(\w+)/` \| ([^|]+) \|", page, flags=re.MULTILINE):
        names = re.findall(r"`(\w+)`", imports)
        told[room] = imports.replace("`", "") if imports.startswith("all") else " ".join(names)
    packages = {name: ROOMS[name] for name in ROOMS if (PACKAGE / name).is_dir()}
    assert told == packages


def test_the_architecture_page_names_what_is_there():
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`((?:[a-z]+/)+[a-z_]+)`", page)) - {"armguard/robots"}
    assert "scheduling/certificates" in named
    missing = {name for name in named if not (PACKAGE / f"{name}.py").is_file()}
    assert not missing, f"docs/architecture.md names modules that are not there: {missing}"
