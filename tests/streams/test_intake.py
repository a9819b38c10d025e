import math

import numpy as np
import pytest

from armguard.streams.intake import is_finite
from support.stream_messages import (
    World,
    obstacles,
)


@pytest.mark.parametrize("count", [1, 4000])
def test_no_sum_is_shared_out_among_threads_that_the_loop_would_wait_for(count, monkeypatch):
    """OpenBLAS does so beyond 10,000 numbers, and other processes may keep its threads waiting."""
    sizes, compute = [0], np.vdot
    monkeypatch.setattr(np, "vdot", lambda a, b: sizes.append(a.size) or compute(a, b))
    positions = np.full((count, 3), 5.0)
    message = {"ids": [f"b{i}" for i in range(count)], "velocity": ...}
    world = World()
    world.send(obstacles(seq=1, position=positions.tobytes(), **message))
    assert world.faults.total == 0
    positions[-1, 1] = math.nan
    world.send(obstacles(seq=2, position=positions.tobytes(), **message))
    assert any(f"position[{count - 1}, 1] is nan" in line for line in world.lines)
    assert max(sizes) <= 10_000


@pytest.mark.parametrize("shape", [(1,), (7,), (2, 7), (5, 3, 3), (4000, 3)])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_no_number_that_is_not_finite_passes_for_finite(shape, value):
    array = np.full(shape, -1e6)
    assert is_finite(array) or array.size > 10_000
    array.reshape(-1)[-1] = value
    assert not is_finite(array)
    # Two that might make up for each other.
    array.reshape(-1)[0] = -value
    assert not is_finite(array)
    # One that is only too large for a sum leads to a closer look, and to no fault.
    world = World()
    assert world.edge._intake.check_finite("cam0", 1, {"position": np.full(shape, 1e308)})
    assert world.faults.total == 0
