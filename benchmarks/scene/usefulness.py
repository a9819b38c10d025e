"""The page on how much an arm has to stop: tables of what was found, and how to read them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scene.contestants import (
    DESCRIPTIONS,
    LEAST,
    NO_LOAD,
    ORACLE,
    ORDER,
    SEPARATION,
    TARGETS,
    Scope,
    Target,
)
from scene.plays import RISE_DELAY, Judged, Obeyed
from scene.stop_rules import LATENCY, PERIOD, Setting

HEADER = Path(__file__).with_name("usefulness_head.md")
"""What stands above the tables, with places for what a run fills in."""


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
        camera: With which the oracle judges: it makes no difference to it, in [s].
        rate: Ticks a second.
    """

    def __init__(self, found: Iterable[Found], camera: float, rate: float) -> None:
        self._camera, self._rate = camera, rate
        self.found = list(found)
        self._by: dict[tuple[float, str, Setting, str], list[Found]] = {}
        for one in self.found:
            self._by.setdefault((one.speed, one.rule, one.setting, one.how), []).append(one)
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
        speed: float,
        rule: str,
        setting: Setting,
        how: str = "goes on",
        **where: object,
    ) -> list[Found]:
        """Of one rule in one setting; `where` are fields of `Found` and their values."""
        if rule.startswith(ORACLE):
            setting = setting._replace(camera=self._camera)
        return [
            one
            for one in self._by.get((speed, rule, setting, how), [])
            if all(getattr(one, key) == x for key, x in where.items())
        ]

    def share(self, *what: object, **where: object) -> float:
        """Share of time in STOP; NaN where there is none."""
        outcomes = [one.outcome for one in self.of(*what, **where)]  # type: ignore[arg-type]
        ticks = sum(outcome.ticks for outcome in outcomes)
        return sum(outcome.stopped for outcome in outcomes) / ticks if ticks else np.nan

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


def write_page(
    found: Iterable[Found],
    priced: Iterable[Found],
    scope: Scope,
    rate: float,
    command: str,
    machine: str,
) -> str:
    """The page, in Markdown.

    Args:
        found: All that was found.
        priced: What was found in the run that counts for prices.
        scope: Settings that were compared.
        rate: Ticks a second.
        command: What was called.
        machine: What it was measured on.
    """
    results = Results(found, scope.cameras[0], rate)
    speed = results.speeds[0]
    judged = results.of(speed, SEPARATION, scope.usual)
    parts = [
        HEADER.read_text(encoding="utf-8").format(
            recordings=_count(len({one.recording for one in judged}), "recording", "recordings"),
            minutes=results.minutes(speed, SEPARATION, scope.usual),
            seeds=_count(len({one.seed for one in judged}), "trajectory", "trajectories"),
            placements=_count(len({one.placement for one in judged}), "place", "places"),
            rules="\n".join(
                f"  - **{rule}**: {text}" for rule, text in DESCRIPTIONS.items()
                if rule in results.rules
            ),
            command=command, machine=machine,
            oracle=ORACLE.capitalize(), least=LEAST.capitalize(),
            separation=SEPARATION.capitalize(),
            rise=RISE_DELAY, extra=1e3 * (PERIOD + LATENCY), rate=rate,
        )
    ]  # fmt: skip
    parts += _targets(results, scope)
    parts += _shares(results, scope)
    parts += _beside_rivals(results, scope)
    parts += _spread(results, scope)
    parts += _obeying(results, scope)
    parts += _missed(results, scope)
    parts += _prices(Results(priced, scope.cameras[0], rate), scope.usual)
    return "\n".join(parts) + "\n"


def _targets(results: Results, scope: Scope) -> list[str]:
    """What was aimed at, and what came of it: over all recordings and by recording."""
    rows = []
    for target in TARGETS:
        for setting in scope.settings():
            if setting.reaction in target.reactions and setting.camera == scope.cameras[0]:
                cells = [_target_cells(results, target, x, setting) for x in results.speeds]
                if any(cells):
                    what = f"{target.rule} ÷ {target.rival}, at most {target.most:g}"
                    first = [what, _milliseconds(setting.reaction), setting.bounds]
                    rows.append(first + [one for some in cells for one in some or ["–"] * 4])
    lines = ["## What was aimed at", ""]
    if rows:
        heads = ["ratio of time in STOP", "reaction", "people"]
        for speed in results.speeds:
            heads += [f"{speed:g} rad/s", "aim", "least possible", "by recording"]
        lines += [*_table(heads, rows), ""]
    rows = [row for setting in _obeyed_settings(scope) for row in _scale_rows(results, setting)]
    if rows:
        text = "An arm that obeys the scale was to lose no more work than one that ignores it, and"
        text += " to be stopped no more often: work lost, and stops a minute, of both."
        heads = ["rule", "reaction"]
        for speed in results.speeds:
            heads += [f"{speed:g} rad/s: ignores it", "obeys it", "aim"]
        lines += [text, "", *_table(heads, rows), ""]
    monitors = [
        one for one in results.found if not one.rule.startswith((ORACLE, SEPARATION, LEAST))
    ]
    ticks, contacts = (
        sum(one.outcome.missed for one in monitors if isinstance(one.outcome, kind))
        for kind in (Judged, Obeyed)
    )
    hits = sum(results.hits(speed) for speed in results.speeds)
    text = f"Monitors were to miss nothing: they missed {ticks} ticks of an arm that goes on, and"
    text += f" {contacts} contacts of an arm that obeys. One that obeys nobody has {hits} contacts."
    return [*lines, text, ""]


