"""The figures of a page: `python docs/make_settings.py` fills docs/settings.md from docs/tradeoff.

It also draws docs/pictures/prices.svg.

A figure stands between the marks `<!-- figures: NAME -->` and `<!-- end of figures -->`, where NAME
is that of a report, for a table of its settings; "auto", for the table of what trials chose;
"touches", for the number of contacts; or REPORT/SETTING/FIGURE, for one figure.
"""

from __future__ import annotations

import json
import math
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
    "cover level 1", "cover level 2", "cover 80 mm", "motion distance",
    "schedule daa, fibonacci", "max_staleness 0.5", "rate 200 Hz", "rate 500 Hz",
    "budget 64", "budget 256",
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


def draw_prices() -> None:
    """The picture of the page: what each setting takes, and how often the arm stops by it."""
    from make_concepts import ARM, BODY, INK, PALE, Drawing

    settings = {one["name"]: one["figures"] for one in _read("panda")["settings"]}
    drawing, left, base, wide, tall = Drawing(780, 330), 70.0, 270.0, 640.0, 240.0
    low, high = 0.5, 0.7  # share of the time in STOP
    for share in (0.5, 0.55, 0.6, 0.65, 0.7):
        y = base - tall * (share - low) / (high - low)
        drawing.line([(left, y), (left + wide, y)], PALE)
        drawing.text(left - 8, y + 4, f"{share:.0%}", anchor="end")
    for core in (0.02, 0.1, 0.5, 2.5):
        x = left + wide * math.log(core / 0.02) / math.log(2.5 / 0.02)
        drawing.text(x, base + 22, f"{core:.0%}")
    drawing.text(left + wide / 2, base + 46, "share of a core, logarithmic")
    drawing.text(left, 18, "share of the time in STOP", anchor="start")
    named = {"operating none", "default", "finest", "rate 100 Hz", "motion isotropic"}
    for name, figures in settings.items():
        if figures is None or name in LEFT_OUT - {"rate 500 Hz"} or name == "auto":
            continue
        x = left + wide * math.log(figures["core"] / 0.02) / math.log(2.5 / 0.02)
        y = base - tall * (figures["stop"] - low) / (high - low)
        drawing.circle(x, y, 5.0, BODY if name in named else ARM, filled=name in named)
        if name in named:
            drawing.text(x, y + (22 if name == "default" else -10), name, fill=INK)
    drawing.save("prices.svg", "What settings take of a core, and how often the arm stops")


if __name__ == "__main__":
    draw_prices()
    PAGE.write_text(fill_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
