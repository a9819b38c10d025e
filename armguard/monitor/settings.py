"""Reads the settings of a monitor, and makes its scheduler."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Concatenate, ParamSpec

import msgspec
import pinocchio

from armguard.bounds.operating_history import OperatingHistory
from armguard.exceptions import ArmguardError
from armguard.obstacles.obstacles import Obstacles
from armguard.pairs.arm import WatchedArm
from armguard.pairs.exemptions import Exemptions
from armguard.pairs.ignored import IgnoredPairs
from armguard.robot.joint_states import JointStates
from armguard.robot.operating_limits import LimitsInForce, read_operating
from armguard.robot.robot import Robot
from armguard.scheduling.schedule import make_schedule
from armguard.scheduling.scheduler import Scheduler
from armguard.settings.settings import REMOVED, Settings

P = ParamSpec("P")


def take_keywords(
    record: Callable[P, Settings],
) -> Callable[[Callable[..., None]], Callable[Concatenate[Any, Robot, Obstacles, P], None]]:
    """Give a constructor the keywords of a record, so that checkers of types know them.

    Args:
        record: Record whose fields are the keywords; used only for its type.
    """
    return lambda constructor: constructor


def read_settings(settings: object, keywords: Mapping[str, Any]) -> Settings:
    """The settings of a monitor: a record, or one that is made of keywords.

    Raises:
        ArmguardError: One of them is unusable, or a setting of earlier versions.
        TypeError: A keyword is not a setting, or both are given.
    """
    for name, value in keywords.items():
        if name in REMOVED:
            remedy = REMOVED[name]
            raise ArmguardError(name, f"is {value!r}, and is no setting any more", remedy=remedy)
        if name not in Settings.__struct_fields__:
            raise TypeError(f"Monitor() got an unexpected keyword argument {name!r}")
    if settings is None:
        return Settings(**keywords)
    if not isinstance(settings, Settings):
        raise ArmguardError("settings", f"is {settings!r}", expected="an armguard.Settings")
    if keywords:
        raise TypeError("Monitor() takes settings as a record or as keywords, not as both")
    return settings


def resolve_settings(settings: Settings, robot: Robot, ignored: IgnoredPairs) -> Settings:
    """The same settings with the defaults that depend on the robot filled in.

    Raises:
        ArmguardError: The operating limits do not fit the robot, or the payload its brakes.
    """
    base = settings.base_placement
    return msgspec.structs.replace(
        settings,
        operating=read_operating(robot, settings.operating),
        payload=robot.brakes.check_payload(settings.payload),
        base_placement=pinocchio.SE3.Identity() if base is None else base,
        ignore=ignored.entries,
    )


def make_scheduler(
    robot: Robot,
    obstacles: Obstacles,
    settings: Settings,
    ignored: IgnoredPairs,
    states: JointStates,
    in_force: LimitsInForce,
    operating: OperatingHistory | None = None,
    exemptions: Exemptions | None = None,
) -> Scheduler:
    """A scheduler over the pairs of an arm and obstacles, compiled and ready.

    Args:
        robot: The arm.
        obstacles: The table; the scheduler is the one that follows its rows from now on.
        settings: Settings of the monitor.
        ignored: Pairs that are not watched.
        states: Holds the joint positions and velocities of each tick.
        in_force: The limits and brakes in force, shared.
        operating: Tests joint states against operating limits; None: no operating limits.
        exemptions: Pairs that are exempt for a while; None: none.
    """

    def make_arm(laid_out: Robot) -> WatchedArm:
        return WatchedArm(laid_out, obstacles, ignored, settings, in_force, exemptions)

    if settings.by_deadline:
        return Scheduler(robot, obstacles, make_arm, states, settings, operating)
    # Only schedules of pairs need it.
    from armguard.scheduling.pair_scheduler import PairScheduler

    schedule = make_schedule(settings.schedule, settings.period)
    return PairScheduler(schedule, robot, obstacles, make_arm, states, settings, operating)
