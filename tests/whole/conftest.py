"""What tests of whole benchmarks share."""

import importlib

import pytest


@pytest.fixture
def load():
    """Imports a module of the benchmarks."""
    return importlib.import_module


@pytest.fixture
def recordings():
    """Files of recorded people; without them the test is skipped."""
    try:
        return importlib.import_module("bench_recordings").find_recordings()
    except SystemExit as missing:
        pytest.skip(str(missing))
