"""`armguard robot new`: makes a robot folder from a URDF, which every command accepts."""

from __future__ import annotations

import contextlib
import sys
import tempfile
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from armguard.app import cli
from armguard.app.terminal import make_console, print_json
from armguard.cover.cover import Cover
from armguard.cover.report import CoverReport
from armguard.exceptions import RobotError
from armguard.jit.progress import following
from armguard.lab.covers import (
    UNPROVED,
    fit_cover,
    show_protruding,
    show_report,
)
from armguard.lab.covers import describe as describe_cover
from armguard.lab.new_robot.limits import (
    ERROR_CHOSEN,
    LOAD,
    LOAD_CHOSEN,
    WORK_SPEED_CHOSEN,
    JointFacts,
    find_bare,
    find_coupled,
    find_travel,
)
from armguard.lab.new_robot.questions import (
    GIVEN,
    KINDS,
    Asker,
    Figure,
    Question,
    match,
    match_all,
    put_general_first,
    read_amount,
    read_signed,
)
from armguard.lab.new_robot.sources import URDF, UrdfSource, find_urdf
from armguard.lab.new_robot.text import NewRobot, list_choices, write_text
from armguard.robot.description import (
    COVER,
    DESCRIPTION,
    JointDescription,
    LockedJoint,
    read_description,
)
from armguard.robot.model_file import read_model
from armguard.robot.robot import Robot, read_described
from armguard.robot.ros_parameters import PlanningLimits, read_planning_limits
from armguard.robot.urdf import UrdfModel

NO_PLANNING = PlanningLimits((), {}, {}, ())
"""Where there is no file of MoveIt's."""

DRAWN = "drawn"
"""Answer that uses the visual geometry of links as collision geometry."""


def run_new(wishes: cli.NewRobot) -> int:
    """Write the folder of a new robot and print which values are no data of the arm; the exit code.

    Raises:
        ArmguardError: Something is missing, unusable or contradictory; nothing is written then.
    """
    is_terminal = sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()
    asker = Asker(ask_on_terminal if is_terminal else None, takes_usual=wishes.yes)
    planning = NO_PLANNING
    if wishes.joint_limits is not None:
        planning = read_planning_limits(wishes.joint_limits)
    new, report = make_folder(wishes, planning, asker)
    if show_report(report) != 0:
        print_json(lambda: describe_cover(report))
        return UNPROVED
    if wishes.spheres is None:
        show_protruding(report, wishes.protrusion)
    wrote, choices = [wishes.out / DESCRIPTION, wishes.out / COVER], list_choices(new)
    _print(f"wrote {wrote[0]} and {wrote[1]}")
    for line in choices:
        _print(f"- {line}")
    if planning.unused:
        _print(f"not used from {wishes.joint_limits}: {', '.join(planning.unused)}")
    # Read back as every command reads it, so that nothing is promised that cannot be loaded.
    Robot.load(wishes.out.absolute())
    print_json(
        lambda: {
            "wrote": wrote,
            "cover": describe_cover(report),
            "choices": choices,
            "unused": planning.unused,
        }
    )
    _print(
        f"next: armguard show {wishes.out}; armguard demo --robot {wishes.out}; in a cell file "
        f'[robot] name = "{wishes.out}" (relative to its folder), and operating = "published" if '
        "your controller enforces the operating limits: without it, armguard uses none"
    )
    return 0


def _check_title(wishes: cli.NewRobot) -> None:
    """Refuse text that would break its line of robot.toml or that cannot be written."""
    option = "--title" if wishes.title else "--out"
    title = wishes.title or wishes.out.resolve().name
    if not title.isprintable():
        raise RobotError(
            option,
            f"gives the title {title!r}",
            expected="printable characters",
            remedy="" if wishes.title else "give --title, or another folder",
        )


