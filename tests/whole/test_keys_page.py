"""The lines of the page about keys are good ones."""

import re
import shlex
from pathlib import Path
from typing import get_args

from armguard.app.cell import Cell
from armguard.app.cli import main
from armguard.streams.authentication import Right
from armguard.streams.keys import write_new_pair
from support.cell_texts import ROBOT

PAGE = (Path(__file__).parents[2] / "docs" / "keys.md").read_text()


def read_blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, flags=re.MULTILINE | re.DOTALL)


def test_the_keys_are_made_as_it_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = read_blocks("sh")[0].splitlines()
    for line in lines:
        assert main(shlex.split(line)[1:]) == 0
    assert len(list((tmp_path / "cell").iterdir())) == 2 * len(lines)


def test_the_lines_for_the_cell_file_let_in_whom_they_name(tmp_path):
    write_new_pair("monitor", tmp_path)
    (lines,) = read_blocks("toml")
    with Cell.from_text(ROBOT + lines, tmp_path).make_authenticator() as authenticator:
        assert set(authenticator.clients) == {"camera", "desk"}


def test_the_snippet_runs():
    (snippet,) = read_blocks("python")
    exec(compile(snippet, "keys.md", "exec"), {})


def test_every_right_is_told():
    assert re.findall(r"^\| `(\w+)` \|", PAGE, flags=re.MULTILINE) == [*get_args(Right)]
