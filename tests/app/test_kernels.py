import subprocess

import pytest

from armguard.app import kernels
from armguard.exceptions import ArmguardError
from armguard.jit.carried import describe_environment
from armguard.jit.progress import compilation
from armguard.robot import Robot


def test_what_is_compiled_for_one_robot_serves_the_others():
    kernels.compile_all()
    before = compilation.count
    for name in ("ur10", "tiago"):
        for settings in kernels.MONITORS:
            kernels.watch_a_moment(Robot.load(name), **settings)
    assert compilation.count == before


def test_the_command_tells_what_it_has_compiled(capsys):
    assert kernels.run(carry=False) == 0
    assert "kernels compiled" in capsys.readouterr().out


class Child:
    """Instead of a process that compiles for a minute."""

    def __init__(self, folder, code):
        self.folder, self.code = folder, code

    def __call__(self, arguments, env, check):
        assert describe_environment().items() <= env.items()
        (self.folder / "kernels-a" / "callees").mkdir(parents=True)
        for name in ("one.kernel", "one.lock", "callees/one.kernel", "callees/one.lock"):
            (self.folder / "kernels-a" / name).write_bytes(500_000 * b" ")
        return subprocess.CompletedProcess(arguments, self.code)


@pytest.mark.parametrize("code", [0, 9])
def test_a_wheel_is_given_what_python_calls(tmp_path, monkeypatch, capsys, code):
    folder = tmp_path / "kernels"
    (folder / "kernels-of-yesterday").mkdir(parents=True)
    monkeypatch.setattr(kernels, "CARRIED", folder)
    monkeypatch.setattr(subprocess, "run", Child(folder, code))
    assert kernels.run(carry=True) == min(code, 1)
    told = capsys.readouterr()
    if code:
        assert "exit code 9" in told.err
    else:
        assert "x86-64-v3" in told.out
        assert "1.0 MB" in told.out
        kept = [path.name for path in folder.rglob("*") if path.is_file()]
        assert kept == ["one.kernel", "one.kernel"]


def test_a_folder_that_cannot_be_written_is_named(tmp_path, monkeypatch):
    (tmp_path / "kernels").write_text("in the way")
    monkeypatch.setattr(kernels, "CARRIED", tmp_path / "kernels")
    with pytest.raises(ArmguardError, match="kernels: cannot be written"):
        kernels.run(carry=True)


def test_kernels_that_no_start_could_use_are_not_carried(monkeypatch):
    monkeypatch.setattr(kernels, "IS_FAST", False)
    with pytest.raises(ArmguardError, match="--carry: needs the fast path"):
        kernels.run(carry=True)
