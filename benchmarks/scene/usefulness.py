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
from scene.headline import tell_share, write_costs, write_numbers, write_short_tables
from scene.limited import RULES, find_aims, write_limits
from scene.plays import RISE_DELAY, Judged, Obeyed
from scene.raw_data import CAUSES, write_causes, write_missed_raw
from scene.results import Aim, Found, Results, in_words, make_table, milliseconds, percent
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
    limited = Results([one for one in found if one.rule in RULES], rate)
    # Where contact is permitted there is nothing that they miss: they have a part of their own.
    results = Results([one for one in found if not one.rule.endswith(WITH_LIMITS)], rate)
    speed = results.speeds[0]
    judged = results.of(speed, SEPARATION, scope.usual)
    head = HEADER.read_text(encoding="utf-8").format(
        numbers="\n".join(write_numbers(results, scope)),
        recordings=in_words(len({one.recording for one in judged}), "recording", "recordings"),
        minutes=results.minutes(speed, SEPARATION, scope.usual),
        seeds=in_words(len({one.seed for one in judged}), "trajectory", "trajectories"),
        placements=in_words(len({one.placement for one in judged}), "place", "places"),
        rules="; ".join(
            f"**{rule.replace(AS_THEY_COME, '').capitalize()}**: {text}"
            for rule, text in DESCRIPTIONS.items() if rule in results.rules
        ),
        command=command, machine=machine, oracle=ORACLE.capitalize(), least=LEAST.capitalize(),
        separation=SEPARATION.capitalize(), rise=RISE_DELAY, extra=1e3 * (PERIOD + LATENCY),
    )  # fmt: skip
    parts = [head, *write_short_tables(results, scope)]
    parts += _targets(results, scope, find_aims(limited, scope))
    parts += write_limits(limited, scope)
    parts += ["## Missed", "", _tell_missed(results), "", *_missed(results, scope), ""]
    parts += [*write_missed_raw(results, scope), ""]
    parts += ["## Every setting", "", *write_costs(results, scope), ""]
    parts += ["## Rule by rule", "", *_shares(results, scope), ""]
    parts += ["## Spread", "", *_spread(results, scope), ""]
    parts += ["## Causes", "", CAUSES, "", *write_causes(results, scope), ""]
    parts += _obeying(results, scope)
    parts += _prices(Results(priced, rate), scope.usual)
    return "\n".join(parts) + "\n"


def _targets(results: Results, scope: Scope, more: list[Aim]) -> list[str]:
    """What was aimed at, and what came of it: over all recordings and by recording."""
    aims = [
        _find_aim(results, target, speed, setting)
        for target in TARGETS
        for setting in scope.settings()
        if setting.reaction in target.reactions and setting.camera == scope.cameras[0]
        for speed in results.speeds
    ]
    aims = [aim for aim in [*aims, *more] if np.isfinite(aim.found)]
    lines = ["## What was aimed at", ""]
    if aims:
        worst = max(aims, key=lambda aim: aim.found / aim.most)
        text = f"{sum(aim.is_met for aim in aims)} of {len(aims)} aims are met. The farthest:"
        text += f" {worst.name}, {worst.setting.bounds}, {milliseconds(worst.setting.reaction)} of"
        text += f" reaction, {worst.speed:g} rad/s: {worst.found:.2f}, aim {worst.most:g}"
        lines += [f"{text} (by recording {worst.spread}).", ""]
        heads = ["ratio of time in STOP", "bounds on people", "reaction", "speed", "at most"]
        heads += ["found", "aim", "least possible", "by recording"]
        lines += [*make_table(heads, [aim.list_cells() for aim in aims]), ""]
    return lines


def _find_aim(results: Results, target: Target, speed: float, setting: Setting) -> Aim:
    """The ratio over all recordings, whether that is what was aimed at, and what each has."""
    least = np.nan
    if target.least is not None:
        least = results.ratio(speed, target.least, target.rival, setting)
    found = results.of(speed, target.rule, setting)
    each = [
        results.ratio(speed, target.rule, target.rival, setting, recording=name)
        for name in dict.fromkeys(one.recording for one in found)
    ]
    whole = results.ratio(speed, target.rule, target.rival, setting)
    name = f"{target.rule} ÷ {target.rival}"
    return Aim(name, setting, speed, target.most, whole, least, each)


