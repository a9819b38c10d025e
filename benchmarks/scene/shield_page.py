"""The page on what a shield gets done, and tables of all that was found."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scene.results import make_table, milliseconds, percent
from scene.shielded import Shielded
from scene.stop_rules import Setting
from scene.touches import Touch

HEADER = Path(__file__).with_name("shield_head.md")
"""What stands above the tables, with places for what a run fills in."""

RATE = 100.0
"""Of ticks, in [Hz]."""

SHIELD, LIMITED = "shield, 30 ms ahead", "shield, contact limits"

SHOWN = (
    "obeys the scale", "separation distance", SHIELD, LIMITED,
    "failsafe motions, guaranteed brakes", "failsafe motions, own brakes",
)  # fmt: skip
"""Of the table on the page; the CSV file has all."""


class Outcome(NamedTuple):
    """What became of one way to move an arm in one case; None where it does not apply."""

    ticks: int
    progress: float
    rests: int
    hard_stops: int | None
    reversals: int | None
    jerk: float | None
    missed: int
    beyond: int
    shielded: Shielded | None
    touches: tuple[Touch, ...]


class Row(NamedTuple):
    """One way to move an arm, in one case."""

    speed: float
    recording: str
    placement: int
    name: str
    setting: Setting
    free: float
    """How far an arm of that kind comes that obeys nobody, in [s]."""
    outcome: Outcome


class Rows:
    """What was found, asked by what matters."""

    def __init__(self, rows: Iterable[Row]) -> None:
        self.rows = list(rows)
        self.speeds = list(dict.fromkeys(row.speed for row in self.rows))
        self.names = list(dict.fromkeys(row.name for row in self.rows))
        self.settings = list(dict.fromkeys(row.setting for row in self.rows))

    def of(self, speed: float, name: str, setting: Setting) -> list[Row]:
        """Of one way at one speed in one setting."""
        what = speed, name, setting
        return [row for row in self.rows if (row.speed, row.name, row.setting) == what]

    def lost(self, *what: object) -> float:
        """Share of the work of an arm that obeys nobody that was not done."""
        rows = self.of(*what)  # type: ignore[arg-type]
        whole = sum(row.free for row in rows)
        return 1.0 - sum(row.outcome.progress for row in rows) / whole if whole else np.nan

    def lost_free(self, *what: object) -> float:
        """The same in time in which no body is inside the arm's cover."""
        rows = self.of(*what)  # type: ignore[arg-type]
        played = [row.outcome.shielded for row in rows]
        ticks = sum(one.ticks for one in played if one is not None)
        free = sum(one.free for one in played if one is not None)
        whole = sum(row.free for row in rows)
        done = sum(one.progress_free for one in played if one is not None)
        return 1.0 - done * ticks / (whole * free) if free else np.nan

    def per_minute(self, field: str, *what: object) -> float:
        """How often something happened in a minute; NaN where it does not apply."""
        rows = self.of(*what)  # type: ignore[arg-type]
        counts = [getattr(row.outcome, field) for row in rows]
        ticks = sum(row.outcome.ticks for row in rows)
        if not ticks or None in counts:
            return np.nan
        return sum(counts) * 60.0 * RATE / ticks


