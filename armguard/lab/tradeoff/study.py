"""A study: all settings through one scene, in turns, then combinations of what was cheap.

Turns are short, so that whatever else the machine does falls on all settings alike, and so that a
study which is ended early has seen the same part of the scene with each of them. Where rows are
kept or measured by other processes there are no turns: each setting goes through the whole scene by
itself. What it says is the same; what it takes is that of its machine at its time.
"""

from __future__ import annotations

import gc
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from armguard.cover.cover import Cover
from armguard.exceptions import ArmguardError
from armguard.lab.choice import choose_settings
from armguard.lab.rows import MACHINE, Measure, Row, Rows, Tell
from armguard.lab.tradeoff.adversary import Adversary, Body
from armguard.lab.tradeoff.contestant import Contestant, Run, Track
from armguard.lab.tradeoff.covers import Covers
from armguard.lab.tradeoff.figures import Figures, Hunted, compute_figures, find_front
from armguard.lab.tradeoff.growth import Grown, list_sizes, measure_size
from armguard.lab.tradeoff.ladder import (
    AUTO,
    DEFAULT,
    FINEST,
    OPERATING,
    Rung,
    Setting,
    combine,
    list_settings,
)
from armguard.lab.tradeoff.scene import Message, Scene, Site
from armguard.lab.tradeoff.truth import Contact, TrueArm, find_contacts
from armguard.lab.trial import list_ticks, make_setting
from armguard.monitor.settings import read_settings
from armguard.monitor.trial import Choice

TURN = 0.1
"""Of the scene, before it is the next setting's, in [s]."""

CLOSE = 0.01
"""Shares of STOP that differ by no more count as the same."""

CHEAPER = 0.95
"""Of a price, what is cheaper by more than the measurement scatters."""

MOMENTS, HUNTERS = 12, 2
"""At which an adversary is let loose, and how many bodies of those that are nearest hunt."""


class Outcome(NamedTuple):
    """One setting, and what was found of it."""

    setting: Setting
    figures: Figures | None
    """None where it could not be made."""
    refused: str = ""
    """Why not."""
    machine: str = ""
    """Where it was measured; empty where all is of this process."""


class Study(NamedTuple):
    """What was found."""

    outcomes: list[Outcome]
    front: list[str]
    """Names of the settings on the front of price and caution."""
    contacts: list[Contact] | None
    """What really touched; None: it was ended before that was looked for."""
    hunted: list[Hunted]
    grown: list[Grown]
    tracks: dict[str, Track]
    """Of the default and of the finest."""
    seconds: float
    """Of the scene, that all settings have seen."""
    interrupted: str
    """In which part it was ended early; empty: it was not."""
    choice: Choice | None = None
    """What was chosen by a trial; None: nothing was."""

    def find(self, name: str) -> Figures | None:
        """Figures of a setting; None if it has none."""
        return next((one.figures for one in self.outcomes if one.setting.name == name), None)


