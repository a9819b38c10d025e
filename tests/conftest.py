"""What all tests rely on."""

import gc
import signal

import pytest

# Where a script starts pytest in the background, all that it starts would ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="module", autouse=True)
def _leave_out_of_collections():
    """What the tests before have left, compiled kernels above all, is there for good."""
    gc.collect()
    gc.freeze()
