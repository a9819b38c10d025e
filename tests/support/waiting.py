"""Waiting for what another thread or process does."""

import time

PATIENCE = 120.0
"""In [s]: more than any machine needs."""


def wait_until(condition):
    """Return when a condition holds."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "what was waited for did not come"
        time.sleep(0.01)