def run_study(
    site: Site,
    scene: Scene,
    axes: Sequence[str],
    seed: int,
    covers: Covers,
    tell: Tell,
    rows: Rows,
    trial: Scene | None = None,
    *,
    in_turns: bool = False,
) -> Study:
    """Run all settings; Ctrl-C ends it with what was measured so far.

    Args:
        site: Where, and by what arm.
        scene: What all are shown.
        axes: Of the ladder; growth with pairs is measured where schedules are among them.
        seed: Of the motions in which growth is measured.
        covers: Makes those that settings ask for.
        tell: Is told how far it is.
        rows: Measures settings, and keeps them.
        trial: What settings are chosen by, where `AUTO` is among the axes: another scene than that
            which all are shown.
        in_turns: Whether settings take turns in this process instead of being measured one by one.

    Raises:
        ArmguardError: The default or the finest setting cannot be made.
        KeyboardInterrupt: It came before there was anything to show.
    """
    outcomes: list[Outcome] = []
    settings = list_settings(axes, site.robot.cover, site.settings)
    choice = None
    if trial is not None and AUTO in axes:
        tell("a trial to choose by", 0.0)
        choice = _choose(site, trial, outcomes)
    if choice is not None:
        settings.append(make_setting(choice))

    def run(some: Sequence[Setting], part: str) -> tuple[list[Run], str]:
        """Let settings go through the scene; the part in which that was ended, if it was."""
        tasks = _list_tasks(some, covers, outcomes, tell)
        place = Turns(part, tell) if in_turns else None
        found, is_whole = rows.measure(measure_setting, (site, scene), tasks, part, tell, place)
        done = []
        for name, row in found.items():
            if "refused" in row:
                _refuse(tasks[name][0], row["refused"], outcomes)
            else:
                done.append(Run.restore(tasks[name][0], row))
        return done, "" if is_whole else part

    runs, interrupted = run(settings, "axes")
    tracks = {run.setting.name: run.track for run in runs}
    seconds = min((run.begun for run in runs), default=0.0)
    if seconds <= 0.0 or not {DEFAULT, FINEST} <= set(tracks):
        raise KeyboardInterrupt
    tracks = {name: track.until(seconds) for name, track in tracks.items()}
    contacts: list[Contact] | None = None
    hunted: list[Hunted] = []
    grown: list[Grown] = []

    def add(some: Sequence[Run]) -> None:
        for one in some:
            messages = [m.stamp <= seconds for m in scene.messages[: len(one.intake)]]
            # The adversary keeps to what the default counts with.
            is_hunted = one.setting.axis != OPERATING
            figures = compute_figures(
                one.track.until(seconds), tracks[FINEST], one.intake[: sum(messages)],
                hunted if is_hunted else [], contacts or [], one.response, one.memory,
            )  # fmt: skip
            if contacts is None:
                figures = figures._replace(missed=math.nan)
            outcomes.append(Outcome(one.setting, figures, machine=one.machine))

    try:
        # Looked for in any case: that nothing was missed is not to be said without it.
        part = "what really happened"
        interrupted, ended = interrupted or part, interrupted
        tell(part, 0.0)
        contacts = _find_contacts(site, scene, seconds)
        if not ended:
            hunted += _hunt(site, scene, tracks[FINEST], tell)
        interrupted = ended
    except KeyboardInterrupt:
        pass
    add(runs)
    try:
        if not interrupted:
            interrupted = "combinations"
            some = combine(_choose_rungs(outcomes))
            combined, interrupted = run(some, interrupted)
            # Of settings that took turns and were ended early, none saw the whole scene.
            add([run for run in combined if run.begun >= seconds])
        if not interrupted and "schedule" in axes:
            interrupted = "growth"
            interrupted = _grow(site, seed, grown, tell, rows)
    except KeyboardInterrupt:
        pass
    counted = [one for one in outcomes if one.setting.is_choice and _is_sound(one)]
    front = find_front(
        [one.figures.core for one in counted if one.figures],
        [one.figures.stop for one in counted if one.figures],
    )
    return Study(
        outcomes,
        [counted[place].setting.name for place in front],
        contacts,
        hunted,
        grown,
        {name: tracks[name] for name in (DEFAULT, FINEST)},
        seconds,
        interrupted,
        choice,
    )


def _choose(site: Site, trial: Scene, outcomes: list[Outcome]) -> Choice | None:
    """What `Monitor.auto` chooses there; None, and noted why, where it has no choice."""
    ticks = list_ticks(trial, read_settings(None, site.settings).rate)
    try:
        return choose_settings(
            site.robot,
            site.make_obstacles(),
            ticks,
            keeps_cover=site.keeps_cover,
            **site.settings,
        )
    except ArmguardError as error:
        outcomes.append(Outcome(Setting(AUTO), None, str(error)))
        return None


def _list_tasks(
    settings: Sequence[Setting], covers: Covers, outcomes: list[Outcome], tell: Tell
) -> dict[str, tuple[Setting, Cover]]:
    """Settings with their covers, by name; of those without one it is noted why."""
    tasks = {}
    for number, setting in enumerate(settings):
        tell(f"making {setting.name}", number / len(settings))
        try:
            tasks[setting.name] = setting, covers.choose(setting)
        except ArmguardError as error:
            _refuse(setting, str(error), outcomes)
    return tasks


class Turns:
    """This process, in which all settings go through the scene in turns.

    Args:
        part: Of the study, for the progress.
        tell: Is told how far they are.
    """

    def __init__(self, part: str, tell: Tell) -> None:
        self._part, self._tell = part, tell

    def run(
        self, measure: Measure, shared: Any, tasks: Mapping[str, tuple[Any, ...]]
    ) -> Iterator[tuple[str, Row]]:
        """Hand over all runs at the end; after Ctrl-C, what they had seen until then."""
        site, scene = shared
        made: dict[str, Contestant] = {}
        for number, (name, (setting, cover)) in enumerate(tasks.items()):
            self._tell(f"making {name}", number / len(tasks))
            try:
                made[name] = Contestant(setting, site, scene, cover)
            except ArmguardError as error:
                yield name, {"refused": str(error)}
        is_whole = self._take_turns(made, scene)
        for name, one in made.items():
            yield name, one.report().describe()
        if not is_whole:
            raise KeyboardInterrupt

    def _take_turns(self, made: Mapping[str, Contestant], scene: Scene) -> bool:
        turns = max(1, round(scene.seconds / TURN))
        try:
            for turn in range(turns):
                until = (turn + 1) * TURN if turn + 1 < turns else scene.seconds
                gc.collect()
                gc.disable()
                for number, (name, one) in enumerate(made.items()):
                    one.run(until)
                    self._tell(f"{self._part}: {name}", (turn + number / len(made)) / turns)
        except KeyboardInterrupt:
            return False
        finally:
            gc.enable()
        return True