def _obeyed_settings(scope: Scope) -> list[Setting]:
    return [scope.usual._replace(reaction=reaction) for reaction in scope.extremes]


def _scale_rows(results: Results, setting: Setting) -> list[list[str]]:
    """By rule, what obeying its scale costs beside ignoring it."""
    rows = []
    for rule in results.rules:
        cells = []
        for speed in results.speeds:
            ignoring, obeying = (
                (speed, rule, setting, how) for how in ("obeys", "obeys the scale")
            )
            if not results.of(*obeying):
                continue
            costs = [(results.lost(*what), results.stops(*what)) for what in (ignoring, obeying)]
            # Percentages and stops a minute, as exact as they are printed.
            is_met = all(round(b, 3) <= round(a, 3) for a, b in zip(*costs, strict=True))
            cells += [f"{_percent(lost)}, {stops:.1f}" for lost, stops in costs]
            cells.append("met" if is_met else "not met")
        if cells:
            rows.append([rule, _milliseconds(setting.reaction), *cells])
    return rows


def _target_cells(results: Results, target: Target, speed: float, setting: Setting) -> list[str]:
    """The ratio over all recordings, whether that is what was aimed at, and what each has."""
    whole = _ratio(results, target, speed, setting)
    if not np.isfinite(whole):
        return []
    found = results.of(speed, target.rule, setting)
    names = dict.fromkeys(one.recording for one in found)
    least = np.nan
    if target.least is not None:
        least = _ratio(results, target._replace(rule=target.least), speed, setting)
    each = [_ratio(results, target, speed, setting, recording=name) for name in names]
    known = [ratio for ratio in each if np.isfinite(ratio)]
    return [
        f"{whole:.2f}",
        "met" if whole <= target.most else "not met",
        f"{least:.2f}" if np.isfinite(least) else "–",
        f"{min(known):.2f} to {max(known):.2f}",
    ]


def _ratio(
    results: Results, target: Target, speed: float, setting: Setting, **where: object
) -> float:
    """Of the shares of time in STOP; NaN where the rival has none, or there is none."""
    share, rival = (
        results.share(speed, rule, setting, **where) for rule in (target.rule, target.rival)
    )
    return share / rival if rival > 0.0 else np.nan


def _shares(results: Results, scope: Scope) -> list[str]:
    """Share of time in STOP of an arm that goes on, in every setting."""
    lines = ["## Share of time in STOP", ""]
    groups: dict[tuple[float, str], list[float]] = {}
    for one in scope.settings():
        groups.setdefault((one.camera, one.bounds), []).append(one.reaction)
    for (camera, bounds), reactions in groups.items():
        rows = []
        columns = [(speed, reaction) for speed in results.speeds for reaction in reactions]
        heads = ["rule", *(f"{speed:g} rad/s, {_milliseconds(x)}" for speed, x in columns)]
        for rule in results.rules:
            shares = [
                results.share(speed, rule, Setting(x, camera, bounds)) for speed, x in columns
            ]
            if np.isfinite(shares).any():
                rows.append([rule, *map(_percent, shares)])
        lines += [f"Bounds on people: {bounds}. Samples are {_milliseconds(camera)} old.", ""]
        lines += [*_table(heads, rows), ""]
    return lines


def _beside_rivals(results: Results, scope: Scope) -> list[str]:
    """Every share as a multiple of those of the separation distance and of the oracle."""
    columns = [(speed, reaction) for speed in results.speeds for reaction in scope.reactions]
    rows = []
    for rule in results.rules:
        cells = []
        for speed, reaction in columns:
            setting = scope.usual._replace(reaction=reaction)
            pair = [
                _ratio(results, Target(rule, rival, 0.0, ()), speed, setting)
                for rival in (SEPARATION, ORACLE)
            ]
            cells.append(", ".join(f"{ratio:.2f}" if np.isfinite(ratio) else "–" for ratio in pair))
        rows.append([rule, *cells])
    heads = ["rule", *(f"{speed:g} rad/s, {_milliseconds(x)}" for speed, x in columns)]
    text = f"The first of these tables as multiples: of the {SEPARATION}, and of what {ORACLE}."
    return [text, "", *_table(heads, rows), ""]


