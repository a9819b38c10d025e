"""A study: all settings through one scene, in turns.

Turns are short, so other load of the machine affects all settings alike. A study that ends early
has run the same part of the scene with each setting.
"""

from __future__ import annotations

import gc
import math
from collections.abc import Sequence
from typing import NamedTuple

from armguard.exceptions import ArmguardError
from armguard.lab.choice import choose_settings
from armguard.lab.study_facts import Tell
from armguard.lab.tradeoff.contestant import Contestant
from armguard.lab.tradeoff.covers import Covers
from armguard.lab.tradeoff.figures import Figures, compute_figures, find_front
from armguard.lab.tradeoff.ladder import (
    AUTO,
    DEFAULT,
    FINEST,
    Setting,
    list_settings,
)
from armguard.lab.tradeoff.scene import Scene, Site
from armguard.lab.tradeoff.truth import Contact, TrueArm, find_contacts
from armguard.lab.trial import list_ticks, make_setting
from armguard.monitor.settings import read_settings
from armguard.monitor.trial import Choice

TURN = 0.1
"""Of the scene, before it is the next setting's, in [s]."""

CLOSE = 0.01
"""Shares of STOP that differ by no more count as the same."""


class Outcome(NamedTuple):
    """One setting, and what was found of it."""

    setting: Setting
    figures: Figures | None
    """None where it could not be made."""
    refused: str = ""
    """Why not."""

    @property
    def is_sound(self) -> bool:
        """Whether it was made, and missed no contact."""
        return self.figures is not None and not self.figures.missed > 0.0


class Study(NamedTuple):
    """What was found."""

    outcomes: list[Outcome]
    front: list[str]
    """Names of the settings on the front of price and caution."""
    contacts: list[Contact] | None
    """True contacts; None: the study ended before they were computed."""
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
    tell: Tell,
    trial: Scene | None = None,
) -> Study:
    """Run all settings; Ctrl-C ends it with what was measured so far.

    Args:
        site: Where, and by what arm.
        scene: What all are shown.
        axes: Of the ladder.
        tell: Is told how far it is.
        trial: What settings are chosen by, where `AUTO` is among the axes: another scene than that
            which all are shown.

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
    covers = Covers(site.robot)

    contestants: list[Contestant] = []
    interrupted = ""
    try:
        for number, setting in enumerate(settings):
            tell(f"making {setting.name}", number / len(settings))
            try:
                contestants.append(Contestant(setting, site, scene, covers.choose(setting)))
            except ArmguardError as error:
                _refuse(setting, str(error), outcomes)
        _take_turns(contestants, scene, tell)
    except KeyboardInterrupt:
        interrupted = "axes"
    seconds = min((one.begun for one in contestants), default=0.0)
    if seconds <= 0.0:
        raise KeyboardInterrupt
    finest = next(one.track.until(seconds) for one in contestants if one.setting.name == FINEST)
    contacts: list[Contact] | None = None

    def judge(one: Contestant) -> Outcome:
        heard = sum(message.stamp <= seconds for message in scene.messages[: len(one.intake)])
        figures = compute_figures(
            one.track.until(seconds),
            finest,
            one.intake[:heard],
            contacts or [],
            one.response,
        )
        if contacts is None:
            figures = figures._replace(missed=math.nan)
        return Outcome(one.setting, figures)

    try:
        # Looked for in any case: that nothing was missed is not to be said without it.
        tell("true contacts", 0.0)
        arm, table = TrueArm(site.robot, site.base), site.make_obstacles().settings
        found = find_contacts(scene, arm, table.accel, table.speed)
        contacts = [one for one in found if one.time <= seconds]
    except KeyboardInterrupt:
        interrupted = interrupted or "true contacts"
    outcomes += map(judge, contestants)
    counted = [
        (one.setting.name, one.figures)
        for one in outcomes
        if one.figures is not None and one.is_sound and one.setting.is_choice
    ]
    front = find_front([one.core for _, one in counted], [one.stop for _, one in counted])
    return Study(
        outcomes,
        [counted[place][0] for place in front],
        contacts,
        seconds,
        interrupted,
        choice,
    )


def _take_turns(contestants: Sequence[Contestant], scene: Scene, tell: Tell) -> None:
    turns = max(1, round(scene.seconds / TURN))
    try:
        for turn in range(turns):
            until = (turn + 1) * TURN if turn + 1 < turns else scene.seconds
            gc.collect()
            gc.disable()
            for number, one in enumerate(contestants):
                one.run(until)
                share = (turn + number / len(contestants)) / turns
                tell(one.setting.name, share)
    finally:
        gc.enable()


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


def _refuse(setting: Setting, reason: str, outcomes: list[Outcome]) -> None:
    if setting.name in (DEFAULT, FINEST):
        raise ArmguardError(f"setting {setting.name!r}", f"cannot be made: {reason}")
    outcomes.append(Outcome(setting, None, reason))
