"""`armguard cover`: fits, proves and writes covers, and exchanges them with other tools.

It works on a known robot, or on any other URDF. A URDF without limits is sufficient, since only
geometry matters.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from armguard.app import cli
from armguard.app.terminal import make_console, make_table, print_json
from armguard.cover.cover import DEFAULT_PROTRUSION, Cover
from armguard.cover.inflation import Gap, inflate_spheres, measure_gaps
from armguard.cover.interchange import (
    YAML_ENDINGS,
    place_spheres,
    read_spheres,
    write_curobo,
    write_spherized_urdf,
)
from armguard.cover.report import CoverReport, LinkReport
from armguard.exceptions import CoverError, RobotError
from armguard.jit.progress import following
from armguard.lab.pages import make_folder
from armguard.robot.description import (
    COVER,
    DESCRIPTION,
    find_robot,
    is_known,
    list_robots,
    locate_urdf,
    read_description,
)
from armguard.robot.links import UrdfLinks
from armguard.robot.robot import Robot, read_described

TOLERANCE = 0.1  # rounding and margins of radii stay below this, in [mm]
UNPROVED = 1
"""Exit code if a cover does not contain the robot."""


class Target:
    """A robot as far as covers go, and where it comes from.

    Args:
        name: A robot that armguard knows, the folder of one of your own, or the path of a URDF.
        limits: A robot.toml for that URDF: says which joints move. None: all do.
        package_dirs: Folders in which `package://` mesh names are looked up, besides those
            that the URDF lies in.

    Attributes:
        robot: With links, surfaces and a model.
        urdf: Its URDF.
        folders: In which its packages are looked up.
        is_known: Whether it is one that armguard knows.
        cover: Where its proved cover is kept; None for a URDF.
    """

    robot: Robot | UrdfLinks

    def __init__(
        self, name: str, limits: Path | None = None, package_dirs: Sequence[Path] = ()
    ) -> None:
        self.cover: Path | None = None
        self.is_known = is_known(name)
        self.folders: list[Path]
        if Path(name).suffix != ".urdf" and not os.path.isfile(name):
            try:
                directory = find_robot(name)
            except RobotError as error:
                raise RobotError(
                    name,
                    "is neither a URDF nor a robot that armguard knows",
                    expected=error.expected and f"a file, or {error.expected}",
                    remedy=error.remedy,
                ) from error
            description = read_description(directory / DESCRIPTION)
            self.cover = directory / COVER
            self.urdf, self.folders = locate_urdf(directory, description)
            title = directory.resolve().name
        else:
            self.urdf = Path(name)
            self.folders = [*package_dirs, *self.urdf.resolve().parents]
            if limits is None:
                self.robot = UrdfLinks(self.urdf, self.folders)
                return
            description = read_description(limits)
            title = self.urdf.stem
        urdf = read_described(self.urdf, self.folders, description)
        self.robot = Robot(title, urdf, description, list(description.joints))

    def load_cover(self, option: str) -> Cover:
        """The proved cover that is kept of it.

        Args:
            option: What asks for it.

        Raises:
            CoverError: There is none, or it is damaged or of another robot.
        """
        if self.cover is None:
            raise CoverError(option, "needs a robot that armguard knows", expected="its name")
        cover = Cover.load(self.cover)
        cover.verify(self.robot)
        return cover


def run(wishes: cli.Cover) -> int:
    """Do what the options of `armguard cover` ask for; the exit code.

    Args:
        wishes: What the command line says.

    Raises:
        ArmguardError: They contradict each other, or something that they name is unusable.
    """
    out, inflate, file = wishes.out, wishes.inflate, wishes.spheres_from
    kinds = {"--check": wishes.check, "--import": file, "--export": wishes.export}
    asked = [option for option, is_asked in kinds.items() if is_asked]
    if len(asked) > 1:
        raise CoverError(" and ".join(asked), "exclude each other")
    if asked and (wishes.spheres is not None or wishes.protrusion is not None):
        raise CoverError(asked[0], "fits nothing", remedy="leave out --spheres and --protrusion")
    if inflate and file is None:
        raise CoverError("--inflate", "needs spheres", expected="--import FILE")
    if out is not None and asked and not inflate:
        raise CoverError("--out", "has nothing to be written", remedy="leave it out")
    if out is None and not asked:
        raise CoverError("--out", "is missing", expected="the folder to write cover.json into")
    target = Target(wishes.robot, wishes.limits, wishes.package_dirs)
    if wishes.check:
        return prove(target)
    if wishes.export is not None:
        return write(target, wishes.export)
    if file is not None:
        return exchange(target, file, inflate, out)
    return fit(target, wishes.spheres, wishes.protrusion, Path(out or "."))


def fit(target: Target, spheres: int | None, protrusion: float | None, folder: Path) -> int:
    """Fit a cover, prove it, write it and show what it is like; the exit code.

    Args:
        target: What to cover.
        spheres: At most so many leaves a link, or
        protrusion: how far they may stick out, in [mm]; neither: `DEFAULT_PROTRUSION`.
        folder: Where to write `cover.json`; made if it is not there.
    """
    robot = target.robot
    if isinstance(robot, UrdfLinks) and robot.bare:
        _print(f"drawn without collision geometry, NOT covered: {', '.join(robot.bare)}")
    make_folder(folder)
    cover = fit_cover(robot, spheres, protrusion)
    report = cover.check(robot)
    code = _finish(cover, report, folder)
    if spheres is None:
        show_protruding(report, protrusion)
    return code


def fit_cover(robot: Robot | UrdfLinks, spheres: int | None, protrusion: float | None) -> Cover:
    """Fit and prove a cover; a terminal is shown how far it is.

    Args:
        robot: Whose links to cover.
        spheres: At most so many leaves a link, or
        protrusion: how far they may stick out, in [mm]; neither: `DEFAULT_PROTRUSION`.

    Raises:
        CoverError: As `Cover.fit` does.
    """
    metres = None if protrusion is None else 1e-3 * protrusion
    with following("fitting spheres to link", len(robot.links)) as begin:
        return Cover.fit(robot, spheres=spheres, protrusion=metres, on_link=begin)


def prove(target: Target) -> int:
    """Prove a known robot's cover again, and show it; the exit code."""
    cover = target.load_cover("--check")
    return _finish(cover, cover.check(target.robot), None)


