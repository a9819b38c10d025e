"""Motion models: bounds on how far the arm can move by a given time, each a proof by itself.

From the loosest to the tightest for near obstacles: `ReachMotion` (the region of links in any
posture, the tightest for far obstacles), `IsotropicMotion` (points as free bodies), `JointMotion`
(every joint within its limits), `BrakingMotion` (while the arm brakes), `PlannedMotion` (while the
arm follows a plan that `check_plan` has found to be within limits).
"""

from typing import TYPE_CHECKING

from armguard.bounds.braking import BrakingMotion
from armguard.bounds.isotropic import IsotropicMotion
from armguard.bounds.joint import JointMotion
from armguard.bounds.model import MotionModel
from armguard.bounds.reach import ReachMotion
from armguard.bounds.sums import compute_levers
from armguard.bounds.table_time import table_contact_time
from armguard.lazy import lazy_names

if TYPE_CHECKING:
    from armguard.bounds.planned.check import check_plan
    from armguard.bounds.planned.course import PlannedCourse
    from armguard.bounds.planned.motion import PlannedMotion
    from armguard.bounds.planned.plan import CheckedPlan, Plan, Refusal
    from armguard.bounds.planned.stop import append_stop, stop_on_path
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "CheckedPlan": "armguard.bounds.planned.plan",
            "Plan": "armguard.bounds.planned.plan",
            "PlannedCourse": "armguard.bounds.planned.course",
            "PlannedMotion": "armguard.bounds.planned.motion",
            "Refusal": "armguard.bounds.planned.plan",
            "append_stop": "armguard.bounds.planned.stop",
            "check_plan": "armguard.bounds.planned.check",
            "stop_on_path": "armguard.bounds.planned.stop",
        },
    )

__all__ = [
    "BrakingMotion",
    "CheckedPlan",
    "IsotropicMotion",
    "JointMotion",
    "MotionModel",
    "Plan",
    "PlannedCourse",
    "PlannedMotion",
    "ReachMotion",
    "Refusal",
    "append_stop",
    "check_plan",
    "compute_levers",
    "stop_on_path",
    "table_contact_time",
]
