"""What contact limits save, and every touch that they permit."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable

import numpy as np

from scene.contestants import LIMIT_TARGETS, OPERATING, PIECES, SEPARATION, WITH_LIMITS, Scope
from scene.plays import Judged, Obeyed
from scene.results import Aim, Found, Results, make_table, milliseconds, multiple, percent
from scene.stop_rules import Setting
from scene.touches import Touch

RULES = (SEPARATION, OPERATING, OPERATING + WITH_LIMITS, PIECES, PIECES + WITH_LIMITS)


def make_limit_tables(results: Results, scope: Scope) -> dict[str, list[str]]:
    """Tables by name: shares, causes of STOP, costs of obeying, and touches.

    Args:
        results: Of `RULES`.
        scope: Settings that were compared.
    """
    settings = [scope.usual._replace(reaction=reaction) for reaction in scope.extremes]
    obeyed, touches = _obeying(results, settings)
    return {
        "contact-limits": _shares(results, settings),
        "contact-limits-causes": _causes(results, settings),
        "contact-limits-obeyed": obeyed,
        "contact-limits-touches": touches,
    }


def find_aims(results: Results, scope: Scope) -> list[Aim]:
    """What was aimed at outside blocked time; `results` are of `RULES`."""
    aims = []
    for rule, speed, most in LIMIT_TARGETS:
        each = [
            _find_ratio(results, rule, speed, scope.usual, recording=name)
            for name in dict.fromkeys(one.recording for one in results.found)
        ]
        name = f"{rule} ÷ {SEPARATION}, outside blocked time"
        whole = _find_ratio(results, rule, speed, scope.usual)
        aims.append(Aim(name, scope.usual, speed, most, whole, np.nan, each))
    return aims


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


def _heads(results: Results, settings: list[Setting]) -> list[str]:
    return _columns(
        results, settings, lambda speed, one: [f"{speed:g} rad/s, {milliseconds(one.reaction)}"]
    )


def _shares(results: Results, settings: list[Setting]) -> list[str]:
    """Shares outside blocked time, beside those of the separation distance."""

    def blocked(speed: float, setting: Setting) -> list[str]:
        outcomes = _outcomes(results, speed, SEPARATION, setting)
        time = sum(one.ticks for one in outcomes)
        return [percent(sum(one.blocked for one in outcomes) / time if time else np.nan)]

    rows = [["blocked, of all time", *_columns(results, settings, blocked)]]
    for rule in (SEPARATION, OPERATING + WITH_LIMITS, PIECES + WITH_LIMITS):

        def share(speed: float, setting: Setting, rule: str = rule) -> list[str]:
            mine = find_open_share(_outcomes(results, speed, rule, setting))
            return [f"{percent(mine)} ({multiple(_find_ratio(results, rule, speed, setting))})"]

        rows.append([rule, *_columns(results, settings, share)])
    return make_table(["rule", *_heads(results, settings)], rows)


def _find_ratio(
    results: Results, rule: str, speed: float, setting: Setting, **where: object
) -> float:
    """Of the shares of STOP outside blocked time; NaN where the separation distance has none."""
    mine, rival = (
        find_open_share(one.outcome for one in results.of(speed, each, setting, **where))
        for each in (rule, SEPARATION)
    )
    return mine / rival if rival > 0.0 else np.nan


def _causes(results: Results, settings: list[Setting]) -> list[str]:
    """By cause, the share of the time outside blocked time that rules with limits still stop."""
    rows = []
    for rule in (OPERATING + WITH_LIMITS, PIECES + WITH_LIMITS):
        causes: Counter[str] = Counter()
        for one in results.found:
            if one.rule == rule and one.setting in settings and isinstance(one.outcome, Judged):
                causes += one.outcome.causes
        for cause, _ in causes.most_common():

            def share(
                speed: float, setting: Setting, rule: str = rule, cause: str = cause
            ) -> list[str]:
                outcomes = _outcomes(results, speed, rule, setting)
                time = sum(one.ticks - one.blocked for one in outcomes)
                ticks = sum(one.causes[cause] for one in outcomes if isinstance(one, Judged))
                return [percent(ticks / time if time else np.nan)]

            rows.append([rule, cause, *_columns(results, settings, share)])
    return make_table(["rule", "stopped by", *_heads(results, settings)], rows)


def _obeying(results: Results, settings: list[Setting]) -> tuple[list[str], list[str]]:
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
    heads = [
        "rule", "speed", "reaction", "in STOP outside blocked time", "blocked",
        "stops a minute", "work lost", "touches permitted", "contacts beyond a limit",
        "with a body that broke its bounds",
    ]  # fmt: skip
    return make_table(heads, rows), _list_touches(touched)


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
        "rule", "speed of joints", "reaction", "recording", "body", "lasts",
        "speed of the surface", "fastest", "limit", "depth of the cover",
        "way of the surface into the body", "limit kept",
    ]  # fmt: skip
    return make_table(heads, rows)
