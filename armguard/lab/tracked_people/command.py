"""`armguard people`: prints measurements of recordings of tracked people, and lines to paste."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path

from rich.table import Table

from armguard.app.terminal import make_console, make_table, print_json
from armguard.exceptions import ArmguardError
from armguard.lab.pages import UNKNOWN
from armguard.lab.people import SLOWEST_RATE
from armguard.lab.tracked_people.findings import ENOUGH, Findings, measure_people
from armguard.lab.tracked_people.tracks import Tracked, load_tracks
from armguard.people.body_parts import BOUNDS
from armguard.people.proportions import SHORTEST, TALLEST
from armguard.people.skeleton import JOINTS

MOST_PROBLEMS = 3
"""Kinds of bad frames that are printed."""

_IDS = {
    "head": ("head",),
    "trunk": ("torso", "neck"),
    "shoulder": ("_shoulder",),
    "elbow": ("_upper_arm", "_elbow"),
    "hand": ("_forearm", "_hand"),
    "thigh": ("_thigh",),
    "foot": ("_shank", "_foot"),
}
"""Ends of ids of `armguard.people.Skeleton` that have a part's bounds."""


def run_people(
    files: Sequence[Path],
    *,
    check: bool = False,
    threshold: float | None = None,
    rate: float | None = None,
    unit: float | None = None,
    position_error: float | None = None,
    height: float | None = None,
) -> int:
    """Print the content of recordings, and with `check` measured bounds and errors.

    Args:
        files: Recordings; none: the motion captures in the folder ARMGUARD_RECORDINGS.
        check: Whether bounds, errors, hidden joints and bones are measured.
        threshold: Joints of less confidence are hidden; None: the kit's.
        rate: Frames a second, in [Hz], where files have no stamps.
        unit: Of positions, in [m]; None: the kit's.
        position_error: That is stated, in [m]; None: the one that is proposed.
        height: Of the people, in [m]; None: of anybody.

    Returns:
        The exit code.

    Raises:
        ArmguardError: A recording or an option cannot be used.
    """
    paths = list(files)
    if not paths:
        folder = os.environ.get("ARMGUARD_RECORDINGS", "")
        paths = sorted(Path(folder).glob("*.csv")) if folder else []
    if not paths:
        raise ArmguardError(
            "recordings", "are missing", remedy="name files, or set ARMGUARD_RECORDINGS"
        )
    if position_error is not None and not (0.0 <= position_error < math.inf):
        raise ArmguardError("--position-error", f"is {position_error}", expected="metres")
    if height is not None and not (SHORTEST <= height <= TALLEST):
        raise ArmguardError(
            "--height", f"is {height}", expected=f"{SHORTEST:g} to {TALLEST:g} metres"
        )
    if threshold is not None and not (0.0 <= threshold < math.inf):
        raise ArmguardError("--threshold", f"is {threshold}", expected="a confidence, from 0 on")
    recordings = [load_tracks(path, threshold=threshold, rate=rate, unit=unit) for path in paths]
    console = make_console(soft_wrap=True)
    for recording in recordings:
        console.print(_describe_recording(recording))
    if not check:
        print_json(lambda: {"recordings": [_summarise(one) for one in recordings]})
        return 0
    found = measure_people(recordings, position_error=position_error, height=height)
    for table in _draw_tables(found):
        make_console().print(table)
    for line in _list_advice(found):
        console.print(line)
    lines = write_lines(found)
    console.print("\nfor the cell file:\n")
    console.print(lines)
    print_json(
        lambda: {
            "recordings": [_summarise(one) for one in recordings],
            "findings": found,
            "cell_lines": lines,
        }
    )
    return 0


def write_lines(found: Findings) -> str:
    """Bounds and errors as lines of a cell file.

    Args:
        found: What was measured.
    """
    lines = [
        f"# position_error = {found.position_error:.3f}  # m: in each message, or Skeleton.update",
        "[bounds.of]",
    ]
    for part, ids in _IDS.items():
        if part in found.proposed:
            accel, speed = found.proposed[part][:2]
            told = "published" if found.proposed[part] == BOUNDS[part] else "measured here"
            lines += [
                f'"*{id}" = {{ accel = {accel:.1f}, speed = {speed:.1f} }}  # {told}' for id in ids
            ]
    return "\n".join(lines) + "\n"


