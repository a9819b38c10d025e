import ast
from pathlib import Path

import numba
import pytest

from armguard.jit import kernel_folder
from armguard.jit.kernel_folder import PACKAGE, digest_sources, find_cache, find_imported


@pytest.fixture
def package(tmp_path):
    package = tmp_path / "armguard"
    (package / "deep").mkdir(parents=True)
    (package / "top.py").write_text("from armguard.middle import half\n")
    (package / "middle.py").write_text("import armguard.deep.bottom\n")
    (package / "deep" / "bottom.py").write_text("from armguard.middle import half\nHALF = 0.5\n")
    (package / "other.py").write_text("THIRD = 1 / 3\n")
    return package


def is_followed(package, changed):
    """Whether the digest of `top.py` depends on a file."""
    before = digest_sources(package / "top.py", package)
    with (package / changed).open("a") as file:
        file.write("# changed\n")
    return digest_sources(package / "top.py", package) != before


@pytest.mark.parametrize(
    "statement",
    [
        "from armguard.room import door",
        "from armguard.room import (\n    window,\n    door,\n)",
        "from armguard.room.door import *",
        "import armguard.room.door",
        "def late():\n    from armguard.room import door",
        "try:\n    import numpy\nfinally:\n    from armguard.room import \\\n        door",
        "class Late:\n    async def enter(self):\n        with self: import armguard.room.door",
        "from .room.door import HANDLE",
        "from . import room",
        "from armguard import room",
        "from armguard.room import (window,  # (a comment, from here\n    door)",
        "# from armguard import (\nfrom armguard.room import door",
        "one = '#'; from armguard.room import door",
        "import numpy; import armguard . room\\\n . door",
        "from . . armguard . room import door",
        "from armguard.room import*",
    ],
)
def test_modules_of_packages_are_followed_however_they_are_imported(package, statement):
    (package / "room").mkdir()
    (package / "room" / "__init__.py").write_text("from armguard.room.door import HANDLE\n")
    (package / "room" / "door.py").write_text("from ..hinge import ANGLE\nHANDLE = 1\n")
    (package / "room" / "window.py").write_text("")
    (package / "hinge.py").write_text("ANGLE = 0.5\n")
    (package / "top.py").write_text(statement + "\n")
    for changed in ("room/door.py", "hinge.py"):
        assert is_followed(package, changed)
    assert not is_followed(package, "other.py")


def find_parsed(source):
    """Names of what a source imports, by Python's own parser."""
    for node in ast.walk(ast.parse(source.read_bytes())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = node.module or ""
            yield from (module, *(f"{module}.{alias.name}" for alias in node.names))


def test_nothing_that_the_sources_import_is_missed():
    for source in PACKAGE.rglob("*.py"):
        found = find_imported(str(source), source.read_bytes(), str(PACKAGE))
        for name in find_parsed(source):
            first, *parts = name.split(".")
            if first == "armguard":
                place = PACKAGE.joinpath(*parts)
                files = {place.with_name(f"{place.name}.py"), place / "__init__.py"}
                assert {str(file) for file in files if file.is_file()} <= set(found), (source, name)


def test_the_face_of_a_package_counts_where_something_is_taken_from_it(package):
    (package / "room").mkdir()
    (package / "room" / "__init__.py").write_text("from armguard.other import THIRD\n")
    (package / "room" / "door.py").write_text("")
    (package / "top.py").write_text("from armguard.room import THIRD\n")
    assert is_followed(package, "room/__init__.py")
    assert is_followed(package, "other.py")
    (package / "top.py").write_text("from armguard.room.door import HANDLE\n")
    assert not is_followed(package, "room/__init__.py")


def test_how_kernels_are_compiled_counts_with_each(package):
    (package / "jit").mkdir()
    (package / "jit" / "handle.py").write_text("WORD = 8\n")
    assert is_followed(package, "jit/handle.py")


def test_old_kernels_of_a_module_are_removed(package, monkeypatch):
    monkeypatch.setattr(kernel_folder, "PACKAGE", package)
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    source = package / "top.py"
    first = find_cache.__wrapped__(source)
    first.mkdir(parents=True)
    source.write_text("ONE = 1.0\n")
    monkeypatch.setattr(kernel_folder, "_seen", {})  # as in a process that starts later
    second = find_cache.__wrapped__(source)
    assert second != first
    assert not first.exists()


def test_the_folder_that_the_user_names_is_used(package, monkeypatch):
    monkeypatch.setattr(kernel_folder, "PACKAGE", package)
    monkeypatch.setattr(numba.config, "CACHE_DIR", "/somewhere")
    assert find_cache.__wrapped__(package / "top.py").parent == Path("/somewhere")


def test_a_package_that_cannot_be_written_uses_the_users_cache(package, monkeypatch):
    monkeypatch.setattr(kernel_folder, "PACKAGE", package)
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setattr(kernel_folder.os, "access", lambda path, mode: False)
    monkeypatch.setenv("XDG_CACHE_HOME", "/caches")
    assert find_cache.__wrapped__(package / "top.py").parent == Path("/caches/armguard")
