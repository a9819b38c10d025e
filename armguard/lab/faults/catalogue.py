"""The faults of the campaign: the process or stream, the disturbance, and the required sign."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from typing import Any, Literal, NamedTuple

from armguard.exceptions import ArmguardError
from armguard.lab.faults.disturbance import Kind

Part = Literal["camera", "driver", "monitor", "recorder", "view", "browser"]

Act = Literal["disturb", "kill", "stop", "slow", "full", "hang"]

SILENCE = "silence"
"""The sign that the arm found no valid verdict and braked by the deadline."""

DEFAULT_DURATION = 1.0
"""In [s]: from the first steps of the people's approach until they are near."""

VISIT = 4.0
"""In [s]: a whole visit, for what might come to be believed after a while."""


class Fault(NamedTuple):
    """One fault, and how it must show."""

    name: str
    part: Part
    """Whose stream or process it strikes."""
    act: Act
    """`disturb` its stream; `kill` it and start it anew at the end; `stop` it (SIGSTOP) until the
    end; of a recorder, a disk that is `slow` or `full`; a browser that takes a page's connection
    and `hang`s."""
    signs: tuple[str, ...] = ()
    """Any of them tells of it: the name of a `ReasonKind` among the reasons of a verdict,
    `SILENCE`, or words in a line on the monitor's standard error. Empty: bounds cover the fault, or
    it is none of the monitor's, and nothing has to be told."""
    duration: float = DEFAULT_DURATION
    """In [s]."""
    kind: Kind = "drop"
    """Of a disturbance; so are the next two."""
    field: str = ""
    value: str = "0"


NOT_FINITE = ("OBSTACLE_REFUSED", "OBSTACLE_NOT_BELIEVED", "STAMP_AHEAD", "CALL_REFUSED")
REFUSED = ("OBSTACLE_REFUSED", "OBSTACLE_NOT_BELIEVED", "SOURCE_NOT_BELIEVED", "BOUND_BROKEN")
JOINTS = ("JOINT_STATE_MALFORMED", "JOINT_STATE_JUMPED", "JOINT_STATE_BEYOND_LIMITS")
ORDER = ("lost:", "sequence went back:", "two publishers:", "stamp went back:", "TIME_BACKWARDS")
LATE_STATES: tuple[str, ...] = ("JOINT_STATE_GAP", "TIME_BACKWARDS")
OVERLOAD = (SILENCE, "SOURCE_SILENT", "OVERDUE", "OBSTACLE_REFUSED", "lost:", "malformed:")
RECORDING = ("recording is not written", "recording cannot be written")


def list_faults() -> list[Fault]:
    """All faults, those that end processes last."""
    return [*_disturbed_streams(), *_struck_processes()]


