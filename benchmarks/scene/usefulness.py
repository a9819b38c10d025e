"""The page on how much an arm has to stop: tables of what was found, and how to read them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from scene.contestants import (
    AS_THEY_COME,
    DESCRIPTIONS,
    LEAST,
    MAIN,
    MAIN_RAW,
    OPERATING,
    ORACLE,
    SEPARATION,
    TARGETS,
    WITH_LIMITS,
    Scope,
    Target,
)
from scene.headline import write_costs, write_numbers
from scene.limited import write_limits
from scene.plays import RISE_DELAY, Judged, Obeyed
from scene.raw_data import write_raw
from scene.results import (
    Found,
    Results,
    in_words,
    make_table,
    milliseconds,
    multiple,
    percent,
)
from scene.stop_rules import LATENCY, PERIOD, Setting

HEADER = Path(__file__).with_name("usefulness_head.md")
"""What stands above the tables, with places for what a run fills in."""


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
    found = list(found)
    limited = write_limits(found, scope, rate)
    # Where contact is permitted there is nothing that they miss: they have a part of their own.
    results = Results([one for one in found if not one.rule.endswith(WITH_LIMITS)], rate)
    speed = results.speeds[0]
    judged = results.of(speed, SEPARATION, scope.usual)
    parts = [
        HEADER.read_text(encoding="utf-8").format(
            numbers="\n".join(write_numbers(results, scope)),
            costs="\n".join(write_costs(results, scope, MAIN)),
            reaction=milliseconds(scope.reactions[0]),
            recordings=in_words(len({one.recording for one in judged}), "recording", "recordings"),
            minutes=results.minutes(speed, SEPARATION, scope.usual),
            seeds=in_words(len({one.seed for one in judged}), "trajectory", "trajectories"),
            placements=in_words(len({one.placement for one in judged}), "place", "places"),
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
    parts += write_raw(results, scope)
    parts += _targets(results, scope)
    parts += _shares(results, scope)
    parts += _spread(results, scope)
    parts += _obeying(results, scope)
    parts += limited
    parts += _missed(results, scope)
    parts += _prices(Results(priced, rate), scope.usual)
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
                    first = [what, milliseconds(setting.reaction), setting.bounds]
                    rows.append(first + [one for some in cells for one in some or ["–"] * 4])
    lines = ["## What was aimed at", ""]
    if rows:
        heads = ["ratio of time in STOP", "reaction", "people"]
        for speed in results.speeds:
            heads += [f"{speed:g} rad/s", "aim", "least possible", "by recording"]
        lines += [*make_table(heads, rows), ""]
    rows = [row for setting in _obeyed_settings(scope) for row in _scale_rows(results, setting)]
    if rows:
        text = "An arm that obeys the scale was to lose no more work than one that ignores it, and"
        text += " to be stopped no more often: work lost, and stops a minute, of both."
        heads = ["rule", "reaction"]
        for speed in results.speeds:
            heads += [f"{speed:g} rad/s: ignores it", "obeys it", "aim"]
        lines += [text, "", *make_table(heads, rows), ""]
    monitors = [
        one for one in results.found if not one.rule.startswith((ORACLE, SEPARATION, LEAST))
    ]
    ticks, contacts = (
        [
            sum(getattr(one.outcome, field) for one in monitors if isinstance(one.outcome, kind))
            for field in ("missed", "hidden", "beyond")
        ]
        for kind in (Judged, Obeyed)
    )
    hits = sum(results.hits(speed) for speed in results.speeds)
    text = "Monitors were to miss nothing where bodies were in view and had kept their bounds: they"
    text += f" missed {ticks[0]} ticks of an arm that goes on, and {contacts[0]} contacts of an arm"
    text += f" that obeys. Of hidden bodies it was {ticks[1]} and {contacts[1]}, of such as had"
    text += f" broken their bounds {ticks[2]} and {contacts[2]}; all settings together, clean data"
    text += f" and data as they come. An arm that obeys nobody has {hits} contacts in each."
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
            cells += [f"{percent(lost)}, {stops:.1f}" for lost, stops in costs]
            cells.append("met" if is_met else "not met")
        if cells:
            rows.append([rule, milliseconds(setting.reaction), *cells])
    return rows


def _target_cells(results: Results, target: Target, speed: float, setting: Setting) -> list[str]:
    """The ratio over all recordings, whether that is what was aimed at, and what each has."""
    whole = results.ratio(speed, target.rule, target.rival, setting)
    if not np.isfinite(whole):
        return []
    found = results.of(speed, target.rule, setting)
    names = dict.fromkeys(one.recording for one in found)
    least = np.nan
    if target.least is not None:
        least = results.ratio(speed, target.least, target.rival, setting)
    each = [
        results.ratio(speed, target.rule, target.rival, setting, recording=name) for name in names
    ]
    known = [ratio for ratio in each if np.isfinite(ratio)]
    return [
        f"{whole:.2f}",
        "met" if whole <= target.most else "not met",
        multiple(least),
        f"{min(known):.2f} to {max(known):.2f}",
    ]


def _shares(results: Results, scope: Scope) -> list[str]:
    """Share of time in STOP of an arm that goes on, of all rules in the usual setting."""
    usual = scope.usual
    columns = [
        (speed, usual._replace(reaction=x)) for speed in results.speeds for x in scope.reactions
    ]
    rows = []
    for rule in results.rules:
        cells = []
        for speed, setting in columns:
            ratio = results.ratio(speed, rule, SEPARATION, setting)
            share = results.share(speed, rule, setting)
            cells.append(f"{percent(share)} ({multiple(ratio)})" if np.isfinite(share) else "–")
        rows.append([rule, *cells])
    text = f"Bounds on people: {usual.bounds}. Samples are {milliseconds(usual.camera)} old. In"
    text += f" brackets: as a multiple of the {SEPARATION}."
    heads = ["rule", *(f"{speed:g} rad/s, {milliseconds(x.reaction)}" for speed, x in columns)]
    return ["## Share of time in STOP, rule by rule", "", text, "", *make_table(heads, rows), ""]


def _spread(results: Results, scope: Scope) -> list[str]:
    """How much that depends on the recording and on the place, for the main rules."""
    found = results.of(results.speeds[0], SEPARATION, scope.usual)
    recordings = list(dict.fromkeys(one.recording for one in found))
    places = list(dict.fromkeys(one.placement for one in found))
    rows = []
    for setting in dict.fromkeys((scope.usual, scope.real)):
        for speed in results.speeds:
            for rule in (ORACLE, *MAIN, *MAIN_RAW):
                each = [results.share(speed, rule, setting, recording=x) for x in recordings]
                each += [results.share(speed, rule, setting, placement=x) for x in places]
                first = [f"{speed:g} rad/s", setting.bounds, milliseconds(setting.camera), rule]
                rows.append([*first, *map(percent, each)])
    heads = ["speed", "bounds on people", "age of samples", "rule", *recordings]
    heads += [f"place {place + 1}" for place in places]
    text = f"Share of time in STOP, {milliseconds(scope.reactions[0])} of reaction."
    return ["## Spread", "", text, "", *make_table(heads, rows), ""]


def _obeying(results: Results, scope: Scope) -> list[str]:
    """What obeying costs beside clean data, with and without the scale."""
    rows = []
    for setting in _obeyed_settings(scope):
        for speed in results.speeds:
            for rule in results.rules:
                if AS_THEY_COME in rule:
                    continue
                for how in ("obeys", "obeys the scale"):
                    what = speed, rule, setting, how
                    if not (found := results.of(*what)):
                        continue
                    rows.append([
                        f"{speed:g} rad/s", milliseconds(setting.reaction), rule, how,
                        percent(results.share(*what)),
                        f"{results.stops(*what):.1f}",
                        percent(results.lost(*what)),
                        *(str(results.total(x, *what)) for x in ("missed", "hidden", "beyond")),
                        str(results.hits(speed, found)),
                    ])  # fmt: skip
    if not rows:
        return []
    heads = [
        "speed", "reaction", "rule", "how", "in STOP", "stops a minute", "work lost", "missed",
        "hidden", "beyond", "contacts of an arm that obeys nobody",
    ]  # fmt: skip
    return ["## An arm that obeys", "", *make_table(heads, rows), ""]


def _missed(results: Results, scope: Scope) -> list[str]:
    """Ticks in which a rule let pass what really would have happened."""
    heads = ["rule"]
    for speed in results.speeds:
        heads += [f"{speed:g} rad/s: missed", "hidden", "beyond", "of"]
    rows = []
    for rule in results.rules:
        if rule.startswith(ORACLE):
            continue
        cells = [
            sum(results.total(field, speed, rule, setting) for setting in scope.settings())
            for speed in results.speeds
            for field in ("missed", "hidden", "beyond", "needed")
        ]
        if any(cells[3::4]):
            rows.append([rule, *map(str, cells)])
    hits = ", ".join(f"{results.hits(speed)} at {speed:g} rad/s" for speed in results.speeds)
    text = "Of the ticks in which a STOP was the last one in time, in all settings together, how"
    text += " many a rule let pass. Nothing asks pieces in this way: see the"
    text += f" contacts of arms that obey them. Contacts of the arm, which goes on: {hits}."
    return ["## Missed", "", text, "", *make_table(heads, rows), ""]


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
        " its kinematics in it, those of the other rules have not."
    )
    main = next((row for row in rows if row[0] == OPERATING), None)
    if main is not None:
        speeds = zip(results.speeds, main[1::2], main[2::2], strict=True)
        each = ", ".join(f"{x:g} rad/s {median} µs and {most} µs" for x, median, most in speeds)
        text += f" With {OPERATING}, median and 99th percentile: {each}."
    return ["## Price of a tick", "", text, "", *make_table(heads, rows)]
