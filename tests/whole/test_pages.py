"""Pages that scripts write are what these write, and the pages name all that they promise to."""

import re
import runpy
from pathlib import Path

import pytest

import armguard
from armguard.app.premises import Premise

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


@pytest.mark.parametrize("page", ["cell", "safety"])
def test_a_page_is_what_its_script_writes(page):
    script = runpy.run_path(str(DOCS / f"make_{page}.py"))
    told = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    assert told == script["write_page"](), f"python docs/make_{page}.py writes it anew"


@pytest.mark.parametrize("premise", list(Premise), ids=lambda premise: premise.name)
def test_each_premise_stands_on_the_page_of_safety_notes(premise):
    page = (DOCS / "safety.md").read_text(encoding="utf-8")
    assert f"**{premise.text[0].upper()}{premise.text[1:]}.** {premise.explanation}\n" in page


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
        *("README.md", "docs/contact.md", "docs/extremes.md", "docs/faults.md", "docs/keys.md"),
        *("docs/paper/README.md", "docs/performance.md", "docs/recording.md", "docs/sensors.md"),
        *("docs/several_arms.md", "docs/start.md", "docs/usefulness.md", "docs/view.md"),
    ],
)
def test_a_page_of_measured_times_names_its_machine_and_version(name):
    page = (ROOT / name).read_text(encoding="utf-8")
    assert re.search(r"\barmguard \d+\.\d+\.\d+\b", page)
    assert re.search(r"EPYC|Xeon|znver\d|processor .{0,10}was not noted|Machine: \w+", page)