def prepare(
    wishes: cli.NewRobot, planning: PlanningLimits, asker: Asker
) -> tuple[NewRobot, str, Robot, str | None]:
    """Describe a robot, and read it by its description; nothing is written.

    Args:
        wishes: Options of the command line.
        planning: MoveIt's limits.
        asker: Answers questions about missing values.

    Returns:
        The description, its text, the robot without a cover, and the text of a URDF that is to be
        written beside robot.toml, if there is one.

    Raises:
        ArmguardError: Something is missing, unusable or contradictory.
    """
    check_new_folder(wishes.out)
    _check_title(wishes)
    with tempfile.TemporaryDirectory(prefix="armguard-") as scratch:
        source = find_urdf(wishes.urdf, wishes.out, wishes.package_dirs, Path(scratch))
        new = describe(wishes, source, planning, asker)
        text = write_text(new)
        # Read as every command reads it.
        description = read_description(tomllib.loads(text))
        urdf = read_described(source.path, source.folders, description)
    robot = Robot(wishes.out.resolve().name, urdf, description, list(description.joints))
    return new, text, robot, source.text


def make_folder(
    wishes: cli.NewRobot, planning: PlanningLimits, asker: Asker
) -> tuple[NewRobot, CoverReport]:
    """Describe a robot, fit and prove its cover, write both, and return the report of the cover.

    Nothing is written where a link is not inside its spheres.

    Arguments and errors are those of `prepare`, and a folder that cannot be written.
    """
    new, text, robot, urdf = prepare(wishes, planning, asker)
    cover = fit_cover(robot, wishes.spheres, wishes.protrusion)
    report = cover.check(robot)
    if report.proved:
        write_folder(wishes.out, text, cover, urdf)
    return new, report


def check_new_folder(folder: Path) -> None:
    """Refuse a folder that cannot be made, or has something in it.

    Raises:
        RobotError: It is a file, not empty, or its parent cannot be written to.
    """
    expected = "a new folder, or an empty one"
    try:
        if not folder.is_dir():
            # Made and removed again: a fit of minutes must not end with a folder that cannot be.
            folder.mkdir(parents=True)
            folder.rmdir()
        elif any(folder.iterdir()):
            raise RobotError(f"--out {folder}", "is not empty", expected=expected)
    except OSError as error:
        problem = f"cannot be made: {error.strerror}"
        raise RobotError(f"--out {folder}", problem, expected=expected) from error


def ask_on_terminal(text: str) -> str:
    """Show a question on standard error and read the answer.

    Raises:
        RobotError: Standard input has ended.
    """
    sys.stderr.write(text)
    sys.stderr.flush()
    line = sys.stdin.readline()
    if not line:
        raise RobotError("armguard robot new", "no more answers: standard input has ended")
    return line.strip()


def describe(
    wishes: cli.NewRobot, source: UrdfSource, planning: PlanningLimits, asker: Asker
) -> NewRobot:
    """Content of robot.toml, from options, the model file, MoveIt's limits and answers.

    Raises:
        RobotError: Something is missing or unusable.
    """
    urdf = read_model(source.path, source.folders, (), wishes.collision_from_visual)
    watched, locked = settle_joints(wishes, urdf, asker)
    drawn, bare = settle_bare_links(wishes, urdf, watched, asker)
    facts = JointFacts(urdf, watched, locked, source.origin)
    joints = facts.joints
    _check_planning(wishes.joint_limits, planning, urdf)
    facts.refuse_ranges(wishes.position)

    def ask(
        name: str,
        known: Mapping[str, Figure[Any]],
        usual: Mapping[str, Figure[Any]],
        given: Sequence[str] | None = None,
        of: Sequence[str] = joints,
    ) -> dict[str, Figure[Any]]:
        question = Question(f"--{name.replace('_', '-')}", KINDS[name], known, usual)
        return asker.answer(question, of, getattr(wishes, name) if given is None else given)

    figures: dict[str, dict[str, Figure[Any]]] = {}
    ranged = [joint for joint in joints if joint not in facts.continuous]
    figures["position"] = ask("position", facts.positions, facts.usual_positions, of=ranged)
    velocity = figures["velocity"] = ask("velocity", facts.velocities, facts.usual_velocities)
    facts.put(figures["position"], velocity)
    usual = _derive("accelerations", joints, wishes.acceleration, facts.derive_accelerations)
    acceleration = figures["acceleration"] = ask("acceleration", {}, usual)
    for name in ("position_error", "velocity_error"):
        known = dict.fromkeys(joints, Figure(getattr(_DEFAULTS, name), ERROR_CHOSEN))
        # One number counts for all, though all are known.
        given = put_general_first(getattr(wishes, name))
        given = [item if "=" in item else f"*={item}" for item in given]
        figures[name] = ask(name, known, {}, given)
    load = asker.choose(
        "--load",
        "load at the tool up to which the decelerations of the brakes hold, in kg",
        f"{LOAD:g}",
        wishes.load,
    )
    is_usual = wishes.load is None and load == f"{LOAD:g}"
    held = read_amount(f"--load {load}", load)
    figures["load"] = {"": Figure(held, LOAD_CHOSEN if is_usual else GIVEN)}
    usual = _derive(
        "decelerations",
        joints,
        wishes.deceleration,
        lambda: facts.derive_decelerations(held, acceleration),
    )
    figures["deceleration"] = ask("deceleration", {}, usual)
    chosen = {
        "velocity": {
            joint: Figure(one.value, WORK_SPEED_CHOSEN) for joint, one in velocity.items()
        },
        "acceleration": facts.choose_work_accelerations(acceleration),
    }
    for kind, usual in chosen.items():
        known = _take(getattr(planning, kind), joints, wishes.joint_limits, figures[kind])
        figures[f"operating_{kind}"] = ask(f"operating_{kind}", known, usual)
    return NewRobot(
        title=wishes.title or wishes.out.resolve().name,
        urdf=source.key,
        package_dirs=source.package_keys,
        bare_links=tuple(bare),
        collision_from_visual=tuple(drawn),
        locked=locked,
        figures=figures,
    )


