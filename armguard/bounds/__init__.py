"""How far the arm can get by a given time: motion models, each a proof by itself.

From the loosest to the tightest near by: `ReachMotion` (where links can be at all, the tightest
far away), `IsotropicMotion` (points as free bodies), `JointMotion` (every joint within its
limits), `BrakingMotion` (while the arm brakes), `PlannedMotion` (while it follows a plan).
"""

from armguard.bounds.braking import BrakingMotion
from armguard.bounds.isotropic import IsotropicMotion, free_advance
from armguard.bounds.joint import JointMotion
from armguard.bounds.joint_box import JointTable
from armguard.bounds.motion_model import MotionModel
from armguard.bounds.planned import PlannedMotion
from armguard.bounds.planned_course import PlannedCourse
from armguard.bounds.planned_time import PlannedContact
from armguard.bounds.reach import ReachMotion
from armguard.bounds.sums import compute_levers
from armguard.bounds.table_time import table_contact_time

__all__ = [
    "BrakingMotion",
    "IsotropicMotion",
    "JointMotion",
    "JointTable",
    "MotionModel",
    "PlannedContact",
    "PlannedCourse",
    "PlannedMotion",
    "ReachMotion",
    "compute_levers",
    "free_advance",
    "table_contact_time",
]
