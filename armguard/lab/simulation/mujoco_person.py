"""A person as bodies of a MuJoCo simulation, for cameras that render and for true distances."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from armguard.lab.simulation.bodies import BODIES, POINTS, Body

LEGS = Body("legs", ("hip",), 0.15)
"""From the hip down to the floor, which no tracked point tells of."""

_CAPSULE = mujoco.mjtGeom.mjGEOM_CAPSULE


class MujocoPerson:
    """The bodies of `BODIES` and legs in a simulation, placed from nine tracked points.

    Args:
        spec: An `MjSpec`, to which the bodies are added; they collide with nothing.
        floor: Its height, in [m].
        group: Of the geoms, by which a renderer can leave them out.
    """

    def __init__(self, spec: Any, floor: float, group: int = 0) -> None:
        self._floor = floor
        self._bodies = (*BODIES, LEGS)
        for body in self._bodies:
            placed = spec.worldbody.add_body(name=body.name, mocap=True)
            size, kind = [body.radius, body.radius, 0.0], {"contype": 0, "conaffinity": 0}
            placed.add_geom(name=body.name, type=_CAPSULE, size=size, group=group, **kind)

    def find_geoms(self, model: Any) -> list[int]:
        """Indices of the geoms in a model that was compiled of the spec."""
        return [model.geom(body.name).id for body in self._bodies]

    def place(self, model: Any, data: Any, position: NDArray[np.float64]) -> None:
        """Put the person somewhere; kinematics are to be computed afterwards.

        Args:
            model: Compiled of the spec; lengths of the bodies are written to it.
            data: Its state.
            position: Of the tracked points in the order of `POINTS`, in [m]. Shape (9, 3).
        """
        for body, geom in zip(self._bodies, self.find_geoms(model), strict=True):
            start, end = (position[POINTS.index(body.points[k])] for k in (0, -1))
            if body is LEGS:
                end = np.array([start[0], start[1], self._floor + body.radius])
            axis, turn = end - start, np.array([1.0, 0.0, 0.0, 0.0])
            half = 0.5 * float(np.linalg.norm(axis))
            if half > 0.0:
                mujoco.mju_quatZ2Vec(turn, axis)
            number = model.body_mocapid[model.geom_bodyid[geom]]
            data.mocap_pos[number], data.mocap_quat[number] = 0.5 * (start + end), turn
            # A ball is a capsule without a length.
            model.geom_size[geom, 1], model.geom_rbound[geom] = half, half + body.radius
