"""The pages about robot.toml and about arms that were tried say what the code and a run say."""

import json
import runpy
import tomllib
from pathlib import Path

import msgspec
import pytest

from armguard.robot import Robot
from armguard.robot.brakes import BrakeRow
from armguard.robot.description import RobotDescription, read_description
from support.urdf_arms import two_links

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "robot.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(DOCS / "make_robot.py"))


@pytest.fixture(scope="module")
def arms():
    return runpy.run_path(str(DOCS / "make_arms.py"))


def list_schemas(schema):
    """A class that reads a table, and those of all tables in it."""
    found = {schema}
    for field in msgspec.structs.fields(schema):
        for part in (field.type, *find_parts(field.type)):
            if isinstance(part, type) and issubclass(part, msgspec.Struct):
                found |= list_schemas(part)
    return found


def find_parts(kind):
    parts = getattr(kind, "__args__", ())
    return [inner for part in parts for inner in (part, *find_parts(part))]


def test_the_page_is_what_its_script_writes(script):
    assert script["write_page"]() == PAGE


def test_every_table_and_every_key_is_told(script):
    told = {schema for _, schema, _ in script["SECTIONS"]}
    assert told == list_schemas(RobotDescription)
    for _, schema, module in script["SECTIONS"]:
        keys = script["read_keys"](schema, module)
        assert [name for name, *_ in keys] == list(schema.__struct_fields__)
        for name, kind, default, text in keys:
            assert f"{script['write_key'](name, kind, default, text)}\n" in PAGE
            assert text.endswith(".")
            is_measure = "number" in kind
            assert "[" in text or not is_measure or name == "braking", name


def test_keys_that_are_told_to_be_needed_are_needed(script):
    for _, schema, module in script["SECTIONS"]:
        needed = [name for name, _, default, _ in script["read_keys"](schema, module)
                  if default == "needed"]  # fmt: skip
        fields = msgspec.structs.fields(schema)
        assert needed == [field.name for field in fields if field.required]
    assert {field.name for field in msgspec.structs.fields(BrakeRow) if field.required} == {
        "load", "speed"
    }  # fmt: skip


def test_the_least_description_loads(tmp_path):
    text = PAGE.partition("```toml\n")[2].partition("```")[0]
    description = read_description(tomllib.loads(text))
    robot = Robot.from_urdf(two_links(tmp_path), limits=tomllib.loads(text))
    assert robot.joints == tuple(description.joints)


def test_every_arm_of_the_examples_was_tried(arms):
    rows = json.loads((DOCS / "arms.json").read_text(encoding="utf-8"))
    assert sorted(rows) == arms["list_arms"]()
    assert arms["write_page"](rows) == (DOCS / "arms.md").read_text(encoding="utf-8")
    for row in rows.values():
        assert ("refused" in row) != ("links" in row)
