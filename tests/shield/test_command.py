import numpy as np
import pytest

from armguard.shield import Command


def test_a_command_tells_where_the_arm_is_to_be():
    times = 5.0 + np.linspace(0.0, 1.0, 21)
    since = (times - 5.0)[:, None]
    q = np.hstack([since**3 - 1.5 * since**2, 0.0 * since])
    v = np.hstack([3.0 * since**2 - 3.0 * since, 0.0 * since])
    a = np.hstack([6.0 * since - 3.0, 0.0 * since])
    command = Command(times, q, v, a, True, 6.0, 1.0, True, None, None, None, None)
    for t in np.linspace(0.0, 1.0, 57):
        place, pace, change = command.at(5.0 + t)
        assert place[0] == pytest.approx(t**3 - 1.5 * t**2, abs=1e-12)
        assert pace[0] == pytest.approx(3.0 * t**2 - 3.0 * t, abs=1e-12)
        assert change[0] == pytest.approx(6.0 * t - 3.0, abs=1e-9)
    for outside, k in ((4.0, 0), (9.0, -1)):
        place, pace, _ = command.at(outside)
        assert place == pytest.approx(q[k])
        assert pace == pytest.approx(np.zeros(2), abs=1e-12)
