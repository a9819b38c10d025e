import ast
import shutil
from pathlib import Path

import numba
import numpy as np
import pytest

import armguard
from armguard.jit import kernel, kernels
from armguard.jit.kernels import PACKAGE, digest_sources, find_cache, find_imported
from support.kernel_program import Program


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


@pytest.mark.parametrize("changed", ["top.py", "middle.py", "deep/bottom.py"])
def test_a_change_of_anything_imported_changes_the_digest(package, changed):
    assert is_followed(package, changed)


@pytest.mark.parametrize(
    "statement",
    [
        "from armguard.room import door",
        "from armguard.room import window, door as entry",
        "from armguard.room import (\n    window,\n    door,\n)",
        "from armguard.room.door import HANDLE",
        "from armguard.room.door import *",
        "import armguard.room.door",
        "import numpy, armguard.room.door as entry",
        "def late():\n    from armguard.room import door",
        "try:\n    import numpy\nfinally:\n    from armguard.room import \\\n        door",
        "try:\n    import numpy\nexcept ImportError:\n    from armguard.room import door",
        "for n in ():\n    pass\nelse:\n    from armguard.room import door",
        "match 1:\n    case _:\n        from armguard.room import door",
        "class Late:\n    async def enter(self):\n        with self: import armguard.room.door",
        "from .room import door",
        "from .room.door import HANDLE",
        "from . import room",
        "from armguard import room",
        "from armguard.room import (window,  # (a comment, from here\n    door)",
        "# what follows is taken from here\nfrom armguard.room import door",
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


def test_imports_from_elsewhere_are_not_followed(package):
    (package / "numpy.py").write_text("")
    (package / "top.py").write_text("import numpy\nfrom numpy import linalg\n")
    assert not is_followed(package, "numpy.py")


def test_a_module_outside_the_package_is_digested_with_what_it_imports_from_it(package, tmp_path):
    script = tmp_path / "script.py"
    script.write_text("from armguard import middle\n")
    before = digest_sources(script, package)
    (package / "middle.py").write_text("HALF = 0.25\n")
    assert digest_sources(script, package) != before


def test_the_package_is_all_of_armguard():
    assert Path(armguard.__file__).parent.resolve() == PACKAGE


def test_how_kernels_are_compiled_counts_with_each(package):
    (package / "jit").mkdir()
    (package / "jit" / "handle.py").write_text("WORD = 8\n")
    assert is_followed(package, "jit/handle.py")


def test_a_change_of_what_is_not_imported_changes_nothing(package):
    before = digest_sources(package / "top.py", package)
    (package / "other.py").write_text("THIRD = 0.0\n")
    assert digest_sources(package / "top.py", package) == before


def test_every_kernel_of_armguard_is_compiled_here():
    for path in PACKAGE.rglob("*.py"):
        if path.name != "kernels.py":
            text = path.read_text()
            assert "njit" not in text, f"{path}: use armguard.jit.kernel"


def test_old_kernels_of_a_module_are_removed(package, monkeypatch):
    monkeypatch.setattr(kernels, "PACKAGE", package)
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    source = package / "top.py"
    first = find_cache.__wrapped__(source)
    first.mkdir(parents=True)
    source.write_text("ONE = 1.0\n")
    monkeypatch.setattr(kernels, "_seen", {})  # as in a process that starts later
    second = find_cache.__wrapped__(source)
    assert second != first
    assert not first.exists()


def test_the_folder_that_the_user_names_is_used(package, monkeypatch):
    monkeypatch.setattr(kernels, "PACKAGE", package)
    monkeypatch.setattr(numba.config, "CACHE_DIR", "/somewhere")
    assert find_cache.__wrapped__(package / "top.py").parent == Path("/somewhere")


def test_a_package_that_cannot_be_written_uses_the_users_cache(package, monkeypatch):
    monkeypatch.setattr(kernels, "PACKAGE", package)
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setattr(kernels.os, "access", lambda path, mode: False)
    monkeypatch.setenv("XDG_CACHE_HOME", "/caches")
    assert find_cache.__wrapped__(package / "top.py").parent == Path("/caches/armguard")


def test_kernels_divide_as_numpy_does_and_keep_nan():
    @kernel
    def divide(a, b):
        return a / b

    @kernel(inline="always")
    def subtract(a, b):
        return a - b

    assert divide(1.0, 0.0) == np.inf
    assert np.isnan(divide(0.0, 0.0))
    assert np.isnan(subtract(np.inf, np.inf))
    assert find_cache(Path(__file__)) != find_cache(PACKAGE / "jit" / "handle.py")


@pytest.fixture
def program(tmp_path):
    return Program(tmp_path)


def test_a_program_that_dies_is_a_failure(program):
    """As one does that calls machine code which is not there."""
    with pytest.raises(AssertionError, match="ended with status 9"):
        program.run(before="import os, signal\nos.kill(os.getpid(), signal.SIGKILL)\n")
    assert program.run() == ["3.0", "0"]


def test_a_cache_with_types_of_a_script_that_is_gone_is_an_empty_one(program, tmp_path):
    """One process packs a tuple of its own, the next knows nothing of where it came from."""
    (tmp_path / "script").mkdir()
    (tmp_path / "script" / "own.py").write_text(
        "from typing import NamedTuple\nclass Own(NamedTuple):\n    number: float\n"
    )
    own = {"content": "own.Own(2.0)", "before": "import own", "path": str(tmp_path / "script")}
    assert program.run(**own) == ["2.0", "0"]
    assert program.run(**own) == ["2.0", "1"]
    assert program.run() == ["3.0", "0"]
    assert program.run() == ["3.0", "1"]


def test_what_another_kernel_calls_is_read_from_the_cache_as_well(program):
    program.run()
    before = {path for path in program.kept() if path.name.startswith("lib.inner")}
    assert program.run(name="twice") == ["6.0", "0"]
    assert {path for path in program.kept() if path.name.startswith("lib.inner")} == before


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A program that has run once, and what it left in its cache."""
    program = Program(tmp_path_factory.mktemp("compiled"))
    program.run()
    return program, {path: path.read_bytes() for path in program.kept()}


@pytest.mark.parametrize("ending", [".nbi", ".nbc"])
@pytest.mark.parametrize("length", [0, 10, 200])
def test_a_file_of_the_cache_that_is_cut_short_is_written_anew(compiled, ending, length):
    program, left = compiled
    shutil.rmtree(program.cache)
    for path, content in left.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content[:length] if path.suffix == ending else content)
    assert any(path.suffix == ending for path in left)
    assert program.run() == ["3.0", "0"]
    assert program.run() == ["3.0", "1"]


def test_code_for_another_processor_is_not_run(program):
    assert program.run(NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="") == ["3.0", "0"]
    assert program.run() == ["3.0", "0"]
    assert program.run() == ["3.0", "1"]
    assert program.run(NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="") == ["3.0", "1"]


def test_kernels_run_where_no_cache_can_be_written_and_leave_nothing_elsewhere(program):
    """Numba would put them beside their source, and know them by its content alone."""
    program.cache.write_text("not a folder")
    before = sorted(program.folder.rglob("*.nb[ic]"))
    assert program.run() == ["3.0", "0"]
    assert program.run() == ["3.0", "0"]
    assert sorted(program.folder.rglob("*.nb[ic]")) == before == []


def test_kernels_run_where_the_disk_is_full(program):
    full = (
        "from numba.core import caching\n"
        "def refuse(*_):\n"
        "    raise OSError(28, 'No space left on device')\n"
        "caching.IndexDataCacheFile.save = refuse\n"
    )
    assert program.run(before=full) == ["3.0", "0"]


@pytest.mark.parametrize(
    ("version", "tried"),
    [("0.62.1", False), ("0.63.0", True), ("0.68.1", True), ("0.99.0rc1", False), ("1.0", False)],
)
def test_only_versions_of_numba_that_were_tried_read_kernels_from_a_cache(version, tried):
    assert kernels.is_tried(version) is tried


def test_kernels_of_another_version_of_numba_are_kept_for_no_other_process(monkeypatch):
    source = PACKAGE / "contact" / "gap.py"
    usual = find_cache(source)
    monkeypatch.setattr(numba, "__version__", "0.62.1")
    own = find_cache.__wrapped__(source)
    assert own != usual
    assert kernels.find_private_folder() in own.parents