def _spread(results: Results, scope: Scope) -> list[str]:
    """How much that depends on the recording and on the place."""
    lines = ["## Spread", ""]
    for setting in _obeyed_settings(scope):
        for speed in results.speeds:
            found = results.of(speed, SEPARATION, setting)
            recordings = list(dict.fromkeys(one.recording for one in found))
            places = list(dict.fromkeys(one.placement for one in found))
            heads = ["rule", "median (range) of recordings", *recordings]
            heads += [f"place {place + 1}" for place in places]
            rows = []
            for rule in results.rules:
                each = [results.share(speed, rule, setting, recording=x) for x in recordings]
                if not np.isfinite(each).all():
                    continue
                there = [results.share(speed, rule, setting, placement=x) for x in places]
                middle = (
                    f"{_percent(np.median(each))} ({_percent(min(each))} to {_percent(max(each))})"
                )
                rows.append([rule, middle, *map(_percent, each + there)])
            lines += [f"{speed:g} rad/s, {_milliseconds(setting.reaction)} of reaction.", ""]
            lines += [*_table(heads, rows), ""]
    return lines


def _obeying(results: Results, scope: Scope) -> list[str]:
    """What obeying costs, with and without the scale."""
    lines = ["## An arm that obeys", ""]
    heads = [
        "rule", "in STOP", "stops a minute", "work lost", "missed", "beyond",
        "obeying the scale: in STOP", "stops a minute", "work lost", "missed", "beyond",
    ]  # fmt: skip
    for setting in _obeyed_settings(scope):
        for speed in results.speeds:
            rows = []
            among: list[Found] = []
            for rule in results.rules:
                cells = []
                for how in ("obeys", "obeys the scale"):
                    what = speed, rule, setting, how
                    found = results.of(*what)
                    among += found
                    if not found:
                        cells += ["–"] * 5
                        continue
                    cells += [
                        _percent(results.share(*what)),
                        f"{results.stops(*what):.1f}",
                        _percent(results.lost(*what)),
                        str(results.total("missed", *what)),
                        str(results.total("beyond", *what)),
                    ]
                if cells[0] != "–":
                    rows.append([rule, *cells])
            if rows:
                lines += [
                    f"{speed:g} rad/s, {_milliseconds(setting.reaction)} of reaction. An arm that"
                    f" obeys nobody hits the person {results.hits(speed, among)} times.",
                    "",
                    *_table(heads, rows),
                    "",
                ]
    return lines if len(lines) > 2 else []


def _missed(results: Results, scope: Scope) -> list[str]:
    """Ticks in which a rule let pass what really would have happened."""
    heads = ["rule", "people, age of samples"]
    for speed in results.speeds:
        heads += [f"{speed:g} rad/s: missed", "beyond", "of"]
    rows = []
    for camera, bounds in dict.fromkeys((x.camera, x.bounds) for x in scope.settings()):
        settings = [x for x in scope.settings() if (x.camera, x.bounds) == (camera, bounds)]
        for rule in results.rules:
            cells: list[int] = []
            for speed in results.speeds:
                for field in ("missed", "beyond", "needed"):
                    counts = [results.total(field, speed, rule, x) for x in settings]
                    cells.append(sum(counts))
            if any(cells[2::3]) and rule not in (ORACLE, ORACLE + NO_LOAD):
                rows.append([rule, f"{bounds}, {_milliseconds(camera)}", *map(str, cells)])
    hits = ", ".join(f"{results.hits(speed)} at {speed:g} rad/s" for speed in results.speeds)
    text = "Of the ticks in which a STOP was the last one in time, at all reactions together, how"
    text += " many a rule let pass. Nothing asks pieces in this way: see the"
    text += f" contacts of arms that obey them. Contacts of the arm, which goes on: {hits}."
    return ["## Missed", "", text, "", *_table(heads, rows), ""]


def _prices(results: Results, setting: Setting) -> list[str]:
    """What a tick of each rule costs, in this very run."""
    rows = []
    for rule in results.rules:
        cells = []
        for speed in results.speeds:
            prices = [one.outcome.prices for one in results.of(speed, rule, setting)]  # type: ignore[union-attr]
            if prices:
                cells += [f"{1e6 * x:.0f}" for x in np.percentile(np.concatenate(prices), [50, 99])]
        if cells:
            rows.append([rule, *cells])
    heads = ["rule"]
    for speed in results.speeds:
        heads += [f"{speed:g} rad/s: median [µs]", "99th percentile [µs]"]
    text = (
        "At 1 kHz, all in one run, beside one person within the arm's reach. A monitor's tick has"
    )
    text += " its kinematics in it, those of the other rules have not."
    return ["## Price of a tick", "", text, "", *_table(heads, rows)]


def _table(heads: list[str], rows: list[list[str]]) -> list[str]:
    lines = [heads, ["---"] * len(heads), *rows]
    return [f"| {' | '.join(line)} |" for line in lines]


def _percent(share: float) -> str:
    return "–" if not np.isfinite(share) else f"{round(100.0 * share, 1) + 0.0:.1f} %"


def _milliseconds(time: float) -> str:
    return f"{1e3 * time:g} ms"


def _count(count: int, one: str, many: str) -> str:
    return f"{count} {one if count == 1 else many}"