def exchange(target: Target, file: Path, inflate: bool, folder: Path | None) -> int:
    """Show what another tool's spheres leave uncovered; if asked, make a cover of them.

    Args:
        target: Whose spheres they should be.
        file: cuRobo's YAML or a spherized URDF.
        inflate: Grow them into a proved cover.
        folder: Where to write that cover; None: it is only shown.

    Returns:
        The exit code: `UNPROVED` if they do not cover the robot and were not inflated.
    """
    robot, read = target.robot, read_spheres(file)
    spheres = place_spheres(robot, read)
    gaps = measure_gaps(robot, spheres)
    _print(_tabulate_gaps(gaps))
    others = sorted(set(read) - set(robot.links))
    if others:
        _print(f"not watched, left out: {', '.join(others)}")
    covered = all(gap.proved for gap in gaps.values())
    found = {"gaps": gaps, "not_watched": others}
    if not inflate:
        _print("covers the robot: proved" if covered else "does not cover the robot")
        print_json(lambda: {"proved": covered} | found)
        return 0 if covered else UNPROVED
    cover = inflate_spheres(robot, spheres)
    report = cover.check(robot)
    for link, rows in spheres.items():
        kept = np.unique(cover.spheres(link)[:, :3], axis=0)
        if len(kept) < len(rows):
            _print(f"{link}: {len(rows) - len(kept)} of {len(rows)} spheres are not needed")
    return _finish(cover, report, folder, **found)


def write(target: Target, file: Path) -> int:
    """Write a known robot's cover as cuRobo's YAML or as a spherized URDF; the exit code."""
    cover = target.load_cover("--export")
    if file.suffix in YAML_ENDINGS:
        write_curobo(file, target.robot, cover)
    elif file.suffix == ".urdf":
        write_spherized_urdf(file, target.robot, cover, target.urdf)
    else:
        raise CoverError(str(file), "is of no known kind", expected=".yml, .yaml or .urdf")
    _print(f"wrote {file}")
    print_json(lambda: {"wrote": file})
    return 0


