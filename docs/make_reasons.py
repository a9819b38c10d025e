"""The page of all reasons: `python docs/make_reasons.py` writes docs/reasons.md."""

from __future__ import annotations

from pathlib import Path

from armguard.verdict import Effect, ReasonKind

PAGE = Path(__file__).resolve().parent / "reasons.md"

HEAD = """# Reasons

<!-- written by docs/make_reasons.py from armguard.ReasonKind: change it there -->

Every reason that a verdict can have, and what to do about it. In code, the advice is `reason.kind.remedy`. [Troubleshooting a STOP](troubleshooting.md) says where to find the reasons.
"""

SECTIONS = {
    Effect.STANDING: (
        "Reasons that stop the arm while they last",
        "The level rises `rise_delay` (0.3 s) after their cause has gone.",
    ),
    Effect.LATCHED: (
        "Reasons that stop the arm until a reset",
        "Remove the cause, then reset: `monitor.reset()`, or `armguard reset ADDRESS --token TOKEN` with the token of `armguard run --reset-token`. The command says whether the monitor obeyed.",
    ),
    Effect.NOTE: (
        "Reasons that explain, and stop nothing by themselves",
        "If a STOP has no other reasons, the deciding pair could touch before the arm is at rest.",
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
