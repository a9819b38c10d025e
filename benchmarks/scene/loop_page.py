"""The page on a shield that moves a simulated arm, and tables of all that was found."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scene.results import make_table, milliseconds, percent
from scene.shielded import Contact, Following, Shielded
from scene.stop_rules import Setting

HEADER = Path(__file__).with_name("loop_head.md")
"""What stands above the tables, with places for what a run fills in."""


class Row(NamedTuple):
    """One case with one setting, or shown nobody."""

    arm: str
    speed: float
    """Of the fastest joint, in [rad]/[s]."""
    recording: str
    placement: int
    seed: int
    setting: Setting | None
    """None: the arm is shown nobody."""
    following: Following
    """What is stated of the arm."""
    free: float
    """How far the arm comes that is shown nobody, in [s] along its path."""
    played: Shielded
    share: float
    """Its greatest error, as a share of what is stated."""
    steps_off: int
    """How many steps had a greater one than is stated."""
    least_gap: float
    """Of the moving arm from any body, in [m]."""


def find_hours(rows: Iterable[Row], period: float) -> float:
    """Simulated time in [h]; `period` of the steps in [s]."""
    return sum(row.played.ticks for row in rows) * period / 3600.0


def write_page(rows: list[Row], period: float, **facts: object) -> tuple[str, dict[str, list[str]]]:
    """The page in Markdown, and tables by the names of their files.

    Args:
        rows: All that was found.
        period: Of steps, in [s].
        **facts: Further ones that the header names.
    """
    shown = [row for row in rows if row.setting is not None]
    blind = [row for row in rows if row.setting is None]
    prices = np.concatenate([row.played.prices for row in shown])
    p50, p99 = (1e3 * float(np.quantile(prices, share)) for share in (0.5, 0.99))
    speeds = dict.fromkeys(row.speed for row in rows)
    lost = (
        f"{percent(_find_lost([row for row in shown if row.speed == speed]))} at {speed:g} rad/s"
        for speed in speeds
    )
    head = HEADER.read_text(encoding="utf-8").format(
        hours=f"{find_hours(shown, period):.2f}", missed=sum(row.played.missed for row in shown),
        broken=sum(row.played.beyond for row in shown),
        blind=sum(len(row.played.contacts) for row in blind),
        blind_hours=f"{find_hours(blind, period):.2f}",
        off=sum(row.steps_off for row in shown), steps=f"{len(prices):,}", lost=", ".join(lost),
        p50=f"{p50:.2f}", p99=f"{p99:.2f}", rate=1.0 / period, **facts,
    )  # fmt: skip
    tables = {
        "beside-people": _table(shown, period),
        "shown-nobody": _table_of_blind(blind, period),
    }
    contacts = [(row, contact) for row in shown for contact in row.played.contacts]
    if contacts:
        tables["contacts"] = _table_of_contacts(contacts)
    return head.rstrip() + "\n", tables


def _find_lost(rows: list[Row]) -> float:
    """Share of the work of an arm that is shown nobody that was not done."""
    whole = sum(row.free for row in rows)
    return 1.0 - sum(row.played.progress for row in rows) / whole if whole else np.nan


def _group(rows: list[Row], key: Callable[[Row], tuple[object, ...]]) -> list[list[Row]]:
    groups: dict[tuple[object, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return list(groups.values())


def _table(rows: list[Row], period: float) -> list[str]:
    """By setting. Distances end at `scene.simulated_arm.NEAR`; rests and stops are a minute."""
    heads = [
        "arm", "speed", "people", "sample age", "minutes", "contacts", "premise broken",
        "least distance", "steps beyond", "error ÷ stated", "work lost", "rests",
        "hardest stops",
    ]  # fmt: skip
    lines = []
    for some in _group(rows, lambda row: (row.arm, row.speed, row.setting)):
        first, minutes = some[0], 60.0 * find_hours(some, period)
        assert first.setting is not None, "those that are shown nobody are left out"
        often = (
            sum(getattr(row.played, field) for row in some) / minutes
            for field in ("rests", "hard_stops")
        )
        lines.append(
            [
                first.arm, f"{first.speed:g} rad/s", first.setting.bounds,
                milliseconds(first.setting.camera), f"{minutes:.1f}",
                str(sum(row.played.missed for row in some)),
                str(sum(row.played.beyond for row in some)),
                f"{1e3 * min(row.least_gap for row in some):.1f} mm",
                str(sum(row.steps_off for row in some)),
                f"{max(row.share for row in some):.2f}", percent(_find_lost(some)),
                *(f"{count:.1f}" for count in often),
            ]
        )  # fmt: skip
    return make_table(heads, lines)


def _table_of_blind(rows: list[Row], period: float) -> list[str]:
    heads = [
        "arm", "speed", "minutes", "contacts", "stated tracking error", "of velocity",
        "error ÷ stated",
    ]  # fmt: skip
    lines = []
    for some in _group(rows, lambda row: (row.arm, row.speed)):
        first = some[0]
        lines.append(
            [
                first.arm, f"{first.speed:g} rad/s", f"{60.0 * find_hours(some, period):.1f}",
                str(sum(len(row.played.contacts) for row in some)),
                f"up to {1e3 * np.max(first.following.position):.1f} mrad",
                f"up to {1e3 * np.max(first.following.velocity):.0f} mrad/s",
                f"{max(row.share for row in some):.2f}",
            ]
        )  # fmt: skip
    return make_table(heads, lines)


def _table_of_contacts(contacts: list[tuple[Row, Contact]]) -> list[str]:
    heads = [
        "arm", "speed", "recording", "place", "seed", "people", "sample age", "body", "after",
        "premise broken",
    ]  # fmt: skip
    lines = []
    for row, contact in contacts:
        assert row.setting is not None, "those that are shown nobody are left out"
        lines.append(
            [
                row.arm, f"{row.speed:g} rad/s", row.recording, str(row.placement), str(row.seed),
                row.setting.bounds, milliseconds(row.setting.camera), contact.body,
                f"{contact.since:.3f} s", contact.broken or "none",
            ]
        )  # fmt: skip
    return make_table(heads, lines)
