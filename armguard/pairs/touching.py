"""Which link a body part touches, by what was measured, and whether the link draws back from it.

A part that is touched may not be pushed along: a link whose cover meets the part's measured state,
errors included, may only come to rest or recede. So a part is pressed no farther than one stop
goes.
"""

from __future__ import annotations

import math
from typing import Any

from armguard.contact.gjk import distance_to_hull
from armguard.jit.kernels import kernel
from armguard.obstacles.possible_states import possible_states
from armguard.pairs.contact_time import StatePlace, contact_distance, own_place
from armguard.pairs.scene import Scene

NO_LINK = -1


@kernel
def _meets(scene: Scene, node: int, state: StatePlace) -> tuple[bool, bool]:
    """Whether a sphere meets a body as it was measured, and whether it surely recedes from it."""
    bodies = scene.refused if state.is_refused else scene.bodies
    center, place = scene.arm.centers[node], state.place
    distance, x, y, z = distance_to_hull(
        center[0], center[1], center[2], bodies.points[place], bodies.velocities[place],
        bodies.point_count[place],
    )  # fmt: skip
    if distance > contact_distance(scene, node, bodies, state):
        return False, False
    velocity = scene.arm.velocities[node]
    closing = velocity[0] * x + velocity[1] * y + velocity[2] * z
    size = math.sqrt(x * x + y * y + z * z)
    return True, closing + scene.arm.velocity_error[node] * size < 0.0


@kernel
def find_touching_link(handle: Any, row: int, watched: Any, now: float) -> int:
    """A link that touches an obstacle and does not recede from it; NO_LINK if there is none.

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
            # Invariant: no sphere that was passed so far touches it without receding.
            node = tree.root[link]
            while node >= 0:
                meets, recedes = _meets(scene, node, state)
                if not meets:
                    node = tree.skip[node]
                elif tree.first_child[node] >= 0:
                    node = tree.first_child[node]
                elif recedes:
                    node = tree.skip[node]
                else:
                    return link
    return NO_LINK
