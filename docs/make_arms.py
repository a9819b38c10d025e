"""The page of arms that were tried: `python docs/make_arms.py` writes docs/arms.md.

Every URDF of example-robot-data that is an arm or has arms goes through what `armguard robot new
--yes` does, as it is; docs/arms.json keeps what came of it, so that a run goes on where
an earlier one ended. `python docs/make_arms.py NAME…` tries some of them anew.
"""

from __future__ import annotations

import importlib.metadata
import json
import re
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from armguard.app.cli import NewRobot
from armguard.exceptions import ArmguardError
from armguard.lab.new_robot.command import NO_PLANNING, make_folder, prepare
from armguard.lab.new_robot.questions import Asker
from armguard.robot import Robot

FOLDER = Path(__file__).resolve().parent
PAGE, ROWS = FOLDER / "arms.md", FOLDER / "arms.json"

WITHOUT_ARMS = {
    "a1.urdf": "four legs",
    "alexander_v1.lowerBodyOnly.urdf": "two legs",
    "allegro_left_hand.urdf": "a hand",
    "allegro_right_hand.urdf": "a hand",
    "anymal.urdf": "four legs",
    "b1.urdf": "four legs",
    "bolt.urdf": "two legs",
    "finger_edu.urdf": "a finger",
    "go1.urdf": "four legs",
    "go2.urdf": "four legs",
    "hyq_no_sensors.urdf": "four legs",
    "iris.urdf": "flies",
    "iris_simple.urdf": "flies",
    "laikago.urdf": "four legs",
    "quadrotor_base.urdf": "flies",
    "quadruped.urdf": "four legs",
    "solo.urdf": "four legs",
    "solo12.urdf": "four legs",
}
"""File names of the URDFs that are not tried, and why."""

SPHERES = 4
"""At most so many a link, so that a trial is about loading more than about fitting."""

MOST_LINKS = 14
"""Robots with more are described and read, and not fitted: each would take many minutes."""

HEAD = f"""# Tested arms

<!-- written by docs/make_arms.py from docs/arms.json, which a run of it makes: change it there -->

    armguard robot new FILE.urdf --out DIR --yes --spheres {SPHERES}

ran on every URDF of [example-robot-data](https://pypi.org/project/example-robot-data/) that has an arm, without other options. `--yes` takes CHOSEN or DERIVED values. So a name here shows that armguard can read the URDF, not that its limits are right. Robots of more than {MOST_LINKS} links were read only, because fitting takes many minutes. Legs, hands and drones alone were not tried. [arms.json](arms.json) has joints, links, spheres and times of each.
"""


def list_urdfs() -> list[str]:
    """All URDFs of the distribution, as paths below its `robots/`."""
    found = set()
    for file in importlib.metadata.files("example-robot-data") or ():
        if file.parts[-1].endswith(".urdf") and "robots" in file.parts:
            found.add("/".join(file.parts[file.parts.index("robots") + 1 :]))
    return sorted(found)


def list_arms() -> list[str]:
    """Those that are tried."""
    return [path for path in list_urdfs() if Path(path).name not in WITHOUT_ARMS]


def read_arm(path: str) -> dict[str, Any]:
    """What comes of one URDF until its cover would be fitted."""
    begun = time.process_time()
    with tempfile.TemporaryDirectory() as scratch:
        try:
            asker = Asker(None, takes_usual=True)
            new, _, robot, _ = prepare(make_wishes(path, scratch), NO_PLANNING, asker)
        except ArmguardError as error:
            return {"refused": describe_refusal(error)}
    return {
        "joints": len(robot.joints),
        "locked": len(new.locked),
        "links": len(robot.links),
        "drawn": len(new.collision_from_visual),
        "described": round(time.process_time() - begun, 1),
    }


def fit_arm(path: str) -> dict[str, Any]:
    """What comes of its cover."""
    begun = time.process_time()
    with tempfile.TemporaryDirectory() as scratch:
        wishes = make_wishes(path, scratch)
        try:
            _, report = make_folder(wishes, NO_PLANNING, Asker(None, takes_usual=True))
        except ArmguardError as error:
            return {"refused": describe_refusal(error)}
        if not report.proved:
            return {"refused": "its cover could not be proved"}
        robot = Robot.load(wishes.out)
    spheres = sum(len(robot.cover.spheres(link)) for link in robot.links)
    return {"spheres": spheres, "fitted": round(time.process_time() - begun, 1)}


def describe_refusal(error: ArmguardError) -> str:
    """What is wrong, with paths as the package has them."""
    return re.sub(r"/\S*/example-robot-data/robots/", "", str(error))


def make_wishes(path: str, scratch: str) -> NewRobot:
    """What the command line says in each trial."""
    return NewRobot("new", Path(path), Path(scratch) / "arm", spheres=SPHERES, yes=True)


def write_page(rows: dict[str, dict[str, Any]]) -> str:
    """The page, in Markdown."""
    loaded = {path: row for path, row in rows.items() if "refused" not in row}
    refused = {path: row for path, row in rows.items() if "refused" in row}
    fitted = sorted(path for path, row in loaded.items() if "spheres" in row)
    read = sorted(path for path in loaded if path not in fitted)
    parts = [
        HEAD,
        f"## {len(fitted)} were read, fitted, proved and loaded\n",
        f"{list_names(fitted)}\n",
        f"## {len(read)} were read\n",
        f"{list_names(read)}\n",
        f"## {len(refused)} were refused\n",
        *(
            f"- `{Path(path).stem}`: {shorten(row['refused'])}"
            for path, row in sorted(refused.items())
        ),
    ]
    return "\n".join(parts) + "\n"


def shorten(refusal: str) -> str:
    """What is wrong, without the offender and the remedy."""
    problem = refusal.split(": ")[1].partition(";")[0]
    return f"{problem}.".replace("<robot>", "`<robot>`")


def list_names(paths: list[str]) -> str:
    """File names without their ending, in Markdown."""
    return ", ".join(f"`{Path(path).stem}`" for path in paths) + "."


def main() -> None:
    """Try what has not been tried, or what is named, and write the page."""
    rows = json.loads(ROWS.read_text(encoding="utf-8")) if ROWS.is_file() else {}
    arms = list_arms()
    named = [path for path in arms if Path(path).stem in sys.argv[1:]]
    rows = {path: row for path, row in rows.items() if path in arms and path not in named}
    for path in [path for path in arms if path not in rows]:
        rows[path] = read_arm(path)
        keep(rows)
        print(path, rows[path], flush=True)
    for path, row in rows.items():
        if "refused" in row or "spheres" in row or row["links"] > MOST_LINKS:
            continue
        row |= fit_arm(path)
        keep(rows)
        print(path, row, flush=True)


def keep(rows: dict[str, dict[str, Any]]) -> None:
    """Write what is known so far."""
    ROWS.write_text(json.dumps(dict(sorted(rows.items())), indent=1) + "\n", encoding="utf-8")
    PAGE.write_text(write_page(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
