"""Loops end here as they end for their users, and tests go on after them."""

import gc

import pytest


@pytest.fixture(autouse=True)
def _leave_out_of_collections_again():
    """A loop that ends gives back what was left out, which takes a second to look through."""
    yield
    if gc.get_freeze_count() == 0:
        gc.collect(1)
        gc.freeze()
