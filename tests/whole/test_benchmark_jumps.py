"""The benchmark of wider bounds measures the package that it says."""

import importlib
import os
import subprocess
import sys

import pytest

from armguard.obstacles.broken_bounds import BROKEN_FACTOR, BROKEN_FOR


@pytest.fixture
def jumps():
    return importlib.import_module("bench_jumps")


def test_a_copy_has_its_own_counts(jumps, tmp_path):
    jumps.copy_package(1.25, 0.75, tmp_path)
    module = "armguard.obstacles.broken_bounds"
    code = f"from {module} import BROKEN_FACTOR, BROKEN_FOR; print(BROKEN_FACTOR, BROKEN_FOR)"
    told = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {"PYTHONPATH": str(tmp_path)},
        cwd=tmp_path, check=True, capture_output=True, text=True,
    ).stdout  # fmt: skip
    assert told.split() == ["1.25", "0.75"]


def test_the_counts_that_are_in_use_are_among_those_that_are_compared(jumps):
    assert f"{BROKEN_FACTOR:g},{BROKEN_FOR:g}" in jumps.COUNTS


def test_a_short_run(jumps, capsys):
    try:
        importlib.import_module("bench_recordings").find_recordings()
    except SystemExit as missing:
        pytest.skip(str(missing))
    short = "--speeds 0.8 --seconds 0.3 --placements 1 --recordings 1"
    counts = f"{BROKEN_FACTOR:g},{BROKEN_FOR:g}"
    found = jumps.main(["--counts", counts, *short.split()])
    for one in found[counts].values():
        assert one["ticks"] == 30
        assert one["missed"] == 0
    assert capsys.readouterr().out.count(f"| {BROKEN_FACTOR:g} | {BROKEN_FOR:g} s |") == 2
