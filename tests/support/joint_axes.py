"""How far points are from joints' axes, by Pinocchio's placements."""

import numpy as np


def distances_from_axes(model, data, joint, places):
    """Distance of world points from the axis line of each joint before `joint`. Shape (n, nv)."""
    distances = np.zeros((len(places), model.nv))
    for number in list(model.supports[joint])[1:]:
        subspace = np.ravel(model.joints[number].createData().S)
        if subspace[3:].any():
            axis = data.oMi[number].rotation @ subspace[3:]
            offset = places - data.oMi[number].translation
            distances[:, number - 1] = np.linalg.norm(np.cross(offset, axis), axis=1)
        else:
            distances[:, number - 1] = 1.0
    return distances
