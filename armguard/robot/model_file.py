"""Reads a robot's model from a URDF or an MJCF, which differ in their root element."""

from __future__ import annotations

import contextlib
import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Sequence
from pathlib import Path

from armguard.robot.urdf import UrdfModel, read_urdf


def read_model(
    path: str | Path,
    package_dirs: Sequence[str | Path] = (),
    freed: Collection[str] = (),
    drawn: Collection[str] = (),
) -> UrdfModel:
    """Read the model and the collision geometry of a robot.

    Args:
        path: A URDF, or an MJCF: a file whose root element is <mujoco>.
        package_dirs: Folders in which a URDF's `package://` names are looked up.
        freed: Joints that a URDF draws fixed but that turn; an MJCF has no fixed joints.
        drawn: Links without collision geometry whose visual geometry is taken for it.

    Raises:
        RobotError: As `read_urdf` or `read_mjcf` does.
    """
    if is_mjcf(path):
        # Few robots are described by one.
        from armguard.robot.mjcf import read_mjcf

        return read_mjcf(path, drawn)
    return read_urdf(path, package_dirs, freed, drawn)


def is_mjcf(path: str | Path) -> bool:
    """Whether a file can be read and its root element is that of an MJCF."""
    unreadable = (OSError, ElementTree.ParseError, LookupError, ValueError)
    with contextlib.suppress(*unreadable), Path(path).open("rb") as file:
        for _, element in ElementTree.iterparse(file, events=("start",)):
            return element.tag == "mujoco"
    return False
