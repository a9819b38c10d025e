"""Finds the points of a cloud that may be the arm's own, which are not obstacles.

A camera also sees the arm. Points inside the arm's cover, enlarged by its position errors and by a
shell, count as the arm's own; any other body there is not seen. `CloudFilter.blind_shell` is the
thickness of this blind shell.

At the arm's edge, cameras also measure points too far away, somewhere between the arm and the
surface behind it. Such a point is on a ray through the enlarged cover. So with a `trail`, points on
such a ray also count as the arm's own, up to this distance behind the enlarged cover. Apart from
the space behind the arm, which the camera does not see anyway, this adds a blind rim: as wide as
the shell in the image, and as deep as the trail.
"""

from __future__ import annotations

import copy
import math

import numpy as np
import pinocchio
from numpy.typing import ArrayLike

from armguard.bounds.sums import compute_levers, sum_levers
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import BoolArray, FloatArray, IntArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.obstacles.frames import Frame
from armguard.robot.robot import Robot

SHELL = 0.02
"""Around the arm's cover, its errors apart, in [m]: for points that are off, as of edges."""


class CloudFilter:
    """Finds the points of a cloud that are not the arm's own.

    Bodies attached to the robot at construction are part of the arm; later ones are not.

    Args:
        robot: The arm.
        base_placement: Placement of its base in the world; None: at the origin.
        shell: Thickness of the shell around the arm's cover, in [m], including the error of the
            camera's points.
        time_error: Greatest time between a joint state and a cloud, in [s]: the arm may have moved
            meanwhile, up to its joints' velocity limits.
        trail: Greatest distance behind the enlarged cover, along the ray, at which a point of the
            arm's edge is measured, in [m].

    Attributes:
        blind_shell: Greatest distance from the arm's cover at which a point counts as the arm's
            own, in [m]: the shell, plus the greatest position error of the arm's surface. The trail
            begins behind it, as seen from the camera.

    Raises:
        ArmguardError: A length or a time is not a finite number of at least 0.
    """

    def __init__(
        self,
        robot: Robot,
        base_placement: pinocchio.SE3 | None = None,
        *,
        shell: float = SHELL,
        time_error: float = 0.0,
        trail: float = 0.0,
    ) -> None:
        for name, value in (("shell", shell), ("time_error", time_error), ("trail", trail)):
            if not 0.0 <= value < math.inf:
                raise ArmguardError(name, f"is {value!r}", expected="a finite number, at least 0")
        robot = copy.copy(robot)
        self._trail = float(trail)
        self._model = robot.model
        self._data = robot.model.createData()
        self._base = pinocchio.SE3.Identity() if base_placement is None else base_placement
        self._joints: list[int] = []
        self._leaves: list[FloatArray] = []
        balls, grown, first = [], [], [0]
        for link in robot.links:
            tree = robot.cover.tree(link)
            leaves = np.ascontiguousarray(tree.spheres[tree.child_count == 0])
            levers = compute_levers(robot, link, leaves[:, :3])
            errors = sum_levers(levers, robot.position_error)
            errors = errors + sum_levers(levers, robot.velocity_limit) * time_error
            growth = (shell + errors) * (1.0 + SUM_ROUNDING)
            grown.append(leaves[:, 3] + growth)
            middle = leaves[:, :3].mean(axis=0)
            reach = np.linalg.norm(leaves[:, :3] - middle, axis=1) + leaves[:, 3] + growth
            balls.append(np.append(middle, reach.max() * (1.0 + SUM_ROUNDING)))
            first.append(first[-1] + len(leaves))
            self._joints.append(robot.joint_index(link))
            self._leaves.append(leaves[:, :3])
        self._radius = np.concatenate(grown)
        self._balls = np.array(balls)
        self._first = np.array(first, dtype=np.int64)
        self.blind_shell = float(
            max(
                (one - tree.spheres[tree.child_count == 0][:, 3]).max()
                for one, tree in zip(grown, map(robot.cover.tree, robot.links), strict=True)
            )
        )
        # Compiled here, so that the first cloud is like any other.
        self.find_others(np.zeros((1, 3)), np.zeros(robot.model.nq), origin=np.zeros(3))

    def find_others(
        self,
        points: ArrayLike,
        q: ArrayLike,
        frame: Frame | None = None,
        origin: ArrayLike | None = None,
    ) -> BoolArray:
        """Finds the points of a cloud that are not the arm's own.

        Points that are not finite count as not the arm's: `update_cloud` drops and reports them.

        Args:
            points: In [m]. Shape (n, 3).
            q: Joint positions at the time of the cloud, in the order of `robot.joints`, in [rad] or
                [m]. Shape (nv,).
            frame: Frame of the points and the origin; None: the world.
            origin: Origin of the rays, the camera's centre, in [m]; required with a trail. Shape
                (3,).

        Returns:
            Whether each is not the arm's, for `Obstacles.update_cloud(…, occupied=…)`. Shape (n,).

        Raises:
            ArmguardError: Points, positions or origin have a wrong shape, or positions or origin
                are not finite, so that the place of the arm or its edge is unknown.
        """
        ends = np.ascontiguousarray(points, dtype=np.float64)
        if ends.ndim != 2 or ends.shape[1] != 3:
            raise ArmguardError("points", f"has shape {ends.shape}", expected="(n, 3)")
        position = np.array(q, dtype=np.float64)
        if position.shape != (self._model.nq,) or not np.isfinite(position).all():
            raise ArmguardError(
                "q", f"is {position.tolist()}", expected=f"{self._model.nq} finite positions"
            )
        begin = np.zeros(3)
        if self._trail > 0.0:
            begin = np.array([] if origin is None else origin, dtype=np.float64)
            if begin.shape != (3,) or not np.isfinite(begin).all():
                raise ArmguardError(
                    "origin", f"is {begin.tolist()}", expected="3 finite numbers, with a trail"
                )
        pinocchio.forwardKinematics(self._model, self._data, position)
        balls, centers = self._balls.copy(), []
        for link, (joint, leaves) in enumerate(zip(self._joints, self._leaves, strict=True)):
            pose = self._base * self._data.oMi[joint]
            rotation, translation = pose.rotation, pose.translation
            centers.append(leaves @ rotation.T + translation)
            balls[link, :3] = rotation @ self._balls[link, :3] + translation
        rotation, translation = np.eye(3), np.zeros(3)
        if frame is not None:
            rotation, translation = frame.rotation, frame.translation
        others = np.zeros(len(ends), dtype=np.bool_)
        _find_others(
            ends,
            rotation,
            translation,
            rotation @ begin + translation,
            self._trail,
            balls,
            self._first,
            np.concatenate(centers),
            self._radius,
            others,
        )
        return others


