"""`Recorder`: writes all that reaches a monitor, and all that it answers, from another process.

What happens in the loop is to write bytes into memory that both processes share. It never waits:
where the other process does not keep up, as with a slow disk, events are lost, counted, and a gap
is recorded in their place. The other process ends with this one, however that ends, and writes what
was told until then.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import subprocess
import sys
import time
import warnings
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET

from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
from armguard.monitor.monitor import Monitor
from armguard.obstacles.message import ToldSamples
from armguard.pairs.exemptions import Exemption
from armguard.recording.events import (
    FORMAT,
    BodiesChanged,
    DroppedPoints,
    FaultsTaken,
    Gap,
    JointState,
    LinkTold,
    Log,
    MalformedCall,
    PairWatched,
    Payload,
    PromiseBroken,
    Removal,
    Reset,
    StaticObstacle,
    Time,
    encode,
    tell_answer,
    tell_exemption,
)
from armguard.recording.inputs import tell_plan, tell_state
from armguard.recording.packing import (
    ATTACHED,
    FRAME,
    HEADED,
    NOTED,
    NUMBERS,
    Heading,
    ToldState,
    ToldUpdate,
    ToldVerdict,
    pack_body,
    pack_plain,
    pack_state,
    pack_update,
    pack_verdict,
)
from armguard.recording.provenance import describe_provenance
from armguard.recording.ring import Ring, create_memory
from armguard.recording.settings import describe_settings
from armguard.robot.portable import describe_bodies, describe_robot, write_number, write_numbers
from armguard.verdict import PlanVerdict, Verdict

CAPACITY = 32 * 1024 * 1024
"""Bytes that wait for the disk at most: a minute and more of a usual cell."""

START_TIMEOUT = 60.0
"""How long the process that writes may take to start, in [s]; the end waits for it."""

SILENT_TIMEOUT = 2.0
"""How long the process that writes may show no sign of life while it goes on, in [s]."""

STUCK_TIMEOUT = 10.0
"""How long the disk may hold up that process at the end, in [s], before it is ended."""

MOST_PENDING = 1000
"""What is left to be written when there is time; where more comes in one tick, it is written."""

MOST_IDS = 10_000
"""Ids that are remembered to have been told; then all are told anew."""


class Recorder:
    """Writes a file from which a replay gives the same verdicts to the bit.

    It is a context, which is left with a `RuntimeWarning` if the file is not complete.

    It begins when it is made: before the first step of the monitor, and before any obstacle is
    told but those that stand still for ever. From then on it is told by the monitor and its table
    themselves. Nothing that goes wrong with the file reaches the monitor.

    Args:
        path: The file, which must not exist yet; or a folder, for a file named by the time.
        monitor: Whose inputs and verdicts are written.
        capacity: Bytes that may wait for the disk; what comes beyond is lost, and a gap is written.

    Attributes:
        path: The file.
        lost: Events so far that were lost.
        pid: The process that writes the file.

    Raises:
        ArmguardError: The file cannot be written, the monitor or its table is in use already or
            cannot be made anew from a recording, or the packages for recordings are missing.
    """

    def __init__(self, path: str | Path, monitor: Monitor, *, capacity: int = CAPACITY) -> None:
        check_installed()
        _check_untouched(monitor)
        self._monitor, self._robot = monitor, monitor.robot
        self._shape = (len(monitor.robot.joints),)
        self._clock_offset = time.time_ns() - time.monotonic_ns()
        self._stepping = False
        self._defers = False
        self._pending: deque[ToldState | ToldVerdict | ToldUpdate | bytes] = deque()
        """What is still to be written, in order."""
        self._is_tick_left = False
        """Whether a whole tick is among it."""
        self._headings: dict[tuple[int, str, str], tuple[int, Heading]] = {}
        """What messages have in common and was told, with its number; by which list of ids it is,
        whatever it holds: the heading keeps that list, so no other one is taken for it."""
        self._heading_ids = 0
        self.lost = 0
        self._gap_events, self._gap_since = 0, 0
        self._beats, self._beat_time = 0, time.monotonic()
        start = self._describe_start()
        self.path, file = open_new(Path(path))
        memory = create_memory(capacity)
        try:
            self._process = subprocess.Popen(
                [
                    sys.executable,
                    "-m",
                    "armguard.recording",
                    *map(str, (memory, file, os.getpid())),
                ],
                stdin=subprocess.DEVNULL,
                pass_fds=(memory, file),
                start_new_session=True,  # a Ctrl-C is the loop's, whose end is to be in the file
            )
            self.pid = self._process.pid
            self._ring = Ring(memory)
        finally:
            os.close(file)
            os.close(memory)
        for number, data in start:
            self._send(number, data)
        if self.lost:
            self.close()
            raise ArmguardError(
                "capacity", f"is {capacity} bytes", expected="room for the robot's description"
            )
        self._known_links = monitor.robot.links
        self._revision = monitor.robot.revision
        for event in _list_statics(monitor):
            self._tell(event)
        if monitor.payload != monitor.settings.payload:
            self.note_payload(monitor.payload)
        for exemption in monitor.exemptions:
            self.note_exemption(exemption)
        monitor.journal = monitor.obstacles.journal = self

    def note(self, text: str) -> None:
        """Write a line for people, as of the present."""
        now = time.time_ns()
        timestamp = Time(now // 1_000_000_000, now % 1_000_000_000)
        self._tell(Log(timestamp=timestamp, level=3, message=text))

    def find_trouble(self) -> str:
        """What keeps the file from being written at present, in words; empty: nothing.

        For a loop that asks about once a second; it costs some microseconds.
        """
        if self._ring.is_released:
            return ""
        if self._process.poll() is not None:
            return "the process that writes it has ended"
        now, beats = time.monotonic(), self._ring.beats
        if beats != self._beats:
            self._beats, self._beat_time = beats, now
        silence = now - self._beat_time
        # Before its first sign of life it starts, which may take a while.
        if silence > (SILENT_TIMEOUT if beats else START_TIMEOUT):
            return f"what writes it has been held up for {silence:.0f} s"
        return ""

    def close(self) -> str:
        """Write what is left, and end; harmless if that was done.

        Returns:
            What went wrong with the file, in words; empty if nothing did.
        """
        process = self._process
        if self._monitor.journal is self:
            self._monitor.journal = self._monitor.obstacles.journal = None
        if self._ring.is_released:
            return ""
        self.write_pending()
        ring = self._ring
        beats, deadline = 0, time.monotonic() + START_TIMEOUT
        while process.poll() is None and time.monotonic() < deadline:
            if not self._gap_events or self._end_gap():
                ring.close_writing()
            if ring.beats != beats:
                beats, deadline = ring.beats, time.monotonic() + STUCK_TIMEOUT
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(0.01)
        if process.poll() is None:
            process.kill()
            process.wait()
        is_unread = ring.free < ring.capacity
        ring.release()
        if process.returncode != 0 or is_unread:
            return f"{self.path} is not complete: what wrote it was ended, or could not write it"
        if self.lost:
            return (
                f"{self.path} has gaps: {self.lost} events were lost, since the disk did not keep "
                "up or they could not be written as text"
            )
        return ""

    def __enter__(self) -> Recorder:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        problem = self.close()
        if problem:
            warnings.warn(problem, RuntimeWarning, stacklevel=2)

    # What a monitor tells; see `armguard.monitor.journal`.

    def note_state(self, stamp: object, q: Any, v: Any, now: object) -> None:
        """As `MonitorJournal` says."""
        self._stepping = True
        try:
            if self._is_tick_left:
                self.write_pending()
            if self._robot.revision != self._revision:
                self._tell_bodies()
            state = ToldState(self._now(), stamp, q, v, now)
            if self._defers:
                self._pending.append(state)
            else:
                self._put(self._pack(state))
        except Exception:
            # A recorder must not hurt the loop: what cannot be recorded is a gap.
            self._lose()

    def note_verdict(self, verdict: Verdict) -> None:
        """As `MonitorJournal` says; also of what is told while there is no joint state to judge."""
        self._stepping = False
        try:
            if self._is_tick_left:
                self.write_pending()
            told = ToldVerdict(self._now(), verdict)
            if self._defers:
                self._pending.append(told)
                self._is_tick_left = True
            else:
                self._put(self._pack(told))
        except Exception:
            self._lose()

    def defer(self) -> None:
        """Leave what is told to `write_pending`, which a loop calls when it has time to spare.

        So recording takes no time of its ticks. What a loop could not write in time is written in
        its next tick. If it is killed in the middle of a tick, that tick is not in the file. Arrays
        of joint states must stay as they are until they are written.
        """
        self._defers = True

    def write_pending(self) -> None:
        """Write what was left; the loop has time to spare."""
        self._is_tick_left = False
        while self._pending:
            told = self._pending.popleft()
            try:
                self._put(told if isinstance(told, bytes) else self._pack(told))
            except Exception:
                self._lose()
            except BaseException:
                # Ctrl-C: whether it is in the file is not known, and twice would be worse than not.
                self._lose()
                raise

    def note_plan(self, plan: object) -> None:
        """As `MonitorJournal` says."""
        try:
            self._tell(tell_plan(plan))
        except Exception:
            self._lose()

    def note_plan_verdict(self, verdict: PlanVerdict) -> None:
        """As `MonitorJournal` says."""
        self._tell(tell_answer(verdict))

    def note_payload(self, payload: float) -> None:
        """As `MonitorJournal` says."""
        self._tell(Payload(payload=write_number(payload)))

    def note_exemption(self, exemption: Exemption) -> None:
        """As `MonitorJournal` says."""
        self._tell(tell_exemption(exemption))

    def note_exemption_end(self, number: int) -> None:
        """As `MonitorJournal` says."""
        self._tell(PairWatched(number=number))

    def note_reset(self) -> None:
        """As `MonitorJournal` says."""
        self._tell(Reset())

    # What a table of obstacles tells; see `armguard.obstacles.journal`.

    def note_update(
        self,
        ids: list[str],
        stamp: float,
        samples: ToldSamples,
        *,
        has_velocity: bool,
        has_accel: bool,
        has_speed: bool,
        source: str,
        frame: str,
        snapshot: bool,
    ) -> None:
        """As `ObstacleJournal` says."""
        try:
            body = pack_body(
                stamp,
                samples,
                has_velocity=has_velocity,
                has_accel=has_accel,
                has_speed=has_speed,
                snapshot=snapshot,
            )
            told = ToldUpdate(self._now(), Heading(ids, source, frame), body)
            if self._defers:
                self._keep(told)
            else:
                self._put(self._pack(told))
        except Exception:
            self._lose()

    def note_static(self, id: str, points: FloatArray, radius: float) -> None:
        """As `ObstacleJournal` says."""
        self._tell(_tell_static(id, points, radius))

    def note_entrance(
        self, id: str, points: FloatArray, radius: float, speed: float, accel: float
    ) -> None:
        """As `ObstacleJournal` says."""
        self._tell(_tell_static(id, points, radius, speed, accel))

    def note_removal(self, ids: Sequence[str], stamp: float | None, source: str | None) -> None:
        """As `ObstacleJournal` says."""
        self._tell(
            Removal(
                ids=list(ids),
                stamp=UNSET if stamp is None else write_number(stamp),
                source=UNSET if source is None else source,
            )
        )

    def note_malformed(self, source: str, offender: str, problem: str, stamp: float) -> None:
        """As `ObstacleJournal` says."""
        self._tell(
            MalformedCall(
                source=source, offender=offender, problem=problem, stamp=write_number(stamp)
            )
        )

    def note_broken(self, source: str, joint: str, problem: str, stamp: float) -> None:
        """As `ObstacleJournal` says."""
        told = write_number(stamp)
        self._tell(PromiseBroken(source=source, joint=joint, problem=problem, stamp=told))

    def note_points(self, source: str, stamp: float, points: int, dropped: int) -> None:
        """As `ObstacleJournal` says."""
        told = write_number(stamp)
        self._tell(DroppedPoints(source=source, stamp=told, points=points, dropped=dropped))

    def note_faults_taken(self) -> None:
        """As `ObstacleJournal` says; the monitor itself takes them in its steps."""
        if not self._stepping:
            self._tell(FaultsTaken())

    def _describe_start(self) -> list[tuple[int, bytes]]:
        """What stands once at the start of the file."""
        monitor = self._monitor
        provenance = {
            "format": str(FORMAT),
            **describe_provenance(monitor.robot),
            "monotonic_offset_ns": str(self._clock_offset),
        }
        robot = encode_plain(describe_robot(monitor.robot))
        settings = encode_plain(describe_settings(monitor))
        return [
            (NOTED, pack_plain(("armguard", provenance))),
            (ATTACHED, pack_plain(("settings.json", "application/json", settings))),
            (ATTACHED, pack_plain(("robot.json", "application/json", robot))),
        ]

    def _tell_bodies(self) -> None:
        data = describe_bodies(self._robot, self._known_links)
        links = [
            LinkTold(link["name"], "" if len(link) == 1 else encode_plain(link).decode())
            for link in data["links"]
        ]
        self._tell(BodiesChanged(revision=data["revision"], links=links))
        self._known_links = tuple(link["name"] for link in data["links"])
        self._revision = data["revision"]

    def _tell(self, event: Any) -> None:
        try:
            self._send(NUMBERS[type(event)], encode(event))
        except Exception:
            self._lose()

    def _send(self, number: int, data: bytes) -> None:
        self._write(FRAME.pack(number, self._now()) + data)

    def _write(self, record: bytes) -> None:
        """Write a record, now or when there is time."""
        if self._defers:
            self._keep(record)
        else:
            self._put(record)

    def _keep(self, told: ToldUpdate | bytes) -> None:
        self._pending.append(told)
        if len(self._pending) > MOST_PENDING:
            self.write_pending()

    def _pack(self, told: ToldState | ToldVerdict | ToldUpdate) -> bytes:
        """The record of what was told.

        Raises:
            Exception: It cannot be recorded.
        """
        if isinstance(told, ToldVerdict):
            return pack_verdict(told)
        if isinstance(told, ToldUpdate):
            return pack_update(told, self._number_heading(told.heading))
        record = pack_state(told, self._shape)
        if record is None:
            event = tell_state(*told[1:], *self._shape)
            record = FRAME.pack(NUMBERS[JointState], told.came) + encode(event)
        return record

    def _number_heading(self, heading: Heading) -> int:
        """The number of what a message has in common with others, which is told once.

        Raises:
            BufferError: There is no room to tell it, so what has it is lost.
        """
        ids, source, frame = heading
        key = id(ids) if ids else 0, source, frame
        if (known := self._headings.get(key)) is not None:
            return known[0]
        if self._heading_ids + len(ids) > MOST_IDS:
            self._headings.clear()
            self._heading_ids = 0
        number = len(self._headings)
        record = FRAME.pack(HEADED, self._now()) + pack_plain((number, *heading))
        if (self._gap_events and not self._end_gap()) or not self._ring.write(record):
            raise BufferError("no room")
        self._headings[key] = number, heading
        self._heading_ids += len(ids) + 1
        return number

    def _put(self, record: bytes) -> None:
        if (self._gap_events and not self._end_gap()) or not self._ring.write(record):
            self._lose()

    def _now(self) -> int:
        """[ns] since 1970, by a clock that never goes back."""
        return time.monotonic_ns() + self._clock_offset

    def _lose(self) -> None:
        self.lost += 1
        if not self._gap_events:
            self._gap_since = time.monotonic_ns()
        self._gap_events += 1

    def _end_gap(self) -> bool:
        """Tell of a gap, once there is room for more than that."""
        ring = self._ring
        if ring.free < ring.capacity // 4:
            return False
        seconds = 1e-9 * (time.monotonic_ns() - self._gap_since)
        event = encode(Gap(events=self._gap_events, seconds=seconds))
        if not ring.write(FRAME.pack(NUMBERS[Gap], self._now()) + event):
            return False
        self._gap_events = 0
        return True


def check_installed() -> None:
    """Refuse to go on without the packages that recordings need.

    Raises:
        ArmguardError: They are missing.
    """
    for package in ("mcap", "zstandard"):
        if importlib.util.find_spec(package) is None:
            raise ArmguardError(
                "recordings",
                f"need the package {package}, which is not installed",
                remedy="pip install 'armguard[record]'",
            )


def check_new(path: Path) -> None:
    """Refuse a file that is there already, or that cannot be in its folder, and go on without one.

    Raises:
        ArmguardError: It is so, or the packages for recordings are missing.
    """
    check_installed()
    try:
        is_there = path.is_file() and path.stat().st_size > 0
        if not path.parent.is_dir():
            raise ArmguardError(str(path), f"cannot be written (no folder {path.parent})")
    except OSError as error:
        raise ArmguardError(str(path), f"cannot be written ({error.strerror})") from None
    if is_there:
        raise ArmguardError(
            str(path),
            "is there already, and no recording is written over",
            expected="a new file",
            remedy="a folder in its place gets a file named by the time",
        )


def open_new(path: Path) -> tuple[Path, int]:
    """Open a file that is not there yet, for writing; a recording is never written over.

    Args:
        path: The file; or a folder, for a file in it that is named by the time.

    Returns:
        The file's path and descriptor.

    Raises:
        ArmguardError: It is there already, or cannot be written.
    """
    if path.is_dir():
        # A service that is started anew may be so within a second.
        path = path / f"{time.strftime('armguard-%Y%m%dT%H%M%S')}-{os.getpid()}.mcap"
    check_new(path)
    try:
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC
        return path, os.open(path, flags, 0o644)
    except OSError as error:
        raise ArmguardError(str(path), f"cannot be written ({error.strerror})") from None


def encode_plain(data: Any) -> bytes:
    """Plain data as JSON."""
    return msgspec.json.encode(data)


def _check_untouched(monitor: Monitor) -> None:
    if not isinstance(monitor, Monitor):
        raise ArmguardError("monitor", f"is {monitor!r}", expected="an armguard.Monitor")
    obstacles = monitor.obstacles
    if monitor.journal is not None or obstacles.journal is not None:
        raise ArmguardError("monitor", "is recorded already", expected="one recorder at a time")
    if monitor.ticks:
        raise ArmguardError(
            "monitor",
            f"has judged {monitor.ticks} joint states already",
            expected="none: a replay needs them all",
            remedy="make the recorder before the first step",
        )
    if monitor.exemption_count != len(monitor.exemptions):
        raise ArmguardError(
            "monitor",
            "was told to watch pairs again already",
            expected="none of its exemptions ended: a replay begins with all of them",
            remedy="make the recorder before the first `watch`",
        )
    if not obstacles.is_untouched:
        raise ArmguardError(
            "obstacles",
            "were told already",
            expected="none but those that stand still, none of them removed: a replay needs all",
            remedy="make the recorder before the first update",
        )


def _list_statics(monitor: Monitor) -> list[StaticObstacle]:
    table, ids = monitor.obstacles.table, monitor.obstacles.ids
    return [
        _tell_static(
            ids[row],
            table.points[row, : table.point_count[row]],
            table.radius[row],
            *((table.speed[row], table.accel[row]) if monitor.obstacles.is_entrance(row) else ()),
        )
        for row in np.flatnonzero(table.alive & table.static).tolist()
    ]


def _tell_static(
    id: str,
    points: FloatArray,
    radius: float,
    speed: float | None = None,
    accel: float | None = None,
) -> StaticObstacle:
    return StaticObstacle(
        id=id,
        position=write_numbers(np.ravel(points)),
        radius=write_number(float(radius)),
        speed=UNSET if speed is None else write_number(float(speed)),
        accel=UNSET if accel is None else write_number(float(accel)),
    )
