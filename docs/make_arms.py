"""The page of arms that were tried: `python docs/make_arms.py` writes docs/arms.md.

Every URDF of example-robot-data that is an arm or has arms goes through what `armguard robot new
--yes` does, as it is; docs/arms.json keeps what came of it, so that a run goes on where
an earlier one ended. `python docs/make_arms.py NAME…` tries some of them anew.
"""

from __future__ import annotations

import importlib.metadata
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from armguard.app.new_robot.command import Wishes, make_folder
from armguard.app.new_robot.questions import Asker
from armguard.cover import Cover
from armguard.exceptions import ArmguardError
from armguard.robot import Robot
from armguard.robot.description import read_description

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

HEAD = f"""# Arms that were tried

<!-- written by docs/make_arms.py from docs/arms.json, which a run of it makes: change it there -->

Every URDF of [example-robot-data](https://pypi.org/project/example-robot-data/) that is an arm, or has arms, through

    armguard robot new FILE.urdf --out DIR --yes --spheres {SPHERES}

as it is, without any other option: what loads, with how many watched joints, links and spheres, and what is refused and why. Seconds are processor time on a shared machine: reading, deriving, fitting, proving, and loading it again. With `--yes` much is CHOSEN or DERIVED, so a row says that an arm loads, not that its description is right. At most {SPHERES} spheres a link keep the trial short; seven of these arms have covers of 20 mm in [covers](covers.md).
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


def try_arm(path: str) -> dict[str, Any]:
    """What comes of one URDF."""
    asker = Asker(None, takes_usual=True)
    begun = time.process_time()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "arm"
        try:
            wishes = Wishes(Path(path), folder, spheres=SPHERES, takes_usual=True)
            made = make_folder(wishes, None, asker)
        except ArmguardError as error:
            return {"refused": str(error)}
        if not made.report.proved:
            return {"refused": "its cover could not be proved"}
        Robot.load(folder)
        return read_folder(folder) | {"seconds": round(time.process_time() - begun, 1)}


def read_folder(folder: Path) -> dict[str, Any]:
    """What a folder that was written has."""
    description = read_description(folder / "robot.toml")
    cover = Cover.load(folder / "cover.json")
    return {
        "joints": len(description.joints),
        "locked": len(description.locked),
        "drawn": len(description.collision_from_visual),
        "links": len(cover.links),
        "spheres": sum(len(cover.spheres(link)) for link in cover.links),
    }


def write_page(rows: dict[str, dict[str, Any]]) -> str:
    """The page, in Markdown."""
    loaded = {path: row for path, row in rows.items() if "refused" not in row}
    refused = {path: row for path, row in rows.items() if "refused" in row}
    parts = [
        HEAD,
        f"## {len(loaded)} load\n",
        "| URDF | joints | locked | links | of them as drawn | spheres | seconds |",
        "|---|---|---|---|---|---|---|",
        *(
            f"| `{path}` | {row['joints']} | {row['locked']} | {row['links']} | {row['drawn']} | "
            f"{row['spheres']} | {row['seconds']:.0f} |"
            for path, row in sorted(loaded.items())
        ),
        f"\n## {len(refused)} are refused\n",
        "| URDF | why |",
        "|---|---|",
        *(
            f"| `{path}` | {row['refused'].replace('|', '/')} |"
            for path, row in sorted(refused.items())
        ),
        "\n## Not tried: no arms\n",
        ", ".join(f"`{name}` ({why})" for name, why in sorted(WITHOUT_ARMS.items())) + ".",
    ]
    return "\n".join(parts) + "\n"


def main() -> None:
    """Try what has not been tried, or what is named, and write the page."""
    rows = json.loads(ROWS.read_text(encoding="utf-8")) if ROWS.is_file() else {}
    arms = list_arms()
    wanted = [path for path in arms if Path(path).stem in sys.argv[1:]]
    for path in wanted or [path for path in arms if path not in rows]:
        rows[path] = try_arm(path)
        print(path, rows[path], flush=True)
        rows = {path: rows[path] for path in arms if path in rows}
        ROWS.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        PAGE.write_text(write_page(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
