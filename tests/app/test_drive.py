import pytest

from armguard.app.cli import main
from armguard.exceptions import ArmguardError

CELL = """
sources = {{}}
[robot]
name = "ur5e"
{driver}
"""
DRIVER = '[robot.driver]\nname = "ur"\nhost = "127.0.0.1"\nmodel = "UR5e"\n'


def refuse(tmp_path, capsys, *words, driver=DRIVER):
    """The one line that says why it is refused."""
    cell = tmp_path / "cell.toml"
    cell.write_text(CELL.format(driver=driver))
    assert main(["drive", str(cell), *words]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    return line


@pytest.mark.parametrize(
    ("driver", "said"),
    [
        ("", "robot.driver: is missing"),
        (DRIVER.replace('"ur"', '"kuka"'), "robot.driver.name"),
        (DRIVER + "rate = 1000.0", "robot.driver.rate"),
        (DRIVER + "speed = 0.0", "robot.driver.speed"),
        (DRIVER + "speed = 1.5", "robot.driver.speed"),
        (DRIVER + "deceleration = -1.0", "robot.driver.deceleration"),
        (DRIVER + "colour = 1", "colour"),
        (DRIVER + 'joints = ["a", "b"]', "robot.driver.joints: has a, b, and the monitor watches"),
    ],
)
def test_what_a_cell_file_says_wrong_is_one_line(tmp_path, capsys, driver, said):
    assert said in refuse(tmp_path, capsys, driver=driver)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--duration", "0"], "--duration"),
        (["--measure", "--stops", "0"], "--stops"),
        (["--joints", "tcp://0.0.0.0:5702"], "tcp://0.0.0.0:5702"),
        (["--verdicts", "nonsense"], "nonsense"),
        (["--key", "x.secret"], "--server-key"),
    ],
)
def test_what_the_command_line_says_wrong_is_one_line(tmp_path, capsys, words, said):
    assert said in refuse(tmp_path, capsys, *words)


def test_a_missing_library_is_one_line_with_the_remedy(tmp_path, capsys, monkeypatch):
    def check(driver):
        raise ArmguardError("driver", "needs ur_rtde", remedy="pip install 'armguard[ur]'")

    monkeypatch.setattr("armguard.app.drive.check_library", check)
    assert "pip install 'armguard[ur]'" in refuse(tmp_path, capsys)
