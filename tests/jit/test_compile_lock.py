import os
import subprocess
import sys

import pytest

from armguard.jit import compile_lock
from armguard.jit.compile_lock import hold_compile_lock
from armguard.jit.kernels import IS_FAST
from support.kernel_program import ALONE

HOLDER = ALONE + (
    "import sys, time\n"
    "from pathlib import Path\n"
    "from armguard.jit.compile_lock import hold_compile_lock\n"
    "with hold_compile_lock(Path(sys.argv[1])):\n"
    "    print('taken', flush=True)\n"
    "    time.sleep(600.0)\n"
)

COMPILER = ALONE + (
    "import sys\n"
    "from armguard.jit import kernel\n"
    "from armguard.jit.progress import compilation\n"
    "@kernel\n"
    "def inner(number):\n"
    "    return number + 1.0\n"
    "@kernel\n"
    "def outer(number):\n"
    "    return 2.0 * inner(number)\n"
    "print('ready', flush=True)\n"
    "sys.stdin.readline()\n"
    "assert outer(3.0) == 8.0\n"
    "print(compilation.count)\n"
)


@pytest.fixture
def holder(tmp_path):
    """A process that has the lock for as long as it lives, and its file."""
    path = tmp_path / "folder" / "kernel.lock"
    command = [sys.executable, "-c", HOLDER, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "taken\n"
        yield process, path
        process.kill()


@pytest.mark.parametrize("jit", ["", "plain"])
def test_processes_that_start_at_once_compile_each_kernel_once(tmp_path, jit):
    if not jit and not IS_FAST:
        pytest.skip("this process does not use the fast path")
    (tmp_path / "program.py").write_text(COMPILER)
    cache = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    environment = {**os.environ, **cache, "ARMGUARD_JIT": jit}
    processes = [
        subprocess.Popen(
            [sys.executable, str(tmp_path / "program.py")],
            env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )
        for _ in range(3)
    ]  # fmt: skip
    for process in processes:
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        process.stdin.write("go\n")
        process.stdin.flush()
    assert sum(int(process.communicate()[0]) for process in processes) == 2
    assert all(process.returncode == 0 for process in processes)


def test_a_process_that_keeps_its_lock_for_too_long_is_not_waited_for(holder, monkeypatch):
    monkeypatch.setattr(compile_lock, "PATIENCE", 0.1)
    with hold_compile_lock(holder[1]):
        assert holder[0].poll() is None


def test_the_lock_of_a_process_that_died_is_free(holder):
    process, path = holder
    process.kill()
    process.wait()
    with hold_compile_lock(path):
        pass


def test_a_process_may_need_a_lock_again_while_it_has_it(tmp_path):
    path = tmp_path / "kernel.lock"
    with hold_compile_lock(path), hold_compile_lock(path):
        pass
    assert not compile_lock._held


def test_nobody_is_waited_for_where_files_cannot_be_locked(tmp_path, monkeypatch):
    monkeypatch.setattr(compile_lock, "fcntl", None)
    with hold_compile_lock(tmp_path / "kernel.lock"):
        pass
    assert not list(tmp_path.iterdir())
