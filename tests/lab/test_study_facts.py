import pytest

from armguard.app.cli import Extremes
from armguard.exceptions import ArmguardError
from armguard.lab.study_facts import digest_file, is_by_rows, list_facts, open_rows
from support.slow_rows import square


def test_rows_are_measured_one_by_one_only_where_that_is_asked_for(tmp_path):
    assert not is_by_rows(Extremes())
    with open_rows(Extremes(), tmp_path, {}) as rows:
        assert rows.measure(square, 1, {"row": (2,)}, "", lambda *told: None)[0] == {
            "row": {"square": 4}
        }
    assert not list(tmp_path.iterdir())
    for asked in (Extremes(dask="local"), Extremes(workers=2), Extremes(resume=True)):
        assert is_by_rows(asked)
    with open_rows(Extremes(resume=True), tmp_path, {"seed": "0"}) as rows:
        assert rows.kept == 0
    assert (tmp_path / "rows" / "study.json").is_file()


def test_a_file_is_known_by_its_content(tmp_path):
    (tmp_path / "a").write_text("x")
    (tmp_path / "b").write_text("x")
    assert digest_file(tmp_path / "a") == digest_file(tmp_path / "b") != digest_file(None)
    with pytest.raises(ArmguardError, match="cannot be read"):
        digest_file(tmp_path / "c")


def test_a_page_names_machine_versions_and_seed():
    facts = list_facts(3)
    assert set(facts) == {"machine", "versions", "seed"}
    assert facts["seed"] == "3"
    assert "numba" in facts["versions"]