def _shares(results: Results, scope: Scope) -> list[str]:
    """Share of time in STOP of an arm that goes on, of all rules in the usual setting."""
    usual = scope.usual
    columns = [
        (speed, usual._replace(reaction=x)) for speed in results.speeds for x in scope.reactions
    ]
    rows = [
        [rule, *(tell_share(results, speed, rule, SEPARATION, x) for speed, x in columns)]
        for rule in results.rules
    ]
    text = f"Time in STOP: {usual.bounds}, samples {milliseconds(usual.camera)} old."
    heads = ["rule", *(f"{speed:g} rad/s, {milliseconds(x.reaction)}" for speed, x in columns)]
    return [text, "", *make_table(heads, rows)]


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
    text = f"Time in STOP, {milliseconds(scope.reactions[0])} of reaction."
    return [text, "", *make_table(heads, rows)]


def _obeying(results: Results, scope: Scope) -> list[str]:
    """What obeying costs beside clean data, with and without the scale."""
    rows, costs = [], []
    for reaction in scope.extremes:
        setting = scope.usual._replace(reaction=reaction)
        for speed in results.speeds:
            for rule in results.rules:
                if AS_THEY_COME in rule:
                    continue
                ways = [(speed, rule, setting, how) for how in ("obeys", "obeys the scale")]
                ways = [what for what in ways if results.of(*what)]
                # As exact as they are printed.
                costs.append([
                    (round(results.lost(*what), 3), round(results.stops(*what), 1)) for what in ways
                ])  # fmt: skip
                rows += [
                    [
                        f"{speed:g} rad/s", milliseconds(reaction), rule, what[3],
                        percent(results.share(*what)),
                        f"{results.stops(*what):.1f}",
                        percent(results.lost(*what)),
                        *(str(results.total(x, *what)) for x in ("missed", "hidden", "beyond")),
                        str(results.hits(speed, results.of(*what))),
                    ]
                    for what in ways
                ]  # fmt: skip
    pairs = [pair for pair in costs if len(pair) == 2]
    worse = sum(any(b > a for a, b in zip(*pair, strict=True)) for pair in pairs)
    text = f"Obeying the scale lost more work or stopped more often in {worse} of {len(pairs)}"
    text += " cases; it was to do neither."
    heads = [
        "speed", "reaction", "rule", "how", "in STOP", "stops a minute", "work lost", "missed",
        "hidden", "beyond", "contacts of an arm that obeys nobody",
    ]  # fmt: skip
    return ["## An arm that obeys", "", text, "", *make_table(heads, rows), ""] if rows else []


def _tell_missed(results: Results) -> str:
    """What monitors missed, all of it together, beside an arm that obeys nobody."""
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
    hits = ", ".join(f"{results.hits(x)} contacts at {x:g} rad/s" for x in results.speeds)
    text = f"In all settings monitors missed {ticks[0]} ticks and {contacts[0]} contacts; with"
    text += f" hidden bodies {ticks[1]} and {contacts[1]}, beyond {ticks[2]} and {contacts[2]}. Of"
    text += " pieces only contacts count. An arm that obeys nobody has"
    return f"{text} {hits}."


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
    return make_table(heads, rows)


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
    text = "At 1 kHz, beside one person within reach; of monitors with kinematics."
    main = next((row for row in rows if row[0] == OPERATING), None)
    if main is not None:
        speeds = zip(results.speeds, main[1::2], main[2::2], strict=True)
        each = ", ".join(f"{x:g} rad/s {median} µs and {most} µs" for x, median, most in speeds)
        text += f" With {OPERATING}, median and 99th percentile: {each}."
    return ["## Price of a tick", "", text, "", *make_table(heads, rows)]
