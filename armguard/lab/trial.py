"""Trials that settings are chosen by where there is no recording: a scene's states and messages.

What is made up is a simulated person's visit, from the first step towards the arm until both hands
are at it, so that all levels occur.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

from armguard.lab.simulation import ObstacleSource, ProceduralPerson
from armguard.lab.simulation.person import DURATIONS
from armguard.lab.tradeoff.ladder import AUTO, Rung, Setting
from armguard.lab.tradeoff.scene import TARGET, Scene, Site
from armguard.messages.batch import ObstacleBatch
from armguard.monitor.trial import Choice, TrialTick

SECONDS = 3.0
"""Of a scene that settings are chosen by, in [s]."""

BEGIN = 0.4
"""When the person of the shortest visit begins to walk, in [s]."""

SEED = 1
"""Of motions that are made up."""


def make_visit(site: Site, seed: int = SEED) -> Scene:
    """What a site could see: its arm at work, and a person who comes, if anything is heard there.

    The same site and seed give the same scene.

    Args:
        site: Where, and by what arm.
        seed: Of all motions.

    Raises:
        ArmguardError: The arm cannot work here.
    """
    hears = site.make_obstacles().settings.sources != ()
    people: list[ObstacleSource] = []
    if hears:
        people.append(ProceduralPerson(seed, DURATIONS[0], target=TARGET))
    return Scene(site, people, SECONDS, seed, BEGIN)


def list_ticks(scene: Scene, rate: float) -> list[TrialTick]:
    """A scene as a trial.

    Args:
        scene: The scene.
        rate: Of ticks, in [Hz].
    """
    ticks = []
    left = scene.messages[::-1]
    for number in range(round(scene.seconds * rate)):
        now = number / rate
        due = []
        while left and left[-1].stamp <= now + 1e-12:
            due.append(left.pop())
        tell: Callable[[Any], object] | None = functools.partial(_tell, due) if due else None
        ticks.append(TrialTick(now, *scene.sample(now), tell=tell))
    return ticks


def make_setting(choice: Choice) -> Setting:
    """What was chosen, as a setting of a study."""
    return Setting(AUTO, (Rung(AUTO, "", choice.settings, level=choice.level),))


def _tell(messages: Sequence[ObstacleBatch], monitor: Any) -> None:
    for message in messages:
        monitor.obstacles.update(*message)
