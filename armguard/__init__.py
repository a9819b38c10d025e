"""armguard: a real-time safety monitor for robot arms.

At every tick it says when the arm could touch anything, at the earliest, whatever the arm and the
obstacles do within their bounds, and whether the arm can still stop before that.

    robot = armguard.Robot.load("panda")
    obstacles = armguard.Obstacles()
    monitor = armguard.Monitor(robot, obstacles)
    verdict = monitor.step(stamp, q, v)
"""

from armguard import bounds, certificate, contact
from armguard.cover import Cover
from armguard.exceptions import ArmguardError
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot import Robot
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
]
