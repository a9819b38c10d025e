"""Writes results as lines of a cell file and of a robot.toml, each with its basis."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable

from armguard.lab.commission.findings import Findings
from armguard.robot.brakes import BrakeEntry

_DIGITS = 4

UNCHANGED = "as in the recording: not found by commissioning"


def write_cell_lines(found: Findings) -> str:
    """Lines for `cell.toml`: thresholds, operating limits, sources."""
    seen = found.seen
    lines = []
    unmeasured = [f"# not measured: {one}" for one in found.unmeasured]
    if not math.isnan(found.response):
        reaction = round_up(max(0.0, found.response - seen.latency))
        told = {stop.told for stop in found.stops}
        told |= {one.command.told for one in found.unmeasured if math.isfinite(one.response)}
        lines += [
            "[thresholds]",
            f"latency = {seen.latency:g} # as recorded: stops show only the sum of the two",
            f"reaction_time = {reaction} # STOP to slowing, {1e3 * found.response:.1f} ms at the "
            f"latest of {len(told)} stops, minus that latency",
            *unmeasured,
            "",
        ]
    elif unmeasured:
        lines += ["# reaction_time not found: the arm may have ignored a STOP", *unmeasured, ""]
    if found.limits:
        robot = seen.robot
        velocity, acceleration = robot.velocity_limit.tolist(), robot.acceleration_limit.tolist()
        windows, unknown = [], list(robot.joints)
        for joint, name in enumerate(robot.joints):
            if (kept := found.limits.get(name)) is None:
                continue
            velocity[joint] = min(velocity[joint], round_up(kept.velocity))
            if not math.isnan(kept.acceleration):
                acceleration[joint] = min(acceleration[joint], round_up(kept.acceleration))
                windows.append(f"{1e3 * kept.window:.3g}")
                unknown.remove(name)
        how = []
        if windows:
            how.append(f"within {', '.join(windows)} ms; shorter accelerations may be missed")
        if unknown:
            how.append(f"not found, so the joint's limit is used: {', '.join(unknown)}")
        lines += [
            "[robot.operating] # observed here: state the limits of the controller",
            f"velocity = {velocity}",
            f"acceleration = {acceleration} # {'; '.join(how)}",
            "",
        ]
    for name, source in found.sources.items():
        rest = f"the longest without a STOP here, {source.quiet_silence:.3g} s"
        if source.uncovered:
            rest += f"; not covered: {source.uncovered} up to {source.longest_silence:.3g} s"
        lines += [
            f"[sources.{quote_key(name)}]",
            f"rate = {round_down(source.rate)}",
            f"timeout = {round_up(source.timeout)} # 1.5 times {rest}",
        ]
        if not math.isnan(source.spread):
            spread = round_up(source.spread)
            lines.append(f"# position_error of its messages: {spread} m is one standard deviation")
        lines.append("")
    return "\n".join(lines)


def write_robot_lines(found: Findings) -> str:
    """A `robot.toml` with the figures that were found; the others are those of the recording."""
    robot = found.seen.robot
    lines = ["[sources]"]
    lines += [f'{limit} = "{UNCHANGED}"' for limit in ("position", "velocity", "acceleration")]
    lower, upper = robot.lower_position_limit.tolist(), robot.upper_position_limit.tolist()
    velocity, acceleration = robot.velocity_limit.tolist(), robot.acceleration_limit.tolist()
    for joint, name in enumerate(robot.joints):
        lines += ["", f"[joints.{quote_key(name)}]"]
        if math.isfinite(lower[joint]) and math.isfinite(upper[joint]):
            lines.append(f"position = [{lower[joint]}, {upper[joint]}]")
        lines += [f"velocity = {velocity[joint]}", f"acceleration = {acceleration[joint]}"]
        errors = found.errors.get(name)
        for title in ("position_error", "velocity_error"):
            # What is constant cannot be seen, so nothing is stated to be better than it was.
            known = float(getattr(robot, title)[joint])
            measured = errors and getattr(errors, title.removesuffix("_error"))
            if measured is None or measured <= known:
                how = "not found" if measured is None else f"{measured:.2g} was measured"
                lines.append(f"{title} = {known} # as in the recording; {how}")
            else:
                lines.append(f"{title} = {round_up(measured)} # measured; recorded value {known:g}")
    for joint, name in enumerate(robot.joints):
        if name in found.brakes:
            entries = [_round_entry(entry, acceleration[joint]) for entry in found.brakes[name]]
        else:
            entries = [one._replace(source=UNCHANGED) for one in robot.brakes.entries[name]]
        for entry in entries:
            lines += _write_entry(name, entry)
    if found.tracking is not None:
        for title, errors_of in zip(
            ("tracking_error", "velocity_tracking_error"), found.tracking, strict=True
        ):
            listed = [round_up(float(error)) for error in errors_of]
            lines += ["", f"# {title} of plans, by joint: {listed}"]
    return "\n".join(lines) + "\n"


def _round_entry(entry: BrakeEntry, acceleration: float) -> BrakeEntry:
    """Rounded to the safe side, and no harder a stop than the joint's acceleration limit allows."""
    return entry._replace(
        speed=round_down(entry.speed),
        stopping_time=round_up(max(entry.stopping_time, entry.speed / acceleration)),
        stopping_distance=round_up(
            max(entry.stopping_distance, 0.5 * entry.speed * entry.speed / acceleration)
        ),
        deceleration=round_down(min(entry.deceleration, acceleration)),
    )


def _write_entry(name: str, entry: BrakeEntry) -> list[str]:
    lines = ["", "[[brakes]]", f"load = {entry.load:g}", f"source = {quote(entry.source)}"]
    for figure in ("speed", "stopping_time", "stopping_distance", "deceleration"):
        value = getattr(entry, figure)
        if 0.0 < value < math.inf:
            lines.append(f"{figure} = {{ {quote_key(name)} = {value} }}")
    return lines


def quote(text: str) -> str:
    """A basic string of TOML: JSON's escapes are among those that it knows."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def quote_key(name: str) -> str:
    """A name as a key of TOML."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else quote(name)


def round_up(value: float) -> float:
    """To four digits, not below."""
    return _round(value, math.ceil)


def round_down(value: float) -> float:
    """To four digits, not above."""
    return _round(value, math.floor)


def _round(value: float, whole: Callable[[float], int]) -> float:
    if value == 0.0 or not math.isfinite(value):
        return value
    digits = _DIGITS - 1 - math.floor(math.log10(abs(value)))
    return round(whole(value * 10.0**digits) / 10.0**digits, digits)