def _disturbed_streams() -> Iterator[Fault]:
    def camera(name: str, kind: Kind, signs: tuple[str, ...], **more: Any) -> Fault:
        return Fault(f"camera-{name}", "camera", "disturb", signs, kind=kind, **more)

    def driver(name: str, kind: Kind, signs: tuple[str, ...], **more: Any) -> Fault:
        return Fault(f"driver-{name}", "driver", "disturb", signs, kind=kind, **more)

    for value in ("nan", "inf"):
        for field in ("stamp", "position", "velocity", "radius"):
            yield camera(f"{value}-{field}", "set", NOT_FINITE, field=field, value=value)
        for field in ("position_error", "velocity_error"):
            yield camera(f"{value}-{field}", "set", NOT_FINITE, field=field, value=value)
        for field in ("accel", "speed"):
            # That there is no bound may be said, and is reckoned with.
            refusal = NOT_FINITE if value == "nan" else ()
            yield camera(f"{value}-{field}", "set", refusal, field=field, value=value)
        for field in ("stamp", "q", "v"):
            latches = (*JOINTS, "TIME_INVALID")
            yield driver(f"{value}-{field}", "set", latches, field=field, value=value)
    for duration, name in ((0.01, "10ms"), (0.1, "100ms"), (1.0, "1s"), (10.0, "10s")):
        # What is shorter than the timeouts, bounds cover; that it was lost is told.
        is_long = duration >= 1.0
        silence, gap = (("SOURCE_SILENT",), LATE_STATES) if is_long else (("lost:",), ("lost:",))
        yield camera(f"dropout-{name}", "drop", silence, duration=duration)
        yield driver(f"dropout-{name}", "drop", gap, duration=duration)
    yield camera("late", "late", (), value="0.1")
    yield driver("late", "late", (), value="0.02")
    yield camera("jitter", "delay", ("SOURCE_SILENT", *ORDER), value="0.6")
    yield driver("jitter", "delay", (*LATE_STATES, *ORDER), value="0.1")
    yield camera("reordered", "swap", ORDER, value="0.015")
    yield driver("reordered", "swap", ORDER, value="0.005")
    yield camera("repeated", "repeat", ORDER)
    yield driver("repeated", "repeat", ORDER)
    yield camera("clock-ahead", "clock", ("STAMP_AHEAD",), value="1")
    yield camera("clock-behind", "clock", ("SOURCE_SILENT",), value="-1")
    yield driver("clock-ahead", "clock", LATE_STATES, value="1")
    yield driver("clock-behind", "clock", LATE_STATES, value="-1")
    yield camera("clock-fast", "drift", ("STAMP_AHEAD",), value="0.2", duration=VISIT)
    yield camera("clock-slow", "drift", ("SOURCE_SILENT",), value="-0.2", duration=VISIT)
    yield driver("clock-fast", "drift", (*LATE_STATES, *JOINTS), value="0.2", duration=VISIT)
    yield driver("clock-slow", "drift", (*LATE_STATES, *JOINTS), value="-0.2", duration=VISIT)
    yield camera("teleports", "teleport", REFUSED, value="1", duration=VISIT)
    yield driver("teleports", "teleport", JOINTS, value="0.3")
    yield camera("identities-swapped", "exchange", REFUSED, duration=VISIT)
    yield driver("joints-swapped", "exchange", JOINTS)
    yield camera("drifting-static", "static", ("ID_SHARED",), duration=VISIT)
    yield camera("unknown-frame", "frame", ("CALL_REFUSED",), field="nowhere")
    yield camera("wrong-frame", "frame", REFUSED, field="shelf", duration=VISIT)
    yield camera("wrong-length", "shorten", ("CALL_REFUSED",))
    yield driver("wrong-length", "shorten", ("malformed:", *LATE_STATES))
    yield camera("crowd", "crowd", OVERLOAD, value="100000")
    yield camera("crowd-at-once", "crowd", OVERLOAD, value="100000", field="100000")
    yield camera("flood", "flood", OVERLOAD, value="100000")


def _struck_processes() -> Iterator[Fault]:
    yield Fault("camera-stopped", "camera", "stop", ("SOURCE_SILENT",))
    yield Fault("camera-killed", "camera", "kill", ("SOURCE_SILENT",))
    yield Fault("driver-stopped", "driver", "stop", LATE_STATES)
    yield Fault("driver-killed", "driver", "kill", LATE_STATES)
    yield Fault("view-stopped", "view", "stop")
    yield Fault("browser-hangs", "browser", "hang")
    yield Fault("view-killed", "view", "kill")
    yield Fault("disk-slow", "recorder", "slow", duration=VISIT)
    yield Fault("disk-full", "recorder", "full", RECORDING, duration=VISIT)
    yield Fault("recorder-stopped", "recorder", "stop", RECORDING, duration=VISIT)
    yield Fault("monitor-stopped", "monitor", "stop", (SILENCE,))
    yield Fault("recorder-killed", "recorder", "kill", RECORDING)
    yield Fault("monitor-killed", "monitor", "kill", (SILENCE,))


def choose_faults(patterns: Sequence[str]) -> list[Fault]:
    """The faults that have one of these names, or fit one as a pattern; without any, all.

    Raises:
        ArmguardError: No fault has such a name.
    """
    faults = list_faults()
    for pattern in patterns:
        if not any(fnmatchcase(fault.name, pattern) for fault in faults):
            raise ArmguardError(
                "--only",
                f"{pattern!r} is no fault",
                expected="some of " + ", ".join(fault.name for fault in faults),
            )
    return [
        fault
        for fault in faults
        if not patterns or any(fnmatchcase(fault.name, pattern) for pattern in patterns)
    ]
