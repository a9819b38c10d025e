import numpy as np
import pytest

from armguard import Obstacles
from armguard.app.reachable import find_reachable

STEPS = 400


def observe(velocity, **changes):
    obstacles = Obstacles(sources=[])
    bounds = {"radius": 0.1, "accel": 8.0, "speed": 2.0} | changes
    obstacles.update(["hand"], 1.0, [[0.5, 0.2, 0.3]], [velocity], **bounds)
    return obstacles.table.accepted, obstacles.row("hand")


@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (1.5, 0.0, 0.0), (-0.4, 0.9, 1.2)])
@pytest.mark.parametrize("horizon", [0.05, 0.3, 2.0])
def test_no_body_within_its_bounds_leaves_the_ball(velocity, horizon):
    states, row = observe(velocity, velocity_error=0.1, position_error=0.02)
    ((*center, radius),) = find_reachable(states, row, 1.05, horizon)
    random = np.random.default_rng(2)
    lasting = 0.05 + horizon
    step = lasting / STEPS
    farthest = 0.0
    for _ in range(60):
        x = states.points[row, 0] + unit(random) * 0.02
        v = np.array(velocity) + unit(random) * 0.1
        push = unit(random)
        for _ in range(STEPS):
            v = v + push * 8.0 * step
            v = v * min(1.0, max(2.0, np.linalg.norm(velocity)) / np.linalg.norm(v))
            x = x + v * step
            farthest = max(farthest, np.linalg.norm(x - center))
    assert farthest + 0.1 <= radius * (1.0 + 1e-2 / STEPS)
    assert farthest + 0.1 > 0.4 * radius


def unit(random):
    direction = random.normal(size=3)
    return direction / np.linalg.norm(direction)


def test_what_has_no_bounds_may_be_anywhere_and_has_no_ball():
    states, row = observe((0.0, 0.0, 0.0), accel=np.inf, speed=np.inf)
    assert find_reachable(states, row, 1.0, 0.2).shape == (0, 4)
