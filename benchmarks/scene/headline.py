"""What the page says first: three numbers, and one table of what each bound and each age costs."""

from __future__ import annotations

from scene.contestants import (
    AS_THEY_COME,
    FORGETFUL,
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
    stopped, rivals = (results.share(None, rule, setting) for rule in (mine, rival))
    lost, by_rival = (results.lost(None, rule, setting, "obeys") for rule in (mine, rival))
    text = f"Operating limits stated, bounds on people {setting.bounds}, samples"
    text += f" {milliseconds(setting.camera)} old and as they come,"
    text += f" {milliseconds(setting.reaction)} of reaction; all speeds and places together:"
    tied = OPERATING + TETHERED
    missed = _find_missed(results, mine, setting)
    needed = results.total("needed", None, mine, setting)
    return [
        text,
        "",
        f"- **{percent(stopped)} of the time in STOP**; the {SEPARATION} on the same samples"
        f" {percent(rivals)}. That is {multiple(results.ratio(None, mine, rival, setting))} times.",
        f"- **{percent(lost)} of its work lost** by an arm that obeys; by the {SEPARATION}"
        f" {percent(by_rival)}.",
        "- Where the person's limbs are tied to each other, by published lengths:"
        f" **{percent(results.share(None, tied, setting))} of the time in STOP**, which is"
        f" {multiple(results.ratio(None, tied, rival, setting))} times, and"
        f" {percent(results.lost(None, tied, setting, 'obeys'))} of its work lost.",
        f"- **{missed[0]} of {needed} needed STOPs missed**, and {missed[1]} with a hidden body,"
        f" {missed[2]} with one that had broken its bounds; with limbs tied"
        f" {_count(results, tied, setting)}. The {SEPARATION} missed"
        f" {_count(results, rival, setting)}, and where it leaves hidden bodies out"
        f" {_count(results, SEPARATION + FORGETFUL, setting)}.",
        "",
    ]


def write_costs(results: Results, scope: Scope, rules: tuple[str, ...]) -> list[str]:
    """Time in STOP and work lost by speed, bounds and age, of some rules; all places together.

    Args:
        results: What was found.
        scope: Settings that were compared.
        rules: All beside clean data, or all beside data as they come; the first is the rival.
    """
    rows = []
    for speed in results.speeds:
        for setting in scope.settings():
            if setting.reaction != scope.reactions[0]:
                continue
            clean, raw = (
                results.total("ticks", speed, OPERATING + x, setting) for x in ("", AS_THEY_COME)
            )
            row = [f"{speed:g} rad/s", setting.bounds, percent(1.0 - clean / raw)]
            row.append(milliseconds(setting.camera))
            for rule in rules:
                ratio = results.ratio(speed, rule, rules[0], setting)
                row.append(f"{percent(results.share(speed, rule, setting))} ({multiple(ratio)})")
            row += [percent(results.lost(speed, rule, setting, "obeys")) for rule in rules]
            rows.append(row)
    names = [rule.replace(AS_THEY_COME, "") for rule in rules]
    heads = ["speed", "bounds on people", "broken", "age of samples"]
    heads += [f"in STOP: {names[0]}", *names[1:], f"work lost: {names[0]}", *names[1:]]
    return [*make_table(heads, rows), ""]


def _find_missed(results: Results, rule: str, setting: Setting) -> list[int]:
    """Ticks that it let pass: of bodies in view, of hidden ones, of those that broke bounds."""
    return [results.total(x, None, rule, setting) for x in ("missed", "hidden", "beyond")]


def _count(results: Results, rule: str, setting: Setting) -> str:
    missed, hidden, beyond = _find_missed(results, rule, setting)
    return f"{missed}, {hidden} and {beyond}"
