import gc

import pytest

from armguard.jit.collection import pause_collection


@pytest.mark.parametrize("is_on", [True, False])
def test_nothing_is_collected_until_the_outermost_pause_ends(is_on):
    was_on, found = gc.isenabled(), []

    def fail():
        with pause_collection():
            with pause_collection():
                found.append(gc.isenabled())
            found.append(gc.isenabled())
            raise ValueError("failed")

    try:
        gc.enable() if is_on else gc.disable()
        with pytest.raises(ValueError, match="failed"):
            fail()
        assert [*found, gc.isenabled()] == [False, False, is_on]
    finally:
        gc.enable() if was_on else gc.disable()
