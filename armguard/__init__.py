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
next piece of trajectory, a `Plan`, asks `monitor.commit(plan)` whether it is safe. With a
`SeparationRule` each verdict carries the margin of the usual separation distance, too. A `Recorder`
writes all that a monitor is told and all that it answers, for `armguard replay`.
"""

from typing import TYPE_CHECKING

from armguard import bounds, contact, people
from armguard.bounds import Plan, stop_on_path
from armguard.contact import Certificate, certificate
from armguard.cover import Cover, CoverReport
from armguard.exceptions import ArmguardError
from armguard.monitor import (
    Attention,
    Choice,
    Explanation,
    Headroom,
    Monitor,
    PairReport,
    PlanVerdict,
    Snapshot,
    TrialTick,
)
from armguard.obstacles import Fault, Frame, Obstacles, Source
from armguard.pairs import ArmObstacles, CloudFilter, SeparationRule
from armguard.robot import OperatingLimits, Robot
from armguard.settings import Settings
from armguard.verdict import Held, Level, Reason, ReasonKind, Verdict

if TYPE_CHECKING:
    from armguard.lab.choice import choose_settings
    from armguard.recording.recorder import Recorder
else:

    def __getattr__(name):
        """What only some need is loaded when it is first asked for."""
        if name == "Recorder":
            from armguard.recording.recorder import Recorder

            return Recorder
        if name == "choose_settings":
            from armguard.lab.choice import choose_settings

            return choose_settings
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = [
    "ArmObstacles",
    "ArmguardError",
    "Attention",
    "Certificate",
    "Choice",
    "CloudFilter",
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
    "Plan",
    "PlanVerdict",
    "Reason",
    "ReasonKind",
    "Recorder",
    "Robot",
    "SeparationRule",
    "Settings",
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
