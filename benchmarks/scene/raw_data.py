"""Tables on data as they come: what stops an arm then, and what each rule misses."""

from __future__ import annotations

from collections import Counter

from scene.contestants import (
    AS_THEY_COME,
    FORGETFUL,
    MAIN_RAW,
    MEASURED,
    OPERATING,
    SEPARATION,
    TETHERED,
    Scope,
)
from scene.plays import Judged
from scene.results import Results, make_table, milliseconds, multiple, percent
from scene.stop_rules import FAULTS, HELD, Setting

INSIDE = "inside the arm"
"""A body is where the arm is: recorded people do not yield."""

RULES = (SEPARATION + FORGETFUL, *MAIN_RAW, OPERATING + MEASURED)

TETHERS = {
    "none": OPERATING + AS_THEY_COME,
    "of anybody": OPERATING + TETHERED,
    "measured": OPERATING + MEASURED,
}
"""Rules by how the person's limbs are tied to each other."""


def write_causes(results: Results, scope: Scope) -> list[str]:
    """What operating limits stop for: the first fault without which the level would be higher.

    By setting and tethers, and in the usual one and that nearest to a real cell by place.
    """
    rows = []
    for setting in _settings(scope):
        for tethers, rule in TETHERS.items():
            name = [setting.bounds, milliseconds(setting.camera), tethers]
            rows.append([*name, "all", *_find_causes(results, rule, setting)])
            if setting not in (scope.usual, scope.real):
                continue
            for place in dict.fromkeys(x.placement for x in results.of(None, rule, setting)):
                cells = _find_causes(results, rule, setting, placement=place)
                rows.append([*name, f"{place + 1}", *cells])
    heads = ["bounds on people", "age of samples", "tethers", "place"]
    heads += [SEPARATION, f"{SEPARATION}, no hidden"]
    return make_table([*heads, f"{OPERATING} (multiple)", INSIDE, *FAULTS, HELD], rows)


def _settings(scope: Scope) -> list[Setting]:
    return [one for one in scope.settings() if one.reaction == scope.reactions[0]]


def _find_causes(results: Results, rule: str, setting: Setting, **where: object) -> list[str]:
    """Shares of time in STOP, and by cause."""
    rival = SEPARATION + AS_THEY_COME
    outcomes = [one.outcome for one in results.of(None, rule, setting, **where)]
    ticks = sum(one.ticks for one in outcomes)
    causes = Counter({INSIDE: sum(one.stopped_blocked for one in outcomes)})
    for one in outcomes:
        assert isinstance(one, Judged)
        causes += one.causes
    share = percent(results.share(None, rule, setting, **where))
    return [
        percent(results.share(None, rival, setting, **where)),
        percent(results.share(None, SEPARATION + FORGETFUL, setting, **where)),
        f"{share} ({multiple(results.ratio(None, rule, rival, setting, **where))})",
        *(percent(causes[name] / ticks) for name in (INSIDE, *FAULTS, HELD)),
    ]


def write_missed_raw(results: Results, scope: Scope) -> list[str]:
    """By rule and bounds: which samples count as broken depends on these."""
    rows = []
    fields = ("missed", "hidden", "beyond")
    for rule in RULES:
        for bounds in scope.bounds:
            settings = [one for one in _settings(scope) if one.bounds == bounds]
            ticks = _add(results, ("needed", *fields), rule, settings)
            contacts = _add(results, fields, rule, settings, "obeys")
            cells = [str(x) for x in ticks] if ticks[0] else ["–"] * 4
            rows.append([rule, bounds, *cells, *map(str, contacts)])
    heads = ["rule", "bounds on people", "ticks that needed a STOP", "missed", "hidden", "beyond"]
    return make_table([*heads, "contacts: missed", "hidden", "beyond"], rows)


def _add(
    results: Results, fields: tuple[str, ...], rule: str, settings: list[Setting], *how: str
) -> list[int]:
    """Counts over settings, at all speeds and places."""
    return [sum(results.total(x, None, rule, one, *how) for one in settings) for x in fields]
