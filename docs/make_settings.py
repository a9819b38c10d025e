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
    "default", "finest", "operating none", "motion isotropic", "schedule full",
    "max_staleness 0.05", "max_staleness 0.25", "rate 100 Hz", "budget 16",
)  # fmt: skip
"""Settings of the table on the page; the CSV file has all."""

SHOWN = {"panda": ("core", "stop", "slow"), "ur10": ("core", "stop"), "near-1000": ("core", "slow")}
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

TRIALS = {
    "cell": "a [cell file](tradeoff/auto/cell/cell.toml), simulated person",
    "panda": "Panda, recorded person",
    "ur10": "UR10, simulated person",
    "near-1000": "Panda, 1,000 balls",
}
"""Of the reports on what trials chose."""

TEXT = """# Choosing settings

<!-- written by docs/make_settings.py from docs/tradeoff: change it there -->

- **State operating limits first.** Beside a recorded person, the arm is in STOP for {panda/operating none/stop} of the time without them, and for {panda/default/stop} with them.
- **Keep the default schedule.** Among 1,000 balls it takes {near-1000/default/core} of a core; evaluating everything takes {near-1000/schedule full/core}.
- **Lower the rate on a slow machine.** At 100 Hz, a cell takes {panda/rate 100 Hz/core} of a core instead of {panda/default/core}.

![Settings beside a recorded person: without operating limits the arm stops most; the default stops as often as the finest, for a twentieth of the processor time](pictures/prices.svg)

`armguard tradeoff` runs one scene through all settings with the same states, in turns of 0.1 s in one process, so that other load affects all alike. Every setting errs to the safe side: a cheaper one has shorter contact times and stops more. The arm moves at up to a fifth of its speeds, ignores verdicts, and keeps its published operating limits; only “operating none” does not know these. Ticks are at 1 kHz. “Core” is processor time with messages; compare it within a scene only.

## Results

<!-- figures -->

Scenes: a [Panda beside a recorded person](tradeoff/panda/README.md), a [UR10 and a simulated visitor](tradeoff/ur10/README.md), a [Panda among 1,000 balls](tradeoff/near-1000/README.md) from 1 m on. [figures.csv](settings/figures.csv) has all settings and columns. In a fourth scene, [balls touch the arm](tradeoff/contacts/README.md): no setting missed any of the {touches} contacts with bodies within their bounds.

- **Operating limits decide how often the arm stops**; the fineness of evaluation does not. So state limits that the controller enforces, and the payload.
- **Differences of a few percent of STOP are chance**: a STOP lasts at least 0.3 s (`rise_delay`), which is 2.5 % of a scene of 12 s.
- **The default** has the STOPs of the finest setting within about one point, for 3 to 20 % of its processor time. Its contact times can be a tenth shorter, so there is more SLOW, but hardly more work lost.
- **The rate** saves much. At 100 Hz, a STOP and the controller's answer come up to 10 ms later.

## What each setting does

| setting | cheaper | price |
|---|---|---|
| `robot.cover`, `robot.level` | fewer, larger spheres | a thicker arm |
| `motion` | `"isotropic"` | far more cautious; `"planned"` is dearer and stops less |
| `schedule` | `"deadline"` | none; `"full"` and `"daa"` are for comparison |
| `max_staleness` | higher; little above 0.1 | contact times shorter by up to this share |
| `rate` | lower | a STOP up to one period later |
| `budget` | bounds the dearest tick | cautious answers beyond it; choose it above `monitor.headroom()` |

## Measure your own

```sh
armguard tradeoff demos/cell.toml --person person.csv --seconds 20 --out tradeoff
armguard tradeoff --robot ur10 --axis cover motion
```

The summary names the cheapest setting that stops no more than the finest one.

## Settings that a trial chooses

```toml
settings = "auto"
settings_from = "yesterday.mcap" # a recording; left out: a simulated visit
robot = { name = "panda", operating = "published" }
```

At the start, a trial of about ten seconds chooses the cheapest settings whose verdicts match those of the finest (`schedule = "full"`, all of the cover): the same level in at least 99 % of the ticks, and speed scales within 0.01 on average. Otherwise it chooses the nearest. `armguard run` prints the choice with its reasons; the recording keeps it. In Python, use `armguard.Monitor.auto` with a list of `armguard.TrialTick`.

- The trial chooses `max_staleness`, `level`, `motion` (`joint` or `isotropic`), and a `budget` of four times the dearest tick, at least 5,000. Stated settings stay.
- The price is counted in evaluations, so the choice is the same on any machine.
- The trial uses the 4 s of the recording with the most changes of level, or 3 s of a simulated person. If these have one level, the defaults stay.
- No candidate watches less, so an unlike scene is judged more cautiously, never less safely. The choice names links that nothing came near.

On states that were not in the trial, compared with the finest ([trials.csv](settings/trials.csv) also has evaluations):

<!-- trials -->

If the levels between CLEAR and STOP matter less, keep the default.

## Three cells

- **Collaborative assembly**: state `operating`, `payload` and `[bounds.of]`; then `max_staleness = 0.05` or `settings = "auto"`. If drives react late, use `motion = "planned"`.
- **Bin picking with a depth camera**: send what moves, and make statics of the rest. Keep the rate: half of it takes {near-1000/rate 500 Hz/core} of a core, because each tick has more to do. `budget = 5000` bounds a tick.
- **Mobile arm with a small processor**: first `rate = 100.0`, which has STOP for {panda/rate 100 Hz/stop} of the time instead of {panda/default/stop}; then `level = 1`, which takes {panda/cover level 1/core} of a core.
"""


def write_page() -> str:
    """The page, in Markdown."""
    values = {"touches": str(count_contacts())}
    for scene, keys in SHOWN.items():
        for name, figures in read_figures(scene).items():
            values |= {f"{scene}/{name}/{key}": f"{figures[key]:.1%}" for key in keys}
    page = TEXT
    for name, value in values.items():
        page = page.replace(f"{{{name}}}", value)
    return page.replace("<!-- figures -->", tabulate_settings()).replace(
        "<!-- trials -->", tabulate_trials()
    )


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


def write_markdown(rows: list[list[str]]) -> str:
    """A table whose first row is its head; figures stand at the right."""
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([lines[0], f"|---|{'---:|' * (len(rows[0]) - 1)}", *lines[1:]])


def tabulate_settings() -> str:
    """The table of settings on the page."""
    shown = [(scene, key, read_figures(scene)) for scene, keys in SHOWN.items() for key in keys]
    heads = [f"{scene}: {key if key == 'core' else key.upper()}" for scene, key, _ in shown]
    rows = [[name, *(f"{figures[name][key]:.1%}" for _, key, figures in shown)] for name in ROWS]
    return write_markdown([["setting", *heads], *rows])


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


def tabulate_trials() -> str:
    """The table of trials on the page."""
    head = [
        "scene",
        "`max_staleness`, `level`",
        "same level",
        "time",
        "default: same level",
        "time",
    ]
    rows = [head]
    for name, stale, level, *shares in list_trials():
        scene = f"{TRIALS[name]} ([report](tradeoff/auto/{name}/README.md))"
        rows.append([scene, f"{stale}, {level}", shares[0], shares[2], shares[3], shares[5]])
    return write_markdown(rows)


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
