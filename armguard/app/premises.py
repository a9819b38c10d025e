"""The premises that every verdict rests on; `--premises` prints them, one a line.

A CLEAR is a proof, and a proof has premises. armguard checks some of them. The integrator of the
cell must ensure the others. docs/safety.md explains each.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence

import msgspec
import numpy as np

from armguard.bounds.braking import BrakingMotion
from armguard.monitor.monitor import Monitor
from armguard.robot.operating_limits import PUBLISHED


class Premise(enum.Enum):
    """A condition that must be true for verdicts to hold; the value states it in one line."""

    LIMITS = "the arm's limits hold in every mode, emergency brakes included"
    PAYLOAD = "the arm carries no more than the configured payload"
    OPERATING = "the controller enforces its operating limits, if any are configured"
    OTHER_ARMS = (
        "the other arms of the cell keep their operating limits and follow the plans they share"
    )
    DRAWN_LINKS = "links of other arms that are only drawn are not there, unless named in [statics]"
    OBEDIENCE = "the controller brakes on STOP, and when its last verdict has expired"
    OBSTACLES = "obstacles keep their bounds, and are within their stated shapes and errors"
    TETHERS = "tethered obstacles are never farther apart than is stated"
    FIRST_SIGHT = "what no source reports is not there, except behind a named entrance"
    EXEMPTIONS = "contact that is ignored does no harm"
    CONTACT = (
        "where contact limits are stated, surfaces of the arm are blunt and padded, what it wears "
        "or holds is attached, no gripper closes on a person, ids that are alike up to the last "
        "'/' are those of one person, and regions are right"
    )
    CLOCKS = "stamps are right within the stated clock errors, and latencies no longer than stated"
    PLACEMENT = "the arm is where its URDF and base placement say, with the tools that they say"


def list_premises(
    monitor: Monitor | None = None, others: Mapping[str, Sequence[str]] | None = None
) -> list[str]:
    """All premises, one a line.

    Args:
        monitor: Its configured figures are added to the lines; None: no figures.
        others: For each other arm of the cell, by name: its links that have only visual geometry.
    """
    figures = {} if monitor is None else _find_figures(monitor)
    if others:
        drawn = [f"{arm} {link}" for arm, links in others.items() for link in links]
        figures[Premise.DRAWN_LINKS] = f"not watched against: {', '.join(drawn) or 'none'}"
    return [
        f"premise: {premise.value}{f' ({figures[premise]})' if premise in figures else ''}"
        for premise in Premise
    ]


def summarise_premises() -> str:
    """One line with the number of premises and where they are explained."""
    return (
        f"every verdict rests on {len(Premise)} premises: --premises prints them, docs/safety.md "
        "explains them"
    )


def _find_figures(monitor: Monitor) -> dict[Premise, str]:
    """The configured figures that belong to premises, in words."""
    settings, obstacles = monitor.settings, monitor.obstacles
    table = obstacles.settings
    names = [obstacles.ids[row] for row in obstacles.entrance_rows.tolist()]
    return {
        Premise.PAYLOAD: f"{monitor.payload:g} kg",
        Premise.OPERATING: "stated" if settings.has_operating else "none are stated",
        Premise.OBEDIENCE: f"within {1e3 * settings.reaction_time:g} ms; "
        f"a verdict is valid for {1e3 * settings.response_time:g} ms",
        Premise.OBSTACLES: f"{table.accel:g} m/s² and {table.speed:g} m/s, unless told otherwise",
        Premise.TETHERS: _describe_tethers(monitor),
        Premise.FIRST_SIGHT: f"entrances: {', '.join(names) if names else 'none'}",
        Premise.CONTACT: _describe_limits(monitor),
        Premise.CLOCKS: f"latency of verdicts: {1e3 * settings.latency:g} ms",
    }


def _describe_tethers(monitor: Monitor) -> str:
    """The tethered obstacles, the length of each tether, and its source, in words."""
    told = [
        f"{one.a} and {one.b}: {one.length:g} m ({one.source})" for one in monitor.obstacles.tethers
    ]
    return "; ".join(told) or "none are stated"


def _describe_limits(monitor: Monitor) -> str:
    """The contact limits in force, and whether statics to be clamped against are configured."""
    limits = monitor.settings.contact_limits
    if limits is None:
        return "none are stated"
    told = []
    for region, limit in limits.by_region.items():
        own = limit.person_speed
        person = own if own == "own" else f"{own:g} m/s"
        told.append(f"{region}: {limit.max_speed:.3g} m/s, person's speed {person}")
    table = monitor.obstacles.table
    if (table.alive & table.static).sum() == len(monitor.obstacles.entrance_rows):
        told.append("no statics are stated: nothing is clamped against floor or table")
    return "; ".join(told)


def describe_missing_limits(monitor: Monitor) -> str | None:
    """What missing operating limits cost; None if some are configured or none are published.

    Args:
        monitor: The monitor of the run.
    """
    robot, settings = monitor.robot, monitor.settings
    if settings.has_operating or robot.published_operating_limits is None:
        return None
    still = np.zeros(len(robot.joints))
    middle = 0.5 * (robot.lower_position_limit + robot.upper_position_limit)
    q = np.where(np.isfinite(middle), middle, 0.0)
    without, published = (
        BrakingMotion(
            robot,
            settings.reaction_time,
            operating=msgspec.structs.replace(settings, operating=operating).put_in_force(robot),
        ).stop_time(q, still, 0.0, settings.response_time)
        for operating in (None, PUBLISHED)
    )
    return (
        f"no operating limits are stated, so {robot.name} may do all that its hardware can until "
        f"its brakes engage: from rest it needs {1e3 * without:.0f} ms to stop, with the "
        f'published ones {1e3 * published:.0f} ms (operating = "published" in [robot], if its '
        "controller keeps to them)"
    )
