"""A study: all settings through one scene, in turns, then combinations of what was cheap.

Turns are short, so that whatever else the machine does falls on all settings alike, and so that a
study which is ended early has seen the same part of the scene with each of them.
"""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from armguard.exceptions import ArmguardError
from armguard.monitor.choice import Choice, choose
from armguard.monitor.monitor import Monitor
from armguard.studies.tradeoff.adversary import Adversary, Body
from armguard.studies.tradeoff.contestant import RATE, Contestant, Track
from armguard.studies.tradeoff.covers import Covers
from armguard.studies.tradeoff.figures import Figures, Hunted, compute_figures, find_front
from armguard.studies.tradeoff.growth import Grown, measure_growth
from armguard.studies.tradeoff.ladder import (
    AUTO,
    DEFAULT,
    FINEST,
    Rung,
    Setting,
    combine,
    list_settings,
)
from armguard.studies.tradeoff.scene import Message, Scene, Site
from armguard.studies.tradeoff.trial import list_ticks, make_setting
from armguard.studies.tradeoff.truth import Contact, TrueArm, find_contacts

TURN = 0.1
"""Of the scene, before it is the next setting's, in [s]."""

CLOSE = 0.01
"""Shares of STOP that differ by no more count as the same."""

CHEAPER = 0.95
"""Of a price, what is cheaper by more than the measurement scatters."""

MOMENTS, HUNTERS = 12, 2
"""At which an adversary is let loose, and how many bodies of those that are nearest hunt."""

Tell = Callable[[str, float], None]
"""Is told what is done, and which share of that is done."""


class Outcome(NamedTuple):
    """One setting, and what was found of it."""

    setting: Setting
    figures: Figures | None
    """None where it could not be made."""
    refused: str = ""
    """Why not."""


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
    trial: Scene | None = None,
) -> Study:
    """Run all settings; Ctrl-C ends it with what was measured so far.

    Args:
        site: Where, and by what arm.
        scene: What all are shown.
        axes: Of the ladder; growth with pairs is measured where schedules are among them.
        seed: Of the motions in which growth is measured.
        covers: Makes those that settings ask for.
        tell: Is told how far it is.
        trial: What settings are chosen by, where `AUTO` is among the axes: another scene than that
            which all are shown.

    Raises:
        ArmguardError: The default or the finest setting cannot be made.
        KeyboardInterrupt: It came before there was anything to show.
    """
    outcomes: list[Outcome] = []
    settings = list_settings(axes, site.robot.cover, site.settings)
    contestants = _make_contestants(settings, site, scene, covers, outcomes, tell)
    choice = None
    if trial is not None and AUTO in axes:
        tell("a trial to choose by", 0.0)
        choice = _choose(site, trial, outcomes)
    if choice is not None:
        chosen = [make_setting(choice)]
        contestants += _make_contestants(chosen, site, scene, covers, outcomes, tell)
    interrupted = _run_turns(contestants, scene, "axes", tell)
    seconds = min(one.begun for one in contestants)
    if seconds <= 0.0:
        raise KeyboardInterrupt
    tracks = {one.setting.name: one.track.until(seconds) for one in contestants}
    contacts: list[Contact] | None = None
    hunted: list[Hunted] = []
    grown: list[Grown] = []

    def add(some: Sequence[Contestant]) -> None:
        for one in some:
            messages = [m.stamp <= seconds for m in scene.messages[: len(one.intake)]]
            figures = compute_figures(
                one.track.until(seconds), tracks[FINEST], one.intake[: sum(messages)], hunted,
                contacts or [], one.response, one.memory,
            )  # fmt: skip
            if contacts is None:
                figures = figures._replace(missed=math.nan)
            outcomes.append(Outcome(one.setting, figures))

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
    add(contestants)
    try:
        if not interrupted:
            interrupted = "combinations"
            some = combine(_choose_rungs(outcomes))
            combined = _make_contestants(some, site, scene, covers, outcomes, tell)
            interrupted = _run_turns(combined, scene, interrupted, tell)
            if not interrupted:
                add(combined)
        if not interrupted and "schedule" in axes:
            interrupted = "growth"
            for one in measure_growth(site, seed):
                grown.append(one)
                tell(f"growth: {one.pairs:,} pairs", 0.0)
            interrupted = ""
    except KeyboardInterrupt:
        pass
    counted = [one for one in outcomes if one.figures is not None and _is_sound(one)]
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
    ticks = list_ticks(trial, float(site.settings.get("rate", RATE)))
    try:
        return choose(
            Monitor, site.robot, site.make_obstacles(), ticks, site.settings, keeps_cover=False
        )
    except ArmguardError as error:
        outcomes.append(Outcome(Setting(AUTO), None, str(error)))
        return None


