"""Computes contact times under changed conditions, for explanations.

Never part of a tick. The pair is evaluated again with the data of the last tick and the change.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.handle import pack
from armguard.obstacles.partners import NO_PARTNER
from armguard.obstacles.table import MOST_REFUSED, Marks, States, make_states
from armguard.obstacles.tethers import Tie, find_length, make_tethers, tie
from armguard.pairs.evaluate import TickState, evaluate_handle, find_partner_row


class Change(NamedTuple):
    """A changed condition."""

    distance: float = 0.0
    """Added to the distance at contact, in [m]."""
    speed: float = 0.0
    """Added to the obstacle's speed bound, in [m/s]."""
    age: float = 0.0
    """Added to the age of the obstacle's state, in [s]."""
    fresh: bool = False
    """Whether the obstacle has a fresh state, predicted with its velocity."""


UNCHANGED = Change()


class WhatIf:
    """Evaluates one obstacle and some links under changes, on copies of the last tick's data.

    Copying and packing the data takes far longer than an evaluation, so it is done once for all.

    Args:
        state: The tick's numbers, with the arm prepared.
        row: Of the obstacle.
        links: Of the arm. Shape (n,). None: all.
    """

    def __init__(self, state: TickState, row: int, links: IntArray | None = None) -> None:
        scene = state.scene
        self._now, self._arm_age = state.now, state.arm_age
        self._margin = scene.settings.margin
        # Where it is tethered, a partner stands in the second row.
        partner = find_partner_row(state, row)
        rows = np.array([row, row if partner == NO_PARTNER else partner])
        places = row * MOST_REFUSED + np.arange(MOST_REFUSED)
        self._known = _copy_rows(scene.bodies, rows), _copy_rows(scene.refused, places)
        self._changed = _copy_rows(scene.bodies, rows), _copy_rows(scene.refused, places)
        bodies, refused = self._changed
        marks = Marks._make(array[rows] for array in scene.marks)
        tethers = make_tethers(2, 1)
        if partner != NO_PARTNER:
            tie(
                tethers, [Tie(0, 1, find_length(scene.tethers, row, partner), None)], marks.revision
            )
        self._is_static = bool(marks.static[0])
        self._handle = pack(
            scene._replace(
                bodies=bodies,
                refused=refused,
                marks=marks,
                tethers=tethers,
                node_time=scene.node_time.copy(),
                sphere_time=scene.sphere_time.copy(),
            )
        )
        self._links = np.arange(len(state.tree.root)) if links is None else links
        self._nodes = np.zeros(len(self._links), dtype=np.int64)
        self._bounds = np.zeros(len(self._links), dtype=np.int8)

    def contact_times(
        self, change: Change = UNCHANGED, refinement_threshold: float = np.inf
    ) -> FloatArray:
        """Contact time of each link, in [s] from the last tick. Shape (n,).

        Args:
            change: The changed condition.
            refinement_threshold: Pairs with a contact time below this, in [s], are refined, as in a
                tick; inf: all pairs.
        """
        for known, changed in zip(self._known, self._changed, strict=True):
            for original, array in zip(known, changed, strict=True):
                array[...] = original
            np.maximum(known.speed + change.speed, 0.0, out=changed.speed)
            changed.stamp[:] -= change.age
        bodies, refused = self._changed
        if change.fresh and not self._is_static:
            elapsed = self._now - bodies.stamp
            bodies.points[:] += bodies.velocities * elapsed[:, None, None]
            bodies.stamp[:] = self._now
        # What counts as contact is the sum of radii and margin, which the packed numbers hold.
        margin = max(self._margin + change.distance, -float(bodies.radius[0]))
        bodies.radius[:] += margin - self._margin
        refused.radius[:] += margin - self._margin
        times = np.zeros(len(self._links))
        evaluate_handle(
            self._handle,
            self._links,
            self._now,
            self._arm_age,
            refinement_threshold,
            times,
            self._nodes,
            self._bounds,
        )
        return times


def _copy_rows(states: States, rows: IntArray) -> States:
    """A copy of some rows, two at least: arrays of one are of another type."""
    copied = make_states(len(rows), states.points.shape[1])
    for array, original in zip(copied, states, strict=True):
        array[...] = original[rows]
    return copied
