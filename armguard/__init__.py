"""armguard: a real-time safety monitor for robot arms.

At every tick it says when the arm could touch anything, at the earliest, whatever the arm and the
obstacles do within their bounds, and whether the arm can still stop before that.

    robot = armguard.Robot.load("panda")
    obstacles = armguard.Obstacles()
    monitor = armguard.Monitor(robot, obstacles)
    verdict = monitor.step(stamp, q, v)

By default the arm may do whatever its joints' limits allow, and each obstacle is looked at in time,
at the price of a few. Between ticks `monitor.explain()` says why a verdict is as it is,
`monitor.headroom()` how much more could be watched, and `monitor.attention()` which obstacle a
sensor had better look at next. A controller that shares its next piece of trajectory, a `Plan` of
`armguard.bounds.planned.check`, asks `monitor.commit(plan)` whether it is safe. With a
`SeparationRule` of `armguard.pairs.separation_margin` each verdict carries the margin of the usual
separation distance, too. What the parts of a body do, and how often, is in `armguard.people`.
"""

from armguard import bounds, contact, people
from armguard.contact import certificate
from armguard.cover.cover import Cover
from armguard.exceptions import ArmguardError
from armguard.monitor.monitor import Monitor
from armguard.obstacles.obstacles import Obstacles
from armguard.robot.robot import Robot
from armguard.verdict import Level, Reason, Verdict

__all__ = [
    "ArmguardError",
    "Cover",
    "Level",
    "Monitor",
    "Obstacles",
    "Reason",
    "Robot",
    "Verdict",
    "bounds",
    "certificate",
    "contact",
    "people",
]
