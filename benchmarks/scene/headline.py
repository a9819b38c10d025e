"""What the page says first: three numbers, and one table of what each bound and each age costs."""

from __future__ import annotations

from scene.contestants import AS_THEY_COME, FORGETFUL, MAIN, OPERATING, SEPARATION, Scope
from scene.results import Results, make_table, milliseconds, multiple, percent
from scene.stop_rules import Setting


def write_numbers(results: Results, scope: Scope) -> list[str]:
    """Time in STOP, work lost and what was missed, in the setting nearest to a real cell."""
    setting, (mine, rival) = scope.real, _pair(AS_THEY_COME)
    stopped, rivals = (results.share(None, rule, setting) for rule in (mine, rival))
    lost, by_rival = (results.lost(None, rule, setting, "obeys") for rule in (mine, rival))
    text = f"Operating limits stated, bounds on people {setting.bounds}, samples"
    text += f" {milliseconds(setting.camera)} old and as they come,"
    text += f" {milliseconds(setting.reaction)} of reaction; all speeds and places together:"
    ignoring = SEPARATION + FORGETFUL
    return [
        text,
        "",
        f"- **{percent(stopped)} of the time in STOP**; the {SEPARATION} on the same samples"
        f" {percent(rivals)}. That is {multiple(results.ratio(None, mine, rival, setting))} times.",
        f"- **{percent(lost)} of its work lost** by an arm that obeys; by the {SEPARATION}"
        f" {percent(by_rival)}.",
        f"- **{results.total('missed', None, mine, setting)} STOPs missed** of"
        f" {results.total('needed', None, mine, setting)}, where the body was in view and had kept"
        f" its bounds; {_find_others(results, mine, setting)}. By the {SEPARATION}"
        f" {results.total('missed', None, rival, setting)}"
        f" ({_find_others(results, rival, setting)}), and"
        f" {results.total('missed', None, ignoring, setting)}"
        f" ({_find_others(results, ignoring, setting)}) if it leaves out what is hidden.",
        "",
    ]


def write_costs(results: Results, scope: Scope, suffix: str = "") -> list[str]:
    """Time in STOP and work lost by speed, bounds and age, of the main rules; all places together.

    Args:
        results: What was found.
        scope: Settings that were compared.
        suffix: Of the rules' names: of clean data or of data as they come.
    """
    rules = [rule + suffix for rule in MAIN]
    rival = SEPARATION + suffix
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
                ratio = results.ratio(speed, rule, rival, setting)
                row.append(f"{percent(results.share(speed, rule, setting))} ({multiple(ratio)})")
            row += [percent(results.lost(speed, rule, setting, "obeys")) for rule in rules]
            rows.append(row)
    heads = ["speed", "bounds on people", "broken", "age of samples"]
    heads += [f"in STOP: {MAIN[0]}", *MAIN[1:], f"work lost: {MAIN[0]}", *MAIN[1:]]
    return [*make_table(heads, rows), ""]


def _pair(suffix: str) -> tuple[str, str]:
    return OPERATING + suffix, SEPARATION + suffix


def _find_others(results: Results, rule: str, setting: Setting) -> str:
    hidden, beyond = (results.total(x, None, rule, setting) for x in ("hidden", "beyond"))
    return f"{hidden} with a hidden body, {beyond} with one that had broken its bounds"
