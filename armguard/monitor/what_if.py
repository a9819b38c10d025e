"""Contact times as they would be if something were different: for those who ask why.

Never part of a tick. The pair is evaluated again on the numbers of the last one, with the change.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armguard.jit.arrays import FloatArray
from armguard.jit.handle import pack
from armguard.obstacles.table import MOST_REFUSED, Marks, States, make_states
from armguard.pairs.evaluate import TickState, evaluate_handle


class Change(NamedTuple):
    """What would be different."""

    distance: float = 0.0
    """Added to the distance that counts as contact, [m]."""
    speed: float = 0.0
    """Added to the obstacle's speed bound, [m/s]."""
    age: float = 0.0
    """Added to the age of the obstacle's state, [s]."""
    fresh: bool = False
    """Whether the obstacle is seen anew, where its velocity has carried it."""


UNCHANGED = Change()


def contact_times(
    state: TickState, row: int, change: Change = UNCHANGED, refinement_threshold: float = np.inf
) -> FloatArray:
    """Contact time of each link and one obstacle, in [s] from the last tick. Shape (links,).

    Args:
        state: The tick's numbers, with the arm prepared.
        row: Of the obstacle.
        change: What would be different.
        refinement_threshold: What could be touched before this, in [s], is refined, as a
            tick has it; inf: everything.
    """
    scene = state.scene
    bodies, refused = _copy_row(scene.bodies, row, 1), _copy_row(scene.refused, row, MOST_REFUSED)
    marks = Marks._make(array[row : row + 1].copy() for array in scene.marks)
    for states in (bodies, refused):
        states.speed[:] = np.maximum(states.speed + change.speed, 0.0)
        states.stamp[:] -= change.age
    if change.fresh and not marks.static[0]:
        elapsed = state.now - bodies.stamp
        bodies.points[:] += bodies.velocities * elapsed[:, None, None]
        bodies.stamp[:] = state.now
    margin = max(scene.settings.margin + change.distance, -float(bodies.radius[0]))
    links = len(state.tree.root)
    times, spheres = np.zeros(links), np.zeros(links, dtype=np.int64)
    changed = scene._replace(
        bodies=bodies,
        refused=refused,
        marks=marks,
        settings=scene.settings._replace(margin=margin),
        node_time=scene.node_time.copy(),
        sphere_time=scene.sphere_time.copy(),
    )
    bounds = np.zeros(links, dtype=np.int8)
    evaluate_handle(
        pack(changed),
        np.arange(links),
        state.now,
        state.arm_age,
        refinement_threshold,
        times,
        spheres,
        bounds,
    )
    return times


def _copy_row(states: States, row: int, places: int) -> States:
    """A copy of a row's states; there are two at least, as arrays of one are of another type."""
    copied = make_states(max(places, 2), states.points.shape[1])
    for array, original in zip(copied, states, strict=True):
        array[:places] = original[row * places : (row + 1) * places]
    return copied
