"""How far points are from joints' axes, by Pinocchio's placements."""

import numpy as np


def find_axes(model, joint):
    """Axis of each joint before `joint` in its own frame, by its number; None: it slides."""
    axes = {}
    for number in list(model.supports[joint])[1:]:
        subspace = np.ravel(model.joints[number].createData().S)
        axes[number] = subspace[3:] if subspace[3:].any() else None
    return axes


def distances_from_axes(model, data, joint, places, axes=None):
    """Distance of world points from the axis line of each joint before `joint`. Shape (n, nv).

    Args:
        model: Of the arm.
        data: With placements.
        joint: Number of the last joint that counts.
        places: Points. Shape (n, 3).
        axes: What `find_axes` says, for those who ask again and again.
    """
    distances = np.zeros((len(places), model.nv))
    for number, own in (find_axes(model, joint) if axes is None else axes).items():
        if own is None:
            distances[:, number - 1] = 1.0
            continue
        placement = data.oMi[number]
        a, b, c = placement.rotation @ own
        x, y, z = (places - placement.translation).T
        # The cross product, as `np.cross` has it, at a tenth of its price for few points.
        squared = (y * c - z * b) ** 2 + (z * a - x * c) ** 2 + (x * b - y * a) ** 2
        distances[:, number - 1] = np.sqrt(squared)
    return distances
