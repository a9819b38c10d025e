"""A small program with kernels of its own, run in processes of its own."""

import atexit
import functools
import json
import os
import subprocess
import sys
from typing import NamedTuple

from armguard.jit.kernel_folder import PACKAGE

ALONE = f"""
import sys, types
root = types.ModuleType("armguard")
root.__path__ = [{str(PACKAGE)!r}]
sys.modules["armguard"] = root
"""
"""Imports of `armguard.jit` bring nothing else of the package along, which takes three times as
long as the rest of such a process."""


FORKING = f"""{ALONE}
import io, json, os, traceback
from contextlib import redirect_stderr, redirect_stdout
from numba import config
import armguard.jit.kernels

def run(code, environment):
    os.environ.clear()
    os.environ.update(environment)
    config.reload_config()
    sys.path[:0] = environment["PYTHONPATH"].split(os.pathsep)
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            exec(code, {{}})
        except BaseException:
            traceback.print_exc()
    return out.getvalue(), err.getvalue()

for line in sys.stdin:
    if os.fork() == 0:
        print(json.dumps(run(*json.loads(line))), flush=True)
        os._exit(0)
    _, status = os.wait()
    if status:
        print(json.dumps(["", f"ended with status {{status}}"]), flush=True)
"""
"""Forks a process for each program that it is told of: to import Numba takes several times as long
as the rest of such a process, and what was read of no source, and of no kernel, is as in a process
that has just begun. What Numba settles when it is imported, the processor, it cannot change."""


class Told(NamedTuple):
    """What a process has printed."""

    stdout: str
    stderr: str


@functools.cache
def start_forking():
    """The process that forks others, for as long as this one lives."""
    process = subprocess.Popen(
        [sys.executable, "-c", FORKING], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    atexit.register(process.communicate)
    return process


def run_forked(code, environment):
    """What a program prints in a process that has imported Numba and `armguard.jit` already."""
    process = start_forking()
    process.stdin.write(json.dumps([code, environment]) + "\n")
    process.stdin.flush()
    return Told(*json.loads(process.stdout.readline()))


def run_anew(code, environment):
    """What a program prints in a process of its own from the beginning."""
    return subprocess.run(
        [sys.executable, "-c", f"{ALONE}{code}"],
        env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip


class Program:
    """Runs a kernel that calls another one, each time in a process of its own."""

    LIBRARY = (
        "from armguard.jit.kernels import kernel\n"
        "@kernel\n"
        "def inner(content):\n"
        "    return content[0]\n"
        "@kernel\n"
        "def first(content):\n"
        "    return inner(content)\n"
        "@kernel\n"
        "def twice(content):\n"
        "    return 2.0 * inner(content)\n"
        "def hits(one):\n"
        "    return sum(one.stats.cache_hits.values())\n"
    )

    def __init__(self, folder):
        self.folder = folder
        self.cache = folder / "cache"
        (folder / "lib.py").write_text(self.LIBRARY)

    def run(self, content="(3.0, 1)", name="first", before="", path=None, **environment):
        """What the kernel returns, and how much of it came from the cache."""
        paths = [str(self.folder), *filter(None, [path, os.environ.get("PYTHONPATH")])]
        # Which processor Numba compiles for is settled when it is imported.
        run = run_anew if environment.keys() - {"NUMBA_CACHE_DIR"} else run_forked
        told = run(
            f"{before}\nimport lib\nprint(lib.{name}({content}), lib.hits(lib.{name}))",
            {
                **os.environ,
                "PYTHONPATH": os.pathsep.join(paths),
                "NUMBA_CACHE_DIR": str(self.cache),
                **environment,
            },
        )
        assert told.stderr == "", told.stderr
        return told.stdout.split()

    def kept(self):
        return [path for path in self.cache.rglob("*") if path.is_file()]
