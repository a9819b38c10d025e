"""`armguard commission`: prints figures of an arm from a recording of stops, as lines to paste."""

from __future__ import annotations

import math
from pathlib import Path

from rich.table import Table

from armguard.app.terminal import make_console, make_table, print_json
from armguard.lab.commission.findings import Findings, commission
from armguard.lab.commission.lines import write_cell_lines, write_robot_lines
from armguard.lab.commission.observations import observe
from armguard.lab.pages import UNKNOWN, make_folder, write_files
from armguard.recording.reading import Recording

CELL_FILE = "cell-lines.toml"
ROBOT_FILE = "robot.toml"

_UNKNOWN = (math.nan,) * 4


def run_commission(file: Path, out: Path | None) -> int:
    """Print the results of a recording, and write its lines if a folder is given.

    Args:
        file: The recording.
        out: A folder, made if it is not there; None: nothing is written.

    Returns:
        The exit code.

    Raises:
        ArmguardError: The recording cannot be used, or something cannot be written.
    """
    found = commission(observe(Recording(file)))
    cell_lines, robot_lines = write_cell_lines(found), write_robot_lines(found)
    written: list[Path] = []
    if out is not None:
        make_folder(out)
        lines = {CELL_FILE: cell_lines.encode(), ROBOT_FILE: robot_lines.encode()}
        written = write_files(out, lines)
    for table in _draw_tables(found):
        make_console().print(table)
    console = make_console(soft_wrap=True)
    stops = len({stop.told for stop in found.stops})
    if not math.isnan(found.response):
        console.print(
            f"From a STOP to the first slowing it took {1e3 * found.response:.1f} ms at most, in "
            f"{stops} stops. Each figure is the worst measurement, plus three standard deviations "
            f"of its error. The next stop is worse with a probability of 1 in {stops + 1}, if "
            f"nothing else changes. Record more stops, from full speed and with full load, to "
            f"lower this probability."
        )
    for line in found.missing:
        console.print(f"not found: {line}")
    for title, text in (("cell file", cell_lines), ("robot.toml", robot_lines)):
        if out is None:
            console.print(f"\nfor the {title}:\n")
            console.print(text)
    for path in written:
        console.print(f"written: {path}")
    print_json(lambda: describe(found, cell_lines, robot_lines, written))
    return 0


def describe(
    found: Findings, cell_lines: str, robot_lines: str, written: list[Path]
) -> dict[str, object]:
    """Results of a recording, for programs; in SI units.

    Args:
        found: The results.
        cell_lines: For the cell file.
        robot_lines: For robot.toml.
        written: Files that have these lines.
    """
    kept = found._asdict()
    del kept["seen"], kept["unmeasured"]  # all that was recorded; and `missing` tells of these
    return kept | {
        "robot": found.seen.robot.name,
        "payload": found.seen.payload,
        "cell_lines": cell_lines,
        "robot_lines": robot_lines,
        "written": written,
    }


def _draw_tables(found: Findings) -> list[Table]:
    """Joints, and sources if there are any."""
    stops, kept = [], []
    for name in found.seen.robot.joints:
        count = str(sum(stop.joint == name for stop in found.stops))
        entry = found.brakes[name][-1] if name in found.brakes else None
        braking = (entry.speed, 1e3 * entry.stopping_time, entry.stopping_distance,
                   entry.deceleration or math.nan) if entry else _UNKNOWN  # fmt: skip
        stops.append([name, count, *map(_show, braking)])
        limits, errors = found.limits.get(name, _UNKNOWN), found.errors.get(name, _UNKNOWN)
        kept.append([name, *map(_show, limits[:2] + errors[:2])])
    sources = [
        (
            name,
            _show(source.rate),
            f"{_show(1e3 * source.usual_silence)}, at most {_show(1e3 * source.longest_silence)}",
            f"{_show(1e3 * source.median_age)}, at most {_show(1e3 * source.oldest)}",
            _show(1e3 * source.spread),
        )
        for name, source in found.sources.items()
    ]
    title = f"{found.seen.robot.name}, {found.seen.payload:g} kg"
    heads = ("joint", "stops", "speed", "time [ms]", "distance", "deceleration")
    tables = [
        make_table(heads, stops, title=title),
        make_table(("joint", "kept speed", "acceleration", "off position", "off velocity"), kept),
    ]
    if sources:
        tables.append(
            make_table(("source", "rate [Hz]", "silence [ms]", "age [ms]", "spread [mm]"), sources)
        )
    return tables


def _show(value: float) -> str:
    return UNKNOWN if math.isnan(value) else f"{value:.3g}"
