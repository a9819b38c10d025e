"""What the page says first: three numbers, and tables of time in STOP and work lost."""

from __future__ import annotations

import numpy as np

from scene.contestants import (
    AS_THEY_COME,
    MAIN,
    MAIN_RAW,
    OPERATING,
    SEPARATION,
    TETHERED,
    Scope,
)
from scene.results import Results, make_table, milliseconds, multiple, percent
from scene.stop_rules import Setting


def write_numbers(results: Results, scope: Scope) -> list[str]:
    """Time in STOP, work lost and what was missed, in the setting nearest to a real cell."""
    setting, mine, rival = scope.real, OPERATING + AS_THEY_COME, SEPARATION + AS_THEY_COME
    tied = OPERATING + TETHERED
    stopped, rivals, tied_stopped = (
        percent(results.share(None, rule, setting)) for rule in (mine, rival, tied)
    )
    lost, by_rival, tied_lost = (
        percent(results.lost(None, rule, setting, "obeys")) for rule in (mine, rival, tied)
    )
    times, tied_times = (
        multiple(results.ratio(None, rule, rival, setting)) for rule in (mine, tied)
    )
    missed = _find_missed(results, mine, setting)
    needed = results.total("needed", None, mine, setting)
    return [
        f"With operating limits, bounds on people {setting.bounds}, samples"
        f" {milliseconds(setting.camera)} old, and"
        f" {milliseconds(setting.reaction)} of reaction:",
        "",
        f"- **{stopped} of the time in STOP**, which is {times} times the {rivals} of the"
        f" {SEPARATION}; with [tethers](obstacles.md#tethers) **{tied_stopped}**, or {tied_times}"
        " times.",
        f"- **{lost} of the work lost**, compared with {by_rival} by the {SEPARATION}; with"
        f" tethers {tied_lost}.",
        f"- **{missed[0]} of {needed} needed STOPs missed**, {missed[1]} while the body was hidden"
        f" and {missed[2]} after it had broken its bounds.",
    ]


def write_short_tables(results: Results, scope: Scope) -> list[str]:
    """The main rules in the setting nearest to a real cell, and in the usual one."""
    usual, real = scope.usual, scope.real
    settings = [usual._replace(reaction=reaction) for reaction in scope.extremes]
    return [
        "## Time in STOP and work lost",
        "",
        f"All samples, {real.bounds}, {milliseconds(real.camera)} old: time in STOP, in brackets as"
        f" a multiple of the {SEPARATION}, and work lost.",
        "",
        *_tabulate(results, MAIN_RAW[:3], [real], has_lost=True),
        "",
        f"Samples within their bounds, {usual.bounds}, {milliseconds(usual.camera)} old: time in"
        " STOP.",
        "",
        *_tabulate(results, MAIN[1:], settings, has_lost=False),
        "",
    ]


def tell_share(results: Results, speed: float, rule: str, rival: str, setting: Setting) -> str:
    """Share of time in STOP, and in brackets as a multiple of the rival's."""
    share = results.share(speed, rule, setting)
    if not np.isfinite(share):
        return percent(share)
    return f"{percent(share)} ({multiple(results.ratio(speed, rule, rival, setting))})"


def _tabulate(
    results: Results, rules: tuple[str, ...], settings: list[Setting], *, has_lost: bool
) -> list[str]:
    columns = [(speed, setting) for speed in results.speeds for setting in settings]
    heads = ["rule", *(f"{speed:g} rad/s, {milliseconds(x.reaction)}" for speed, x in columns)]
    rival = SEPARATION + AS_THEY_COME if has_lost else SEPARATION
    rows = []
    for rule in rules:
        row = [rule.replace(AS_THEY_COME, "")]
        for speed, setting in columns:
            lost = f", {percent(results.lost(speed, rule, setting, 'obeys'))}" if has_lost else ""
            row.append(tell_share(results, speed, rule, rival, setting) + lost)
        rows.append(row)
    return make_table(heads, rows)


def write_costs(results: Results, scope: Scope) -> list[str]:
    """Time in STOP and work lost by data, speed, bounds and age; all places together."""
    names = [rule.replace(AS_THEY_COME, "") for rule in MAIN_RAW]
    rows = []
    for data, suffix in (("clean", ""), ("as they come", AS_THEY_COME)):
        rules = list(MAIN_RAW) if suffix else names
        for speed in results.speeds:
            for setting in scope.settings():
                if setting.reaction != scope.reactions[0]:
                    continue
                clean, raw = (
                    results.total("ticks", speed, OPERATING + x, setting)
                    for x in ("", AS_THEY_COME)
                )
                row = [data, f"{speed:g} rad/s", setting.bounds, percent(1.0 - clean / raw)]
                row.append(milliseconds(setting.camera))
                row += [tell_share(results, speed, rule, rules[0], setting) for rule in rules]
                row += [percent(results.lost(speed, rule, setting, "obeys")) for rule in rules]
                rows.append(row)
    heads = ["data", "speed", "bounds on people", "broken", "age of samples"]
    heads += [f"in STOP: {names[0]}", *names[1:], f"work lost: {names[0]}", *names[1:]]
    return make_table(heads, rows)


def _find_missed(results: Results, rule: str, setting: Setting) -> list[int]:
    """Ticks that it let pass: of bodies in view, of hidden ones, of those that broke bounds."""
    return [results.total(x, None, rule, setting) for x in ("missed", "hidden", "beyond")]
