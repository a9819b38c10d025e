"""A small program with kernels of its own, run in processes of its own."""

import os
import subprocess
import sys

from armguard.jit.kernels import PACKAGE

ALONE = f"""
import sys, types
root = types.ModuleType("armguard")
root.__path__ = [{str(PACKAGE)!r}]
sys.modules["armguard"] = root
"""
"""Imports of `armguard.jit` bring nothing else of the package along, which takes three times as
long as the rest of such a process."""


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
        told = subprocess.run(
            [
                sys.executable,
                "-c",
                f"{ALONE}{before}\nimport lib\nprint(lib.{name}({content}), lib.hits(lib.{name}))",
            ],
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join(
                    [str(self.folder), *filter(None, [path, os.environ.get("PYTHONPATH")])]
                ),
                "NUMBA_CACHE_DIR": str(self.cache),
                **environment,
            },
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        assert told.stderr == ""
        return told.stdout.split()

    def kept(self):
        return [path for path in self.cache.rglob("*") if path.is_file()]
