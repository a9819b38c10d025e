import re

import pytest

from armguard.app.cli import main


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--only", "earthquake"], "'earthquake' is no fault"),
        (["--only", "disk-full", "--out", "/nowhere/faults.md"], "no folder /nowhere"),
        (["--only", "disk-full", "--out", "/tmp"], "/tmp: is a folder"),
    ],
)
def test_mistakes_are_one_line(arguments, words, capsys):
    assert main(["faults", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(r"armguard: [^\n]+\n", err)
    assert words in err
