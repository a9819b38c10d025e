"""The page of hazards: `python docs/make_hazards.py` writes docs/hazards.md.

Hazards are those of docs/hazards.toml. The tests that show what armguard does about each say so
themselves, by `@pytest.mark.hazard("H-07")`.
"""

from __future__ import annotations

import ast
import tomllib
from pathlib import Path

DOCS = Path(__file__).resolve().parent
PAGE = DOCS / "hazards.md"
TESTS = DOCS.parent / "tests"

FIELDS = ("hazard", "cause", "does", "premise", "remains")
"""What docs/hazards.toml says of each hazard."""

HEAD = """# Hazards

<!-- written by docs/make_hazards.py from docs/hazards.toml and the marks of tests: change it there -->

What can go wrong in a monitored cell, what armguard does about it, and what it leaves to the integrator. The list is a beginning for a risk assessment of a cell, and none by itself: each cell has hazards of its own (tools, parts, energies, tasks), and who puts a machine into service decides what is enough.

armguard is software for research and integration, **no certified safety device**. Nothing on this page claims that armguard, or a cell which uses it, conforms to a standard or to a law.

## The list

Each test is marked with the hazards that it is about. A hazard without a test, and a mark without a hazard, fail the tests of the project. `pytest FILE -k NAME` runs one. A test shows what armguard does under the premise; it does not show that the premise holds in your cell.
"""

STANDARDS = {
    "RiskAssessment": (
        "ISO 12100:2010",
        "How to find hazards, to estimate and evaluate risks, and to reduce them: first by design, then by safeguards, then by information. A revision is under way: look for a newer edition.",
        "The table above, with causes, premises and what remains, as an input. `armguard run --premises` lists the premises with the cell's own figures.",
        "The assessment: limits of the machine, its tasks and persons, severity and probability, and the decision that a risk is low enough.",
    ),
    "Robots2025": (
        "ISO 10218-1:2025",
        "What an industrial robot must bring as a machine, cybersecurity included, and what its maker must state, such as stopping times and distances.",
        "It uses what makers state, by load and speed, and finds stopping times in recordings (`armguard commission`).",
        "Functions of the robot itself, such as its protective stop, its safety-rated limits of speed and space, and their performance.",
    ),
    "Integration2025": (
        "ISO 10218-2:2025",
        "How robots are integrated into cells and applications. It has taken up what ISO/TS 15066 said of collaborative applications: monitoring of speed and separation, and limiting of power and force.",
        "The separation distance for comparison, verdicts from motion bounds, contact limits by region of the body, and evidence: recordings, replays, premises.",
        "The safety functions and their required performance, measurements of force and pressure in the cell, its limits for contact, and validation of the whole.",
    ),
    "Approach": (
        "ISO 13855:2024",
        "How far safeguards must stand from a hazard, by how fast bodies approach and how long the machine takes to stop. The edition of 2024 adds a dynamic distance for mobile applications. Running, jumping and falling are outside of it.",
        "The usual walking speed in the comparison, and times of the whole chain, from the sample to rest, in each verdict.",
        "The placement of protective devices. A camera that feeds armguard is not thereby a protective device.",
    ),
    "ControlSystems": (
        "ISO 13849-1:2023",
        "How parts of a control system that perform safety functions are designed, quantified and validated, their software included.",
        "A specification that can be tested: named premises, laws held by tests, an error inside that is a STOP, and each verdict repeatable to the bit.",
        "A performance level. armguard runs on one channel, on a general computer and operating system, and has no rate of dangerous failures, and no assessed process of development.",
    ),
    "MachineryRegulation": (
        "Regulation (EU) 2023/1230",
        "The law for machinery that is placed on the market of the EU from 20 January 2027 on. Annex III, 1.1.9: what matters for safety is protected against corruption, the installed software can be identified at any time, and evidence of interventions is collected. Annex III, 1.2.1: logs of interventions and of versions of safety software are kept for five years after an upload; for systems with self-evolving behaviour, data on safety decisions are kept for one year. It was amended in 2026: read the consolidated text.",
        "Recordings that hold versions, configuration, inputs and each verdict, and that show changes (`--sign`, `--verify`). One digest of the configuration. Parts by time and size, with a retention of your choice (`--keep-days`; 1830 days are a little more than five years). armguard itself learns nothing while it runs.",
        "Whether armguard is a safety component in your machine, the conformity assessment, the technical documentation, protection of the computer and of the keys, and a log of what happens outside of armguard.",
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
    marks = read_marks()
    rows = []
    for number, hazard in read_hazards().items():
        tests = "<br>".join(f"`{name}`" for name in marks.get(number, ()))
        cells = [hazard[name] for name in FIELDS]
        rows.append(f"| {number} | {' | '.join([*cells[:4], tests, cells[4]])} |")
    standards = [
        f"| {edition} [[{key}](references.md)] | {about} | {contributes} | {left} |"
        for key, (edition, about, contributes, left) in STANDARDS.items()
    ]
    table = [
        "| no. | hazard | cause | what armguard does | premise | tests that show it | what remains for the integrator |",
        "|---|---|---|---|---|---|---|",
        *rows,
    ]
    law = [
        "## Standards and the law",
        "",
        "In words of this project, as of November 2026. The texts themselves count, in their present editions.",
        "",
        "| text | what it is about | what armguard contributes | what it does not |",
        "|---|---|---|---|",
        *standards,
    ]
    return "\n".join([HEAD, *table, "", *law, ""])


if __name__ == "__main__":
    PAGE.write_text(write_page(), encoding="utf-8")
