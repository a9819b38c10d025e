"""What was found beside recorded people, asked by what matters, and how tables are written."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from scene.contestants import ORACLE, ORDER
from scene.plays import Judged, Obeyed
from scene.stop_rules import Setting


class Found(NamedTuple):
    """What became of one rule in one case."""

    speed: float
    """Of the fastest joint, in [rad]/[s]."""
    rule: str
    setting: Setting
    how: str
    """What the arm does about it: "goes on", "obeys" or "obeys the scale"."""
    recording: str
    placement: int
    seed: int
    outcome: Judged | Obeyed


class Results:
    """Everything that was found, asked by what matters.

    Args:
        found: All of it.
        rate: Ticks a second.
    """

    def __init__(self, found: Iterable[Found], rate: float) -> None:
        self._rate = rate
        self.found = list(found)
        self._by: dict[tuple[float, str, Setting, str], list[Found]] = {}
        for one in self.found:
            key = one.speed, one.rule, _find_key(one.rule, one.setting), one.how
            self._by.setdefault(key, []).append(one)
        self.speeds = list(dict.fromkeys(one.speed for one in self.found))
        self.rules = sorted({one.rule for one in self.found}, key=ORDER.index)
        # Every rule judged the same arm, which obeyed nobody.
        self._free = {
            (one.speed, one.recording, one.placement, one.seed): one.outcome
            for one in self.found
            if isinstance(one.outcome, Judged)
        }

    def of(
        self,
        speed: float | None,
        rule: str,
        setting: Setting,
        how: str = "goes on",
        **where: object,
    ) -> list[Found]:
        """Of one rule in one setting.

        Args:
            speed: In [rad]/[s]; None: all of them.
            rule: Its name.
            setting: What it had to live with.
            how: What the arm does about it.
            **where: Fields of `Found` and their values.
        """
        setting = _find_key(rule, setting)
        return [
            one
            for each in (self.speeds if speed is None else [speed])
            for one in self._by.get((each, rule, setting, how), [])
            if all(getattr(one, key) == x for key, x in where.items())
        ]

    def share(self, *what: object, **where: object) -> float:
        """Share of time in STOP; NaN where there is none."""
        outcomes = [one.outcome for one in self.of(*what, **where)]  # type: ignore[arg-type]
        ticks = sum(outcome.ticks for outcome in outcomes)
        return sum(outcome.stopped for outcome in outcomes) / ticks if ticks else np.nan

    def ratio(
        self, speed: float | None, rule: str, rival: str, setting: Setting, **where: object
    ) -> float:
        """Of the shares of time in STOP of two rules; NaN where the rival has none, or is none."""
        share, rivals = (self.share(speed, one, setting, **where) for one in (rule, rival))
        return share / rivals if rivals > 0.0 else np.nan

    def total(self, field: str, *what: object, **where: object) -> int:
        """Sum of a count over cases."""
        return sum(getattr(one.outcome, field) for one in self.of(*what, **where))  # type: ignore[arg-type]

    def lost(self, *what: object) -> float:
        """Share of its work that an arm that obeys did not do; NaN where there is none."""
        found = self.of(*what)  # type: ignore[arg-type]
        free = [self._free[one.speed, one.recording, one.placement, one.seed] for one in found]
        whole = sum(outcome.progress for outcome in free)
        done = sum(one.outcome.progress for one in found)
        return 1.0 - done / whole if whole else np.nan

    def minutes(self, *what: object) -> float:
        """How long that was."""
        return self.total("ticks", *what) / self._rate / 60.0

    def stops(self, *what: object) -> float:
        """How often it was told to stop, a minute."""
        return self.total("stops", *what) / self.minutes(*what)

    def hits(self, speed: float, among: Iterable[Found] | None = None) -> int:
        """Contacts of an arm that obeys nobody, in all cases or those that occur here."""
        cases = {
            (one.speed, one.recording, one.placement, one.seed)
            for one in (self.found if among is None else among)
        }
        return sum(
            outcome.hits
            for case, outcome in self._free.items()
            if case[0] == speed and case in cases and isinstance(outcome, Judged)
        )


class Aim(NamedTuple):
    """What the ratio of times in STOP of two rules was to be at most, and what it is."""

    name: str
    setting: Setting
    speed: float
    """Of the fastest joint, in [rad]/[s]."""
    most: float
    found: float
    """NaN where there is nothing to compare."""
    least: float
    """What any sound rule could have; NaN where nothing says so."""
    each: list[float]
    """By recording; NaN where the rival never stops."""

    @property
    def is_met(self) -> bool:
        """Whether it is no more than it was to be."""
        return self.found <= self.most

    @property
    def spread(self) -> str:
        """The least and the most of all recordings."""
        known = [ratio for ratio in self.each if np.isfinite(ratio)]
        return f"{min(known):.2f} to {max(known):.2f}"

    def list_cells(self) -> list[str]:
        """Its row of a table."""
        return [
            self.name, self.setting.bounds, milliseconds(self.setting.reaction),
            f"{self.speed:g} rad/s", f"{self.most:g}", f"{self.found:.2f}",
            "met" if self.is_met else "not met", multiple(self.least), self.spread,
        ]  # fmt: skip


def _find_key(rule: str, setting: Setting) -> Setting:
    """What is alike for a rule: the future depends on neither camera nor bounds."""
    return setting._replace(camera=0.0, bounds="") if rule.startswith(ORACLE) else setting


def make_table(heads: list[str], rows: list[list[str]]) -> list[str]:
    """Lines of a table in Markdown."""
    lines = [heads, ["---"] * len(heads), *rows]
    return [f"| {' | '.join(line)} |" for line in lines]


def percent(share: float) -> str:
    """As it is printed; a dash where there is none."""
    return "–" if not np.isfinite(share) else f"{round(100.0 * share, 1) + 0.0:.1f} %"


def multiple(ratio: float) -> str:
    """As it is printed; a dash where there is none."""
    return "–" if not np.isfinite(ratio) else f"{ratio:.2f}"


def milliseconds(time: float) -> str:
    """A time in [s] as it is printed."""
    return f"{1e3 * time:g} ms"


def in_words(count: int, one: str, many: str) -> str:
    """A number of things, in words."""
    return f"{count} {one if count == 1 else many}"
