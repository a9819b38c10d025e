import re

import pytest

from armguard.app.cli import main
from armguard.exceptions import ArmguardError
from armguard.lab.faults import command


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--only", "earthquake"], "'earthquake' is no fault"),
        (["--out", "/nowhere/faults.md"], "/nowhere/faults.md: cannot be written (No such"),
        (["--out", "/tmp"], "/tmp: cannot be written (Is a directory)"),
        (["--out", "/tmp/" + "x" * 300], "cannot be written (File name too long)"),
    ],
)
def test_mistakes_are_one_line_before_any_fault_is_made(arguments, words, capsys, monkeypatch):
    monkeypatch.setattr(command, "run_campaign", None)
    assert main(["faults", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(r"armguard: [^\n]+\n", err)
    assert words in err


def test_a_campaign_that_fails_leaves_the_page_as_it_was(tmp_path, monkeypatch):
    def fail(faults, tell):
        raise ArmguardError("the monitor process", "has ended by itself")

    monkeypatch.setattr(command, "run_campaign", fail)
    old, new = tmp_path / "old.md", tmp_path / "new.md"
    old.write_text("what was found before")
    for page in (old, new):
        assert main(["faults", "--out", str(page)]) == 2
    assert old.read_text() == "what was found before"
    assert not new.exists()