def measure_setting(shared: tuple[Site, Scene], setting: Setting, cover: Cover) -> Row:
    """Let one setting go through the whole scene: its run as plain data, or why it was refused."""
    site, scene = shared
    try:
        contestant = Contestant(setting, site, scene, cover)
    except ArmguardError as error:
        return {"refused": str(error)}
    gc.collect()
    gc.disable()
    try:
        contestant.run(scene.seconds)
    finally:
        gc.enable()
    return contestant.report().describe()


def measure_grown(shared: tuple[Site, int], count: int, setting: Setting) -> Row:
    """`measure_size` as a row."""
    grown = measure_size(*shared, count, setting)
    return {"grown": grown and grown._asdict()}


def _grow(site: Site, seed: int, grown: list[Grown], tell: Tell, rows: Rows) -> str:
    """Measure the growth with pairs; the name of this part if it was ended early."""
    part = "growth"
    tasks = {f"{setting.name} among {count}": (count, setting) for count, setting in list_sizes()}
    found, is_whole = rows.measure(measure_grown, (site, seed), tasks, part, tell)
    for row in found.values():
        if row["grown"] is not None:
            grown.append(Grown(**row["grown"] | {"machine": row.get(MACHINE, "")}))
    return "" if is_whole else part


def _refuse(setting: Setting, reason: str, outcomes: list[Outcome]) -> None:
    if setting.name in (DEFAULT, FINEST):
        raise ArmguardError(f"setting {setting.name!r}", f"cannot be made: {reason}")
    outcomes.append(Outcome(setting, None, reason))


def _choose_rungs(outcomes: Sequence[Outcome]) -> list[Rung]:
    """Of each axis the cheapest rung that is no more cautious than the default, and cheaper."""
    usual = next(one.figures for one in outcomes if one.setting.name == DEFAULT)
    best: dict[str, tuple[float, Rung]] = {}
    for one in outcomes:
        figures, axis = one.figures, one.setting.axis
        if axis in ("", AUTO) or figures is None or usual is None or not _is_sound(one):
            continue
        is_better = figures.core < CHEAPER * usual.core and figures.stop <= usual.stop + CLOSE
        if is_better and one.setting.is_choice and figures.core < best.get(axis, (np.inf,))[0]:
            best[axis] = figures.core, one.setting.rungs[0]
    return [rung for _, rung in sorted(best.values(), key=lambda pair: pair[0])]


def _is_sound(outcome: Outcome) -> bool:
    return outcome.figures is not None and not outcome.figures.missed > 0.0


def _find_contacts(site: Site, scene: Scene, seconds: float) -> list[Contact]:
    table = site.make_obstacles().settings

    def bounds(message: Message, row: int) -> tuple[float, float, float, float]:
        return (
            message.bound("accel", row, table.accel),
            message.bound("speed", row, table.speed),
            message.bound("position_error", row),
            message.bound("velocity_error", row),
        )

    found = find_contacts(scene, TrueArm(site.robot, site.base), bounds)
    return [one for one in found if one.time <= seconds]


def _hunt(site: Site, scene: Scene, finest: Track, tell: Tell) -> list[Hunted]:
    """Let the nearest bodies hunt the arm, and the arm them, from moments that are still open."""
    robot, base = site.robot, site.base
    operating = site.settings.get("operating")
    limits = robot.velocity_limit, robot.acceleration_limit
    adversary = Adversary(robot, base, *(operating.resolve(robot) if operating else limits))
    arm, table = TrueArm(robot, base), site.make_obstacles().settings
    is_open = np.isfinite(finest.contact_time) & (finest.contact_time > 0.01)
    times = finest.time[is_open]
    hunted = []
    for number, time in enumerate(times[:: max(1, len(times) // MOMENTS)][:MOMENTS]):
        tell("an adversary", number / MOMENTS)
        q, v = scene.sample(float(time))
        arm.place(q)
        bodies = _list_bodies(scene, float(time), table.accel, table.speed)
        nearest = sorted(bodies, key=lambda body: arm.gap(body.ends, body.radius, 9.0)[0])
        found = np.inf
        for body in nearest[:HUNTERS]:
            found = min(found, adversary.find_contact(q, v, body, min(1.0, found)))
        hunted.append(Hunted(float(time), found))
    return hunted


def _list_bodies(scene: Scene, time: float, accel: float, speed: float) -> list[Body]:
    """Where bodies are at a time as they were told of last, straight on; fresh ones alone."""
    latest: dict[str, Body] = {}
    for message in scene.messages:
        if message.stamp > time + 1e-9:
            break
        if message.stamp < time - 0.05:
            continue
        for row, body in enumerate(message.ids):
            velocity = message.velocity[row].mean(axis=0)
            latest[body] = Body(
                message.position[row] + velocity * (time - message.stamp),
                velocity,
                float(message.radius[row]),
                message.bound("accel", row, accel),
                message.bound("speed", row, speed),
            )
    return list(latest.values())
