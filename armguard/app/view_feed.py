"""Sends frames from the monitor's loop to the views, 30 times a second.

Each verdict is noted after it was published. A frame copies a bounded amount of data, whatever the
number of obstacles, and is published without waiting. The loop makes it between two ticks, so that
it delays no tick.
"""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from armguard.app.loop import NO_RESETS, Durations, Resets
from armguard.app.rate_meter import RateMeter
from armguard.app.reachable import find_reachable
from armguard.monitor.monitor import Monitor
from armguard.monitor.reports import Snapshot
from armguard.obstacles.table import MOST_REFUSED
from armguard.robot.portable import describe_robot
from armguard.robot.robot import Robot
from armguard.verdict import Effect, Held, Level, Reason, ReasonKind, Verdict, find_weightiest
from armguard.view.buckets import count_buckets
from armguard.view.messages import (
    Balls,
    CommandSummary,
    FrameMessage,
    Latch,
    LinkCover,
    Load,
    ObstacleShapes,
    Origin,
    Pairs,
    SceneMessage,
    SourceReport,
    StoppingRule,
    VerdictSummary,
)
from armguard.view.publisher import FramePublisher

if TYPE_CHECKING:
    from armguard.shield.command import Command
    from armguard.shield.shield import Shield

INTERVAL = 1.0 / 30.0
"""Time between two frames, in [s]."""

LONGEST_WAIT = 0.25
"""Longest wait of a frame for a tick with enough idle time, in [s]."""

PAIR_LIMIT = 32
"""Greatest number of lines to draw."""

ROW_LIMIT = 1000
"""Greatest number of obstacles to draw; those with the least contact times are drawn."""

REASON_LIMIT = 6
"""Greatest number of reasons in a frame."""

PLAN_SAMPLES = 24
"""Number of points to draw on the path of a plan."""

PATH_SAMPLES = 48
"""Number of points to draw on the rest of a shield's path."""


OF_KNOWN_ROBOT = Origin()