@kernel
def _find_others(
    points: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
    origin: FloatArray,
    trail: float,
    balls: FloatArray,
    first: IntArray,
    centers: FloatArray,
    radius: FloatArray,
    others: BoolArray,
) -> None:
    """Find the points whose rays end in none of the arm's spheres, nor up to a trail behind one.

    The last part of a ray, as long as the trail, is a segment. A point is the arm's where that
    segment meets a sphere: where the sphere's centre is no farther from it than the radius.

    Args:
        points: In their frame, in [m]. Shape (n, 3).
        rotation: World from frame. Shape (3, 3).
        translation: Of the frame, in [m]. Shape (3,).
        origin: Where the rays begin in the world, in [m]. Shape (3,).
        trail: In [m].
        balls: Around all grown spheres of each link: centre and radius, in [m]. Shape (links, 4).
        first: First sphere of each link, and one more at the end. Shape (links + 1,).
        centers: Of the spheres, in [m]. Shape (m, 3).
        radius: Of the spheres, grown, in [m]. Shape (m,).
        others: Is filled. Shape (n,).
    """
    place, back = np.empty(3), np.zeros(3)
    for i in range(points.shape[0]):
        for axis in range(3):
            place[axis] = translation[axis]
            for other in range(3):
                place[axis] += rotation[axis, other] * points[i, other]
        x, y, z = place[0], place[1], place[2]
        length = 0.0
        if trail > 0.0:
            # From the point back to the camera, no farther than to there.
            for axis in range(3):
                back[axis] = origin[axis] - place[axis]
            away = math.sqrt(back[0] ** 2 + back[1] ** 2 + back[2] ** 2)
            length = min(trail, away)
            for axis in range(3):
                back[axis] = back[axis] / away if away > 0.0 else 0.0
        is_own = False
        for link in range(balls.shape[0]):
            square = (x - balls[link, 0]) ** 2 + (y - balls[link, 1]) ** 2
            square += (z - balls[link, 2]) ** 2
            if not square <= (balls[link, 3] + length) ** 2:
                continue
            for k in range(first[link], first[link + 1]):
                dx, dy, dz = centers[k, 0] - x, centers[k, 1] - y, centers[k, 2] - z
                along = dx * back[0] + dy * back[1] + dz * back[2]
                along = max(0.0, min(length, along))
                square = (dx - along * back[0]) ** 2 + (dy - along * back[1]) ** 2
                square += (dz - along * back[2]) ** 2
                if square <= radius[k] ** 2:
                    is_own = True
                    break
            if is_own:
                break
        others[i] = not is_own
