"""Selects the watched joints and links, and locks all other joints of the model.

A joint that is neither watched nor locked by name must be independent of all watched joints: it
must not carry one, be carried by one, mimic one or be mimicked by one. A moving link with visual
but without collision geometry could never be found in contact, so it must be named as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio
from numpy.typing import NDArray

from armguard.exceptions import RobotError
from armguard.jit.numerics import LIMIT_SLACK
from armguard.robot.description import RobotDescription
from armguard.robot.links import get_rest_position
from armguard.robot.urdf import UrdfModel

_REVOLUTE = ("JointModelRX", "JointModelRY", "JointModelRZ", "JointModelRevoluteUnaligned")
_PRISMATIC = ("JointModelPX", "JointModelPY", "JointModelPZ", "JointModelPrismaticUnaligned")


def check_joints(
    urdf: UrdfModel, description: RobotDescription, watched: Sequence[str]
) -> list[str]:
    """Refuse joints that are unknown, unlimited or coupled; return the others, to be locked.

    Args:
        urdf: The whole robot.
        description: Limits of the watched joints, and where the others rest or travel.
        watched: Names of the joints to watch.

    Raises:
        RobotError: A joint is not what it must be; the message names it.
    """
    model, names = urdf.model, list(urdf.model.names)[1:]
    for joint in [*watched, *description.locked]:
        if joint not in names:
            raise RobotError(
                f"joint {joint!r}", "is not in the URDF", expected=f"one of {', '.join(names)}"
            )
    if not watched:
        raise RobotError(model.name, "no joint is to be watched")
    for joint in watched:
        if joint not in description.joints:
            raise RobotError(f"joint {joint!r}", "has no limits", remedy="give them in [joints]")
        continuous = joint in urdf.continuous
        if continuous != (description.joints[joint].position is None):
            raise RobotError(
                f"joint {joint!r}",
                "is continuous and has no range" if continuous else "has no position limit",
                expected="no position" if continuous else "position = [lower, upper]",
            )
    for joint, mimic in urdf.mimics.items():
        if joint in watched or mimic.leader in watched:
            raise RobotError(
                f"joint {joint!r}",
                f"mimics joint {mimic.leader!r}",
                expected="joints that move independently",
                remedy="lock both, or remove the mimic element",
            )
    watched_ids = {model.getJointId(joint) for joint in watched}
    carriers = {ancestor for joint in watched_ids for ancestor in model.supports[joint]}
    for joint in names:
        if joint in watched or joint in description.locked:
            continue
        number = model.getJointId(joint)
        if number in carriers or watched_ids & set(model.supports[number]):
            raise RobotError(
                f"joint {joint!r}",
                "is not watched, but carries or is carried by a watched joint",
                remedy="watch it, or give its position or travel in [locked]",
            )
    for joint, entry in description.locked.items():
        number = model.getJointId(joint)
        slides = np.any(model.joints[number].createData().S[:3])
        _check_follower(urdf, description, joint)
        if entry.travel is None:
            continue
        if number in carriers:
            raise RobotError(
                f"joint {joint!r}",
                "cannot be anywhere in its travel",
                expected="a joint that carries no watched one",
                remedy="lock it at a position",
            )
        if not (slides or entry.travel[1] - entry.travel[0] <= 2.0 * np.pi):
            raise RobotError(
                f"joint {joint!r}",
                f"has travel = {list(entry.travel)}",
                expected="at most one turn",
            )
    return [joint for joint in names if joint not in watched]


def _check_follower(urdf: UrdfModel, description: RobotDescription, joint: str) -> None:
    """Refuse a mimic joint that is locked elsewhere than where the joint that it follows takes it.

    Raises:
        RobotError: It may leave its place, or there is no telling how far it may go.
    """
    mimic = urdf.mimics.get(joint)
    if mimic is None or not urdf.model.existJointName(mimic.leader):
        return
    entry, leading = description.locked[joint], description.locked.get(mimic.leader)
    if leading is None:
        lower, upper = urdf.read_range(mimic.leader) or (-np.inf, np.inf)
    else:
        lower, upper = leading.travel or (get_rest_position(leading),) * 2
    least, most = mimic.map_range(lower, upper)
    place = get_rest_position(entry)
    allowed = entry.travel or (place, place)
    if not (allowed[0] - LIMIT_SLACK <= least <= most <= allowed[1] + LIMIT_SLACK):
        raise RobotError(
            f"joint {joint!r}",
            f"has travel = {list(allowed)}" if entry.travel else f"has position = {place!r}",
            expected=f"where joint {mimic.leader!r} takes it: "
            + (repr(least) if least == most else f"all of [{least!r}, {most!r}]"),
            remedy=f"correct it, or the place of {mimic.leader!r}, in [locked]",
        )


def check_bare_links(
    urdf: UrdfModel, description: RobotDescription, watched: Sequence[str]
) -> None:
    """Refuse links that move and are drawn, but have no collision geometry and are not named.

    Args:
        urdf: The whole robot.
        description: Names those that may go uncovered.
        watched: Names of the joints to watch.

    Raises:
        RobotError: There is one, or one is named that is no such link.
    """
    for link in description.bare_links:
        if link not in urdf.bare:
            raise RobotError(
                f"bare link {link!r}", "is not a link that is drawn without collision geometry"
            )
    model = urdf.model
    moving = {model.getJointId(joint) for joint in watched}
    for link in urdf.bare:
        number = model.getFrameId(link, pinocchio.FrameType.BODY)
        is_moved = bool(moving & set(model.supports[model.frames[number].parentJoint]))
        if is_moved and link not in description.bare_links:
            raise RobotError(
                f"link {link!r}",
                "is drawn and moves, but has no collision geometry",
                expected="a collision element",
                remedy="give it one, or name it in bare_links to leave it uncovered",
            )


def reduce_model(
    urdf: UrdfModel, description: RobotDescription, locked: Sequence[str]
) -> tuple[Any, Any]:
    """The model and the collision model with joints locked, a travelling one at its start.

    Raises:
        RobotError: Pinocchio cannot lock them.
    """
    configuration = pinocchio.neutral(urdf.model)
    for joint in locked:
        index = urdf.model.joints[urdf.model.getJointId(joint)].idx_q
        configuration[index] = get_rest_position(description.locked.get(joint))
    return lock_joints(urdf.model, urdf.collision_model, locked, configuration)


def lock_joints(
    model: Any, geometry: Any, locked: Sequence[str], configuration: NDArray[np.float64]
) -> tuple[Any, Any]:
    """A model and its geometry without the joints that are locked.

    Args:
        model: `pinocchio.Model`.
        geometry: `pinocchio.GeometryModel` of it.
        locked: Names of the joints.
        configuration: Where they are locked, among the others. Shape (nq,).

    Raises:
        RobotError: Pinocchio cannot lock them.
    """
    if not locked:
        # It would look up all frames by name alone, and fail where a link and a joint share one.
        return model.copy(), geometry.copy()
    try:
        reduced, reduced_geometry = pinocchio.buildReducedModel(
            model, geometry, [model.getJointId(joint) for joint in locked], configuration
        )
    except ValueError as error:
        raise RobotError(
            model.name,
            f"its joints {', '.join(locked)} cannot be locked: {' '.join(str(error).split())}",
            remedy="give links and joints names of their own",
        ) from error
    return reduced, reduced_geometry


def is_prismatic(model: Any, joint: int) -> bool:
    """Whether a joint slides; it turns otherwise.

    Raises:
        RobotError: It does neither.
    """
    kind = model.joints[joint].shortname()
    if kind in _REVOLUTE or kind in _PRISMATIC:
        return kind in _PRISMATIC
    raise RobotError(
        f"joint {model.names[joint]}",
        f"is a {kind}",
        expected="a revolute or prismatic joint with one degree of freedom",
        remedy="lock it, or watch only the joints behind it",
    )


def find_axis(model: Any, joint: int) -> NDArray[np.float64]:
    """Along which a joint slides, or about which it turns, in its own frame: a unit vector."""
    motion = np.ravel(model.joints[joint].createData().S)
    # What slides does not turn, and what turns does not slide.
    axis: NDArray[np.float64] = motion[:3] + motion[3:]
    return axis
