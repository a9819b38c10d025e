"""The part of the page on contact limits: what they save, and every touch that they permit."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from scene.contestants import LIMIT_TARGETS, OPERATING, PIECES, SEPARATION, WITH_LIMITS, Scope
from scene.example_limits import LIMITS, SOURCE
from scene.plays import Judged, Obeyed
from scene.results import (
    Found,
    Results,
    make_table,
    milliseconds,
    percent,
)
from scene.stop_rules import Setting
from scene.touches import Touch

RULES = (SEPARATION, OPERATING, OPERATING + WITH_LIMITS, PIECES, PIECES + WITH_LIMITS)

HEADER = Path(__file__).with_name("limited_head.md")
"""What stands above the tables, with places for what a run fills in."""

TOUCHES = (
    "Every touch of an arm that obeys. It begins where the cover of a moving arm first meets the"
    " recorded body, which is asked every millisecond. **Speed** is that of the surface there, and"
    " **fastest** the most until the touch ends. **Depth** is how far the cover enters the"
    " recorded body, which does not yield. **Pressed** is how far the surface itself moves into"
    " the body."
)


def write_limits(found: Iterable[Found], scope: Scope, rate: float) -> list[str]:
    """Lines of that part; none where no rule has limits."""
    found = [one for one in found if one.rule in RULES]
    results = Results(found, rate)
    if not any(one.rule.endswith(WITH_LIMITS) for one in found):
        return []
    limits = "; ".join(
        f"{region} {limit.force:g} N ({limit.transient_force:g} N at an impact),"
        f" {limit.stiffness:g} N/m and {limit.body_mass:g} kg: {limit.max_speed:.2f} m/s"
        for region, limit in LIMITS.by_region.items()
    )
    settings = [scope.usual._replace(reaction=reaction) for reaction in scope.extremes]
    text = HEADER.read_text(encoding="utf-8").format(source=SOURCE, limits=limits)
    lines = ["## Contact limits", "", text]
    lines += _shares(results, settings)
    lines += _aims(results, settings)
    lines += _causes(results, settings)
    return lines + _obeying(results, settings)


def find_open_share(outcomes: Iterable[Judged | Obeyed]) -> float:
    """Share of the time outside blocked time that is STOP; NaN where there is none."""
    outcomes = list(outcomes)
    time = sum(one.ticks - one.blocked for one in outcomes)
    stopped = sum(one.stopped - one.stopped_blocked for one in outcomes)
    return stopped / time if time else np.nan


def _outcomes(results: Results, *what: object) -> list[Judged | Obeyed]:
    return [one.outcome for one in results.of(*what)]  # type: ignore[arg-type]


def _columns(
    results: Results, settings: list[Setting], write: Callable[[float, Setting], list[str]]
) -> list[str]:
    """What is written for each speed and reaction, in one line."""
    return [cell for speed in results.speeds for one in settings for cell in write(speed, one)]


def _heads(results: Results, settings: list[Setting], *names: str) -> list[str]:
    return _columns(
        results,
        settings,
        lambda speed, one: [
            f"{speed:g} rad/s, {milliseconds(one.reaction)}{name}" for name in names
        ],
    )


def _shares(results: Results, settings: list[Setting]) -> list[str]:
    """Shares outside blocked time, beside those of the separation distance."""

    def blocked(speed: float, setting: Setting) -> list[str]:
        outcomes = _outcomes(results, speed, SEPARATION, setting)
        time = sum(one.ticks for one in outcomes)
        return [percent(sum(one.blocked for one in outcomes) / time if time else np.nan)]

    rows = [["blocked, of all time", *_columns(results, settings, blocked)]]
    for rule in results.rules:

        def share(speed: float, setting: Setting, rule: str = rule) -> list[str]:
            mine, rival = (
                find_open_share(_outcomes(results, speed, one, setting))
                for one in (rule, SEPARATION)
            )
            ratio = f"{mine / rival:.2f}" if rival > 0.0 else "–"
            return [f"{percent(mine)} ({ratio})"]

        rows.append([rule, *_columns(results, settings, share)])
    text = (
        "Share of the time outside blocked time in STOP, and in brackets as a multiple of that of"
    )
    text += f" the {SEPARATION}."
    return [text, "", *make_table(["rule", *_heads(results, settings, "")], rows), ""]


def _aims(results: Results, settings: list[Setting]) -> list[str]:
    """What was aimed at, and what came of it."""
    rows = []
    for rule, speed, most in LIMIT_TARGETS:
        shares = [
            find_open_share(_outcomes(results, speed, one, settings[0]))
            for one in (rule, SEPARATION)
        ]
        if shares[1] > 0.0:
            ratio = shares[0] / shares[1]
            met = "met" if ratio <= most else "not met"
            each = _find_ratios(results, rule, speed, settings[0])
            rows.append(
                [
                    f"{rule} ÷ {SEPARATION}", f"{speed:g} rad/s", f"{most:g}", f"{ratio:.2f}", met,
                    f"{min(each):.2f} to {max(each):.2f}",
                ]
            )  # fmt: skip
    if not rows:
        return []
    text = f"What was aimed at, outside blocked time, with {milliseconds(settings[0].reaction)}"
    text += " of reaction:"
    heads = ["ratio of time in STOP", "speed", "at most", "found", "aim", "by recording"]
    return [text, "", *make_table(heads, rows), ""]


def _find_ratios(results: Results, rule: str, speed: float, setting: Setting) -> list[float]:
    """By recording, of those in which the separation distance stops at all."""
    ratios = []
    for name in dict.fromkeys(one.recording for one in results.found):
        mine, rival = (
            find_open_share(one.outcome for one in results.of(speed, each, setting, recording=name))
            for each in (rule, SEPARATION)
        )
        if rival > 0.0:
            ratios.append(mine / rival)
    return ratios


def _causes(results: Results, settings: list[Setting]) -> list[str]:
    """By cause, the share of the time outside blocked time that rules with limits still stop."""
    lines = []
    for rule in (OPERATING + WITH_LIMITS, PIECES + WITH_LIMITS):
        causes: Counter[str] = Counter()
        for one in results.found:
            if one.rule == rule and one.setting in settings and isinstance(one.outcome, Judged):
                causes += one.outcome.causes
        rows = []
        for cause, _ in causes.most_common():

            def share(
                speed: float, setting: Setting, rule: str = rule, cause: str = cause
            ) -> list[str]:
                outcomes = _outcomes(results, speed, rule, setting)
                time = sum(one.ticks - one.blocked for one in outcomes)
                ticks = sum(one.causes[cause] for one in outcomes if isinstance(one, Judged))
                return [percent(ticks / time if time else np.nan)]

            rows.append([cause, *_columns(results, settings, share)])
        if rows:
            heads = [f"{rule}: stopped by", *_heads(results, settings, "")]
            lines += [*make_table(heads, rows), ""]
    if not lines:
        return []
    text = "What still stops an arm with limits: the body that could be touched first, or what else"
    text += " it is. A STOP is held for a while after its cause is over."
    return [text, "", *lines]


def _obeying(results: Results, settings: list[Setting]) -> list[str]:
    """What obeying costs, and all that is touched then."""
    rows, touched = [], []
    for setting in settings:
        for speed in results.speeds:
            for rule in results.rules:
                for how in ("obeys", "obeys the scale"):
                    what = speed, rule, setting, how
                    found = results.of(*what)
                    if not found:
                        continue
                    outcomes = [one.outcome for one in found]
                    blocked = sum(one.blocked for one in outcomes if isinstance(one, Obeyed))
                    ticks = sum(one.ticks for one in outcomes)
                    each = [
                        (one, touch)
                        for one in found
                        if isinstance(one.outcome, Obeyed)
                        for touch in one.outcome.touches
                    ]
                    touched += [(what, *pair) for pair in each]
                    promised = [touch for _, touch in each if touch.is_promised]
                    with_limits = rule.endswith(WITH_LIMITS)
                    rows.append(
                        [
                            f"{rule}, {how}", f"{speed:g} rad/s",
                            milliseconds(setting.reaction),
                            percent(find_open_share(outcomes)),
                            percent(blocked / ticks), f"{results.stops(*what):.1f}",
                            percent(results.lost(*what)),
                            str(len(promised)) if with_limits else "–",
                            str(sum(touch.is_beyond for touch in promised))
                            if with_limits else str(results.total("missed", *what)),
                            str(len(each) - len(promised)) if with_limits else
                            str(sum(results.total(x, *what) for x in ("hidden", "beyond"))),
                        ]
                    )  # fmt: skip
    if not rows:
        return []
    heads = [
        "rule", "speed", "reaction", "in STOP outside blocked time", "blocked",
        "stops a minute", "work lost", "touches permitted", "contacts beyond a limit",
        "with a body that broke its bounds",
    ]  # fmt: skip
    lines = ["What obeying costs. Without contact limits each contact is beyond a limit.", ""]
    lines += [*make_table(heads, rows), "", TOUCHES, ""]
    return [*lines, *_list_touches(touched), ""]


def _list_touches(touched: list[tuple[tuple[object, ...], Found, Touch]]) -> list[str]:
    rows = []
    for (speed, rule, setting, how), found, touch in touched:
        assert isinstance(setting, Setting)
        rows.append(
            [
                f"{rule}, {how}", f"{speed:g} rad/s", milliseconds(setting.reaction),
                found.recording, f"{touch.body}, at {touch.begin:.2f} s",
                f"{touch.duration:.3f} s", f"{touch.speed:.3f} m/s", f"{touch.fastest:.3f} m/s",
                f"{touch.limit:.2f} m/s", f"{1e3 * touch.depth:.1f} mm",
                f"{1e3 * touch.way:.1f} mm",
                ("beyond" if touch.is_beyond else "within")
                if touch.is_promised else "broke its bounds",
            ]
        )  # fmt: skip
    heads = [
        "rule", "speed of joints", "reaction", "recording", "body", "lasts", "speed", "fastest",
        "limit", "depth", "pressed", "limit kept",
    ]  # fmt: skip
    return make_table(heads, rows) if rows else ["There was none."]
