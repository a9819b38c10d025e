"""`armguard kernels`: compiles all kernels in advance, for a container image or a wheel."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from typing import Any

import numpy as np

from armguard import bounds, contact
from armguard.app.processes import complain
from armguard.app.terminal import make_console
from armguard.bounds.planned.plan import Plan
from armguard.exceptions import ArmguardError
from armguard.jit.carried import CARRIED, PROCESSOR, describe_environment
from armguard.jit.kernels import IS_FAST
from armguard.jit.progress import compilation
from armguard.monitor.monitor import Monitor
from armguard.obstacles.obstacles import Obstacles
from armguard.robot.robot import Robot
from armguard.scheduling.schedule import SCHEDULES
from armguard.settings.schedule import DEADLINE
from armguard.settings.separation_rule import SeparationRule

MONITORS: tuple[dict[str, Any], ...] = (
    *({"schedule": schedule} for schedule in (DEADLINE, *SCHEDULES)),
    *({"schedule": schedule, "motion": "isotropic"} for schedule in (DEADLINE, *SCHEDULES)),
    {"motion": "planned"},
    {"motion": "planned", "leave": "any"},
    {"operating": "published"},
    {"certify": True, "separation": SeparationRule()},
)
"""Settings of monitors that together need all kernels of the loop."""


def run(*, carry: bool) -> int:
    """Compile all kernels, and print where they are.

    Args:
        carry: Whether to compile for a wheel: for `PROCESSOR`, into the folder `CARRIED`.

    Raises:
        ArmguardError: The package's folder cannot be written, or the fast path of compilation is
            not in use. Only the fast path can use the kernels of a wheel.
    """
    if not carry:
        compile_all()
        _tell(f"{compilation.count} kernels compiled; a start finds them now")
        return 0
    if not IS_FAST:
        raise ArmguardError(
            "--carry",
            "needs the fast path of compilation, which this process does not use",
            expected="a version of Numba that it was tested with, and ARMGUARD_JIT unset",
        )
    try:
        shutil.rmtree(CARRIED, ignore_errors=True)
        CARRIED.mkdir()
    except OSError as error:
        raise ArmguardError(
            str(CARRIED), f"cannot be written: {error.strerror}", expected="a folder of the package"
        ) from None
    # Which processor Numba compiles for is settled when it is imported.
    made = subprocess.run(
        [sys.executable, "-c", "from armguard.app.kernels import compile_all; compile_all()"],
        env={**os.environ, **describe_environment()},
        check=False,
    )
    if made.returncode:
        complain(f"the kernels were not compiled: exit code {made.returncode}")
        return 1
    # Locks were for processes that compile here.
    for lock in list(CARRIED.rglob("*.lock")):
        lock.unlink()
    size = sum(path.stat().st_size for path in CARRIED.rglob("*.kernel"))
    _tell(f"kernels for {PROCESSOR} in {CARRIED}: {size / 1e6:.1f} MB")
    return 0


def _tell(line: str) -> None:
    """Print a line of any length."""
    make_console().print(line, soft_wrap=True)


def compile_all() -> None:
    """Compile all kernels that a monitor or a reader of its answers calls."""
    robot = Robot.load("panda")
    for settings in MONITORS:
        watch_a_moment(robot, **settings)
    call_bounds(robot)
    call_contact()


def watch_a_moment(robot: Robot, **settings: Any) -> Monitor:
    """Run a monitor with these settings for a moment, with a ball and a box, and query all answers.

    Args:
        robot: The robot to watch.
        settings: Of the monitor.
    """
    obstacles = Obstacles(sources=["camera"])
    monitor = Monitor(robot, obstacles, **settings)
    q, v = middle(robot), np.zeros(len(robot.joints))
    for stamp in (0.0, 0.001, 0.002):
        box = [[[2.0 + x, y, z] for x in (0.0, 0.1) for y in (0.0, 0.1) for z in (0.0, 0.1)]]
        obstacles.update(["box"], stamp, box, radius=0.01, source="camera")
        obstacles.update(["ball"], stamp, [[1.2, 0.0, 0.5]], radius=0.1, source="camera")
        monitor.step(stamp, q, v)
        if settings.get("motion") == "planned":
            plan = Plan(stamp, [0.0, 0.5], [q, q], [v, v], np.full(len(q), 0.01))
            monitor.commit(plan)
    monitor.pairs()
    monitor.explain()
    return monitor


def call_bounds(robot: Robot) -> None:
    """Call each motion bound of the public API."""
    q, v, link = middle(robot), np.zeros(len(robot.joints)), robot.links[-1]
    motions: tuple[Any, ...] = (
        bounds.ReachMotion(robot),
        bounds.IsotropicMotion(robot),
        bounds.JointMotion(robot),
        bounds.BrakingMotion(robot, 0.02),
    )
    for motion in motions:
        motion.advance(q, v, link, np.zeros(3), np.array([1.0, 0.0, 0.0]), 0.1)


def call_contact() -> None:
    """Compute contact times of one pair and of many pairs."""
    for shape in ((), (2,)):
        place, still = np.broadcast_to([1.0, 0.0, 0.0], (*shape, 3)), np.zeros((*shape, 3))
        contact.earliest_contact(place, still, 0.1, 1.0, 1.0)
        pair = (still, still, 1.0, 1.0, place, still, 1.0, 1.0, 0.1)
        contact.earliest_contact_pair(*pair)
        if not shape:
            contact.certify(*pair)


def middle(robot: Robot) -> np.ndarray[Any, Any]:
    """The middle of all position limits, where no joint is at its end."""
    return 0.5 * (robot.lower_position_limit + robot.upper_position_limit)
