"""The watch that a monitor's settings ask for."""

from __future__ import annotations

from armguard.bounds.arm import PLANNED
from armguard.monitor_arguments import MonitorSettings
from armguard.obstacles.obstacles import Obstacles
from armguard.pairs.arm import IgnoredPairs, WatchedArm
from armguard.robot.joint_states import JointStates
from armguard.robot.robot import Robot
from armguard.scheduling.deadline import ObstacleWatch
from armguard.scheduling.pair_scheduler import PairWatch
from armguard.scheduling.scheduler import Watch


def make_watch(
    robot: Robot,
    obstacles: Obstacles,
    settings: MonitorSettings,
    ignored: IgnoredPairs,
    states: JointStates,
) -> Watch:
    """A watch over the pairs of an arm and obstacles, compiled and ready.

    Args:
        robot: The arm.
        obstacles: The table; the watch is the one that follows its rows from now on.
        settings: Which watch, and how cautious.
        ignored: Pairs that nobody watches.
        states: Where joint positions and velocities of each tick stand.
    """
    schedule = settings.schedule

    def make_arm() -> WatchedArm:
        return WatchedArm(
            robot,
            obstacles,
            ignored,
            settings.margin,
            settings.reaction_time,
            settings.base_placement,
            with_joints=settings.with_joints,
            with_plans=settings.motion == PLANNED,
            by_distance=schedule is not None and schedule.measure == "distance",
        )

    if schedule is not None:
        return PairWatch(robot, obstacles, schedule, make_arm, states)
    return ObstacleWatch(
        robot,
        obstacles,
        make_arm,
        states,
        settings.horizon + settings.reaction_time,
        settings.freshness,
        settings.aware_margin,
        settings.period,
        settings.budget,
    )