class MonitorFeed:
    """Publishes the state of a monitor for views.

    Args:
        monitor: The monitor.
        publisher: Publishes the frames.
        origin: Facts for the view that the monitor does not know.
    """

    def __init__(
        self, monitor: Monitor, publisher: FramePublisher, origin: Origin = OF_KNOWN_ROBOT
    ) -> None:
        self._command: Command | None = None
        """Of the last tick."""
        self._monitor = monitor
        self._publisher = publisher
        self._next = -math.inf
        self._origin = origin
        self._cost = 0.0
        """Duration of making the last frame, in [s]."""
        self._newest: Verdict | None = None
        self._level: Level | None = None
        """Of the last tick."""
        self._since: dict[Level, float] = {}
        """When each level last began, in [s] of the monitor's clock."""
        self._causes: dict[Level, str] = {}
        """Cause of the last beginning of each level, in words."""
        self._worst: Verdict | None = None
        """The first verdict with the lowest level since the last frame."""
        self._stamp = math.nan
        self._states = 0
        """Number of joint states so far, counted by changes of their stamp."""
        self._meters: dict[str, RateMeter] = {}
        self._latches: dict[str, Latch] = {}
        self._explanation: tuple[str, ...] = ()
        self._publish_scene()

    def observe(
        self,
        verdict: Verdict,
        now: float,
        durations: Durations,
        late: int,
        *,
        wall: float | None = None,
        resets: Resets = NO_RESETS,
    ) -> None:
        """Note a verdict, and publish a frame if one is due.

        Args:
            verdict: The newest.
            now: Time of the monitor's clock, in [s].
            durations: Durations of all ticks so far.
            late: Number of late ticks.
            wall: Time of day, in [s] since 1970; None: the present.
            resets: Resets so far that were obeyed and refused.
        """
        self.note(verdict, now)
        self.publish(now, durations, late, wall=wall, resets=resets)

    def note(self, verdict: Verdict, now: float, command: Command | None = None) -> None:
        """Note the newest verdict, and the shield's command, at a time of the monitor, in [s]."""
        self._newest, self._command = verdict, command
        if verdict.stamp != self._stamp:
            self._stamp = verdict.stamp
            self._states += verdict.sequence > 0
        if verdict.level is not self._level:
            if verdict.level is Level.STOP:
                self._explain()
            self._level = verdict.level
            self._since[verdict.level] = now
            self._causes[verdict.level] = _describe_cause(verdict, now)
            if self._worst is None or verdict.level < self._worst.level:
                self._worst = verdict
        elif verdict.held is not None and verdict.held.since > self._since[verdict.level]:
            # A reset: the same level begins anew.
            self._since[verdict.level] = verdict.held.since
            self._causes[verdict.level] = verdict.held.describe_cause()

    def publish(
        self,
        now: float,
        durations: Durations,
        late: int,
        *,
        wall: float | None = None,
        resets: Resets = NO_RESETS,
        idle: float = math.inf,
        shield: Shield | None = None,
    ) -> None:
        """Publish a frame of the newest verdict if one is due.

        Args:
            now: Time of the monitor's clock, in [s].
            durations: Durations of all ticks so far.
            late: Number of late ticks.
            wall: Time of day, in [s] since 1970; None: the present.
            resets: Resets so far that were obeyed and refused.
            idle: Idle time in [s]. If the last frame took longer, this one waits for a later call,
                but at most for one frame, or for `LONGEST_WAIT` if there is no idle time at all.
            shield: The shield that moves the arm; None: the arm is only watched.
        """
        verdict = self._newest
        wait = 0.0 if self._cost <= idle else (INTERVAL if idle > 0.0 else LONGEST_WAIT)
        if verdict is None or now < self._next + wait:
            return
        begin = time.perf_counter()
        self._next = max(self._next + INTERVAL, now)
        if self._describe_changes() != self._changes:
            self._publish_scene()
        load = Load(
            ticks=durations.count,
            late=late,
            evaluated=verdict.evaluated,
            p50=durations.percentile(50.0),
            p99=durations.percentile(99.0),
        )
        worst = self._worst
        if worst is verdict or (worst is not None and worst.level > verdict.level):
            worst = None
        # What was lower in between, or began the level that holds, is told first: a frame of its
        # own, of the same moment.
        for told in (worst, verdict):
            if told is not None:
                frame = self._make_frame(told, now, load)
                frame = msgspec.structs.replace(
                    frame,
                    wall=time.time() if wall is None else wall,
                    refused_resets=resets.refused,
                    obeyed_resets=resets.obeyed,
                    **describe_shield(shield, self._command),
                )
                self._publisher.publish_frame(frame)
        self._worst = None
        self._cost = time.perf_counter() - begin

    def _explain(self) -> None:
        """Explain the verdict if there is time: this takes as long as thirty ticks."""
        if self._origin.is_recorded:
            explanation = self._monitor.explain()
            self._explanation = () if explanation is None else tuple(str(explanation).splitlines())

    def _describe_changes(self) -> tuple[int, float]:
        """The parts of the scene that can change."""
        return self._monitor.robot.revision, self._monitor.payload

    def _publish_scene(self) -> None:
        self._changes = self._describe_changes()
        self._publisher.publish_scene(make_scene(self._monitor, self._origin))

    def _make_frame(self, verdict: Verdict, now: float, load: Load) -> FrameMessage:
        monitor = self._monitor
        snapshot = monitor.snapshot(pair_limit=PAIR_LIMIT, row_limit=ROW_LIMIT)
        sphere_times = snapshot.sphere_times
        if verdict.link is None and verdict.contact_time == 0.0:
            # Nothing is known about the arm, so everything may be about to touch it.
            sphere_times = np.zeros_like(sphere_times)
        # What a level is held for has fields of its own.
        reasons = [one for one in verdict.reasons if one.kind is not ReasonKind.HOLD][:REASON_LIMIT]
        return FrameMessage(
            sequence=verdict.sequence,
            now=now,
            q=tuple(snapshot.q.tolist()),
            v=tuple(monitor.joint_velocities.tolist()),
            arm_age=max(now - verdict.stamp, 0.0) if math.isfinite(verdict.stamp) else 0.0,
            verdict=VerdictSummary(
                level=verdict.level.name,
                contact_time=verdict.contact_time,
                stop_time=verdict.stop_time,
                speed_scale=verdict.speed_scale,
                link=verdict.link or "",
                obstacle=verdict.obstacle or "",
                complete=verdict.complete,
                reasons=tuple(map(str, reasons)),
                effects=tuple(reason.kind.effect.value for reason in reasons),
                since=self._since[verdict.level],
                cause=self._causes[verdict.level],
                rises_at=None if verdict.held is None else verdict.held.rises_at,
                harm_time=None if verdict.contact_speed is None else verdict.harm_time,
                contact_speed=verdict.contact_speed,
                proved_until=verdict.proved_until,
            ),
            load=load,
            sphere_times=sphere_times.astype("<f4").tobytes(),
            obstacles=_pack_obstacles(monitor, snapshot),
            omitted=max(len(monitor.obstacles) - len(snapshot.rows), 0),
            pairs=self._pack_pairs(snapshot),
            sources=self._report_sources(verdict, now),
            latches=self._follow_latches(verdict, now),
            reach=self._find_reach(verdict, snapshot, now),
            plan=_sample_plan(monitor, now),
            explanation=self._explanation if verdict.level is Level.STOP else (),
        )

    def _pack_pairs(self, snapshot: Snapshot) -> Pairs:
        links = len(self._monitor.robot.links)
        places = {int(row): place for place, row in enumerate(snapshot.rows)}
        rows, those = np.divmod(snapshot.pairs, links)
        listed = [place for place, row in enumerate(rows) if int(row) in places]
        return Pairs.pack(
            those[listed],
            [places[int(row)] for row in rows[listed]],
            snapshot.pair_times[listed],
            count_buckets(snapshot.all_times, self._monitor.period),
        )

    def _report_sources(self, verdict: Verdict, now: float) -> tuple[SourceReport, ...]:
        settings = self._monitor.settings
        is_heard = verdict.sequence > 0 and math.isfinite(verdict.stamp)
        robot_age = now - verdict.stamp if is_heard else None
        heard = [("robot", self._states, robot_age, settings.longest_joint_step)]
        for name, messages, newest, timeout in self._monitor.obstacles.heard_sources:
            age = now - newest if math.isfinite(newest) else None
            heard.append((name, messages, age, timeout or settings.source_timeout))
        return tuple(
            SourceReport(
                name=name,
                age=age,
                rate=self._meters.setdefault(name, RateMeter()).read(now, messages),
                timeout=timeout,
            )
            for name, messages, age, timeout in heard
        )

    def _follow_latches(self, verdict: Verdict, now: float) -> tuple[Latch, ...]:
        latched = [one for one in verdict.reasons if one.kind.effect is Effect.LATCHED]
        self._latches = {
            one.kind.name: self._latches.get(
                one.kind.name, Latch(reason=_tell_latched(one), since=now, remedy=one.kind.remedy)
            )
            for one in latched
        }
        return tuple(self._latches.values())

    def _find_reach(self, verdict: Verdict, snapshot: Snapshot, now: float) -> Balls:
        table = self._monitor.obstacles.table
        if not len(snapshot.rows) or not math.isfinite(verdict.stop_time):
            return Balls()
        row = int(snapshot.rows[0])
        if table.static[row] or not table.has_state[row]:
            return Balls()
        return Balls.pack(find_reachable(table.accepted, row, now, verdict.stop_time))


