"""How the tests of streams wait for other threads and processes."""

import time

PATIENCE = 60.0
"""Seconds that a busy machine is given; nothing waits that long when all is well."""


def attend(source, ready):
    """Subscriptions are sent by the thread that receives, so it must be seen to receive."""
    end = time.monotonic() + PATIENCE
    while not ready():
        assert source.receive() is None
        assert time.monotonic() < end
