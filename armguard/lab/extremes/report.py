"""What became of each case at the extremes, and the page that tells it, in Markdown."""

from __future__ import annotations

import math
import statistics
from collections.abc import Collection, Iterable, Sequence
from typing import NamedTuple

from armguard.lab.pages import UNKNOWN, write_table

SOUND, UNSOUND, REFUSED = "sound", "UNSOUND", "refused"
"""What became of a case."""


class Line(NamedTuple):
    """What became of one case."""

    group: str
    case: str
    outcome: str
    """`SOUND`, `UNSOUND` or `REFUSED`."""
    tight: float = float("nan")
    """Contact time over the exact one, or over an adversary's first contact, in the median; NaN
    where there is nothing to compare."""
    worst: float = float("nan")
    """The least of these."""
    price: float = float("nan")
    """Of an evaluation or of a tick, in the median, in [µs]."""
    note: str = ""
    """Against what, or why refused."""


EXACT = "against exact arithmetic"
"""Note on what single evaluations are compared with."""

HEADS = ("group", "case", "outcome", "tight", "worst", "price, µs", "note")
"""Of the table of all cases."""

HEAD = """# At the extremes

- **{summary}**
- **{evaluation_tight}** of the exact contact time is the worst answer of a single evaluation; a tick's answer has **{tick_tight}** of an adversary's contact time in the median of cases, and {tick_worst} at worst.
- **{evaluation_price} µs** at most for an evaluation, **{tick_price} µs** for a tick.

![Contact time falls while a ball approaches; when it reaches the stop time the level is STOP](pictures/levels.svg)

Each case has a quantity far from everyday numbers. A case is *sound* if no contact time is later than a contact that is possible. Single evaluations are compared with exact rational arithmetic. Whole ticks are compared with an adversary: an arm and a ball that run at each other within their bounds. *Tight* is the contact time over that contact. The adversary is not the best one, so a lower figure does not prove that an answer is loose. *Refused* is by an error or a STOP. `{command}` made this page. {facts}.
"""  # noqa: E501  # a paragraph of Markdown is one line


def write_page(
    lines: Sequence[Line],
    command: str,
    facts: Sequence[str],
    *,
    is_whole: bool = True,
    table: str = "",
) -> str:
    """The whole page.

    Args:
        lines: What was found.
        command: What was called.
        facts: Machine, versions and seed.
        is_whole: Whether no line is missing.
        table: Name of the file that has all cases; "": the page has them.
    """
    evaluations = [line for line in lines if line.note.endswith(EXACT)]
    ticks = [line for line in lines if not line.note.endswith(EXACT)]
    tights = [line.worst for line in ticks if math.isfinite(line.worst)]
    text = HEAD.format(
        command=command, summary=summarise(lines), facts=". ".join(facts),
        evaluation_tight=_share(_find_least(evaluations)), tick_worst=_share(_find_least(ticks)),
        tick_tight=_share(statistics.median(tights) if tights else math.nan),
        evaluation_price=_price(evaluations), tick_price=_price(ticks),
    )  # fmt: skip
    if not is_whole:
        text += "\nInterrupted: what is missing had not begun.\n"
    if ticks:
        groups = dict.fromkeys(line.group for line in ticks)
        rows = [_sum_up([line for line in ticks if line.group == group]) for group in groups]
        text += "\n" + _tabulate(("whole ticks", "cases", "sound", "tight at worst"), rows)
    if table:
        return f"{text}\n[{table}]({table}) has all cases.\n"
    return f"{text}\n## All cases\n\n" + _tabulate(HEADS, list_rows(lines), (0, 1, 2, 6))


def list_rows(lines: Iterable[Line]) -> list[list[str]]:
    """The table of all cases, whose heads are `HEADS`."""
    return [
        [line.group, line.case, line.outcome, _share(line.tight), _share(line.worst),
         _price([line]), line.note]
        for line in lines
    ]  # fmt: skip


def _tabulate(
    heads: Sequence[str], rows: Iterable[Sequence[str]], words: Collection[int] = (0,)
) -> str:
    return "\n".join(write_table(heads, rows, words)) + "\n"


def _sum_up(lines: list[Line]) -> list[str]:
    """The row of a group."""
    sound = sum(line.outcome == SOUND for line in lines)
    least = _share(_find_least(lines))
    return [lines[0].group, f"{len(lines)}", f"{sound}", least]


def _find_least(lines: Iterable[Line]) -> float:
    return min((line.worst for line in lines if math.isfinite(line.worst)), default=math.nan)


def _price(lines: Iterable[Line]) -> str:
    """The greatest."""
    prices = [line.price for line in lines if math.isfinite(line.price)]
    return f"{max(prices):.3g}" if prices else UNKNOWN


def summarise(lines: Sequence[Line]) -> str:
    """One sentence."""
    unsound = [f"{line.group} {line.case}" for line in lines if line.outcome == UNSOUND]
    refused = sum(line.outcome == REFUSED for line in lines)
    text = f"{len(lines)} cases: {len(lines) - refused - len(unsound)} sound, {refused} refused, "
    text += f"{len(unsound)} unsound."
    return f"{text} UNSOUND: {', '.join(unsound)}." if unsound else text


def _share(value: float) -> str:
    """A ratio, as many digits as tell it from 1."""
    if not math.isfinite(value):
        return UNKNOWN
    missing = 1.0 - value
    return f"1 − {missing:.0e}" if 0.0 < missing < 1e-3 else f"{value:.3f}"
