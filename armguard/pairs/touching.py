"""Finds links that touch a body part by its measured state.

A part that is touched may not be pushed along: an arm of which a link's cover meets the part's
measured state, errors included, may only come to rest, or recede on a committed piece (`receding`).
So a part is pressed no farther than one stop goes.

Measured velocities do not say that an arm draws back. A part that is pushed against a compliant arm
pushes it back as well, and the arm would press again as soon as a verdict let it move on.
"""

from __future__ import annotations

from typing import Any

from armguard.contact.gjk import distance_to_hull
from armguard.jit.kernels import kernel
from armguard.obstacles.possible_states import possible_states
from armguard.pairs.contact_time import StatePlace, contact_distance, own_place
from armguard.pairs.scene import Scene

NO_LINK = -1


@kernel
def _meets(scene: Scene, node: int, state: StatePlace) -> bool:
    """Whether a sphere meets a body as it was measured."""
    bodies = scene.refused if state.is_refused else scene.bodies
    center, place = scene.arm.centers[node], state.place
    distance, _, _, _ = distance_to_hull(
        center[0], center[1], center[2], bodies.points[place], bodies.velocities[place],
        bodies.point_count[place],
    )  # fmt: skip
    return not distance > contact_distance(scene, node, bodies, state)


@kernel
def find_touching_link(handle: Any, row: int, watched: Any, now: float) -> int:
    """A link that touches an obstacle; NO_LINK if there is none.

    Args:
        handle: On the tick's `Scene`, its arm prepared.
        row: Of the obstacle; where nothing is known of it no link touches it.
        watched: Which links are watched against it. Shape (links,).
        now: Time of the tick on the obstacles' clock, in [s].
    """
    scene = handle.content
    marks, tree = scene.marks, scene.tree
    for number in possible_states(marks, row):
        state = own_place(scene, row, number, now)
        for link in range(tree.root.shape[0]):
            if not watched[link]:
                continue
            # Invariant: no leaf that was passed so far touches it.
            node = tree.root[link]
            while node >= 0:
                if not _meets(scene, node, state):
                    node = tree.skip[node]
                elif tree.first_child[node] >= 0:
                    node = tree.first_child[node]
                else:
                    return link
    return NO_LINK
