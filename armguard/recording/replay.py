"""Replays a recording and checks that the verdicts are bit-identical.

A verdict depends on its inputs, on the configuration of the monitor, and on the machine. The first
two are in the file. So if verdicts differ, the machine differs, and the report names the
differences.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from armguard.exceptions import ArmguardError
from armguard.messages.answers import (
    PlanVerdictMessage,
    VerdictMessage,
    read_verdict,
    to_plan_message,
    to_verdict_message,
)
from armguard.messages.batch import read_batch
from armguard.messages.events import (
    DroppedPoints,
    FaultsTaken,
    MalformedCall,
    Payload,
    PromiseBroken,
    StaticObstacle,
    TetherEnded,
    TetherStated,
)
from armguard.messages.incoming import (
    IgnoreMessage,
    MessageError,
    ObstaclesMessage,
    PlanMessage,
    RemoveMessage,
    ResetMessage,
    WatchMessage,
    to_rows,
)
from armguard.monitor.monitor import Monitor
from armguard.monitor.provenance import describe_provenance, list_differences
from armguard.obstacles.obstacles import Obstacles
from armguard.recording.events import (
    BodiesChanged,
    Event,
    Gap,
    JointState,
    MalformedPlan,
    MalformedState,
)
from armguard.recording.inputs import restore_plan, restore_state
from armguard.recording.json_form import write_json
from armguard.recording.reading import Recording
from armguard.recording.settings import change_settings, make_monitor, make_obstacles
from armguard.robot.portable import RestoredRobot
from armguard.verdict import PlanVerdict, Verdict

UNEXPLAINED = "unknown: version, sources, robot, cover, processor and compiler are the same"


UNREADABLE = MessageError, ValueError, TypeError, LookupError, ArithmeticError, AttributeError
"""Errors that a damaged message, or damaged settings, raise when they are read."""


class ReplayedTick(NamedTuple):
    """One tick of a recording, and of the replay."""

    nanoseconds: int
    """When it was recorded, since 1970."""
    now: float
    """[s] of the monitor's clock."""
    recorded: Verdict
    replayed: Verdict
    is_compared: bool
    """Whether the two should be the same: not after a gap, nor with other settings."""
    is_identical: bool
    """Whether they are bit-identical."""


class Difference(NamedTuple):
    """The first answer that differs from the recorded one."""

    sequence: int
    """Number of the tick."""
    now: float
    """[s] of the monitor's clock."""
    fields: tuple[str, ...]
    """What differs, as "field: recorded, replayed"."""
    causes: tuple[str, ...]
    """Differences of this replay from the recording."""

    def __str__(self) -> str:
        return (
            f"tick {self.sequence} at {self.now:.6f} s differs in {'; '.join(self.fields)}; cause: "
            f"{'; '.join(self.causes)}"
        )


class ReplayReport(NamedTuple):
    """Results of a replay."""

    ticks: int
    """Verdicts in the recording."""
    compared: int
    """Verdicts that were compared with recorded ones."""
    difference: Difference | None
    """The first; None: all that were compared are identical."""
    lost: int
    """Events that are missing in the recording; verdicts after them are not compared."""
    is_cut_off: bool
    """Whether the recording has no end: its writer was killed."""
    differences: tuple[str, ...]
    """Differences of this machine from the recording's, even if verdicts are the same."""

    @property
    def is_identical(self) -> bool:
        """Whether all verdicts of the recording were compared and are bit-identical."""
        return self.difference is None and self.compared == self.ticks > 0 and not self.lost


