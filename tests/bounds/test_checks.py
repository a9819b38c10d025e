"""Questions that make no sense, asked of each motion model."""

import numpy as np
import pytest

from armguard.exceptions import ArmguardError


@pytest.mark.parametrize("name", ["reach", "isotropic", "joint", "braking"])
@pytest.mark.parametrize(
    ("change", "offender"),
    [
        ({"q": np.zeros(6)}, "joint positions"),
        ({"q": [np.nan] * 7}, "joint positions"),
        ({"q": ["a"] * 7}, "joint positions"),
        ({"v": np.zeros((7, 1))}, "joint velocities"),
        ({"v": [np.inf] * 7}, "joint velocities"),
        ({"q": [0.0, 2.0, 0.0, -1.5, 0.0, 1.8, 0.0]}, "panda_joint2"),
        ({"v": [0.0, 0.0, -2.5, 0.0, 0.0, 0.0, 0.0]}, "panda_joint3"),
        ({"link": "panda_link0"}, "panda_link0"),
        ({"link": "nothing"}, "nothing"),
        ({"point": [0.0, 0.0]}, "point"),
        ({"point": [0.0, np.nan, 0.0]}, "point"),
        ({"direction": [0.0, 0.0, 2.0]}, "direction"),
        ({"direction": [0.0, 0.0, 0.0]}, "direction"),
        ({"t": -1e-9}, "t"),
        ({"t": np.nan}, "t"),
        ({"t": np.inf}, "t"),
    ],
)
def test_bad_questions_are_refused(models, name, change, offender):
    good = {
        "q": np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.8, 0.0]),
        "v": np.zeros(7),
        "link": "panda_hand",
        "point": [0.0, 0.0, 0.0],
        "direction": [0.0, 0.0, 1.0],
        "t": 0.1,
    }
    before = models[name].advance(**good)
    if name == "isotropic" and offender.startswith("panda_joint"):
        # What was measured beyond a limit counts.
        assert models[name].advance(**good | change) >= before
        return
    with pytest.raises(ArmguardError) as caught:
        models[name].advance(**good | change)
    assert offender in caught.value.offender
