import gc

import pytest

from armguard.jit.collection import CollectionPause


@pytest.fixture
def pause():
    was_on = gc.isenabled()
    yield CollectionPause()
    gc.enable() if was_on else gc.disable()


def test_nothing_is_collected_until_the_last_compilation_is_done(pause):
    gc.enable()
    pause.on_start(None)
    pause.on_start(None)
    assert not gc.isenabled()
    pause.on_end(None)
    assert not gc.isenabled()
    pause.on_end(None)
    assert gc.isenabled()


def test_who_turned_it_off_finds_it_off(pause):
    gc.disable()
    pause.on_start(None)
    pause.on_end(None)
    assert not gc.isenabled()
