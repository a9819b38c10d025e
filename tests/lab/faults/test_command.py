import re

import pytest

from armguard.app.cli import main
from armguard.lab.faults import command


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--only", "earthquake"], "'earthquake' is no fault"),
        (["--out", "/nowhere/faults.md"], "/nowhere/faults.md: cannot be written (No such"),
        (["--out", "/tmp"], "/tmp: cannot be written (Is a directory)"),
    ],
)
def test_mistakes_are_one_line_before_any_fault_is_made(arguments, words, capsys, monkeypatch):
    monkeypatch.setattr(command, "run_campaign", None)
    assert main(["faults", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(r"armguard: [^\n]+\n", err)
    assert words in err
