"""Steps a monitor made anew through a recording, and compares its verdicts to the bit.

A verdict rests on its inputs, on what the monitor was made with, and on the machine that computes
it. The first two are in the file. Where verdicts differ all the same, the third must, and the
report says in what.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from armguard.exceptions import ArmguardError
from armguard.monitor.monitor import Monitor
from armguard.obstacles.obstacles import Obstacles
from armguard.recording.events import (
    BodiesChanged,
    DroppedPoints,
    Event,
    FaultsTaken,
    Gap,
    JointState,
    MalformedCall,
    ObstacleUpdate,
    PairIgnored,
    PairWatched,
    Payload,
    PlanAnswered,
    PlanAsked,
    PromiseBroken,
    Removal,
    Reset,
    StaticObstacle,
    VerdictTold,
    encode,
    read_field,
    read_verdict,
    tell_answer,
    tell_verdict,
)
from armguard.recording.inputs import restore_plan, restore_state
from armguard.recording.provenance import describe_provenance, list_differences
from armguard.recording.reading import Recording
from armguard.recording.settings import change_settings, make_monitor, make_obstacles
from armguard.robot.portable import RestoredRobot, read_numbers
from armguard.verdict import PlanVerdict, Verdict

UNEXPLAINED = (
    "none that a recording knows of: version, sources, robot, cover, processor and compiler are "
    "the same"
)


class ReplayedTick(NamedTuple):
    """One tick of a recording, and of the replay."""

    nanoseconds: int
    """When it was recorded, since 1970."""
    now: float
    """[s] of the monitor's clock."""
    recorded: Verdict
    replayed: Verdict
    is_compared: bool
    """Whether the two should be the same: not after a gap, and not under other settings."""
    is_identical: bool
    """Whether they are, to the bit."""


class Difference(NamedTuple):
    """The first answer that differs from the recorded one."""

    sequence: int
    """Number of the tick."""
    now: float
    """[s] of the monitor's clock."""
    fields: tuple[str, ...]
    """What differs, as "field: recorded, replayed"."""
    causes: tuple[str, ...]
    """What this replay does not have in common with the recording."""

    def __str__(self) -> str:
        return (
            f"tick {self.sequence} at {self.now:.6f} s differs in {'; '.join(self.fields)}; cause: "
            f"{'; '.join(self.causes)}"
        )


class ReplayReport(NamedTuple):
    """What a replay found."""

    ticks: int
    """Verdicts in the recording."""
    compared: int
    """Verdicts that were compared with recorded ones."""
    difference: Difference | None
    """The first; None: all that were compared are identical."""
    lost: int
    """Events that are missing in the recording; verdicts after them are not compared."""
    is_cut_off: bool
    """Whether the recording has no end: what wrote it was killed."""
    differences: tuple[str, ...]
    """In what this machine differs from the recording's, whether or not verdicts do."""

    @property
    def is_identical(self) -> bool:
        """Whether all verdicts of the recording were compared, and are the same to the bit."""
        return self.difference is None and self.compared == self.ticks > 0 and not self.lost


