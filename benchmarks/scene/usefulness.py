"""The page on how much an arm has to stop, and tables of all that was found."""

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
from scene.limited import RULES, find_aims, make_limit_tables
from scene.plays import Judged, Obeyed
from scene.raw_data import write_causes, write_missed_raw
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
) -> tuple[str, dict[str, list[str]]]:
    """The page in Markdown, and tables by the names of their files.

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
        rules=".\n- ".join(
            f"**{rule.capitalize()}**: {text}"
            for rule, text in DESCRIPTIONS.items() if rule in results.rules
        ),
        command=command, machine=machine,
        separation=SEPARATION.capitalize(), extra=1e3 * (PERIOD + LATENCY),
    )  # fmt: skip
    aims = _find_aims(results, scope, find_aims(limited, scope))
    price, prices = _prices(Results(priced, rate), scope.usual)
    parts = [head, *write_short_tables(results, scope), "## Also found", ""]
    parts += [_tell_missed(results), *_tell_aims(aims), *price]
    parts += ["- **Not tested**: other arms, and people who react to the arm."]
    tables = {
        "what-was-aimed-at": _tabulate_aims(aims),
        **make_limit_tables(limited, scope),
        "missed": _missed(results, scope),
        "missed-by-bounds": write_missed_raw(results, scope),
        "every-setting": write_costs(results, scope),
        "rule-by-rule": _shares(results, scope),
        "spread": _spread(results, scope),
        "causes": write_causes(results, scope),
        "an-arm-that-obeys": _obeying(results, scope),
        "price-of-a-tick": prices,
    }
    return "\n".join(parts) + "\n", tables


def _find_aims(results: Results, scope: Scope, more: list[Aim]) -> list[Aim]:
    """What was aimed at, and what came of it."""
    aims = [
        _find_aim(results, target, speed, setting)
        for target in TARGETS
        for setting in scope.settings()
        if setting.reaction in target.reactions and setting.camera == scope.cameras[0]
        for speed in results.speeds
    ]
    return [aim for aim in [*aims, *more] if np.isfinite(aim.found)]


def _tell_aims(aims: list[Aim]) -> list[str]:
    """How many are met, and the one that is missed the most."""
    if not aims:
        return []
    worst = max(aims, key=lambda aim: aim.found / aim.most)
    text = f"- **Aims**: {sum(aim.is_met for aim in aims)} of {len(aims)} are met. The farthest is"
    text += f" {worst.name}, {worst.setting.bounds}, {milliseconds(worst.setting.reaction)} of"
    return [f"{text} reaction, {worst.speed:g} rad/s: {worst.found:.2f} instead of {worst.most:g}."]


def _tabulate_aims(aims: list[Aim]) -> list[str]:
    """Over all recordings and by recording."""
    heads = ["ratio of time in STOP", "bounds on people", "reaction", "speed", "at most"]
    heads += ["found", "aim", "least possible", "by recording"]
    return make_table(heads, [aim.list_cells() for aim in aims])


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
    heads = ["rule", *(f"{speed:g} rad/s, {milliseconds(x.reaction)}" for speed, x in columns)]
    return make_table(heads, rows)


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
    return make_table(heads, rows)


def _obeying(results: Results, scope: Scope) -> list[str]:
    """What obeying costs beside clean data, with and without the scale."""
    rows = []
    for reaction in scope.extremes:
        setting = scope.usual._replace(reaction=reaction)
        for speed in results.speeds:
            for rule in results.rules:
                if AS_THEY_COME in rule:
                    continue
                ways = [(speed, rule, setting, how) for how in ("obeys", "obeys the scale")]
                ways = [what for what in ways if results.of(*what)]
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
    heads = [
        "speed", "reaction", "rule", "how", "in STOP", "stops a minute", "work lost", "missed",
        "hidden", "beyond", "contacts of an arm that obeys nobody",
    ]  # fmt: skip
    return make_table(heads, rows)


def _tell_missed(results: Results) -> str:
    """What monitors missed, all of it together, beside an arm that obeys nobody."""
    monitors = [
        one for one in results.found if not one.rule.startswith((ORACLE, SEPARATION, LEAST))
    ]
    ticks, contacts = (
        sum(
            one.outcome.missed + one.outcome.hidden + one.outcome.beyond
            for one in monitors
            if isinstance(one.outcome, kind)
        )
        for kind in (Judged, Obeyed)
    )
    hits = " and ".join(f"{results.hits(x)} contacts at {x:g} rad/s" for x in results.speeds)
    text = f"- **Missed**: in all settings, monitors missed {ticks} ticks and {contacts} contacts."
    return f"{text} An arm that ignores verdicts has {hits}."


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


def _prices(results: Results, setting: Setting) -> tuple[list[str], list[str]]:
    """What a tick of each rule costs, in this very run: told, and as a table."""
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
    told = []
    main = next((row for row in rows if row[0] == OPERATING), None)
    if main is not None:
        speeds = zip(results.speeds, main[1::2], main[2::2], strict=True)
        each = ", ".join(f"{x:g} rad/s {median} µs and {most} µs" for x, median, most in speeds)
        text = f"- **A tick** with {OPERATING} at 1 kHz, median and 99th percentile: {each}."
        told = [text]
    return told, make_table(heads, rows)
