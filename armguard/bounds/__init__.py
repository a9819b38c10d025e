"""How far the arm can get by a given time: motion models, each a proof by itself."""

from armguard.bounds.isotropic import IsotropicMotion, free_advance
from armguard.bounds.motion_model import MotionModel
from armguard.bounds.sums import compute_levers

__all__ = ["IsotropicMotion", "MotionModel", "compute_levers", "free_advance"]
