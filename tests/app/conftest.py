"""Loops end here as they end for their users, and tests go on after them."""

import gc

import pytest


@pytest.fixture(autouse=True)
def _leave_out_of_collections_again(monkeypatch):
    """A loop that ends gives back what was left out, which takes a second to look through."""
    given_back, unfreeze = [], gc.unfreeze
    monkeypatch.setattr(gc, "unfreeze", lambda: given_back.append(unfreeze()))
    yield
    if given_back:
        gc.collect(1)
        gc.freeze()
