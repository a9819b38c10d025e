"""Writes a robot.toml in the same order and with the same comments as the known robots have."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from armguard.lab.commission.lines import quote, quote_key
from armguard.lab.new_robot.questions import KINDS, Figure, Range, group_by_source
from armguard.robot.description import LockedJoint

LOCKED = (
    "# Not watched. `travel`: its links count as everything that they can reach; `position`: the "
    "joint must not move."
)

LIMITS = ("position", "velocity", "acceleration")
"""Of figures that state the source of most of them at the top."""


class NewRobot(NamedTuple):
    """Content of a new robot.toml; figures by joint, in the order of the model."""

    title: str
    urdf: str
    package_dirs: tuple[str, ...]
    bare_links: tuple[str, ...]
    collision_from_visual: tuple[str, ...]
    locked: Mapping[str, LockedJoint]
    figures: Mapping[str, Mapping[str, Figure[Any]]]
    """By kind (`KINDS`) and joint; continuous joints have no position, the load has no joint."""


def write_text(new: NewRobot) -> str:
    """The text of a robot.toml."""
    lines = [
        f"# {new.title}: written by `armguard robot new`; docs/robot.md says what each key means.",
        "# Units: rad, rad/s, rad/s²; of joints that slide m, m/s, m/s². What is CHOSEN or",
        "# DERIVED is no data of this arm: replace it with its maker's values and their source.",
        "",
        f"title = {quote(new.title)}",
        f"urdf = {quote(new.urdf)}",
    ]
    for key in ("package_dirs", "bare_links", "collision_from_visual"):
        if names := getattr(new, key):
            lines.append(f"{key} = [{', '.join(map(quote, names))}]")
    general = {kind: _find_usual_source(new.figures[kind]) for kind in LIMITS}
    lines += ["", "[sources]"]
    lines += [f"{kind} = {quote(source)}" for kind, source in general.items() if source]
    for joint in new.figures["velocity"]:
        lines += ["", *_write_joint(new, joint, general)]
    lines += ["", *_write_brakes(new), ""]
    if new.locked:
        lines.append(LOCKED)
    for joint, entry in new.locked.items():
        key = "position" if entry.travel is None else "travel"
        place = f"{key} = {_write_value(getattr(entry, key))}"
        lines += [f"[locked.{quote_key(joint)}]", place, ""]
    lines += [
        "# Limits that its controller enforces during motion. armguard uses them only on request,",
        '# such as operating = "published" in a cell file; the user must enforce them.',
        "[operating.published.sources]",
    ]
    working = {key: new.figures[f"operating_{key}"] for key in ("velocity", "acceleration")}
    lines += [f"{key} = {quote(_join_sources(figures))}" for key, figures in working.items()]
    for key, figures in working.items():
        lines += ["", f"[operating.published.{key}]"]
        lines += [f"{quote_key(joint)} = {one.value!r}" for joint, one in figures.items()]
    return "\n".join(lines) + "\n"


def _write_joint(new: NewRobot, joint: str, general: Mapping[str, str]) -> list[str]:
    lines = [f"[joints.{quote_key(joint)}]"]
    own = {}
    for kind in LIMITS:
        figure = new.figures[kind].get(joint)
        if figure is not None:
            lines.append(f"{kind} = {_write_value(figure.value)}")
            if figure.source != general[kind]:
                own[kind] = figure.source
    for kind in ("position_error", "velocity_error"):
        figure = new.figures[kind][joint]
        lines.append(f"{kind} = {figure.value!r} # {figure.source}")
    if own:
        entries = ", ".join(f"{kind} = {quote(source)}" for kind, source in own.items())
        lines.append(f"sources = {{ {entries} }}")
    return lines


def _write_brakes(new: NewRobot) -> list[str]:
    """One row of brakes for each source, so that each figure has its own."""
    lines = [
        "# Brakes: up to this load [kg] at the tool and this speed of each joint, they decelerate",
        "# it by at least this at each instant. Makers publish stopping times and distances:",
        "# write those as stopping_time and stopping_distance.",
    ]
    figures, load = new.figures, new.figures["load"][""]
    for source, joints in group_by_source(figures["deceleration"]).items():
        # A measured speed may exceed the limit by its error, and a stop from there is asked for.
        speeds = {
            joint: figures["velocity"][joint].value + 2.0 * figures["velocity_error"][joint].value
            for joint in joints
        }
        held = {joint: figures["deceleration"][joint].value for joint in joints}
        lines += [
            "[[brakes]]",
            f"load = {load.value!r} # {load.source}",
            f"source = {quote(source)}",
            f"speed = {_write_table(speeds)}",
            f"deceleration = {_write_table(held)}",
            "",
        ]
    return lines[:-1]


def _write_value(value: float | Range | None) -> str:
    return repr(list(value) if isinstance(value, tuple) else value)


def _write_table(values: Mapping[str, float]) -> str:
    return "{ " + ", ".join(f"{quote_key(j)} = {value!r}" for j, value in values.items()) + " }"


def _find_usual_source(figures: Mapping[str, Figure[float]]) -> str:
    """The source of most figures; empty where there are none."""
    groups = group_by_source(figures)
    return max(groups, key=lambda source: len(groups[source]), default="")


def _join_sources(figures: Mapping[str, Figure[float]]) -> str:
    """The sources of figures in one text, with the joints where they differ."""
    by_source = group_by_source(figures)
    if len(by_source) == 1:
        return next(iter(by_source))
    return "; ".join(f"{', '.join(joints)}: {source}" for source, joints in by_source.items())


def list_choices(new: NewRobot) -> list[str]:
    """Values that are no data of this arm, one line each."""
    lines = []
    for name, kind in KINDS.items():
        figures = new.figures[name]
        for source, joints in group_by_source(figures).items():
            if not source.startswith(("CHOSEN", "DERIVED")):
                continue
            of = "" if len(joints) == len(figures) else f" of {', '.join(joints)}"
            lines.append(f"{kind.name}{of}: {source}")
    return lines
