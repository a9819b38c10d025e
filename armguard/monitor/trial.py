"""A trial of settings and its result; `armguard.choose_settings` makes the choice."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from numpy.typing import ArrayLike


class TrialTick(NamedTuple):
    """One tick of a trial: a joint state, and the updates before it is judged."""

    stamp: float
    """Time of measurement, in [s]; this and the next three fields are arguments of
    `Monitor.step`."""
    q: ArrayLike
    v: ArrayLike
    now: float | None = None
    tell: Callable[[Any], object] | None = None
    """Called with each tried monitor; applies the updates since the tick before to it and its
    `obstacles`. It must do the same for each. None: no updates."""


class Choice(NamedTuple):
    """The settings that a trial chose, and why."""

    settings: Mapping[str, Any]
    """The chosen settings, as keywords of `Monitor`."""
    level: int | None
    """Finest level of the robot's cover that is used; None: all levels."""
    ticks: int
    """Number of ticks of the trial."""
    same_level: float
    """Share of the ticks with the same level as with the finest settings."""
    scale_difference: float
    """Mean difference of speed scales from those with the finest settings."""
    evaluated: float
    """Mean number of evaluations in a tick."""
    evaluated_max: int
    """Greatest number of evaluations in a tick."""
    evaluated_finest: float
    """Mean number of evaluations in a tick with the finest settings."""
    is_same: bool
    """Whether the verdicts are equivalent to those with the finest settings, by the rule of
    `Monitor.auto`."""
    out_of_reach: tuple[str, ...]
    """Links that no obstacle of the trial could reach in time to affect a verdict."""
    reasons: tuple[str, ...]
    """The reasons in words: the settings, how near they are to the finest, and the links; then the
    other candidates of each setting, with their share of equal levels and evaluations per tick."""

    @property
    def summary(self) -> tuple[str, ...]:
        """The first reason: the settings, how near they are to the finest, and the links."""
        return self.reasons[:3]

    @property
    def price(self) -> float:
        """Evaluations as a share of those with the finest settings; 1 if these have none."""
        return self.evaluated / self.evaluated_finest if self.evaluated_finest > 0.0 else 1.0
