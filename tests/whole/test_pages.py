"""Pages that scripts write are what these write, and the pages name all that they promise to."""

import re
import runpy
from pathlib import Path

import pytest

import armguard
from armguard.app.premises import Premise

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def test_the_page_of_cell_files_is_what_its_script_writes():
    script = runpy.run_path(str(DOCS / "make_cell.py"))
    told = (DOCS / "cell.md").read_text(encoding="utf-8")
    assert told == script["write_page"](), "python docs/make_cell.py writes it anew"


def test_each_premise_is_explained_on_the_page_of_safety_notes():
    page = (DOCS / "safety.md").read_text(encoding="utf-8")
    for premise in Premise:
        text = premise.value[0].upper() + premise.value[1:]
        assert re.search(rf"^- \*\*{re.escape(text)}\.\*\* \w.*\.$", page, re.MULTILINE), premise


def test_each_public_name_is_on_the_page_of_the_api():
    page = (DOCS / "api.md").read_text(encoding="utf-8")
    named = re.findall(r"^::: armguard\.(\w+)$", page, flags=re.MULTILINE)
    assert sorted(named) == sorted(armguard.__all__)


def test_each_page_is_in_the_navigation():
    config = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    named = set(re.findall(r"[\w-]+\.md\b", config))
    missing = {page.name for page in DOCS.glob("*.md")} - named
    assert not missing, f"name them in mkdocs.yml, under nav: {sorted(missing)}"


@pytest.mark.parametrize(
    "name",
    [
        *("README.md", "docs/extremes.md", "docs/faults.md"),
        *("docs/paper/README.md", "docs/performance.md"),
        *("docs/start.md", "docs/usefulness.md"),
    ],
)
def test_a_page_of_measured_times_names_its_machine_and_version(name):
    page = (ROOT / name).read_text(encoding="utf-8")
    assert re.search(r"\barmguard \d+\.\d+\.\d+\b", page)
    assert re.search(r"EPYC|Xeon|znver\d|processor .{0,10}was not noted|Machine: \w+", page)
