from __future__ import annotations

import numpy as np
import pytest

from armguard.contact import (
    earliest_contact,
    earliest_contact_hull,
    earliest_contact_pair,
)
from armguard.exceptions import ArmguardError
from support.contact_cases import ORDINARY


@pytest.mark.parametrize(
    "name",
    [
        "a1", "s1", "a2", "s2", "contact_distance", "velocity_error1", "velocity_error2",
        "clock_error1", "clock_error2",
    ],
)  # fmt: skip
def test_negative_bounds_are_named_with_their_index(name):
    values = np.ones((2, 3))
    values[1, 2] = -0.5
    with pytest.raises(ArmguardError, match=rf"{name}\[1, 2\]: is -0.5"):
        earliest_contact_pair(**ORDINARY | {name: values})
    with pytest.raises(ArmguardError, match=rf"{name}: is -1.0"):
        earliest_contact_pair(**ORDINARY | {name: -1.0})


def test_malformed_arguments_are_named():
    for name in ("p1", "v1", "p2", "v2"):
        with pytest.raises(ArmguardError, match=name):
            earliest_contact_pair(**ORDINARY | {name: [1.0, 2.0]})
    with pytest.raises(ArmguardError, match="do not broadcast"):
        earliest_contact_pair(**ORDINARY | {"a1": np.ones(3), "a2": np.ones(4)})
    with pytest.raises(ArmguardError, match="advances"):
        earliest_contact_pair(**ORDINARY, advances=0)
    with pytest.raises(ArmguardError, match="points"):
        earliest_contact_hull(**ORDINARY | {"p2": np.ones((9, 3)), "v2": np.ones((9, 3))})
    with pytest.raises(ArmguardError, match="do not broadcast: p2"):
        earliest_contact_hull(**ORDINARY | {"p2": np.ones((3, 3)), "v2": np.ones((2, 3))})
    with pytest.raises(ArmguardError, match="accel"):
        earliest_contact([1.0, 0, 0], [0.0, 0, 0], 0.1, -1.0)


def test_shapes_broadcast_and_scalars_stay_scalars():
    single = earliest_contact_pair(**ORDINARY)
    assert isinstance(single, float)
    assert isinstance(earliest_contact([1.0, 0, 0], [0.0, 0, 0], 0.1, 1.0), float)
    many = earliest_contact_pair(**ORDINARY | {"a1": np.full((4, 1), 5.0), "s2": np.full(3, 2.0)})
    assert many.shape == (4, 3)
    assert (many == single).all()
    assert earliest_contact_pair(**ORDINARY | {"a1": np.ones(0)}).shape == (0,)
    assert earliest_contact(np.ones((0, 3)), np.ones(3), 0.1, np.ones((2, 1))).shape == (2, 0)
    assert earliest_contact(np.ones(3), np.zeros(3), np.array(0.1), np.float64(1.0)) > 0.0
