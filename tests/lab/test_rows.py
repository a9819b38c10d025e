import math

import msgspec
import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.lab.rows import Here, Rows, pack_array, unpack_array
from support.slow_rows import square

STUDY = {"study": "squares", "seed": "0"}
TASKS = {f"row {number}": (number,) for number in range(4)}


def measure(rows, tasks=TASKS, function=square, tell=lambda text, share: None):
    return rows.measure(function, 10, tasks, "squares", tell)


def test_rows_come_in_the_order_of_their_tasks(tmp_path):
    class Backwards:
        def run(self, function, shared, tasks):
            return reversed(list(Here().run(function, shared, tasks)))

    found, is_whole = measure(Rows(Backwards(), tmp_path, STUDY, resume=False))
    assert list(found) == list(TASKS)
    assert [row["square"] for row in found.values()] == [0, 10, 40, 90]
    assert is_whole


def test_rows_that_were_kept_are_not_measured_again(tmp_path):
    measure(Rows(Here(), tmp_path, STUDY, resume=False), {"row 1": (1,)})

    def count(shared, number):
        counted.append(number)
        return square(shared, number)

    counted, rows = [], Rows(Here(), tmp_path, STUDY, resume=True)
    found, _ = measure(rows, function=count)
    assert counted == [0, 2, 3]
    assert found["row 1"]["square"] == 10
    assert (rows.resumed, rows.kept) == (1, 4)
    # Without --resume all are.
    counted, rows = [], Rows(Here(), tmp_path, STUDY, resume=False)
    measure(rows, function=count)
    assert counted == [0, 1, 2, 3]
    assert rows.resumed == 0


def test_each_row_names_the_machine_that_measured_it(tmp_path, monkeypatch):
    def say(name):
        monkeypatch.setattr("armguard.lab.rows.name_machine", lambda: name)

    say("slow (a processor)")
    measure(Rows(Here(), tmp_path, STUDY, resume=False), {"row 1": (1,)})
    say("fast (another)")
    found, _ = measure(Rows(Here(), tmp_path, STUDY, resume=True))
    assert [row["machine"] for row in found.values()] == [
        "fast (another)", "slow (a processor)", "fast (another)", "fast (another)",
    ]  # fmt: skip


def test_rows_of_another_study_are_not_taken(tmp_path):
    measure(Rows(Here(), tmp_path, STUDY, resume=False))
    with pytest.raises(ArmguardError, match="of another study: seed was 0, is 1; leave --resume"):
        Rows(Here(), tmp_path, STUDY | {"seed": "1"}, resume=True)
    with pytest.raises(ArmguardError, match="person was not there, is x"):
        Rows(Here(), tmp_path, STUDY | {"person": "x"}, resume=True)


@pytest.mark.parametrize("content", [b"", b"\xc1", msgspec.msgpack.encode({"name": "another"})])
def test_a_row_that_is_no_whole_one_is_measured_again(content, tmp_path):
    measure(Rows(Here(), tmp_path, STUDY, resume=False))
    for path in (tmp_path / "rows").glob("*.msgpack"):
        path.write_bytes(content)
    rows = Rows(Here(), tmp_path, STUDY, resume=True)
    assert len(measure(rows)[0]) == 4
    assert rows.resumed == 0


def test_an_interrupt_keeps_what_there_is(tmp_path):
    def tell(text, share):
        if text.endswith("row 1"):
            raise KeyboardInterrupt

    found, is_whole = measure(Rows(Here(), tmp_path, STUDY, resume=False), tell=tell)
    assert list(found) == ["row 0", "row 1"]
    assert not is_whole
    rows = Rows(Here(), tmp_path, STUDY, resume=True)
    assert measure(rows)[1]
    assert rows.resumed == 2


def test_rows_that_are_not_kept_are_the_same(tmp_path):
    assert measure(Rows(Here(), None, STUDY, resume=False)) == measure(
        Rows(Here(), tmp_path, STUDY, resume=False)
    )


def test_a_folder_in_which_nothing_can_be_kept_is_an_error(tmp_path):
    (tmp_path / "rows").touch()
    with pytest.raises(ArmguardError, match="cannot be kept"):
        Rows(Here(), tmp_path, STUDY, resume=False)
    (tmp_path / "rows").unlink()
    Rows(Here(), tmp_path, STUDY, resume=False)
    (tmp_path / "rows" / "study.json").write_text("{")
    with pytest.raises(ArmguardError, match="cannot be read"):
        Rows(Here(), tmp_path, STUDY, resume=True)


@pytest.mark.parametrize("resume", [False, True])
def test_a_folder_of_somebody_else_is_refused_and_left_alone(resume, tmp_path):
    thesis = tmp_path / "rows" / "thesis.csv"
    thesis.parent.mkdir()
    thesis.write_text("years of work")
    with pytest.raises(ArmguardError, match=r"rows: holds what is no study's.*move it away"):
        Rows(Here(), tmp_path, STUDY, resume=resume)
    assert thesis.read_text() == "years of work"
    assert list(thesis.parent.iterdir()) == [thesis]


def test_only_rows_are_deleted_and_what_was_left_of_them(tmp_path, monkeypatch):
    def fail(*names):
        raise OSError(28, "No space left on device")

    rows = Rows(Here(), tmp_path, STUDY, resume=False)
    measure(rows)
    monkeypatch.setattr("armguard.lab.rows.os.replace", fail)
    with pytest.raises(ArmguardError, match="No space left"):
        measure(rows, {"row 9": (9,)})
    mine = {tmp_path / "rows" / name for name in ("notes.txt", "mine.msgpack", "study.json")}
    for path in mine:
        path.touch()
    assert len(list((tmp_path / "rows").iterdir())) == len(mine) + len(TASKS) + 1
    Rows(Here(), tmp_path, STUDY, resume=False)
    assert set((tmp_path / "rows").iterdir()) == mine


@pytest.mark.parametrize(
    "values", [np.arange(6).reshape(2, 3), np.array([0.1, math.nan, -math.inf]), np.zeros((0, 4))]
)
def test_arrays_come_back_to_the_bit(values):
    data = msgspec.msgpack.decode(msgspec.msgpack.encode(pack_array(values)))
    back = unpack_array(data)
    assert back.dtype == values.dtype
    assert back.shape == values.shape
    assert back.tobytes() == values.tobytes()