class Replay:
    """Steps a monitor with the recorded configuration through a recording.

    Args:
        recording: The recording.
        changes: Settings to be changed, as `settings.change_settings` takes them.

    Attributes:
        robot: The arm.
        obstacles: The table.
        monitor: The monitor; between two ticks it may be asked anything.

    Raises:
        ArmguardError: The monitor cannot be made from the recording, or a change is unusable.
    """

    def __init__(self, recording: Recording, changes: Mapping[str, str] | None = None) -> None:
        self._recording = recording
        self._changes = dict(changes or {})
        settings = copy.deepcopy(recording.settings)
        try:
            self.robot = RestoredRobot(recording.robot)
            change_settings(settings, self._changes, self.robot)
            self.obstacles: Obstacles = make_obstacles(settings["obstacles"])
            self.monitor: Monitor = make_monitor(settings["monitor"], self.robot, self.obstacles)
        except UNREADABLE as error:
            raise ArmguardError(
                str(recording.path),
                f"has settings that cannot be read ({type(error).__name__}: {error})",
            ) from None
        self._ticks = self._compared = self._lost = 0
        self._now = math.nan
        self._difference: Difference | None = None
        self._answer: PlanVerdict | None = None
        self._differences = tuple(
            list_differences(recording.provenance, describe_provenance(self.robot))
        )

    def ticks(self) -> Iterator[ReplayedTick]:
        """Step the monitor through the recording, tick by tick; once.

        Raises:
            ArmguardError: The recording is damaged, or has a message that cannot be read.
        """
        pending: tuple[float, Verdict] | None = None
        for nanoseconds, event, data in self._recording.events():
            if isinstance(event, JointState | MalformedState):
                stamp, q, v, now = self._read(restore_state, event)
                pending = now, self.monitor.step(stamp, q, v, now)
                self._now = now
            elif not isinstance(event, VerdictMessage):
                self._apply(event, data)
            elif event.sequence > 0:
                self._ticks += 1
                if pending is None:
                    continue  # its joint state was lost
                (now, replayed), pending = pending, None
                recorded = self._read(read_verdict, event)
                is_compared = not self._lost and not self._changes
                is_identical = write_json(to_verdict_message(replayed)) == data
                if is_compared:
                    self._compared += 1
                    if not is_identical:
                        self._note_difference(recorded._asdict(), replayed._asdict())
                yield ReplayedTick(nanoseconds, now, recorded, replayed, is_compared, is_identical)

    def report(self) -> ReplayReport:
        """Results so far."""
        return ReplayReport(
            self._ticks,
            self._compared,
            self._difference,
            self._lost,
            self._recording.is_cut_off,
            self._differences,
        )

    def _apply(self, event: Event, data: bytes) -> None:
        """Apply a recorded event to the monitor and its table."""
        try:
            self._take(event, data)
        except (*UNREADABLE, ArmguardError) as error:
            raise self._make_error(event, error) from None

    def _take(self, event: Event, data: bytes) -> None:
        if isinstance(event, BodiesChanged):
            self.robot.replace_bodies(read_bodies(event))
        elif isinstance(event, Gap):
            self._lost += event.events
        elif isinstance(event, PlanVerdictMessage):
            answer, self._answer = self._answer, None
            if answer is not None and not self._lost and not self._changes:
                message = to_plan_message(event.number, answer)
                if write_json(message) != data:
                    self._note_difference(_list_fields(event), _list_fields(message))
        elif not (isinstance(event, Payload) and "payload" in self._changes):
            answer = apply_event(self.monitor, event)
            # Other events may come between a plan and its answer.
            self._answer = self._answer if answer is None else answer

    def _note_difference(self, recorded: Mapping[str, Any], replayed: Mapping[str, Any]) -> None:
        if self._difference is not None:
            return
        fields = tuple(
            f"{name}: {_show(value)} recorded, {_show(replayed[name])} replayed"
            for name, value in recorded.items()
            if _show(value) != _show(replayed[name])
        )
        causes = self._differences or (UNEXPLAINED,)
        self._difference = Difference(self.monitor.ticks, self._now, fields, causes)

    def _read(self, read: Callable[[Any], Any], event: Event) -> Any:
        try:
            return read(event)
        except UNREADABLE as error:
            raise self._make_error(event, error) from None

    def _make_error(self, event: Event, error: Exception) -> ArmguardError:
        name = type(event).__name__
        return ArmguardError(
            str(self._recording.path), f"has a {name} that cannot be replayed ({error})"
        )


def replay(path: str | Path, changes: Mapping[str, str] | None = None) -> ReplayReport:
    """Replay a recording as fast as possible, and check that the verdicts are bit-identical.

    Args:
        path: The recording.
        changes: Settings to be changed, by name, such as {"latency": "0.01"}; then nothing is
            compared.

    Raises:
        ArmguardError: The file is no recording, damaged, or of a later version, or a change is
            unusable.
    """
    run = Replay(Recording(path), changes)
    for _ in run.ticks():
        pass
    return run.report()


def read_bodies(event: BodiesChanged) -> dict[str, Any]:
    """Argument of `RestoredRobot.replace_bodies`."""
    links = [
        msgspec.json.decode(link.data) if link.data else {"name": link.name} for link in event.links
    ]
    return {"revision": event.revision, "links": links}


def apply_event(monitor: Monitor, event: Event) -> PlanVerdict | None:
    """Give the input of a recorded event to a monitor and its table, if the event is an input.

    Returns:
        The answer to a plan, where it is one and the monitor takes plans.
    """
    apply_to_table(monitor.obstacles, event)
    if isinstance(event, IgnoreMessage):
        zone = None
        if event.zone is not None:
            zone = to_rows("zone", event.zone, 3)
        monitor.ignore(event.link, event.ids, event.source, until=event.until, zone=zone)
    elif isinstance(event, WatchMessage):
        monitor.watch(event.number)
    elif isinstance(event, ResetMessage):
        monitor.reset()
    elif isinstance(event, Payload):
        monitor.payload = event.payload
    elif isinstance(event, PlanMessage | MalformedPlan) and monitor.settings.with_plans:
        return monitor.commit(restore_plan(event))
    return None


def apply_to_table(obstacles: Obstacles, event: Event) -> None:
    """Give the input of a recorded event to a table, if the event is an input of a table."""
    if isinstance(event, ObstaclesMessage):
        # The voxels of a recorded cloud stand in an update.
        obstacles.takes_voxels = True
        obstacles.take(read_batch(event))
    elif isinstance(event, StaticObstacle):
        points = np.frombuffer(event.position).reshape(-1, 3)
        if event.speed is None:
            obstacles.add_static(event.id, points, event.radius)
        else:
            # It is as wide as it counts already.
            obstacles.add_entrance(event.id, points, event.radius, 0.0, event.speed, event.accel)
    elif isinstance(event, RemoveMessage):
        since = None if math.isnan(event.stamp) else event.stamp
        obstacles.remove(event.ids, since, event.source or None)
    elif isinstance(event, MalformedCall):
        obstacles.leave_malformed(event.source, event.offender, event.problem, event.stamp)
    elif isinstance(event, PromiseBroken):
        obstacles.leave_broken(event.source, event.joint, event.problem, event.stamp)
    elif isinstance(event, DroppedPoints):
        obstacles.count_points(event.source, event.stamp, event.points, event.dropped)
    elif isinstance(event, TetherStated):
        obstacles.tether(event.a, event.b, event.length, event.source)
    elif isinstance(event, TetherEnded):
        obstacles.untether(event.a, event.b)
    elif isinstance(event, FaultsTaken):
        obstacles.take_faults()


def _list_fields(event: msgspec.Struct) -> dict[str, Any]:
    return {name: getattr(event, name) for name in event.__struct_fields__}


def _show(value: object) -> str:
    return repr(value) if not isinstance(value, tuple) else str([str(one) for one in value])
