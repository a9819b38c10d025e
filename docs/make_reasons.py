"""The page of all reasons: `python docs/make_reasons.py` writes docs/reasons.md."""

from __future__ import annotations

from pathlib import Path

from armguard.verdict import Effect, ReasonKind

PAGE = Path(__file__).resolve().parent / "reasons.md"

HEAD = """# Reasons

<!-- written by docs/make_reasons.py -->

Every reason of a verdict, its name in messages, and its remedy (`reason.kind.remedy`).
"""

RESET = " Then reset."
SECTIONS = {
    Effect.STANDING: (
        "STOP while it lasts",
        "The level rises `rise_delay` (0.3 s) after the cause has gone.",
    ),
    Effect.LATCHED: (
        "STOP until a reset",
        "Use `monitor.reset()`, or `armguard reset ADDRESS --token TOKEN`.",
    ),
    Effect.NOTE: (
        "Notes",
        "Notes stop nothing. A STOP with notes alone means that the deciding pair could touch before the arm is at rest.",
    ),
}


def write_page() -> str:
    """The page, in Markdown."""
    parts = [HEAD]
    for effect, (title, words) in SECTIONS.items():
        rows = [
            f"- **{kind.text}** (`{kind.name.lower()}`): {kind.remedy.removesuffix(RESET)}"
            for kind in ReasonKind
            if kind.effect is effect
        ]
        parts.append("\n".join([f"## {title}\n\n{words}\n", *rows]) + "\n")
    return "\n".join(parts)


if __name__ == "__main__":
    PAGE.write_text(write_page(), encoding="utf-8")
