"""The page on settings: `python docs/make_settings.py` writes docs/settings.md from docs/tradeoff.

It also writes docs/settings/figures.csv and trials.csv, with all that the reports have of each
setting and trial, and draws docs/pictures/prices.svg.
"""

from __future__ import annotations

import csv
import io
import json
import math
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parent
PAGE = DOCS / "settings.md"
TABLES = DOCS / "settings"

SCENES = ("panda", "ur10", "near-1000", "contacts")
"""Reports on all settings."""

ROWS = (
    "default", "finest", "operating none", "motion isotropic", "rate 100 Hz",
)  # fmt: skip
"""Settings of the table on the page; the CSV file has all."""

SHOWN = {"panda": ("core", "stop"), "near-1000": ("core",)}
"""Scenes and figures of the table on the page."""

COLUMNS = {
    "tick, median [µs]": ("tick_p50", "{:.0f}"),
    "of a core": ("core", "{:.1%}"),
    "STOP": ("stop", "{:.1%}"),
    "SLOW": ("slow", "{:.1%}"),
    "work lost": ("work_lost", "{:.1%}"),
    "contact time / finest": ("tight_finest", "{:.2f}"),
}
"""Of figures.csv."""

UNDRAWN = {
    "cover level 1", "cover level 2", "cover 80 mm", "motion distance",
    "schedule daa, fibonacci", "max_staleness 0.5", "rate 200 Hz", "budget 64", "budget 256",
    "auto",
}  # fmt: skip
"""Settings that the picture leaves to the CSV file."""

TRIALS = "cell", "panda", "ur10", "near-1000"
"""Reports on what trials chose."""

TEXT = """# Choosing settings

<!-- written by docs/make_settings.py from docs/tradeoff: change it there -->

- **State operating limits first.** Beside a recorded person, the arm is in STOP for {panda/operating none/stop} of the time without them, and for {panda/default/stop} with them.
- **Keep the default schedule.** Among 1,000 balls a tick takes {tick} µs in the median, and {near-1000/default/core} of a core; evaluating everything takes {near-1000/schedule full/core}.
- **Lower the rate on a slow machine.** At 100 Hz, a cell takes {panda/rate 100 Hz/core} of a core instead of {panda/default/core}, and a STOP comes up to 10 ms later.

![Share of the time in STOP and of a core, by setting](pictures/prices.svg)

`armguard tradeoff` runs one scene through all settings with the same states, at 1 kHz. Every setting errs to the safe side: a cheaper one has shorter contact times and stops more. The arm moves at up to a fifth of its speeds, ignores verdicts, and keeps its published operating limits; only “operating none” does not know these. “Core” is processor time with messages.

<!-- figures -->

The reports name machine and version: a [Panda beside a recorded person](tradeoff/panda/README.md), a [UR10 and a simulated visitor](tradeoff/ur10/README.md), a [Panda among 1,000 balls](tradeoff/near-1000/README.md). [figures.csv](settings/figures.csv) has all settings. In a fourth scene, [balls touch the arm](tradeoff/contacts/README.md): no setting missed any of the {touches} contacts with bodies within their bounds. A difference of a few percent of STOP is chance, because a STOP lasts at least 0.3 s of the 12 s of a scene.

## What each setting does

| setting | cheaper | price |
|---|---|---|
| `robot.cover`, `robot.level` | fewer, larger spheres | a thicker arm |
| `motion` | `"isotropic"` | more STOP; `"planned"` is dearer and stops less |
| `max_staleness` | higher, up to 0.1 | contact times shorter by up to this share |
| `budget` | bounds the dearest tick | cautious answers; choose it above `monitor.headroom()` |

Measure your own cell:

```sh
armguard tradeoff demos/cell.toml --person person.csv --seconds 20 --out tradeoff
```

## Settings that a trial chooses

```toml
settings = "auto"
settings_from = "yesterday.mcap" # a recording; left out: a simulated visit
```

At the start, a trial of about ten seconds chooses the cheapest settings whose verdicts match those of the finest: the same level in at least 99 % of the ticks. Otherwise it chooses the nearest. It chooses `max_staleness`, `level`, `motion` and `budget`; stated settings stay. `armguard run` prints the choice with its reasons, and the recording keeps it. In Python, use `armguard.Monitor.auto` with a list of `armguard.TrialTick`.

The price is counted in evaluations, so the choice is the same on any machine. No candidate watches less, so an unlike scene is judged more cautiously, never less safely. On states that were not in the trial, the choices have the level of the finest setting in {least} of the ticks or more, and the default in {default} or more ([trials.csv](settings/trials.csv)).
"""


