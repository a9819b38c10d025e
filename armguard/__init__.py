"""armguard: a real-time safety monitor for robot arms.

At every tick it says when the arm could touch anything, at the earliest, whatever the arm and the
obstacles do within their bounds, and whether the arm can still stop before that.

    robot = armguard.Robot.load("panda")
    obstacles = armguard.Obstacles()
    monitor = armguard.Monitor(robot, obstacles)
    verdict = monitor.step(stamp, q, v)

By default the arm may do whatever its joints' limits allow, and each obstacle is evaluated in time,
at the price of a few. Between ticks `monitor.explain()` says why a verdict is as it is,
`monitor.headroom()` how much more could be watched, and `monitor.attention()` which obstacle a
sensor should measure next. `Monitor.auto` chooses settings by a trial. A controller that shares its
next piece of trajectory, a `Plan`, asks `monitor.commit(plan)` whether it is safe; a `Shield`
moves the arm along such pieces alone. With a
`SeparationRule` each verdict carries the margin of the usual separation distance, too. A `Recorder`
writes all that a monitor is told and all that it answers, for `armguard replay`.
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
