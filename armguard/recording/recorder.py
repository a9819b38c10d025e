"""`Recorder`: writes all that reaches a monitor, and all that it answers, from another process.

The loop only writes bytes into memory that both processes share. It never waits: if the other
process is too slow, as with a slow disk, events are lost and counted, and a gap is recorded in
their place. The other process ends when this one ends, for any reason, and first writes all events
so far.
"""

from __future__ import annotations

import contextlib
import importlib.util
import math
import os
import subprocess
import sys
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

import msgspec
import numpy as np

from armguard.exceptions import ArmguardError
from armguard.messages.answers import to_plan_message, to_verdict_message
from armguard.messages.batch import ObstacleBatch, pack_batch
from armguard.messages.events import FaultsTaken, Payload, StaticObstacle, TetherStated
from armguard.monitor.configuration import digest_configuration
from armguard.monitor.monitor import Monitor
from armguard.monitor.portable import describe_settings
from armguard.monitor.provenance import describe_provenance
from armguard.recording.events import (
    FORMAT,
    NUMBERS,
    BodiesChanged,
    Event,
    Gap,
    Link,
    Log,
    Time,
)
from armguard.recording.inputs import make_plan, make_state
from armguard.recording.packing import ATTACHED, NOTED, WriterOptions, pack_record
from armguard.recording.parts import NO_ROTATION, Rotation, name_by_time, open_file
from armguard.recording.ring import Ring, create_memory
from armguard.recording.signing import FileSigner
from armguard.robot.portable import describe_bodies, describe_robot
from armguard.verdict import Level, PlanVerdict, Verdict

CAPACITY = 32 * 1024 * 1024
"""Bytes that wait for the disk at most: a minute and more of a usual cell."""

PROOF_INTERVAL = 0.1
"""Time between two verdicts that are proved, in [s]."""

START_TIMEOUT = 60.0
"""How long the writer process may take to start, in [s]; the end waits for it."""

SILENT_TIMEOUT = 2.0
"""How long the running writer process may show no sign of life, in [s]."""

STUCK_TIMEOUT = 10.0
"""How long the disk may delay that process at the end, in [s], before armguard ends it."""

PROOF_TIME = 1.5e-3
"""Time that a proof is assumed to take until one took longer, in [s]; 99 of 100 take less."""

LONGEST_PATIENCE = 60.0
"""Time in [s] after which the assumed time of proofs is halved, once proofs took longer."""

MOST_PENDING = 1000
"""Greatest number of deferred events; further events of a tick are written at once."""


_Entry = tuple[int, Callable[..., Event], tuple[Any, ...]]
"""When a message came, in [ns] since 1970, what makes it, and of what."""


