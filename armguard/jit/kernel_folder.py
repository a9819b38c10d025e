"""The folder of a module's compiled kernels, named by a digest of all their sources.

Numba renews a cached kernel when the kernel's own file changes, and by time stamp and size only. A
kernel also contains the kernels and constants of other files that it uses, and files of a wheel all
have one time stamp: a monitor must not run yesterday's bounds because of that. So every module's
kernels are kept under a digest of its source and of all of armguard's sources that it imports.
"""

from __future__ import annotations

import functools
import hashlib
import os
import re
import shutil
from pathlib import Path
from typing import Any

import numba

# Numba's functions are untyped: they are called as anything is.
config: Any = numba.config

PACKAGE = Path(__file__).resolve().parents[1]


@functools.cache
def find_cache(source: Path) -> Path:
    """The folder for one module's kernels; those of its older versions beside it are removed.

    Args:
        source: The module's file.
    """
    name = f"kernels-{source.parent.name}-{source.stem}-"
    place = name + digest_sources(source, PACKAGE, _seen)
    if config.CACHE_DIR:  # by the user, as NUMBA_CACHE_DIR
        return Path(config.CACHE_DIR) / place
    beside = PACKAGE / "__pycache__"
    if not os.access(beside if beside.exists() else PACKAGE, os.W_OK):
        caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        return caches / "armguard" / place
    for old in beside.glob(f"{name}*"):
        if old.name != place:
            shutil.rmtree(old, ignore_errors=True)
    return beside / place


Source = tuple[bytes, tuple[str, ...]]
"""Digest of a source, and what it imports of the package."""

_seen: dict[str, Source] = {}
"""Sources of this process's kernels; most count for dozens of modules, and are read once."""


def digest_sources(source: Path, package: Path, seen: dict[str, Source] | None = None) -> str:
    """A digest of a module's source and of all sources of its package that it imports.

    What compiles kernels and reads their handles counts with each, imported or not.

    Args:
        source: The module's file.
        package: The folder of the package `armguard`.
        seen: Sources that were read before; those that are read now are added.
    """
    seen = {} if seen is None else seen
    sources: set[str] = set()
    root = str(package)
    waiting = [str(source), *map(str, (package / "jit").glob("*.py"))]
    while waiting:
        path = waiting.pop()
        if path not in sources:
            sources.add(path)
            if path not in seen:
                content = Path(path).read_bytes()
                seen[path] = (
                    hashlib.sha256(content).digest(),
                    find_imported(path, content, root),
                )
            waiting.extend(seen[path][1])
    digest = hashlib.sha256()
    for path in sorted(sources):
        digest.update(seen[path][0])
    return digest.hexdigest()[:16]


WORD = re.compile(r"\w+")

IMPORT = re.compile(r"import\b([\w., \t\f]*)")
"""An import of modules; their names."""

IMPORT_FROM = re.compile(
    r"from\b([ \t\f.]*)([\w. \t\f]*?)\bimport\b"
    r"(?=[ \t\f]*(?:\(((?:[^)#]|#.*)*)|([\w, \t\f]*)))"
)
"""An import from a module: dots, module, and what is taken, in brackets or not."""


def find_imported(source: str, content: bytes, package: str) -> tuple[str, ...]:
    """Files of the package that a module's imports could take anything from.

    A name that is taken from a package can be the package's own or one of its modules, so both
    count. The packages around a module, which Python imports along with it, do not: nothing of
    them gets into a kernel unless it is named.

    All that looks like an import counts, in a string as well: a source too many does no harm, and
    to parse all sources would take a third of a start's time. Paths are strings, because thousands
    of them as objects would take a tenth.

    Args:
        source: The module's file.
        content: What stands in it.
        package: The folder of the package `armguard`.
    """
    join = os.path.join
    text = re.sub(r"\\\r?\n", " ", content.decode(errors="replace"))
    modules: list[str] = []
    for names in IMPORT.findall(text):
        for name, *parts in filter(None, map(WORD.findall, names.split(","))):
            if name == "armguard":
                # An import of armguard.a.b makes armguard and armguard.a accessible as well.
                modules += [join(package, *parts[:k]) for k in range(len(parts) + 1)]
    for dots, module, within, beside in IMPORT_FROM.findall(text):
        parts = WORD.findall(module)
        if "." in dots:
            place = source
            for _ in range(dots.count(".")):
                place = os.path.dirname(place)
            place = join(place, *parts)
        elif parts[:1] == ["armguard"]:
            place = join(package, *parts[1:])
        else:
            continue
        taken = WORD.findall(re.sub("#.*", "", within)) + WORD.findall(beside)
        modules += [place, *(join(place, name) for name in taken)]
    files = (
        file for one in dict.fromkeys(modules) for file in (f"{one}.py", join(one, "__init__.py"))
    )
    return tuple(filter(os.path.isfile, files))
