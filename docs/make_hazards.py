"""The page of hazards: `python docs/make_hazards.py` writes docs/hazards.md.

Hazards are those of docs/hazards.toml. The tests that show what armguard does about each say so
themselves, by `@pytest.mark.hazard("H-07")`.
"""

from __future__ import annotations

import ast
import csv
import io
import tomllib
from pathlib import Path

DOCS = Path(__file__).resolve().parent
PAGE = DOCS / "hazards.md"
TABLE = DOCS / "hazards" / "tests.csv"
TESTS = DOCS.parent / "tests"

FIELDS = ("hazard", "cause", "does", "test", "premise", "remains")
"""What docs/hazards.toml says of each hazard."""

HEAD = """---
hide: [toc]
---

# Hazards

<!-- written by docs/make_hazards.py from docs/hazards.toml -->

An input for the risk assessment of a monitored cell; each cell has more hazards. armguard is **no certified safety device**. Nothing here claims conformity to a standard or a law.

A test shows what armguard does under the premise, not that the premise holds in your cell ([all tests](hazards/tests.csv)).
"""

STANDARDS = {
    "RiskAssessment": (
        "ISO 12100:2010",
        "risk assessment and reduction",
        "this table; `armguard run --premises`",
        "the assessment itself",
    ),
    "Robots2025": (
        "ISO 10218-1:2025",
        "industrial robots as machines",
        "measured stopping times (`armguard commission`)",
        "functions of the robot",
    ),
    "Integration2025": (
        "ISO 10218-2:2025",
        "robot cells",
        "verdicts, contact limits, recordings",
        "safety functions, measured force and pressure, validation",
    ),
    "Approach": (
        "ISO 13855:2024",
        "distance of safeguards by approach speed",
        "separation distance for comparison",
        "placement of protective devices",
    ),
    "ControlSystems": (
        "ISO 13849-1:2023",
        "safety-related control",
        "repeatable verdicts",
        "a performance level: armguard has one channel and no assessed development",
    ),
    "MachineryRegulation": (
        "Regulation (EU) 2023/1230",
        "EU law from 20 January 2027; it asks for logs for five years",
        "signed recordings (`--sign`, `--verify`, `--keep-days 1830`)",
        "Whether it is a safety component, and the assessment of conformity",
    ),
}
"""By key of docs/references.md: edition, what it is about, what armguard contributes, and not."""


def read_hazards() -> dict[str, dict[str, str]]:
    """All hazards, by their number."""
    return tomllib.loads((DOCS / "hazards.toml").read_text(encoding="utf-8"))


def read_marks() -> dict[str, list[str]]:
    """Tests by the hazards with which they are marked, each as "folder/test_module.py: name"."""
    found: dict[str, list[str]] = {}
    for path in sorted(TESTS.rglob("test_*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                for hazard in list_hazards(node):
                    name = f"{path.relative_to(TESTS).as_posix()}: {node.name}"
                    found.setdefault(hazard, []).append(name)
    return found


def list_hazards(function: ast.FunctionDef) -> list[str]:
    """The hazards with which a test is marked."""
    return [
        ast.literal_eval(argument)
        for decorator in function.decorator_list
        if isinstance(decorator, ast.Call) and ast.unparse(decorator.func) == "pytest.mark.hazard"
        for argument in decorator.args
    ]


def write_page() -> str:
    """The page, in Markdown."""
    rows = []
    for number, hazard in read_hazards().items():
        title, cause, does, test, premise, remains = (hazard[name] for name in FIELDS)
        test = test.replace("_", "_<wbr>")
        what = f"**{number}: {title}**<br>{cause}"
        rows.append(f"| {what} | {does}<br><code>{test}</code> | {premise} | {remains} |")
    standards = [
        f"| {edition} [[{key}](references.md)] | {about} | {contributes} | {left} |"
        for key, (edition, about, contributes, left) in STANDARDS.items()
    ]
    table = [
        "| hazard and cause | what armguard does, and a test | premise | what remains |",
        "|---|---|---|---|",
        *rows,
    ]
    law = [
        "## Standards and the law",
        "",
        "As of November 2026; the texts count.",
        "",
        "| text | about | armguard contributes | armguard does not |",
        "|---|---|---|---|",
        *standards,
    ]
    return "\n".join([HEAD, *table, "", *law, ""])


def write_tests() -> str:
    """The tests of each hazard, as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["hazard", "file", "test"])
    for number, tests in sorted(read_marks().items()):
        writer.writerows([number, *test.split(": ")] for test in tests)
    return text.getvalue()


if __name__ == "__main__":
    TABLE.parent.mkdir(exist_ok=True)
    TABLE.write_text(write_tests(), encoding="utf-8")
    PAGE.write_text(write_page(), encoding="utf-8")
