"""The tool of a cell file, made into geometry and attached to the robot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio
from numpy.typing import NDArray

from armguard.cell_schema import ToolTable
from armguard.exceptions import RobotError
from armguard.robot.robot import Robot

SHAPES = ("sphere", "box", "capsule", "cylinder", "mesh")


def attach_tool(
    robot: Robot, table: ToolTable, rotation: NDArray[np.float64], folder: Path
) -> None:
    """Attach what `[tool]` describes.

    Args:
        robot: To whose link.
        table: The tool.
        rotation: Of its geometry in the frame of the link's joint. Shape (3, 3).
        folder: Where a mesh is looked up.

    Raises:
        RobotError: The link, the geometry or the mesh file is unusable.
        CoverError: No cover of it could be proved.
    """
    geometry = _make_geometry(table, folder)
    robot.attach(table.name, table.link, geometry, pinocchio.SE3(rotation, np.array(table.xyz)))


def _make_geometry(table: ToolTable, folder: Path) -> Any:
    if table.sphere is not None:
        return coal.Sphere(table.sphere)
    if table.box is not None:
        return coal.Box(*table.box)
    if table.capsule is not None:
        return coal.Capsule(table.capsule.radius, table.capsule.length)
    if table.cylinder is not None:
        return coal.Cylinder(table.cylinder.radius, table.cylinder.length)
    path = folder / str(table.mesh)
    try:
        return coal.MeshLoader().load(str(path), np.full(3, table.mesh_scale))
    except (ValueError, RuntimeError) as error:
        raise RobotError(
            str(path), "cannot be read as a mesh", expected="an STL, OBJ or DAE file"
        ) from error