def make_scene(monitor: Monitor, origin: Origin) -> SceneMessage:
    """The facts about a monitor, for views, that do not change from tick to tick.

    Args:
        monitor: The monitor.
        origin: Facts for the view that the monitor does not know.
    """
    robot, settings = monitor.robot, monitor.settings
    limits = settings.put_in_force(robot)
    sensors = tuple(
        (name, tuple(_place(frame.rotation, frame.translation).ravel().tolist()))
        for name, frame in monitor.obstacles.settings.frames.items()
    )
    return SceneMessage(
        robot=robot.name,
        joints=tuple(robot.joints),
        cover=pack_cover(robot),
        period=monitor.period,
        base=tuple(monitor.base_placement.homogeneous.ravel().tolist()),
        slow_margin=settings.slow_margin,
        aware_margin=settings.aware_margin,
        sensors=sensors,
        stopping=StoppingRule(
            robot=msgspec.json.encode(describe_robot(robot)),
            response_time=settings.response_time,
            reaction_time=settings.reaction_time,
            velocity=tuple(limits.operating_velocity.tolist()),
            acceleration=tuple(limits.operating_acceleration.tolist()),
            payload=monitor.payload,
        ),
        **msgspec.structs.asdict(origin),
    )


def pack_cover(robot: Robot) -> tuple[LinkCover, ...]:
    """The finest spheres of each link."""
    covers = []
    for link in robot.links:
        tree = robot.cover.tree(link)
        joint = robot.model.names[robot.joint_index(link)]
        covers.append(LinkCover.pack(link, joint, tree.spheres[tree.child_count == 0]))
    return tuple(covers)


