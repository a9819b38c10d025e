"""The page of hazards: each has a test that shows what is done, and each mark has its hazard."""

import ast
import re
import runpy
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(DOCS / "make_hazards.py"))


def test_the_page_is_what_its_script_writes(script):
    told = (DOCS / "hazards.md").read_text(encoding="utf-8")
    assert told == script["write_page"](), "python docs/make_hazards.py writes it anew"
    assert script["TABLE"].read_text(encoding="utf-8") == script["write_tests"]()


def test_each_hazard_has_a_test_and_each_mark_a_hazard(script):
    hazards, marks = script["read_hazards"](), script["read_marks"]()
    assert set(hazards) - set(marks) == set(), "hazards without a test"
    assert set(marks) - set(hazards) == set(), "marks without a hazard"
    for number, hazard in hazards.items():
        names = [mark.split(": ")[1] for mark in marks[number]]
        assert hazard["test"] in names, f"{number}: its test is not marked with it"


def test_each_mark_is_one_that_is_read(script):
    """None on a class, on a module, or without a number, where the script would not find it."""
    count = 0
    for path in script["TESTS"].rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if "mark.hazard" in text and path != Path(__file__):
            tree = ast.parse(text)
            count += sum(
                len(script["list_hazards"](node))
                for node in ast.walk(tree)
                if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
            )
            written = re.findall(r"mark\.hazard\b(?:\(([^)]*)\))?", text)
            count -= sum(max(1, one.count("H-")) for one in written)
    assert count == 0


def test_hazards_are_numbered_and_complete(script):
    hazards = script["read_hazards"]()
    assert list(hazards) == [f"H-{number:02}" for number in range(1, len(hazards) + 1)]
    for number, hazard in hazards.items():
        assert tuple(hazard) == script["FIELDS"], number
        assert all("|" not in text and "\n" not in text for text in hazard.values()), number
        told = [name for name in script["FIELDS"][1:] if name != "test"]
        assert all(hazard[name].endswith(".") for name in told), number


def test_each_text_is_in_the_references_in_its_edition(script):
    listed = (DOCS / "references.md").read_text(encoding="utf-8")
    for key, (edition, *_) in script["STANDARDS"].items():
        entry = re.search(rf"^- \*\*\[{key}\]\*\* (.*)$", listed, re.MULTILINE)
        assert entry, key
        assert edition in entry[1]


def test_nothing_claims_conformity(script):
    page = script["write_page"]()
    assert "no certified safety device" in page
    for sentence in re.split(r"[.|\n]", page):
        if re.search(r"\b(conform|compli|certified|fulfil)", sentence):
            assert re.search(r"\b(no|Nothing|Whether)\b", sentence), sentence


def test_a_mark_is_read_wherever_it_stands(script):
    source = '@pytest.mark.parametrize("a", [1])\n@pytest.mark.hazard("H-01", "H-02")\ndef f(): ...'
    assert script["list_hazards"](ast.parse(source).body[0]) == ["H-01", "H-02"]
