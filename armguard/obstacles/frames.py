"""Frames of sources' coordinates: fixed in the world, with their calibration error."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.exceptions import ObstacleError

ORTHONORMAL_TOLERANCE = 1e-6
"""How far a rotation may be from orthonormal: six written digits, not a scale or a mirror."""


class Frame:
    """A frame F fixed in the world W: p_W = R_WF p_F + p_WF.

    Attributes:
        rotation: R_WF, made exactly orthonormal. Shape (3, 3).
        translation: p_WF, in [m]. Shape (3,).
        position_error: Greatest error of the calibration anywhere in the cell, in [m]; it is added
            to the error of every position in this frame.
    """

    def __init__(
        self, rotation: ArrayLike, translation: ArrayLike, position_error: float = 0.0
    ) -> None:
        """Checks and stores a frame.

        Args:
            rotation: R_WF, orthonormal to six digits, right-handed. Shape (3, 3).
            translation: p_WF, in [m]. Shape (3,).
            position_error: Greatest error of the calibration, in [m], finite, not negative.
        """
        self.rotation = _read("rotation", rotation, (3, 3))
        self.translation = _read("translation", translation, (3,))
        self.position_error = float(position_error)
        largest = float(np.abs(self.rotation).max())
        proper = largest <= 2.0 and np.linalg.det(self.rotation) > 0.0
        product = self.rotation @ self.rotation.T if proper else np.zeros((3, 3))
        if not np.abs(product - np.eye(3)).max() <= ORTHONORMAL_TOLERANCE:
            raise ObstacleError(
                "frame rotation",
                f"is {self.rotation.tolist()}",
                expected="an orthonormal, right-handed (3, 3) matrix",
            )
        if not 0.0 <= self.position_error < math.inf:
            raise ObstacleError(
                "frame position_error",
                f"is {position_error}",
                expected="a finite distance in [m], not negative",
            )
        left, _, right = np.linalg.svd(self.rotation)
        self.rotation = np.ascontiguousarray(left @ right)


def _read(name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.full(shape, np.nan)
    if array.shape != shape or not np.isfinite(array).all():
        raise ObstacleError(f"frame {name}", f"is {value!r}", expected=f"finite numbers {shape}")
    return array
