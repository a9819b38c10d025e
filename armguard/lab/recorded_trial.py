"""Makes a trial of settings from the part of a recording with the most changes of level.

Chosen by is not the whole, which may be hours, but the part with the most changes of level: where
settings differ, they differ there. It begins with what was told in the seconds before; what was not
told of for longer has grown so much by its bounds that it would be nothing but a STOP.
"""

from __future__ import annotations

import functools
import math
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from armguard.exceptions import ArmguardError
from armguard.messages.answers import VerdictMessage
from armguard.messages.events import StaticObstacle
from armguard.messages.incoming import IgnoreMessage, WatchMessage
from armguard.monitor.trial import TrialTick
from armguard.recording.events import BodiesChanged, Event, JointState, MalformedState
from armguard.recording.inputs import restore_state
from armguard.recording.reading import Recording
from armguard.recording.replay import UNREADABLE, apply_event
from armguard.robot.robot import Robot

SECONDS = 4.0
"""Of the part that settings are tried on, in [s] of ticks at their rate."""

BEFORE = 5.0
"""What was told so long before, in [s], stands in the table when the part begins."""

EARLY = 1e-6
"""By which part of a period a tick may come before its time."""


def read_trial(
    path: str | Path, robot: Robot, rate: float, *, seconds: float = SECONDS
) -> list[TrialTick]:
    """The part of a recording in which levels changed most often.

    Obstacles that stand still are those of the table that it is tried on, and tools those of the
    robot: what the recording says of these is passed over.

    Args:
        path: What `--record` or a `Recorder` wrote.
        robot: The arm of the trial, with the same joints.
        rate: Of ticks, in [Hz]; of a recording of more, those that come in time are taken.
        seconds: How long it is, at that rate.

    Raises:
        ArmguardError: The recording cannot be read, has no ticks, or is of an arm with other
            joints.
    """
    recording = Recording(path)
    joints = [str(joint["name"]) for joint in recording.robot["joints"]]
    if joints != list(robot.joints):
        raise ArmguardError(
            str(path),
            f"is of an arm with joints {', '.join(joints)}",
            expected=", ".join(robot.joints),
        )
    changes = _count_changes(recording, rate)
    if not changes:
        raise ArmguardError(
            str(path), "has no joint states", expected="a recording of an arm that was supervised"
        )
    count = min(max(1, round(seconds * rate)), len(changes))
    total = np.concatenate([[0], np.cumsum(changes)])
    begin = int(np.argmax(total[count:] - total[:-count]))
    return _collect(recording, rate, begin, begin + count)


def _take_in_time(recording: Recording, rate: float) -> Iterator[tuple[bool, int, Event]]:
    """All events, with when they came in [ns]; and of joint states, whether they make a tick."""
    due = -math.inf
    for nanoseconds, event, _ in recording.events():
        is_tick = False
        if isinstance(event, JointState | MalformedState):
            # Of times that go back, or are none, a monitor is told as it was.
            is_tick = not due - 2.0 / rate <= event.now < due
            if is_tick:
                due = event.now + (1.0 - EARLY) / rate
        yield is_tick, nanoseconds, event


def _count_changes(recording: Recording, rate: float) -> list[int]:
    """For each tick, whether the recorded level had changed since the tick before: 1 or 0."""
    changes: list[int] = []
    level, is_pending = "", False
    for is_tick, _, event in _take_in_time(recording, rate):
        if is_tick:
            changes.append(0)
            is_pending = True
        elif isinstance(event, VerdictMessage) and is_pending:
            is_pending = False
            changes[-1] = int(level not in ("", event.level))
            level = event.level
    return changes


def _collect(recording: Recording, rate: float, begin: int, end: int) -> list[TrialTick]:
    """The ticks from one place to another, each with what was told before it."""
    ticks: list[TrialTick] = []
    told: deque[tuple[int, Event]] = deque()
    number = 0
    for is_tick, nanoseconds, event in _take_in_time(recording, rate):
        if isinstance(event, JointState | MalformedState):
            if is_tick and number >= begin:
                events = [each for _, each in told]
                told.clear()
                tell = functools.partial(_tell, str(recording.path), events) if events else None
                ticks.append(_make_tick(recording, event, tell))
            number += is_tick
            if number == end:
                break
        # All pairs are tried, so that no choice rests on contact that was wanted then.
        elif not isinstance(
            event, VerdictMessage | StaticObstacle | BodiesChanged | IgnoreMessage | WatchMessage
        ):
            told.append((nanoseconds, event))
            while number < begin and nanoseconds - told[0][0] > 1e9 * BEFORE:
                told.popleft()
    return ticks


def _make_tick(recording: Recording, event: JointState | MalformedState, tell: Any) -> TrialTick:
    try:
        stamp, q, v, now = restore_state(event)
    except UNREADABLE as error:
        raise ArmguardError(
            str(recording.path), f"has a JointState that cannot be tried ({error})"
        ) from None
    return TrialTick(stamp, q, v, now, tell)


def _tell(path: str, events: Sequence[Event], monitor: Any) -> None:
    """Tell a monitor what was recorded."""
    for event in events:
        try:
            apply_event(monitor, event)
        except (ArmguardError, *UNREADABLE) as error:
            kind = type(event).__name__
            raise ArmguardError(path, f"has a {kind} that cannot be tried here ({error})") from None