_DEFAULTS = JointDescription(velocity=1.0, acceleration=1.0)


def settle_joints(
    wishes: cli.NewRobot, urdf: UrdfModel, asker: Asker
) -> tuple[list[str], dict[str, LockedJoint]]:
    """Which joints are watched, and the positions or ranges of joints that affect them.

    Raises:
        RobotError: A joint is unknown, or nothing can be said of one that is not watched.
    """
    names = [str(name) for name in urdf.model.names[1:]]
    locked: dict[str, LockedJoint] = {}
    for item in wishes.lock:
        pattern, has_joint, text = item.rpartition("=")
        if not has_joint:
            raise RobotError(f"--lock {item}", "names no position", expected="JOINT=POSITION")
        position = read_signed(f"--lock {item}", text)
        for joint in match(f"--lock {item}", pattern, names):
            locked[joint] = LockedJoint(position=position)
    for joint in match_all("--travel", wishes.travel, names):
        locked[joint] = _travel(urdf, joint)
    coupled = set(urdf.mimics) | {mimic.leader for mimic in urdf.mimics.values()}
    if wishes.joints:
        chosen = match_all("--joints", wishes.joints, names)
        watched = [joint for joint in names if joint in chosen]
    else:
        watched = [joint for joint in names if joint not in coupled and joint not in locked]
    for joint in watched:
        if joint in locked:
            raise RobotError(f"joint {joint!r}", "is watched and locked", expected="one of both")
        if joint in coupled:
            mimic = urdf.mimics.get(joint)
            problem = f"mimics joint {mimic.leader!r}" if mimic else "is mimicked by another"
            raise RobotError(
                f"joint {joint!r}", problem, expected="--joints that move independently"
            )
    if not watched:
        raise RobotError(
            str(wishes.urdf), "has no joint to watch", expected="one that turns or slides by itself"
        )
    carrying, carried = find_coupled(urdf, watched)
    for joint in carrying:
        if joint not in locked:
            locked[joint] = _settle_carrier(joint, coupled, urdf, asker)
    for joint in carried:
        if joint not in locked:
            locked[joint] = _travel(urdf, joint)
    return watched, locked


def _settle_carrier(joint: str, coupled: set[str], urdf: UrdfModel, asker: Asker) -> LockedJoint:
    """The fixed position of a joint that carries watched joints; only the user can know it."""
    option = f"--lock {joint}=POSITION"
    if joint in coupled:
        raise RobotError(
            f"joint {joint!r}",
            "mimics another, or is mimicked, and carries joints that are watched",
            remedy=f"if it never moves, give {option}",
        )
    index = urdf.model.joints[urdf.model.getJointId(joint)].idx_q
    lower, upper = urdf.model.lowerPositionLimit[index], urdf.model.upperPositionLimit[index]
    nearest = float(min(max(0.0, lower), upper)) if lower < upper else 0.0
    answer = asker.choose(
        option,
        f"joint {joint} carries watched joints and is not watched: the position at which it stays",
        f"{nearest:g}",
        None,
        is_guess=True,
    )
    return LockedJoint(position=read_signed(option, answer))


