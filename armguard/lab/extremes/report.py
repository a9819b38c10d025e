"""What became of each case at the extremes, and the page that tells it, in Markdown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from armguard.lab.pages import UNKNOWN, list_lines, write_table

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


HEADS, WORDS = ("case", "outcome", "tight", "worst", "price, µs", ""), (0, 1, 5)
"""Of the table, and which of its columns are of words."""

HEAD = """# At the extremes

{summary} `{command}` wrote this page.

- **Sound**: no contact time is later than a contact that is possible. Single evaluations are compared with exact rational arithmetic. Whole ticks are compared with an adversary: an arm and a ball that run at each other within their bounds.
- **Tight**: contact time over that contact, in the median and in the worst case of the line. The adversary is not the best one, and knows the true surface, not the cover. So a lower figure does not prove that an answer is loose.
- **Price**: processor time of one evaluation, or of one tick after the first.
- **Refused**: by an error, or by a STOP, with its reason.
"""  # noqa: E501  # a paragraph of Markdown is one line


def write_page(
    lines: Sequence[Line], command: str, facts: Sequence[str], *, is_whole: bool = True
) -> str:
    """The whole page.

    Args:
        lines: What was found.
        command: What was called.
        facts: Machine, versions and seed.
        is_whole: Whether no line is missing.
    """
    text = HEAD.format(command=command, summary=summarise(lines))
    if not is_whole:
        text += "\nInterrupted: what is missing had not begun.\n"
    for group in dict.fromkeys(line.group for line in lines):
        text += f"\n## {group.capitalize()}\n\n"
        rows = [_list_cells(line) for line in lines if line.group == group]
        text += "\n".join(write_table(HEADS, rows, WORDS)) + "\n"
    return f"{text}\n{list_lines(facts)}"


def summarise(lines: Sequence[Line]) -> str:
    """One sentence."""
    unsound = [f"{line.group} {line.case}" for line in lines if line.outcome == UNSOUND]
    refused = sum(line.outcome == REFUSED for line in lines)
    text = f"{len(lines)} cases: {len(lines) - refused - len(unsound)} sound, {refused} refused, "
    text += f"{len(unsound)} unsound."
    return f"{text} UNSOUND: {', '.join(unsound)}." if unsound else text


def _list_cells(line: Line) -> list[str]:
    price = f"{line.price:.3g}" if math.isfinite(line.price) else UNKNOWN
    return [line.case, line.outcome, _share(line.tight), _share(line.worst), price, line.note]


def _share(value: float) -> str:
    """A ratio, as many digits as tell it from 1."""
    if not math.isfinite(value):
        return UNKNOWN
    missing = 1.0 - value
    return f"1 − {missing:.0e}" if 0.0 < missing < 1e-3 else f"{value:.3f}"
