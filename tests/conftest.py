"""What all tests rely on."""

import gc
import signal

import pytest
from hypothesis import settings

from armguard.recording import recorder
from support import forked_writers

# How long an example takes is the machine's doing.
settings.register_profile("armguard", deadline=None)
settings.load_profile("armguard")

# Where a script starts pytest in the background, all that it starts would ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="module", autouse=True)
def _leave_out_of_collections():
    """What the tests before have left, compiled kernels above all, is there for good."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _fork_what_writes_recordings():
    """Unless a test asks for the real process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorder, "subprocess", forked_writers)
        yield