def _summarise(recording: Tracked) -> dict[str, object]:
    return {
        "name": recording.name,
        "kit": recording.kit,
        "rate": recording.rate,
        "duration": recording.duration,
        "people": [track.person for track in recording.tracks],
        "bad_frames": dict(recording.bad_frames),
    }


def _describe_recording(recording: Tracked) -> str:
    people = len(recording.tracks)
    words = (
        f"{recording.name}: {recording.kit}, {recording.duration:.1f} s at "
        f"{recording.rate:.3g} Hz, {people} {'person' if people == 1 else 'people'}, "
        f"{recording.bad_frames.total()} bad frames"
    )
    for problem, count in recording.bad_frames.most_common(MOST_PROBLEMS):
        words += f"\n  {count} times: {problem}"
    return words


def _draw_tables(found: Findings) -> list[Table]:
    parts = []
    for part, hidden in found.hidden.items():
        bound, report = BOUNDS[part], found.bounds.get(part)
        broken = math.nan if report is None else report.broken
        jitter = found.jitter.get(part, math.nan)
        cells = (100.0 * broken, 1e3 * jitter, 100.0 * hidden.share)
        times = [_show_whole(1e3 * value) for value in hidden[2:5]]
        bounds = f"{bound.accel:g}, {bound.speed:g}"
        parts.append([part, bounds, *map(_show, cells), str(hidden.times), *times])
    heads = ("part", "bounds", "broken", "jitter", "hidden", "times", "p50", "p99", "longest")
    caption = (
        "Bounds in m/s² and m/s; broken and hidden in % of samples; jitter in mm. "
        "Hidden: how many times, and for how long in ms."
    )
    tables = [make_table(heads, parts, caption=caption)]
    bones = []
    for name, one in found.bones.items():
        lengths = [f"{value:.3f}" for value in (one.stated, one.median, one.p999)]
        bones.append([name, *lengths, _show(1e3 * one.placement), _show(100.0 * one.broken)])
    if bones:
        caption = "Lengths in m, placement in mm, too long in %."
        columns = ("bone", "at most", "median", "p99.9", "placement", "too long")
        tables.append(make_table(columns, bones, caption=caption))
    return tables


def _list_advice(found: Findings) -> list[str]:
    """Advice about the results, in sentences."""
    lines = [
        f"Position error: {1e3 * found.proposed_error:.0f} mm explains 99.9 % of samples, for "
        f"jitter and for placement; {1e3 * found.position_error:.0f} mm is used here. A constant "
        f"offset is not visible: measure it separately, and add it."
    ]
    if not found.bounds:
        lines.append(
            f"Bounds were not measured: they need {SLOWEST_RATE:g} frames per second or more."
        )
    few = [part for part, one in found.bounds.items() if one.clean < ENOUGH]
    if few:
        lines.append(f"Too few samples for bounds of {', '.join(few)}: record more than 1 minute.")
    wider = [part for part, one in found.proposed.items() if one != BOUNDS[part]]
    if wider:
        lines.append(
            f"Bounds of {', '.join(wider)} were broken, errors included: state the bounds below, "
            f"and pass them to Skeleton(bounds=...)."
        )
    never = sorted(JOINTS & {joint for one in found.hidden.values() for joint in one.never})
    if never:
        lines.append(
            f"Never seen: {', '.join(never)}. Parts without a visible joint are not watched: let "
            f"the camera see them, or make sure that they cannot reach the arm."
        )
    broken = [name for name, one in found.bones.items() if one.broken > 0.0]
    if broken:
        lines.append(
            f"Longer than stated, errors included: {', '.join(broken)}. Joints are swapped or "
            f"misplaced there; armguard ignores a broken tether for a while."
        )
    return lines


def _show(value: float) -> str:
    return UNKNOWN if math.isnan(value) else f"{value:.2g}"


def _show_whole(value: float) -> str:
    return UNKNOWN if math.isnan(value) else f"{value:.0f}"
