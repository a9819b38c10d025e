"""How people in recordings move, part by part, and how often that breaks the bounds on them.

    python benchmarks/bench_people.py                         # print the table
    python benchmarks/bench_people.py --page docs/people.md   # put it into the page
    python benchmarks/bench_people.py mine-1.csv mine-2.csv   # measure people of your own

The first two read the recordings in the folder `ARMGUARD_RECORDINGS`.

Reads motion captures as Vicon exports them, at 25 Hz or more. `armguard.lab.people` says
which samples count and how accelerations are estimated.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from armguard.exceptions import ArmguardError
from armguard.lab.simulation.bodies import POINTS
from armguard.lab.simulation.recordings import read_vicon_csv
from armguard.people import BOUNDS, PartBounds, check_bounds, measure_motion

BEGIN = "<!-- made by benchmarks/bench_people.py -->"
END = "<!-- end of what benchmarks/bench_people.py made -->"
DEFAULTS = PartBounds(10.0, 2.0, 0.0, "of Obstacles")
TRUNK = {"collar": "trunk", "hip": "trunk"}
PARTS = [TRUNK.get(point, point.rpartition("_")[2]) for point in POINTS]


def make_tables(paths: Sequence[Path]) -> str:
    """What was measured, as Markdown."""
    recordings = [(path.stem, *read_vicon_csv(path)) for path in paths]
    motions = [measure_motion(points, rate) for _, rate, points in recordings]
    noise = np.concatenate([motion.noise for motion in motions])
    pairs = [(motion, PARTS) for motion in motions]
    with_defaults = check_bounds(pairs, dict.fromkeys(BOUNDS, DEFAULTS))
    seconds = sum(len(points) / rate for _, rate, points in recordings)
    names = ", ".join(name for name, _, _ in recordings)
    lines = [
        f"{len(recordings)} recordings ({names}), {seconds:.0f} s. Noise in accelerations:"
        f" {np.nanmedian(noise):.2f} m/s² median, {np.nanmax(noise):.2f} m/s² at most.",
        "",
        "| part | bounds [m/s², m/s] | p99.9, max [m/s²] | p99.9, max [m/s]"
        " | beyond bounds [%] | beyond 10 m/s² [%] | beyond 2 m/s [%] |",
        "|---|---|---|---|---|---|---|",
    ]
    for part, report in check_bounds(pairs).items():
        bound, usual = BOUNDS[part], with_defaults[part]
        shares = [report.broken, usual.accel_broken, usual.speed_broken]
        cells = [
            part,
            f"{bound.accel:g}, {bound.speed:g}",
            f"{report.accel[1]:.1f}, {report.accel[2]:.1f}",
            f"{report.speed[1]:.2f}, {report.speed[2]:.2f}",
            *(f"{100.0 * share:.2f}" for share in shares),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def put_into_page(page: Path, tables: str) -> None:
    """Replace what stands between the marks of a page."""
    text = page.read_text(encoding="utf-8")
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ArmguardError(str(page), "lacks the marks around the tables", expected=f"{BEGIN} …")
    page.write_text(f"{before}{BEGIN}\n\n{tables}\n\n{END}{after}", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, and print or write the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recordings", nargs="*", type=Path, help="Vicon CSV files")
    parser.add_argument("--page", type=Path, help="page to put the tables into")
    options = parser.parse_args(arguments)
    paths = options.recordings
    if not paths:
        folder = Path(os.environ.get("ARMGUARD_RECORDINGS", ""))
        paths = sorted(folder.glob("*.csv")) if folder.name else []
    if not paths:
        print("no recordings: name files, or set ARMGUARD_RECORDINGS", file=sys.stderr)
        return 2
    try:
        tables = make_tables(paths)
        if options.page is None:
            print(tables)
        else:
            put_into_page(options.page, tables)
    except (ArmguardError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
