"""The figures of a page: `python docs/make_settings.py` fills docs/settings.md from docs/tradeoff.

A figure stands between the marks `<!-- figures: NAME -->` and `<!-- end of figures -->`, where NAME
is that of a report, for a table of its settings; "auto", for the table of what trials chose;
"touches", for the number of contacts; or REPORT/SETTING/FIGURE, for one figure.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parent
PAGE = DOCS / "settings.md"

BLOCK = re.compile(
    r"(?P<begin><!-- figures: (?P<name>[^>]+?) -->)(?P<old>.*?)(?P<end><!-- end of figures -->)",
    flags=re.DOTALL,
)

LEFT_OUT = {
    "cover level 1", "cover level 2",
    "schedule daa, fibonacci", "max_staleness 0.5", "rate 500 Hz", "budget 256",
}  # fmt: skip
"""Settings that a table leaves to its report."""

COLUMNS = {
    "tick, median [µs]": ("tick_p50", "{:.0f}"),
    "of a core": ("core", "{:.1%}"),
    "STOP": ("stop", "{:.1%}"),
    "SLOW": ("slow", "{:.1%}"),
    "work lost": ("work_lost", "{:.1%}"),
    "÷ finest": ("tight_finest", "{:.2f}"),
}

SCENES = {
    "cell": "Panda from a [cell file](tradeoff/auto/cell/cell.toml), a simulated person",
    "panda": "Panda beside the recorded person",
    "ur10": "UR10 and a simulated person",
    "near-1000": "Panda among 1,000 balls",
}
"""Of the reports on what trials chose."""


def fill_page(page: str) -> str:
    """The page with the figures of the reports as they are."""
    return BLOCK.sub(
        lambda block: block["begin"] + write_figures(block["name"]) + block["end"], page
    )


def write_figures(name: str) -> str:
    """What stands between the marks of some figures."""
    if name == "auto":
        return f"\n\n{_tabulate_choices()}\n\n"
    if name == "touches":
        contacts = _read("contacts")["contacts"]
        return f"{sum(not one['is_beyond'] for one in contacts)} contacts"
    report, *rest = name.split("/")
    figures = {one["name"]: one["figures"] for one in _read(report)["settings"]}
    if not rest:
        return f"\n\n{_tabulate_settings(figures)}\n\n"
    setting, figure = rest
    return f"{figures[setting][figure]:.1%}"


def _read(report: str) -> dict[str, Any]:
    content = (DOCS / "tradeoff" / report / "report.json").read_text(encoding="utf-8")
    data: dict[str, Any] = json.loads(content)
    return data


def _tabulate_settings(settings: dict[str, Any]) -> str:
    lines = [f"| setting | {' | '.join(COLUMNS)} |", f"|---|{'---:|' * len(COLUMNS)}"]
    for name, figures in settings.items():
        if figures is None or name in LEFT_OUT or name == "auto":
            continue
        cells = [
            "–" if figures[field] is None else form.format(figures[field])
            for field, form in COLUMNS.values()
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _tabulate_choices() -> str:
    shares = "same level | of the evaluations | of the time"
    lines = [
        f"| scene | `max_staleness`, level | {shares} | default: {shares} |",
        f"|---|---|{'---:|' * 6}",
    ]
    for name, scene in SCENES.items():
        data = _read(f"auto/{name}")
        figures = {one["name"]: one["figures"] for one in data["settings"]}
        settings, level = data["choice"]["settings"], data["choice"]["level"]
        fineness = "all" if level is None else str(level)
        cells = [
            f"{scene} ([{name}](tradeoff/auto/{name}/README.md))",
            f"{settings['max_staleness']:g}, {fineness}",
        ]
        for one in ("auto", "default"):
            cells.append(f"{figures[one]['same_level']:.1%}")
            cells += [
                f"{figures[one][price] / figures['finest'][price]:.1%}"
                for price in ("evaluated", "core")
            ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    PAGE.write_text(fill_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
