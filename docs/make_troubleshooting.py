"""The page of all reasons: `python docs/make_troubleshooting.py` writes docs/troubleshooting.md."""

from __future__ import annotations

from pathlib import Path

from armguard.verdict import Effect, ReasonKind

PAGE = Path(__file__).resolve().parent / "troubleshooting.md"

HEAD = """# It says STOP: what now

<!-- written by docs/make_troubleshooting.py from armguard.ReasonKind: change it there -->

Every verdict says why, the weightiest reason first: `verdict.reasons`, the page in the browser, the
last lines of `armguard run`, and afterwards `armguard replay FILE.mcap --explain TIME`. Each reason
has a kind, what it is about, and a detail with the value found and the value expected. In code the
advice below is `reason.kind.remedy`.
"""

SECTIONS = {
    Effect.STANDING: (
        "Reasons that stop the arm while they last",
        "The level rises again by itself, `rise_delay` seconds (0.3 s) after their cause has gone.",
    ),
    Effect.LATCHED: (
        "Reasons that stop the arm until a reset",
        "See that the cause has gone, then `monitor.reset()`, or `armguard reset ADDRESS --token TOKEN` "
        "with the token that `armguard run --reset-token` was given. The command says whether the monitor has obeyed.",
    ),
    Effect.NOTE: (
        "Reasons that explain, and stop nothing by themselves",
        "A STOP with none but these is one by contact: the deciding pair could touch before the "
        "arm rests.",
    ),
}


def write_page() -> str:
    """The page, in Markdown."""
    parts = [HEAD]
    for effect, (title, words) in SECTIONS.items():
        rows = [f"| {kind.text} | {kind.remedy} |" for kind in ReasonKind if kind.effect is effect]
        parts.append("\n".join([f"## {title}\n\n{words}\n", "| reason | what to do |",
                                "| --- | --- |", *rows]) + "\n")  # fmt: skip
    return "\n".join(parts)


if __name__ == "__main__":
    PAGE.write_text(write_page(), encoding="utf-8")
