import shutil

import pytest

from armguard.jit import carried, fast_path
from armguard.jit.carried import NEEDED, PROCESSOR, describe_environment
from armguard.jit.fast_path import find_carried_target
from armguard.jit.kernels import IS_FAST
from support.kernel_program import Program

if not IS_FAST:
    pytest.skip("this process does not use the fast path", allow_module_level=True)

WHERE = "from pathlib import Path\nfrom armguard.jit import carried\ncarried.CARRIED = Path({!r})\n"


@pytest.fixture(scope="module")
def carried_by(tmp_path_factory):
    """A program, and the folder of what was compiled of it for all processors of the level."""
    program = Program(tmp_path_factory.mktemp("program"))
    folder = program.folder / "kernels"
    environment = describe_environment() | {"NUMBA_CACHE_DIR": str(folder)}
    assert program.run(**environment) == ["3.0", "0"]
    assert list(folder.rglob("*.kernel"))
    return program, folder


@pytest.fixture
def program(carried_by, tmp_path):
    """The same, somewhere else and with a cache that is empty."""
    made, folder = carried_by
    copy = Program(tmp_path)
    assert copy.LIBRARY == made.LIBRARY
    renamed = tmp_path.name  # Folders are named for the one that the module lies in, too.
    for path in folder.iterdir():
        name = path.name.replace(made.folder.name, renamed)
        shutil.copytree(path, tmp_path / "kernels" / name)
    return copy


def run(program, before="", **changes):
    where = WHERE.format(str(program.folder / "kernels"))
    return program.run(before=f"{where}{before}", **changes)


def test_what_is_carried_is_not_compiled(program):
    assert run(program) == ["3.0", "1"]
    assert not [path for path in program.kept() if path.suffix != ".lock"]


def test_it_is_used_where_nothing_can_be_written(program):
    program.cache.write_text("not a folder")
    assert run(program) == ["3.0", "1"]


def test_a_changed_source_is_compiled(program):
    source = program.folder / "lib.py"
    source.write_text(source.read_text().replace("content[0]", "content[0] + 1.0"))
    assert run(program) == ["4.0", "0"]


@pytest.mark.parametrize("missing", [*NEEDED, None])
def test_a_processor_without_what_is_needed_compiles(monkeypatch, missing):
    has = dict.fromkeys(NEEDED, True)
    if missing:
        del has[missing]
    monkeypatch.setattr(fast_path.llvm, "get_host_cpu_features", lambda: has)
    monkeypatch.setattr(fast_path.llvm, "get_process_triple", lambda: "x86_64-linux")
    monkeypatch.setattr(carried, "CARRIED", carried.CARRIED.parent)
    found = find_carried_target.__wrapped__()
    assert found is None if missing else found == ("x86_64-linux", PROCESSOR, "")


@pytest.mark.parametrize(
    "version", ["numba.__version__ = '0.0'", "sys.implementation.cache_tag = 'other'"]
)
def test_of_another_version_nothing_is_used(program, version):
    assert run(program, before=f"import numba, sys\n{version}\n") == ["3.0", "0"]


@pytest.mark.parametrize("length", [0, 200])
def test_a_damaged_file_is_left_as_it_is_and_its_kernel_compiled(program, length):
    files = list((program.folder / "kernels").rglob("*.kernel"))
    for path in files:
        path.write_bytes(path.read_bytes()[:length])
    assert run(program) == ["3.0", "0"]
    assert run(program) == ["3.0", "1"]
    assert {path.stat().st_size for path in files} == {length}