def list_known() -> int:
    """Show the robots that armguard knows, from their files alone; the exit code."""
    heads = ("name", "joints", "links", "spheres", "title")
    table = Table(*heads, box=None, pad_edge=False)
    robots = []
    for name in list_robots():
        description = read_description(find_robot(name) / DESCRIPTION)
        path = find_robot(name) / COVER
        links = spheres = None
        if path.is_file():
            cover = Cover.load(path)
            links = len(cover.links)
            spheres = sum(len(cover.spheres(link)) for link in cover.links)
        row = (name, len(description.joints), links, spheres, description.title)
        table.add_row(*("no cover" if one is None else str(one) for one in row))
        robots.append(dict(zip(heads, row, strict=True)))
    _print(table)
    print_json(lambda: {"robots": robots})
    return 0


def _finish(cover: Cover, report: CoverReport, folder: Path | None, **found: object) -> int:
    """Show what a cover is like and write it if it is proved, and only then; the exit code."""
    code = show_report(report)
    wrote = None
    if code == 0 and folder is not None:
        make_folder(folder)
        wrote = folder / COVER
        try:
            cover.save(wrote)
        except OSError as error:
            raise CoverError(str(wrote), f"cannot be written: {error.strerror}") from error
        _print(f"wrote {wrote}")
    print_json(lambda: describe(report, wrote) | found)
    return code


def show_report(report: CoverReport) -> int:
    """Print what a cover is like; the exit code is `UNPROVED` where a link is not inside it."""
    _print(_tabulate(report))
    return 0 if report.proved else UNPROVED


def show_protruding(report: CoverReport, limit: float | None) -> None:
    """Name the links whose spheres stick out farther than a limit in [mm]; None: the usual one."""
    limit = limit or 1e3 * DEFAULT_PROTRUSION
    for link, entry in report.links.items():
        if not 1e3 * entry.max_protrusion <= limit + TOLERANCE:
            _print(f"{link}: sticks out by more than {limit:g} mm; finer would need very many")


def describe(report: CoverReport, wrote: Path | None = None) -> dict[str, Any]:
    """What a cover is like, for programs; lengths in [m].

    Args:
        report: What it is like.
        wrote: The file that it was written to; None: it was not.
    """
    return {
        "proved": report.proved,
        "links": {
            name: dataclasses.asdict(link) | {"volume_ratio": link.volume_ratio}
            for name, link in report.links.items()
        },
        "wrote": wrote,
    }


def _tabulate(report: CoverReport) -> Table:
    def show(name: str, link: LinkReport | CoverReport) -> tuple[str, ...]:
        return (
            name,
            str(link.count),
            f"{1e3 * link.mean_protrusion:.1f}",
            f"{1e3 * link.max_protrusion:.1f}",
            f"{link.volume_ratio:.2f}",
            "yes" if link.proved else "NO",
        )

    heads = ("link", "spheres", "mean, mm", "max, mm", "volume ratio", "proved")
    caption = "mean, max: how far spheres stick out; volume ratio: spheres to link"
    table = make_table(heads, (show(*link) for link in report.links.items()), caption=caption)
    table.add_section()
    table.add_row(*show("all", report))
    return table


def _tabulate_gaps(gaps: dict[str, Gap]) -> Table:
    rows = [
        (
            link,
            str(gap.count),
            f"{100 * gap.share:.1f} %",
            f"{1e3 * gap.depth:.1f}" if gap.count else "no spheres",
            "proved" if gap.proved else "NO",
        )
        for link, gap in gaps.items()
    ]
    caption = "uncovered: share of the surface; up to: its distance to the nearest sphere"
    heads = ("link", "spheres", "uncovered", "up to, mm", "covered")
    return make_table(heads, rows, caption=caption)


def _print(what: Any) -> None:
    make_console().print(what, soft_wrap=isinstance(what, str))
