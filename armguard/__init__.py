"""armguard: a real-time safety monitor for robot arms.

In every tick it computes the earliest time at which the arm could touch an obstacle, whatever both
do within their bounds, and whether the arm can still stop before that.

    robot = armguard.Robot.load("panda")
    obstacles = armguard.Obstacles()
    monitor = armguard.Monitor(robot, obstacles)
    verdict = monitor.step(stamp, q, v)

By default the arm can do whatever its joints' limits allow. Each tick evaluates only the obstacles
that need it, so many obstacles cost little more than a few.

Between ticks, `monitor.explain()` explains the last verdict, `monitor.headroom()` predicts how much
more could be watched, and `monitor.attention()` names the obstacles that a sensor should measure
next. `Monitor.auto` chooses settings by a trial. A controller can send its next piece of
trajectory, a `Plan`, to `monitor.commit(plan)`, which judges whether it is safe. A `Shield` moves
the arm only along such pieces. With a `SeparationRule`, each verdict also has the margin to the
separation distance. A `Recorder` records all inputs and answers of a monitor, for `armguard
replay`.
"""

from typing import TYPE_CHECKING

from armguard import bounds, contact
from armguard.cover.cover import Cover
from armguard.exceptions import ArmguardError
from armguard.lazy import lazy_names
from armguard.monitor.monitor import Monitor
from armguard.monitor.reports import PairReport, Snapshot
from armguard.monitor.trial import Choice, TrialTick
from armguard.obstacles.faults import Fault
from armguard.obstacles.frames import Frame
from armguard.obstacles.obstacles import Obstacles
from armguard.obstacles.sources import Source
from armguard.robot.operating_limits import OperatingLimits
from armguard.robot.robot import Robot
from armguard.settings.contact_limits import ContactLimit, ContactLimits
from armguard.settings.separation_rule import SeparationRule
from armguard.settings.settings import Settings
from armguard.verdict import (
    Held,
    Level,
    PlanChoice,
    PlanVerdict,
    Reason,
    ReasonKind,
    Verdict,
)

if TYPE_CHECKING:
    from armguard import people
    from armguard.bounds.planned.plan import Plan
    from armguard.bounds.planned.stop import stop_on_path
    from armguard.contact import certificate
    from armguard.contact.earliest import Certificate
    from armguard.cover.report import CoverReport
    from armguard.lab.choice import choose_settings
    from armguard.monitor.explain import Explanation
    from armguard.monitor.headroom import Attention, Headroom
    from armguard.pairs.arm_obstacles import ArmObstacles
    from armguard.pairs.cloud_filter import CloudFilter
    from armguard.recording.recorder import Recorder
    from armguard.shield.command import Command
    from armguard.shield.path import Path
    from armguard.shield.shield import Shield
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "ArmObstacles": "armguard.pairs.arm_obstacles",
            "Attention": "armguard.monitor.headroom",
            "Certificate": "armguard.contact.earliest",
            "CloudFilter": "armguard.pairs.cloud_filter",
            "Command": "armguard.shield.command",
            "CoverReport": "armguard.cover.report",
            "Explanation": "armguard.monitor.explain",
            "Headroom": "armguard.monitor.headroom",
            "Path": "armguard.shield.path",
            "Plan": "armguard.bounds.planned.plan",
            "Recorder": "armguard.recording.recorder",
            "Shield": "armguard.shield.shield",
            "certificate": "armguard.contact.certificate",
            "choose_settings": "armguard.lab.choice",
            "people": "armguard.people",
            "stop_on_path": "armguard.bounds.planned.stop",
        },
    )

__all__ = [
    "ArmObstacles",
    "ArmguardError",
    "Attention",
    "Certificate",
    "Choice",
    "CloudFilter",
    "Command",
    "ContactLimit",
    "ContactLimits",
    "Cover",
    "CoverReport",
    "Explanation",
    "Fault",
    "Frame",
    "Headroom",
    "Held",
    "Level",
    "Monitor",
    "Obstacles",
    "OperatingLimits",
    "PairReport",
    "Path",
    "Plan",
    "PlanChoice",
    "PlanVerdict",
    "Reason",
    "ReasonKind",
    "Recorder",
    "Robot",
    "SeparationRule",
    "Settings",
    "Shield",
    "Snapshot",
    "Source",
    "TrialTick",
    "Verdict",
    "bounds",
    "certificate",
    "choose_settings",
    "contact",
    "people",
    "stop_on_path",
]