def _describe_cause(verdict: Verdict, now: float) -> str:
    """The cause of a verdict that begins a level, in words; empty if it is latched."""
    held = verdict.held
    if held is None:
        reason = find_weightiest(verdict.reasons)
        if reason is None:
            return ""
        held = Held(reason, verdict.harm_time, verdict.stop_time, now, now)
    is_latched = held.reason is not None and held.reason.kind.effect is Effect.LATCHED
    return "" if is_latched else held.describe_cause()


def _tell_latched(reason: Reason) -> str:
    """A latched reason without its time, which a view computes by its own clock."""
    detail = reason.detail.rpartition("latched since ")[0].removesuffix("; ")
    return str(reason._replace(detail=detail))


def _pack_obstacles(monitor: Monitor, snapshot: Snapshot) -> ObstacleShapes:
    table, rows = monitor.obstacles.table, snapshot.rows
    # A body that was never believed is shown where it was refused, if that is anywhere.
    accepted, refused, places = table.accepted, table.refused_states, rows * MOST_REFUSED
    believed = table.has_state[rows]
    points = np.where(believed[:, None, None], accepted.points[rows], refused.points[places])
    points[~believed & (table.refused_count[rows] == 0)] = np.nan
    return ObstacleShapes.pack(
        [monitor.obstacles.ids[row] for row in rows],
        points,
        np.where(believed, accepted.radius[rows], refused.radius[places]),
        counts=np.where(believed, accepted.point_count[rows], refused.point_count[places]),
        refused=table.refused[rows],
        times=snapshot.row_times,
        statics=table.static[rows],
        entrances=np.isin(rows, monitor.obstacles.entrance_rows),
    )


def describe_shield(shield: Shield | None, command: Command | None) -> dict[str, Any]:
    """Fields of a frame about a shield and its newest command; empty without a shield."""
    if shield is None or command is None:
        return {}
    summary = CommandSummary(
        scale=command.scale,
        reason="" if command.reason is None else str(command.reason),
        progress=shield.progress,
        is_proved=command.stop is None,
    )
    return {"command": summary, "path": shield.sample_path(PATH_SAMPLES).astype("<f4").tobytes()}


def _sample_plan(monitor: Monitor, now: float) -> bytes:
    """Joint positions along the rest of the newest plan; empty without a plan."""
    plans = monitor.plans
    if not plans:
        return b""
    plan = plans[-1]
    times = plan.stamp + plan.times
    begin = min(max(now, float(times[0])), float(times[-1]))
    wanted = np.linspace(begin, times[-1], PLAN_SAMPLES)
    rows = np.column_stack([np.interp(wanted, times, column) for column in plan.q.T])
    return rows.astype("<f4").tobytes()


def _place(rotation: NDArray[np.float64], translation: NDArray[np.float64]) -> NDArray[np.float64]:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    return pose