class Replay:
    """A monitor made as a recording's was, and led through it.

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
        except (KeyError, TypeError, ValueError, AttributeError) as error:
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
        """Lead the monitor through the recording, tick by tick; once.

        Raises:
            ArmguardError: The recording is damaged, or has a message that cannot be read.
        """
        pending: tuple[float, Verdict] | None = None
        for nanoseconds, event, data in self._recording.events():
            if isinstance(event, JointState):
                stamp, q, v, now = self._read(restore_state, event)
                pending = now, self.monitor.step(stamp, q, v, now)
                self._now = now
            elif not isinstance(event, VerdictTold):
                self._apply(event, data)
            elif event.sequence > 0:
                self._ticks += 1
                if pending is None:
                    continue  # its joint state was lost
                (now, replayed), pending = pending, None
                recorded = self._read(read_verdict, event)
                is_compared = not self._lost and not self._changes
                is_identical = encode(tell_verdict(replayed)) == data
                if is_compared:
                    self._compared += 1
                    if not is_identical:
                        self._note_difference(recorded._asdict(), replayed._asdict())
                yield ReplayedTick(nanoseconds, now, recorded, replayed, is_compared, is_identical)

    def report(self) -> ReplayReport:
        """What was found so far."""
        return ReplayReport(
            self._ticks,
            self._compared,
            self._difference,
            self._lost,
            self._recording.is_cut_off,
            self._differences,
        )

    def _apply(self, event: Event, data: bytes) -> None:
        """Do to the monitor and its table what was done to the recorded ones."""
        try:
            self._take(event, data)
        except (ValueError, KeyError, TypeError, IndexError) as error:
            raise self._make_error(event, error) from None
        except ArmguardError as error:
            raise self._make_error(event, error) from None

    def _take(self, event: Event, data: bytes) -> None:
        monitor = self.monitor
        if isinstance(event, StaticObstacle):
            points = read_numbers(event.position).reshape(-1, 3)
            radius = float(event.radius)
            if isinstance(event.speed, float | str) and isinstance(event.accel, float | str):
                # It is as wide as it counts already.
                speed, accel = float(event.speed), float(event.accel)
                self.obstacles.add_entrance(event.id, points, radius, 0.0, speed, accel)
            else:
                self.obstacles.add_static(event.id, points, radius)
        elif isinstance(event, Payload):
            if "payload" not in self._changes:
                monitor.payload = float(event.payload)
        elif isinstance(event, BodiesChanged):
            links = [
                msgspec.json.decode(link.data) if link.data else {"name": link.name}
                for link in event.links
            ]
            self.robot.replace_bodies({"revision": event.revision, "links": links})
        elif isinstance(event, Gap):
            self._lost += event.events
        elif isinstance(event, PlanAsked):
            self._answer = None
            if monitor.settings.with_plans:
                self._answer = monitor.commit(restore_plan(event))
        elif isinstance(event, PlanAnswered):
            answer, self._answer = self._answer, None
            is_compared = answer is not None and not self._lost and not self._changes
            if answer is not None and is_compared and encode(tell_answer(answer)) != data:
                told = tell_answer(answer)
                self._note_difference(_list_fields(event), _list_fields(told))
        else:
            apply_event(monitor, event)

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
        except (ValueError, TypeError) as error:
            raise self._make_error(event, error) from None

    def _make_error(self, event: Event, error: Exception) -> ArmguardError:
        name = type(event).__name__
        return ArmguardError(
            str(self._recording.path), f"has a {name} that cannot be replayed ({error})"
        )


def replay(path: str | Path, changes: Mapping[str, str] | None = None) -> ReplayReport:
    """Replay a recording as fast as possible, and compare its verdicts to the bit.

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


def apply_event(monitor: Monitor, event: Event) -> None:
    """Tell a monitor and its table what a recorded event told, if it is of that kind."""
    obstacles = monitor.obstacles
    if isinstance(event, ObstacleUpdate):
        apply_update(obstacles, event)
    elif isinstance(event, Removal):
        obstacles.remove(
            event.ids,
            float(event.stamp) if isinstance(event.stamp, float | str) else None,
            event.source if isinstance(event.source, str) else None,
        )
    elif isinstance(event, MalformedCall):
        stamp = float(event.stamp)
        obstacles.leave_malformed(event.source, event.offender, event.problem, stamp)
    elif isinstance(event, PromiseBroken):
        stamp = float(event.stamp)
        obstacles.leave_broken(event.source, event.joint, event.problem, stamp)
    elif isinstance(event, DroppedPoints):
        stamp = float(event.stamp)
        obstacles.count_points(event.source, stamp, event.points, event.dropped)
    elif isinstance(event, FaultsTaken):
        obstacles.take_faults()
    elif isinstance(event, PairIgnored):
        monitor.ignore(
            event.link,
            event.ids,
            event.source if isinstance(event.source, str) else None,
            until=float(event.until) if isinstance(event.until, float | str) else None,
            zone=read_numbers(event.zone).reshape(-1, 3) if isinstance(event.zone, list) else None,
        )
    elif isinstance(event, PairWatched):
        monitor.watch(event.number)
    elif isinstance(event, Reset):
        monitor.reset()


def apply_update(obstacles: Obstacles, event: ObstacleUpdate) -> None:
    """Tell a table what a recorded message told."""
    count = len(event.ids)
    shape = (count, event.points, 3)

    def read(values: Any) -> Any:
        return read_field(values, count) if isinstance(values, list) else None

    # The voxels of a recorded cloud stand in an update.
    obstacles.takes_voxels = True
    obstacles.update(
        event.ids,
        float(event.stamp),
        read_numbers(event.position).reshape(shape),
        read_numbers(event.velocity).reshape(shape) if isinstance(event.velocity, list) else None,
        read(event.radius),
        read(event.accel),
        read(event.speed),
        read(event.position_error),
        read(event.velocity_error) if isinstance(event.velocity, list) else 0.0,
        source=event.source,
        frame=event.frame,
        snapshot=event.snapshot,
    )


def _list_fields(event: msgspec.Struct) -> dict[str, Any]:
    return {name: getattr(event, name) for name in event.__struct_fields__}


def _show(value: object) -> str:
    return repr(value) if not isinstance(value, tuple) else str([str(one) for one in value])