def _make_contestants(
    settings: Sequence[Setting],
    site: Site,
    scene: Scene,
    covers: Covers,
    outcomes: list[Outcome],
    tell: Tell,
) -> list[Contestant]:
    """Those that can be made; of the others it is noted why not."""
    made = []
    for number, setting in enumerate(settings):
        tell(f"making {setting.name}", number / len(settings))
        try:
            made.append(Contestant(setting, site, scene, covers.choose(setting)))
        except ArmguardError as error:
            if setting.name in (DEFAULT, FINEST):
                raise
            outcomes.append(Outcome(setting, None, str(error)))
    return made


def _run_turns(contestants: Sequence[Contestant], scene: Scene, part: str, tell: Tell) -> str:
    """Let all go through the scene in turns; the part in which that was ended early, if it was."""
    turns = max(1, round(scene.seconds / TURN))
    try:
        for turn in range(turns):
            until = (turn + 1) * TURN if turn + 1 < turns else scene.seconds
            gc.collect()
            gc.disable()
            for number, one in enumerate(contestants):
                one.run(until)
                tell(f"{part}: {one.setting.name}", (turn + number / len(contestants)) / turns)
    except KeyboardInterrupt:
        return part
    finally:
        gc.enable()
    return ""


def _choose_rungs(outcomes: Sequence[Outcome]) -> list[Rung]:
    """Of each axis the cheapest rung that is no more cautious than the default, and cheaper."""
    usual = next(one.figures for one in outcomes if one.setting.name == DEFAULT)
    best: dict[str, tuple[float, Rung]] = {}
    for one in outcomes:
        figures, axis = one.figures, one.setting.axis
        if axis in ("", AUTO) or figures is None or usual is None or not _is_sound(one):
            continue
        is_better = figures.core < CHEAPER * usual.core and figures.stop <= usual.stop + CLOSE
        # A rule that the monitor does not have cannot be chosen.
        if is_better and not one.setting.rule and figures.core < best.get(axis, (np.inf,))[0]:
            best[axis] = figures.core, one.setting.rungs[0]
    return [rung for _, rung in sorted(best.values(), key=lambda pair: pair[0])]


def _is_sound(outcome: Outcome) -> bool:
    return outcome.figures is not None and not outcome.figures.missed > 0.0


def _find_contacts(site: Site, scene: Scene, seconds: float) -> list[Contact]:
    table = site.make_obstacles().settings

    def bounds(body: str, message: Message, row: int) -> tuple[float, float, float, float]:
        def read(name: str, default: float) -> float:
            return float(np.broadcast_to(message.bounds.get(name, default), len(message.ids))[row])

        return (
            read("accel", table.accel),
            read("speed", table.speed),
            read("position_error", 0.0),
            read("velocity_error", 0.0),
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
        bounds = [
            np.broadcast_to(message.bounds.get(name, default), len(message.ids))
            for name, default in (("accel", accel), ("speed", speed))
        ]
        for row, body in enumerate(message.ids):
            velocity = message.velocity[row].mean(axis=0)
            latest[body] = Body(
                message.position[row] + velocity * (time - message.stamp),
                velocity,
                float(message.radius[row]),
                float(bounds[0][row]),
                float(bounds[1][row]),
            )
    return list(latest.values())
