"""What README and pages say can be done can be done: their snippets and commands are run."""

import ast
import inspect
import json
import os
import re
import shlex
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

import armguard_check
from armguard.app.cli import main

ROOT = Path(__file__).parents[2]
PAGES = {
    path.stem: path.read_text(encoding="utf-8")
    for path in (
        ROOT / "README.md",
        *(
            ROOT / "docs" / f"{name}.md"
            for name in (
                "start",
                "concepts",
                "obstacles",
                "verdicts",
                "cells",
                "troubleshooting",
                "operating_limits",
                "pieces",
                "shield",
                "policies",
                "recording",
                "proofs",
            )
        ),
    )
}
README = PAGES["README"]
# In the environment that docs/start.md makes, where there is one (see test_commands.py).
ARMGUARD = Path(os.environ.get("ARMGUARD_START", sys.prefix), "bin", "armguard")


def read_blocks(language, page=README):
    return re.findall(rf"^```{language}\n(.*?)^```$", page, flags=re.MULTILINE | re.DOTALL)


COMMANDS = [
    line.removeprefix("$ ")
    for page in PAGES.values()
    for block in read_blocks("console", page)
    for line in block.splitlines()
    if line.startswith("$ ")
]


def run_snippets(name):
    """The names that the snippets of a page leave, run one after another from the checkout."""
    names = {}
    for snippet in read_blocks("python", PAGES[name]):
        exec(compile(snippet, f"{name}.md", "exec"), names)
    return names


def test_the_snippet_of_the_readme_runs(capsys):
    run_snippets("README")
    printed = re.findall(r"s: (\w+), contact", capsys.readouterr().out)
    assert printed == ["CLEAR", "AWARE", "SLOW", "STOP"], "as the README says of it"


@pytest.mark.parametrize("name", sorted(set(PAGES) - {"README"}))
def test_the_snippets_of_a_page_run_one_after_another(name, monkeypatch):
    monkeypatch.chdir(ROOT)
    names = run_snippets(name)
    if name == "obstacles":
        assert not names["cell"].take_faults()
    if name == "start":
        assert not [reason for reason in names["verdict"].reasons if "refused" in reason.kind.text]
        assert names["verdict"].obstacle == "hand"
    if name == "recording":
        assert names["report"].is_identical
    if name == "proofs":
        assert armguard_check.verify(json.loads(names["line"])).contact_time > 0.0


def test_figures_in_the_readme_stand_on_the_pages_that_they_name():
    rows = re.findall(r"^\| .* \| (.*\*\*.*) \| `.*` \| \[.*\]\((.*)\) \|$", README, re.MULTILINE)
    assert len(rows) >= 5
    for answer, page in rows:
        told = re.sub(r"[*`]", "", (ROOT / page).read_text(encoding="utf-8"))
        for figure in re.findall(r"\*\*(.*?)\*\*", answer):
            found = re.search(rf"(?<![\d.]){re.escape(figure)}(?![\d.]*\d)", told)
            assert found, f"{page} does not say {figure}: measured anew? Then say so in README.md"


def test_figures_in_the_readme_on_stopping_name_bounds_and_age():
    """Both decide how often an arm stops, so a figure without them says nothing."""
    rows = re.findall(r"^\| .* \| (.*) \| `.*` \| \[.*\]\(docs/usefulness.md\) \|$", README, re.M)
    assert rows
    for answer in rows:
        assert re.search(r"bounds on people (by body part|[\d.]+ m/s² and [\d.]+ m/s)", answer)
        assert re.search(r"samples \d+ ms old", answer)


def test_figures_in_the_readme_among_many_are_the_default_ones_of_their_scene():
    """The page has other scenes and settings, whose figures may be alike."""
    (row,) = re.findall(r"^\| And among 1,000 obstacles\? .*$", README, re.MULTILINE)
    page = (ROOT / "docs" / "settings.md").read_text(encoding="utf-8")
    (told,) = re.findall(r"1,000 balls a tick takes (\S+) µs in the median, and (\S+) of", page)
    assert tuple(re.findall(r"\*\*(.*?)\*\*", row)) == told
    report = (ROOT / "docs" / "tradeoff" / "near-1000" / "README.md").read_text(encoding="utf-8")
    (command,) = re.findall(r"`(armguard tradeoff .*?)`", row)
    assert f"`{command} --out near-1000`" in report


def test_the_first_snippet_is_the_first_demo():
    source = (ROOT / "demos" / "01_hello.py").read_text(encoding="utf-8")
    (main,) = (node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef))
    body = source.splitlines()[main.body[1].lineno - 1 : main.end_lineno]
    (snippet,) = read_blocks("python")
    assert snippet == "import armguard\n\n" + textwrap.dedent("\n".join(body)) + "\n"


@pytest.mark.parametrize("command", COMMANDS)
def test_the_commands_run(command):
    program, *arguments = shlex.split(command)
    assert program == "armguard", "`console` blocks hold commands of armguard that end soon"
    result = subprocess.run(
        [ARMGUARD, *arguments],
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=300,  # a cold start compiles
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout
    if arguments == ["demo", "--duration", "2", "--json"]:
        check_summary(json.loads(result.stdout))


def check_summary(summary):
    """What a demo of two seconds says of itself fits together."""
    assert 0 < summary["ticks"] <= 2001
    assert set(summary["levels"]) == {"STOP", "SLOW", "AWARE", "CLEAR"}
    assert sum(summary["levels"].values()) == summary["ticks"]
    assert 0 <= summary["stops"] <= summary["levels"]["STOP"]
    assert summary["min_contact_time"] is None or summary["min_contact_time"] >= 0
    assert 0 < summary["tick_us"]["p50"] <= summary["tick_us"]["p99"] <= summary["tick_us"]["max"]
    assert 0 <= summary["incomplete"] <= summary["ticks"]
    assert summary["faults"] >= 0


def test_every_command_that_is_named_exists():
    named = set(re.findall(r"(?<![\w/.-])armguard ([a-z]+)\b", code()))
    assert "demo" in named
    for command in named:
        with pytest.raises(SystemExit) as end:
            main([command, "--help"])
        assert end.value.code in (0, None), f"armguard {command}"


def code():
    """All that stands in blocks and between backticks."""
    found = []
    for page in PAGES.values():
        found += re.findall(r"^```\w*\n(.*?)^```$", page, flags=re.MULTILINE | re.DOTALL)
        found += re.findall(r"`([^`\n]+)`", page)
    return "\n".join(found)


def test_the_two_commands_are_there():
    first, second = read_blocks("sh")[0].splitlines()
    assert first == (
        "python3 -m venv .venv && .venv/bin/pip install -e '.[test]' && .venv/bin/armguard demo"
    )
    assert second == ".venv/bin/pytest -n 2 --dist worksteal"


def test_links_lead_somewhere():
    for page in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
            if not target.startswith("http"):
                assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_defaults_in_words_are_those_of_the_code():
    from armguard import Obstacles, Settings

    usual = Settings()
    for name, words in {
        "aware_margin": "`aware_margin` (0.3 s)",
        "slow_margin": "`slow_margin` (0.1 s)",
        "rise_delay": "0.3 s of evidence (`rise_delay`)",
        "source_timeout": "`source_timeout`, 0.2 s",
    }.items():
        assert any(words in page for page in PAGES.values()), words
        assert f"{getattr(usual, name)} s" in words
    assert "at most 10 m/s² and 2 m/s" in README
    bounds = inspect.signature(Obstacles).parameters
    assert (bounds["accel"].default, bounds["speed"].default) == (10.0, 2.0)