def _travel(urdf: UrdfModel, joint: str) -> LockedJoint:
    """A joint that may be anywhere in its range."""
    travel = find_travel(urdf, joint)
    if travel is None:
        raise RobotError(
            f"joint {joint!r}",
            "is not watched, and the model file gives no travel of at most one turn",
            remedy=f"watch it by --joints, or give --lock {joint}=POSITION if it never moves",
        )
    return LockedJoint(travel=travel)


def settle_bare_links(
    wishes: cli.NewRobot, urdf: UrdfModel, watched: Sequence[str], asker: Asker
) -> tuple[list[str], list[str]]:
    """Links whose visual geometry is used for collision, and links that stay uncovered.

    Raises:
        RobotError: A link is neither, or is named that is not only drawn.
    """
    drawn = list(wishes.collision_from_visual)
    lacking = find_bare(urdf, watched)
    bare = match_all("--bare-links", wishes.bare_links, lacking)
    left = [link for link in lacking if link not in bare]
    if left:
        answer = asker.choose(
            "--collision-from-visual",
            f"links {', '.join(left)} move and have visual but no collision geometry: use the "
            f'visual geometry ("{DRAWN}"), or name the links to leave uncovered (--bare-links)',
            DRAWN,
            None,
        )
        if answer != DRAWN:
            bare += match_all("--bare-links", answer.split(), left)
        drawn += [link for link in left if link not in bare]
    return drawn, bare


def _check_planning(file: Path | None, planning: PlanningLimits, urdf: UrdfModel) -> None:
    names = [str(name) for name in urdf.model.names[1:]]
    for joint in planning.joints:
        if joint not in names:
            raise RobotError(
                f"--joint-limits {file}", f"names joint {joint!r}", expected=f"among {names}"
            )


def _take(
    limits: Mapping[str, float],
    joints: Sequence[str],
    path: Path | None,
    hardware: Mapping[str, Figure[float]],
) -> dict[str, Figure[float]]:
    """MoveIt's limits of watched joints, refused where they exceed the hardware's limits."""
    taken = {}
    file = "" if path is None else path.name
    for joint in joints:
        if joint not in limits:
            continue
        if not limits[joint] <= hardware[joint].value * (1.0 + 1e-6):
            raise RobotError(
                f"{file}: joint {joint}",
                f"has {limits[joint]:g}, above the limit of the joint, {hardware[joint].value:g}",
                remedy="correct the file, or give the joint's own limit by --velocity or "
                "--acceleration",
            )
        # Within rounding: files round what a URDF has in full.
        taken[joint] = Figure(
            min(limits[joint], hardware[joint].value), f"{file}, as MoveIt has it"
        )
    return taken


def _derive(
    what: str,
    joints: Sequence[str],
    given: Sequence[str],
    derive: Callable[[], dict[str, Figure[float]]],
) -> dict[str, Figure[float]]:
    """Default values of joints; empty if all are given, since deriving them takes seconds."""
    names = {item.rpartition("=")[0] for item in given}
    if "" in names or names >= set(joints):
        return {}
    with following("deriving from efforts", 1) as begin:
        begin(what)
        return derive()


def write_folder(folder: Path, text: str, cover: Cover, urdf: str | None) -> None:
    """Write all files of a robot; robot.toml, which makes the folder one, comes last.

    Raises:
        RobotError: Something cannot be written; files that were written are removed.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if urdf is not None:
            (folder / URDF).write_text(urdf, encoding="utf-8")
        cover.save(folder / COVER)
        (folder / DESCRIPTION).write_text(text, encoding="utf-8")
    except OSError as error:
        for name in (URDF, COVER, DESCRIPTION):
            with contextlib.suppress(OSError):
                (folder / name).unlink()
        raise RobotError(str(folder), f"cannot be written: {error.strerror}") from error


def _print(text: str) -> None:
    make_console().print(text, soft_wrap=True)
