"""Writes a robot.toml, in the order and with the comments of those that armguard comes with."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from armguard.lab.commission.lines import quote_key
from armguard.lab.new_robot.questions import Figure, Range
from armguard.robot.description import LockedJoint

KINDS = ("position", "velocity", "acceleration")


class NewRobot(NamedTuple):
    """All that a new robot.toml says; figures by joint, in the order of the model."""

    title: str
    urdf: str
    package_dirs: tuple[str, ...]
    bare_links: tuple[str, ...]
    collision_from_visual: tuple[str, ...]
    locked: Mapping[str, LockedJoint]
    lock_source: str
    """Where the places of locked joints come from."""
    position: Mapping[str, Figure[Range]]
    """Continuous joints are not in it."""
    velocity: Mapping[str, Figure[float]]
    acceleration: Mapping[str, Figure[float]]
    position_error: Mapping[str, Figure[float]]
    velocity_error: Mapping[str, Figure[float]]
    load: Figure[float]
    deceleration: Mapping[str, Figure[float]]
    work_velocity: Mapping[str, Figure[float]]
    work_acceleration: Mapping[str, Figure[float]]


def write_text(new: NewRobot) -> str:
    """The text of a robot.toml."""
    lines = [
        f"# {new.title}: written by `armguard robot new`; docs/robot.md says what each key means.",
        "# Units: rad, rad/s, rad/s²; of joints that slide m, m/s, m/s². What is CHOSEN or",
        "# DERIVED is no data of this arm: put what its maker states in its place, and its source.",
        "",
        f"title = {_quote(new.title)}",
        f"urdf = {_quote(new.urdf)}",
    ]
    for key in ("package_dirs", "bare_links", "collision_from_visual"):
        if names := getattr(new, key):
            lines.append(f"{key} = [{', '.join(map(_quote, names))}]")
    general = {kind: _find_usual_source(getattr(new, kind)) for kind in KINDS}
    lines += ["", "[sources]"]
    lines += [f"{kind} = {_quote(source)}" for kind, source in general.items() if source]
    for joint in new.velocity:
        lines += ["", *_write_joint(new, joint, general)]
    lines += ["", *_write_brakes(new)]
    if new.locked:
        lines += ["", f"# Not watched. {new.lock_source}"]
    for joint, entry in new.locked.items():
        lines += [f"[locked.{quote_key(joint)}]"]
        if entry.travel is not None:
            lines.append(f"travel = [{entry.travel[0]!r}, {entry.travel[1]!r}]")
        else:
            lines.append(f"position = {entry.position!r}")
        lines.append("")
    if not new.locked:
        lines.append("")
    lines += [
        "# What its controller keeps to while it moves. It counts only for those who ask for it,",
        '# as by operating = "published" in a cell file, and see to it that it is kept.',
        "[operating.published.sources]",
        f"velocity = {_quote(_join_sources(new.work_velocity))}",
        f"acceleration = {_quote(_join_sources(new.work_acceleration))}",
    ]
    for key, figures in (("velocity", new.work_velocity), ("acceleration", new.work_acceleration)):
        lines += ["", f"[operating.published.{key}]"]
        lines += [f"{quote_key(joint)} = {one.value!r}" for joint, one in figures.items()]
    return "\n".join(lines) + "\n"


def _write_joint(new: NewRobot, joint: str, general: Mapping[str, str]) -> list[str]:
    lines = [f"[joints.{quote_key(joint)}]"]
    if joint in new.position:
        lower, upper = new.position[joint].value
        lines.append(f"position = [{lower!r}, {upper!r}]")
    lines.append(f"velocity = {new.velocity[joint].value!r}")
    lines.append(f"acceleration = {new.acceleration[joint].value!r}")
    for key in ("position_error", "velocity_error"):
        figure = getattr(new, key)[joint]
        lines.append(f"{key} = {figure.value!r} # {figure.source}")
    own = {
        kind: figures[joint].source
        for kind in KINDS
        if joint in (figures := getattr(new, kind)) and figures[joint].source != general[kind]
    }
    if own:
        entries = ", ".join(f"{kind} = {_quote(source)}" for kind, source in own.items())
        lines.append(f"sources = {{ {entries} }}")
    return lines


def _write_brakes(new: NewRobot) -> list[str]:
    """One row of brakes for each source, so that each figure has its own."""
    lines = [
        "# What is known of its brakes: up to this load [kg] at the tool and this speed of each",
        "# joint, it decelerates by this at each instant. Makers publish stopping times and",
        "# distances instead: stopping_time and stopping_distance take them.",
    ]
    by_source: dict[str, list[str]] = {}
    for joint, one in new.deceleration.items():
        by_source.setdefault(one.source, []).append(joint)
    for source, joints in by_source.items():
        # A measured speed may exceed the limit by its error, and a stop from there is asked for.
        speeds = {
            joint: new.velocity[joint].value + 2.0 * new.velocity_error[joint].value
            for joint in joints
        }
        lines += [
            "[[brakes]]",
            f"load = {new.load.value!r} # {new.load.source}",
            f"source = {_quote(source)}",
            f"speed = {_write_table(speeds)}",
            f"deceleration = {_write_table({j: new.deceleration[j].value for j in joints})}",
            "",
        ]
    return lines[:-1]


def _write_table(values: Mapping[str, float]) -> str:
    return "{ " + ", ".join(f"{quote_key(j)} = {value!r}" for j, value in values.items()) + " }"


def _find_usual_source(figures: Mapping[str, Figure[float]]) -> str:
    """The source of most figures; empty where there are none."""
    counted = Counter(one.source for one in figures.values())
    return counted.most_common(1)[0][0] if counted else ""


def _join_sources(figures: Mapping[str, Figure[float]]) -> str:
    """The sources of figures that have one between them, with the joints where they differ."""
    by_source: dict[str, list[str]] = {}
    for joint, one in figures.items():
        by_source.setdefault(one.source, []).append(joint)
    if len(by_source) == 1:
        return next(iter(by_source))
    return "; ".join(f"{', '.join(joints)}: {source}" for source, joints in by_source.items())


def _quote(text: str) -> str:
    """A basic string of TOML: JSON's escapes are among those that it knows."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def list_choices(new: NewRobot) -> list[str]:
    """What is no data of this arm, one line each."""
    lines = []
    named: Sequence[tuple[str, Mapping[str, Figure]]] = (  # type: ignore[type-arg]  # of any amount
        ("position limits", new.position),
        ("velocity limits", new.velocity),
        ("acceleration limits", new.acceleration),
        ("position errors", new.position_error),
        ("velocity errors", new.velocity_error),
        ("load of the brakes", {"": new.load}),
        ("decelerations of the brakes", new.deceleration),
        ("operating velocities", new.work_velocity),
        ("operating accelerations", new.work_acceleration),
    )
    for what, figures in named:
        by_source: dict[str, list[str]] = {}
        for joint, one in figures.items():
            if one.source.startswith(("CHOSEN", "DERIVED")):
                by_source.setdefault(one.source, []).append(joint)
        for source, joints in by_source.items():
            of = "" if len(joints) == len(figures) else f" of {', '.join(joints)}"
            lines.append(f"{what}{of}: {source}")
    return lines