def write_page() -> str:
    """The page, in Markdown."""
    trials = [read_figures(f"auto/{name}") for name in TRIALS]
    values = {
        "touches": str(count_contacts()),
        "tick": f"{read_figures('near-1000')['default']['tick_p50']:.0f}",
        "least": f"{min(one['auto']['same_level'] for one in trials):.1%}",
        "default": f"{min(one['default']['same_level'] for one in trials):.1%}",
    }
    for scene, keys in SHOWN.items():
        for name, figures in read_figures(scene).items():
            values |= {f"{scene}/{name}/{key}": f"{figures[key]:.1%}" for key in keys}
    page = TEXT
    for name, value in values.items():
        page = page.replace(f"{{{name}}}", value)
    return page.replace("<!-- figures -->", tabulate_settings())


def read_report(name: str) -> dict[str, Any]:
    """A report of `armguard tradeoff`, by its folder."""
    content = (DOCS / "tradeoff" / name / "report.json").read_text(encoding="utf-8")
    data: dict[str, Any] = json.loads(content)
    return data


def read_figures(name: str) -> dict[str, dict[str, Any]]:
    """The figures of a report, by setting."""
    settings = read_report(name)["settings"]
    return {one["name"]: one["figures"] for one in settings if one["figures"] is not None}


def count_contacts() -> int:
    """How many contacts a monitor that never says STOP would miss."""
    return sum(not one["is_beyond"] for one in read_report("contacts")["contacts"])


def tabulate_settings() -> str:
    """The table of settings on the page, in Markdown; figures stand at the right."""
    shown = [(scene, key, read_figures(scene)) for scene, keys in SHOWN.items() for key in keys]
    heads = [f"{scene}: {key if key == 'core' else key.upper()}" for scene, key, _ in shown]
    rows = [[name, *(f"{figures[name][key]:.1%}" for _, key, figures in shown)] for name in ROWS]
    lines = [f"| {' | '.join(row)} |" for row in [["setting", *heads], *rows]]
    return "\n".join([lines[0], f"|---|{'---:|' * len(shown)}", *lines[1:]])


def list_trials() -> list[list[str]]:
    """What each trial chose: scene, settings, and shares of the choice and of the default."""
    rows = []
    for name in TRIALS:
        data, figures = read_report(f"auto/{name}"), read_figures(f"auto/{name}")
        settings, level = data["choice"]["settings"], data["choice"]["level"]
        row = [name, f"{settings['max_staleness']:g}", "all" if level is None else str(level)]
        for one in ("auto", "default"):
            row.append(f"{figures[one]['same_level']:.1%}")
            for price in ("evaluated", "core"):
                row.append(f"{figures[one][price] / figures['finest'][price]:.1%}")
        rows.append(row)
    return rows


def write_figures() -> str:
    """figures.csv: all settings of all scenes."""
    rows = [["scene", "setting", *COLUMNS]]
    for scene in SCENES:
        for name, figures in read_figures(scene).items():
            cells = (
                "" if figures[field] is None else form.format(figures[field])
                for field, form in COLUMNS.values()
            )
            rows.append([scene, name, *cells])
    return _write_csv(rows)


def write_trials() -> str:
    """trials.csv: what each trial chose."""
    shares = [
        f"{one}: {share}"
        for one in ("auto", "default")
        for share in ("same level", "evaluations / finest", "time / finest")
    ]
    return _write_csv([["scene", "max_staleness", "level", *shares], *list_trials()])


def _write_csv(rows: list[list[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def draw_prices() -> None:
    """The picture of the page: what each setting takes, and how often the arm stops by it."""
    from make_concepts import ARM, BODY, INK, PALE, Drawing

    settings = read_figures("panda")
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
        if name in UNDRAWN:
            continue
        x = left + wide * math.log(figures["core"] / 0.02) / math.log(2.5 / 0.02)
        y = base - tall * (figures["stop"] - low) / (high - low)
        drawing.circle(x, y, 5.0, BODY if name in named else ARM, filled=name in named)
        if name in named:
            drawing.text(x, y + (22 if name == "default" else -10), name, fill=INK)
    drawing.save("prices.svg", "What settings take of a core, and how often the arm stops")


if __name__ == "__main__":
    draw_prices()
    TABLES.mkdir(exist_ok=True)
    (TABLES / "figures.csv").write_text(write_figures(), encoding="utf-8")
    (TABLES / "trials.csv").write_text(write_trials(), encoding="utf-8")
    PAGE.write_text(write_page(), encoding="utf-8")