class Recorder:
    """Writes a file from which a replay gives the same verdicts to the bit.

    It is a context, which is left with a `RuntimeWarning` if the file is not complete.

    It begins when it is made. This must be before the first step of the monitor and before any
    obstacle is reported, except statics. From then on the monitor and its table report to it. No
    problem of the file reaches the monitor.

    Args:
        path: The file, which must not exist yet; or a folder, for a file named by the time.
        monitor: The monitor whose inputs and verdicts are written.
        capacity: Bytes that may wait for the disk; further events are lost, and a gap is written.
        proof_interval: Least time between two proofs of verdicts that are not CLEAR, in [s]; inf:
            no proofs.
        key: Secret file of the key that signs the file, as `armguard keys new --recordings` writes
            it; None: it is not signed.
        rotation: When the recording goes on in another file, and how long files are kept.
        configuration: Digest of the monitor's configuration; None: that of the monitor itself.

    Attributes:
        path: The file; the first one, where the recording goes on in others.
        lost: Number of events lost so far.
        pid: Id of the writer process.

    Raises:
        ArmguardError: The file cannot be written, the monitor or its table is in use already or
            cannot be made anew from a recording, or the packages for recordings are missing.
    """

    def __init__(
        self,
        path: str | Path,
        monitor: Monitor,
        *,
        capacity: int = CAPACITY,
        proof_interval: float = PROOF_INTERVAL,
        key: str | Path | None = None,
        rotation: Rotation = NO_ROTATION,
        configuration: str | None = None,
    ) -> None:
        check_installed()
        _check_untouched(monitor)
        rotation.check()
        if not proof_interval >= 0.0:
            raise ArmguardError(
                "proof_interval", f"is {proof_interval}", expected="seconds of at least 0, or inf"
            )
        if key is not None:
            FileSigner(key)  # a mistake is told here, and not by the process that writes
        self._monitor, self._robot = monitor, monitor.robot
        self._joints = list(monitor.robot.joints)
        self._plans = 0
        self._clock_offset = time.time_ns() - time.monotonic_ns()
        self._stepping = False
        self._defers = False
        self._pending: deque[_Entry] = deque()
        """Deferred events, in order."""
        self._is_tick_left = False
        """Whether a whole tick is among it."""
        self._proof_interval, self._tried_at = proof_interval, -math.inf
        self._unproved: Verdict | None = None
        self._proof_time, self._patience = PROOF_TIME, 1.0
        self._halve_at = time.monotonic() + self._patience
        self.lost = 0
        self._gap_events, self._gap_since = 0, 0
        self._beats, self._beat_time = 0, time.monotonic()
        if proof_interval < math.inf:
            monitor.prepare_proofs()
        start = self._describe_start(configuration or digest_configuration(monitor))
        self.path, file = open_new(Path(path))
        options = WriterOptions(
            str(self.path.absolute()), "" if key is None else str(Path(key).absolute()), rotation
        )
        memory = create_memory(capacity)
        try:
            self._process = subprocess.Popen(
                [
                    sys.executable,
                    "-P",
                    "-m",
                    "armguard.recording",
                    *map(str, (memory, file, os.getpid())),
                    msgspec.json.encode(options).decode(),
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
        for kind, content in start:
            self._write(pack_record(kind, self._now(), content))
        if self.lost:
            self.close()
            raise ArmguardError(
                "capacity", f"is {capacity} bytes", expected="room for the robot's description"
            )
        self._known_links = monitor.robot.links
        self._revision = monitor.robot.revision
        for place in _list_statics(monitor):
            self.note_message(place)
        for tether in monitor.obstacles.tethers:
            self.note_message(TetherStated(**tether._asdict()))
        if monitor.payload != monitor.settings.payload:
            self.note_message(Payload(payload=monitor.payload))
        for exemption in monitor.exemptions:
            self.note_message(exemption.to_message())
        monitor.journal = monitor.obstacles.journal = self

    def note(self, text: str) -> None:
        """Write a line for people, with the present time."""
        timestamp = Time(*divmod(time.time_ns(), 1_000_000_000))
        self.note_message(Log(timestamp=timestamp, level=3, message=text))

    def find_trouble(self) -> str:
        """Problem that prevents writing at present, in words; empty: none.

        For a loop that asks about once a second; it costs some microseconds.
        """
        if self._ring.is_released:
            return ""
        if self._process.poll() is not None:
            return "its writer process has ended"
        now, beats = time.monotonic(), self._ring.beats
        if beats != self._beats:
            self._beats, self._beat_time = beats, now
        silence = now - self._beat_time
        # Before its first sign of life it starts, which may take a while.
        if silence > (SILENT_TIMEOUT if beats else START_TIMEOUT):
            return f"its writer process has been blocked for {silence:.0f} s"
        return ""

    def close(self) -> str:
        """Write the deferred events, and end; calling it again is harmless.

        Returns:
            Problem of the file, in words; empty if there was none.
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
            return f"{self.path} is not complete: its writer ended or could not write"
        if self.lost:
            return (
                f"{self.path} has gaps: {self.lost} events were lost, because the disk was too "
                f"slow or they could not be encoded"
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

    # What a monitor and its table give; see `armguard.messages.journal`.

    def note_state(self, stamp: object, q: Any, v: Any, now: object) -> None:
        """As `Journal` says."""
        self._stepping = True
        self._unproved = None
        if self._is_tick_left:
            self.write_pending()
        if self._robot.revision != self._revision:
            self._note_at_once(self._describe_bodies)
        self._note(make_state, self._joints, stamp, q, v, now)

    def note_verdict(self, verdict: Verdict) -> None:
        """As in `Journal`; also for inputs without a joint state to judge."""
        self._stepping = False
        if self._is_tick_left:
            self.write_pending()
        self._is_tick_left = self._defers
        self._note(to_verdict_message, verdict)
        # In the monitor's time, which may begin anew.
        is_due = not 0.0 <= verdict.valid_until - self._tried_at < self._proof_interval
        if verdict.level is not Level.CLEAR and verdict.sequence > 0 and is_due:
            self._unproved = verdict
            if not self._defers:
                self.prove_pending()

    def defer(self) -> None:
        """Defer writing to `write_pending`, which a loop calls when it has time to spare.

        So recording takes no time of its ticks. Events that a loop could not write in time are
        written in its next tick. If it is killed during a tick, that tick is not in the file.
        Arrays of joint states must not change until they are written.
        """
        self._defers = True

    def prove_pending(self, idle: float = math.inf) -> None:
        """Prove the last verdict, if a proof is due, and write the proof.

        A loop that defers calls it in its idle time; a verdict that is not proved before the next
        step is left out. No proof is made if one took longer than `idle` in processor time lately.
        That time is halved where it prevents a proof, at most once a minute after proofs took
        longer repeatedly. So it can happen as rarely that a proof takes longer than `idle`.

        Args:
            idle: Time to spare, in [s].
        """
        verdict = self._unproved
        if verdict is None or self._proof_interval == math.inf:
            return
        if not idle > self._proof_time:
            now = time.monotonic()
            if now >= self._halve_at:
                self._proof_time *= 0.5
                self._halve_at = now + self._patience
            return
        self._unproved = None
        begin = time.thread_time()
        self._prove(verdict)
        taken = time.thread_time() - begin
        if taken > self._proof_time:
            self._proof_time = taken
            self._patience = min(2.0 * self._patience, LONGEST_PATIENCE)
        self._halve_at = time.monotonic() + self._patience

    def _prove(self, verdict: Verdict) -> None:
        """Prove a verdict, and write the proof."""
        self._tried_at = verdict.valid_until
        try:
            proof = self._monitor.prove(verdict)
        except Exception as error:
            # It hurts neither the loop nor what a replay needs.
            self.note(f"tick {verdict.sequence} could not be proved: {error!r}")
            return
        if proof is not None:
            self._note(lambda: proof)
            self.write_pending()

    def write_pending(self) -> None:
        """Write the deferred events; the loop has time to spare."""
        self._is_tick_left = False
        while self._pending:
            self._put(self._pending.popleft())

    def note_plan(self, plan: object) -> None:
        """As `Journal` says."""
        self._plans += 1
        self._note_at_once(make_plan, self._joints, self._plans, plan)

    def note_plan_verdict(self, verdict: PlanVerdict) -> None:
        """As `Journal` says."""
        self._note(to_plan_message, self._plans, verdict)

    def note_update(self, batch: ObstacleBatch) -> None:
        """As `Journal` says."""
        self._note_at_once(pack_batch, batch)

    def note_message(self, message: Event) -> None:
        """As in `Journal`; the monitor itself reports faults in its steps."""
        if not (self._stepping and isinstance(message, FaultsTaken)):
            self._note(lambda: message)

    def _describe_start(self, configuration: str) -> list[tuple[int, tuple[Any, ...]]]:
        """Write the records that stand once at the start of the file."""
        monitor = self._monitor
        provenance = {
            "format": str(FORMAT),
            **describe_provenance(monitor.robot),
            "configuration": configuration,
            "monotonic_offset_ns": str(self._clock_offset),
        }
        robot = msgspec.json.encode(describe_robot(monitor.robot))
        settings = msgspec.json.encode(describe_settings(monitor))
        return [
            (NOTED, ("armguard", provenance)),
            (ATTACHED, ("settings.json", "application/json", settings)),
            (ATTACHED, ("robot.json", "application/json", robot)),
        ]

    def _describe_bodies(self) -> BodiesChanged:
        data = describe_bodies(self._robot, self._known_links)
        links = [
            Link(link["name"], "" if len(link) == 1 else msgspec.json.encode(link).decode())
            for link in data["links"]
        ]
        self._known_links = tuple(link["name"] for link in data["links"])
        self._revision = data["revision"]
        return BodiesChanged(revision=data["revision"], links=links)

    def _note_at_once(self, make: Callable[..., Event], *arguments: Any) -> None:
        """Write a message of arguments that may change later."""
        try:
            message = make(*arguments)
        except Exception:
            # A recorder must not hurt the loop: what cannot be recorded is a gap.
            self._lose()
        else:
            self._note(lambda: message)

    def _note(self, make: Callable[..., Event], *arguments: Any) -> None:
        """Write a message that is made of some arguments, now or later."""
        entry = self._now(), make, arguments
        if not self._defers:
            self._put(entry)
            return
        self._pending.append(entry)
        if len(self._pending) > MOST_PENDING:
            self.write_pending()

    def _put(self, entry: _Entry) -> None:
        came, make, arguments = entry
        try:
            message = make(*arguments)
            self._write(pack_record(NUMBERS[type(message)], came, message))
        except Exception:
            self._lose()
        except BaseException:
            # Ctrl-C: whether it is in the file is not known, and twice would be worse than not.
            self._lose()
            raise

    def _write(self, record: bytes) -> None:
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
        """Record a gap, once there is room for more than that."""
        ring = self._ring
        if ring.free < ring.capacity // 4:
            return False
        seconds = 1e-9 * (time.monotonic_ns() - self._gap_since)
        gap = Gap(events=self._gap_events, seconds=seconds)
        if not ring.write(pack_record(NUMBERS[Gap], self._now(), gap)):
            return False
        self._gap_events = 0
        return True


def check_installed() -> None:
    """Refuse if packages that recordings need are missing.

    Raises:
        ArmguardError: A package is missing.
    """
    for package in ("mcap", "zstandard"):
        if importlib.util.find_spec(package) is None:
            raise ArmguardError(
                "recordings",
                f"need the package {package}, which is not installed",
                remedy="pip install 'armguard[record]'",
            )


def check_new(path: Path) -> None:
    """Refuse a file that exists already or cannot be written in its folder; writes nothing.

    Raises:
        ArmguardError: The file is refused, or the packages for recordings are missing.
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
            "is there already, and no recording is overwritten",
            expected="a new file",
            remedy="if you name a folder, the file in it is named by the time",
        )


def open_new(path: Path) -> tuple[Path, int]:
    """Open a new file for writing; a recording is never overwritten.

    Args:
        path: The file; or a folder, for a file in it that is named by the time.

    Returns:
        The file's path and descriptor.

    Raises:
        ArmguardError: It exists already, or cannot be written.
    """
    if path.is_dir():
        path = path / name_by_time()
    check_new(path)
    try:
        return path, open_file(path)
    except OSError as error:
        raise ArmguardError(str(path), f"cannot be written ({error.strerror})") from None


def _check_untouched(monitor: Monitor) -> None:
    if not isinstance(monitor, Monitor):
        raise ArmguardError("monitor", f"is {monitor!r}", expected="an armguard.Monitor")
    obstacles = monitor.obstacles
    if monitor.journal is not None or obstacles.journal is not None:
        raise ArmguardError("monitor", "is recorded already", expected="one recorder at a time")
    if monitor.ticks:
        raise ArmguardError(
            "monitor",
            f"has already judged {monitor.ticks} joint states",
            expected="none, since a replay needs all of them",
            remedy="make the recorder before the first step",
        )
    if monitor.exemption_count != len(monitor.exemptions):
        raise ArmguardError(
            "monitor",
            "has already ended exemptions (`watch`)",
            expected="no ended exemption, since a replay begins with all of them",
            remedy="make the recorder before the first `watch`",
        )
    if not obstacles.is_untouched:
        raise ArmguardError(
            "obstacles",
            "were already reported",
            expected="only statics, and none removed, since a replay needs all obstacles",
            remedy="make the recorder before the first update",
        )


def _list_statics(monitor: Monitor) -> Iterator[StaticObstacle]:
    table, ids = monitor.obstacles.table, monitor.obstacles.ids
    for row in np.flatnonzero(table.alive & table.static).tolist():
        place = StaticObstacle(
            id=ids[row],
            position=table.points[row, : table.point_count[row]].tobytes(),
            radius=float(table.radius[row]),
        )
        if monitor.obstacles.is_entrance(row):
            place.speed, place.accel = float(table.speed[row]), float(table.accel[row])
        yield place
