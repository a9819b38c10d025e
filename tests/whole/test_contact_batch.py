"""The batched first advances: below the converged time, and what the scalar kernel gives."""

from __future__ import annotations

import math

import numpy as np
import pytest

from armguard.contact import earliest_contact
from scene.contact_batch import batch_contact_times, finish_contact_times


def _pairs(rng, count, decades):
    position = rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-decades, decades, (count, 1))
    velocity = rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-decades, decades, (count, 1))
    distance = np.linalg.norm(position, axis=1) * rng.uniform(0.0, 1.0, count)
    accel = 10.0 ** rng.uniform(-decades, decades, count)
    speed = np.linalg.norm(velocity, axis=1) * rng.choice([1.0, 1.001, 3.0, math.inf], count)
    velocity[::13] = 0.0
    accel[1::13] = 0.0
    accel[2::13] = math.inf
    speed[3::13] *= 0.5
    distance[4::13] = 0.0
    distance[5::13] *= 3.0
    return position, velocity, distance, accel, speed


def _batch(pairs, advances, finish=None):
    position, velocity, *numbers = pairs
    columns = [np.ascontiguousarray(c) for c in (*position.T, *velocity.T, *numbers)]
    times, before = np.empty(len(position)), np.empty(len(position))
    batch_contact_times(*columns, advances, times, before)
    if finish:
        finish_contact_times(*columns, finish, times, before)
    return times


@pytest.mark.parametrize("decades", [0.5, 3.0, 20.0, 150.0])
def test_never_above_the_converged_time(decades):
    pairs = _pairs(np.random.default_rng(1), 5_000, decades)
    converged = earliest_contact(*pairs, advances=200)
    for advances in (1, 2, 3):
        times = _batch(pairs, advances)
        assert not np.isnan(times).any()
        assert (times <= converged * (1.0 + 1e-9)).all()


@pytest.mark.parametrize("advances", [1, 2, 3])
def test_agrees_with_the_scalar_kernel_or_stays_out(advances):
    pairs = _pairs(np.random.default_rng(2), 20_000, 1.0)
    times = _batch(pairs, advances)
    scalar = earliest_contact(*pairs, advances=advances)
    taking_part = times > 0.0
    assert taking_part.mean() > 0.4
    agree = np.isclose(times, scalar, rtol=1e-6, atol=0.0)
    assert agree[taking_part].mean() > 0.999  # a graze may go either way


def test_nan_stays_out_and_is_contact_once_finished():
    for column in range(5):
        pairs = [np.array(p) for p in _pairs(np.random.default_rng(5), 300, 1.0)]
        pairs[column][7::11] = math.nan
        assert (_batch(pairs, 3)[7::11] == 0.0).all()
        assert (_batch(pairs, 3, finish=8)[7::11] == 0.0).all()