def write_page(
    rows: list[Row], prices: np.ndarray, command: str, machine: str
) -> tuple[str, dict[str, list[str]]]:
    """The page in Markdown, and tables by the names of their files.

    Args:
        rows: All that was found.
        prices: Of steps at 250 Hz, in [s]. Shape (n,).
        command: What was called.
        machine: What it was measured on.
    """
    found = Rows(rows)
    usual = found.settings[0]
    p50, p99 = (1e3 * float(np.quantile(prices, share)) for share in (0.5, 0.99))
    three = ", ".join(
        f"{percent(found.lost(speed, SHIELD, usual))} at {speed:g} rad/s" for speed in found.speeds
    )
    touched = sum(
        row.outcome.missed for row in rows if row.name.startswith("shield") and row.name != LIMITED
    )
    parts = [
        HEADER.read_text(encoding="utf-8").format(
            lost=three, touched=touched, p50=f"{p50:.2f}", p99=f"{p99:.2f}", command=command,
            machine=machine,
        )
    ]  # fmt: skip
    told, limits = _limits(found)
    parts += [f"## {usual.bounds}, samples {milliseconds(usual.camera)} old", "", *_short(found)]
    parts += ["", told]
    heads = ["bounds on people", "sample age", "reaction", "how the arm is moved"]
    for speed in found.speeds:
        heads += [f"work lost, {speed:g} rad/s", "rests", "hardest stops", "reversals"]
        heads += ["jerk ÷ limit", "contacts, beyond"]
    every = [
        [setting.bounds, milliseconds(setting.camera), milliseconds(setting.reaction), *row]
        for setting in found.settings
        for row in _rows(found, setting)
    ]
    tables = {"all-settings": make_table(heads, every), "with-contact-limits": limits}
    return "\n".join(parts) + "\n", tables


def _short(found: Rows) -> list[str]:
    """Work lost and hardest stops in the usual setting."""
    heads = ["how the arm is moved"]
    for speed in found.speeds:
        heads += [f"work lost, {speed:g} rad/s", "hardest stops"]
    rows = []
    for name in SHOWN:
        cells = [name]
        for speed in found.speeds:
            what = speed, name, found.settings[0]
            often = found.per_minute("hard_stops", *what)
            cells += [percent(found.lost(*what)), "–" if np.isnan(often) else f"{often:.0f}"]
        rows.append(cells)
    return make_table(heads, rows)


def _rows(found: Rows, setting: Setting) -> list[list[str]]:
    """By how the arm is moved, what came of it in one setting.

    Counts of rests, hardest stops and reversals (of 5 % of the top speed or more) are a minute;
    contacts beyond are with bodies that had broken their bounds.
    """
    rows = []
    for name in found.names:
        cells = [name]
        for speed in found.speeds:
            what = speed, name, setting
            some = found.of(*what)
            if not some:
                cells += ["–"] * 6
                continue
            jerks = [row.outcome.jerk for row in some if row.outcome.jerk is not None]
            cells.append(percent(found.lost(*what)))
            for field in ("rests", "hard_stops", "reversals"):
                often = found.per_minute(field, *what)
                cells.append("–" if np.isnan(often) else f"{often:.0f}")
            cells.append(f"{max(jerks):.2f}" if jerks else "–")
            counts = (
                sum(getattr(row.outcome, key) for row in some) for key in ("missed", "beyond")
            )
            cells.append(", ".join(map(str, counts)))
        if any(cell != "–" for cell in cells[1:]):
            rows.append(cells)
    return rows


def _limits(found: Rows) -> tuple[str, list[str]]:
    """What contact limits give a shield, where no body is inside the arm's cover.

    Told in words, and as a table.
    """
    heads = ["people", "sample age", "reaction"]
    for speed in found.speeds:
        heads += [f"{speed:g} rad/s: lost without", "with", "rests without", "with"]
        heads += ["touches", "beyond a limit"]
    rows = []
    promised: list[Touch] = []
    for setting in found.settings:
        cells = [setting.bounds, milliseconds(setting.camera), milliseconds(setting.reaction)]
        for speed in found.speeds:
            for field in ("lost", "rests"):
                for name in (SHIELD, LIMITED):
                    if field == "lost":
                        cells.append(percent(found.lost_free(speed, name, setting)))
                    else:
                        cells.append(f"{found.per_minute('rests', speed, name, setting):.0f}")
            touches = [
                touch
                for row in found.of(speed, LIMITED, setting)
                for touch in row.outcome.touches
                if touch.is_promised
            ]
            promised += touches
            cells += [str(len(touches)), str(sum(touch.is_beyond for touch in touches))]
        rows.append(cells)
    beyond = sum(touch.is_beyond for touch in promised)
    text = f"Shields with contact limits touched people {len(promised)} times in all settings,"
    text += f" {beyond} times beyond a limit. Recorded bodies do not yield."
    return text, make_table(heads, rows)
