"""`armguard tradeoff`: runs one scene with all settings of the ladder, and writes a report."""

from __future__ import annotations

import math
from pathlib import Path

from armguard.app import cli
from armguard.app.cell.cell import Cell
from armguard.app.terminal import make_console, print_json
from armguard.exceptions import ArmguardError
from armguard.lab.pages import PAGE, make_folder, write_files, write_report, write_table
from armguard.lab.study_facts import list_facts, show_progress, tell_command
from armguard.lab.tradeoff.ladder import AUTO, check_axes
from armguard.lab.tradeoff.picture import PICTURE, can_draw, draw_price
from armguard.lab.tradeoff.report import LEGEND, describe, tabulate
from armguard.lab.tradeoff.scene import Site, find_published, make_scene
from armguard.lab.tradeoff.study import run_study
from armguard.lab.tradeoff.touching import add_touching
from armguard.lab.trial import SECONDS, make_visit
from armguard.monitor.settings import read_settings
from armguard.obstacles.obstacles import Obstacles
from armguard.robot.robot import Robot

ROBOT = "panda"

LONGEST = 3600.0
"""Of a scene, in [s]."""


def run(wishes: cli.Tradeoff) -> int:
    """Measure, write the report and print results to choose by; the exit code.

    Args:
        wishes: What the command line says.

    Raises:
        ArmguardError: Something is unusable.
        KeyboardInterrupt: It came before there was anything to show.
    """
    seed, seconds, out = wishes.seed, wishes.seconds, wishes.out
    balls, touching = wishes.obstacles, wishes.touching
    chosen = check_axes(wishes.axis)
    for option, count in (("--seed", seed), ("--obstacles", balls), ("--touching", touching)):
        if not count >= 0:
            raise ArmguardError(option, f"is {count}", expected="0 or more")
    if not 1.0 <= seconds <= LONGEST:
        raise ArmguardError("--seconds", f"is {seconds:g}", expected=f"1 to {LONGEST:g}")
    site = _make_site(wishes.cell, wishes.robot)
    recording = None if wishes.person is None else str(wishes.person)
    scene, what = make_scene(site, recording, balls, seconds, seed)
    if touching:
        what += f" and {add_touching(scene, site, touching, seed)}"
    trial = None
    if AUTO in chosen:
        if balls or recording is not None:
            # Other balls, or another part of the recording.
            trial = make_scene(site, recording, balls, SECONDS, seed + 1, 0.0)[0]
        else:
            trial = make_visit(site, seed + 1)
    make_folder(out)  # once nothing else can be a mistake: none leaves an empty folder
    with show_progress() as tell:
        study = run_study(site, scene, chosen, tell, trial)
    title = f"{site.robot.name} and {what}"
    facts = {
        "command": tell_command(),
        "operating": _tell_operating(wishes.cell, site),
        **list_facts(seed),
    }
    data = describe(study, title, facts)
    picture = ["A picture needs matplotlib, which `pip install 'armguard[plot]'` brings."]
    if can_draw():
        write_files(out, {PICTURE: draw_price(study)})
        picture = [f"![What settings cost, against how cautious they are]({PICTURE})"]
    write_report(
        out,
        f"What accuracy costs: {title}",
        [
            *picture,
            "",
            "## Settings",
            "",
            *(f"- {line}" for line in LEGEND),
            "",
            *write_table(*tabulate(study)),
        ],
        [
            f"Command: `{facts['command']}`",
            f"Scene: {title}, {study.seconds:g} s of it, seed {seed}",
            f"Operating limits of the default: {facts['operating']}",
            f"Machine: {facts['machine']}",
            f"Versions: {facts['versions']}",
        ],
        data,
    )
    console = make_console(soft_wrap=True)
    for line in data["summary"]:
        console.print(f"- {line.replace('**', '')}")
    console.print(f"wrote {out / PAGE}")
    print_json(lambda: data | {"wrote": out / PAGE})
    return 0


def _tell_operating(cell: Path | None, site: Site) -> str:
    if site.settings.get("operating") is None:
        return "none stated, so the hardware's limits are used"
    return "those published of the arm" if cell is None else "as the cell file states them"


def _make_site(cell: Path | None, robot: str | None) -> Site:
    if cell is None:
        arm = Robot.load(robot or ROBOT)
        published = find_published(arm)
        return Site(arm, Obstacles, {} if published is None else {"operating": published})
    if robot is not None:
        raise ArmguardError("--robot", "is given beside a cell file", expected="one of them")
    read = Cell.load(cell)
    arm = read.make_robot()
    settings = read.monitor_settings(arm)
    rate = read_settings(None, settings).rate
    if not math.isclose(rate * 0.1, round(rate * 0.1)):
        raise ArmguardError(
            f"{cell}: monitor.rate", f"is {rate:g}", expected="a multiple of 10 Hz for a study"
        )
    return Site(arm, read.make_obstacles, settings, tuple(read.sources), read.keeps_cover)
