"""How the price of a tick grows with the number of pairs, and the exponent of that growth."""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np

from armguard.exceptions import ArmguardError
from armguard.lab.pages import fit_exponent
from armguard.lab.tradeoff.contestant import Contestant
from armguard.lab.tradeoff.ladder import AXES, Rung, Setting
from armguard.lab.tradeoff.scene import Site, make_scene

COUNTS = (1, 3, 10, 30, 100, 300, 1000, 3000)
"""Of obstacles."""

SECONDS, PATIENCE, LEAST = 0.3, 1.0, 5
"""Of the scene, at most; of processor time for one of its sizes, at most; ticks, at least."""

FROM = 200
"""Pairs from which on the exponent is fitted: below, what every tick costs hides the growth."""


class Grown(NamedTuple):
    """One schedule among so many pairs."""

    schedule: str
    pairs: int
    tick: float
    """In the median, in [µs] of processor time."""
    evaluated: float
    """Evaluations in a tick, on average."""
    flagged: float
    """Share of pairs that `daa` watches out of turn."""
    machine: str = ""
    """Where it was measured; empty where all is of this process."""


def list_sizes() -> list[tuple[int, Setting]]:
    """Numbers of obstacles, and the schedules that are measured among them."""
    return [(count, setting) for count in COUNTS for setting in _settings()]


def measure_size(site: Site, seed: int, count: int, setting: Setting) -> Grown | None:
    """One schedule among so many balls; None if it does not go with the site's settings.

    How many ticks are run depends on how fast the machine is, and so, a little, do the counts.
    """
    scene, _ = make_scene(site, None, count, SECONDS, seed)
    try:
        contestant = Contestant(setting, site, scene, site.robot.cover)
    except ArmguardError:
        return None  # the study itself says which settings do not go together
    begun, until = time.thread_time(), 0.0
    while until < SECONDS and (
        until < LEAST / contestant.rate or time.thread_time() - begun < PATIENCE
    ):
        until += 1.0 / contestant.rate
        contestant.run(until)
    track = contestant.track
    return Grown(
        setting.name,
        count * len(site.robot.links),
        1e6 * float(np.median(track.spent)),
        float(track.evaluated.mean()),
        float(track.flagged.mean()),
    )


def fit_exponents(grown: list[Grown]) -> dict[str, float]:
    """By schedule, the exponent e of tick ~ pairs^e, by least squares on log axes."""
    exponents = {}
    for name in dict.fromkeys(one.schedule for one in grown):
        points = [one for one in grown if one.schedule == name and one.pairs >= FROM]
        fitted = fit_exponent([one.pairs for one in points], [one.tick for one in points])
        if math.isfinite(fitted):
            exponents[name] = fitted
    return exponents


def _settings() -> list[Setting]:
    rungs: list[Rung] = AXES["schedule"]
    return [
        Setting("deadline", (Rung("schedule", "deadline", {"schedule": "deadline"}),)),
        *(Setting(rung.value, (rung,)) for rung in rungs),
    ]
