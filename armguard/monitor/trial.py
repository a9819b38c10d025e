"""A trial of settings, and what was chosen by it; `armguard.choose_settings` makes the choice."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from numpy.typing import ArrayLike


class TrialTick(NamedTuple):
    """One tick of a trial: a joint state, and what is told before it is judged."""

    stamp: float
    """As in `Monitor.step`, and so are the next three."""
    q: ArrayLike
    v: ArrayLike
    now: float | None = None
    tell: Callable[[Any], object] | None = None
    """Is handed the monitor that is tried, and tells it and its `obstacles` what came since the
    tick before; the same for each. None: nothing came."""


class Choice(NamedTuple):
    """What was chosen, and why."""

    settings: Mapping[str, Any]
    """Keywords of `Monitor`."""
    level: int | None
    """Of the robot's cover, the finest that is used; None: all of it."""
    ticks: int
    """Of the trial."""
    same_level: float
    """Share of the ticks with the level that the finest gave."""
    scale_difference: float
    """Of speed scales from the finest's, on average."""
    evaluated: float
    """Evaluations in a tick, on average."""
    evaluated_max: int
    """In the dearest tick."""
    evaluated_finest: float
    """Of the finest, on average."""
    is_same: bool
    """Whether the verdicts cannot be told from the finest's, by the rule of `Monitor.auto`."""
    out_of_reach: tuple[str, ...]
    """Links that nothing in the trial could reach in time to matter, by their reach alone."""
    reasons: tuple[str, ...]
    """In words: the settings, how near they are to the finest, the links, and, setting by setting,
    what else was tried, each with its share of equal levels and its evaluations a tick."""

    @property
    def summary(self) -> tuple[str, ...]:
        """The first of the reasons: the settings, how near they are to the finest, the links."""
        return self.reasons[:3]

    @property
    def price(self) -> float:
        """Evaluations as a share of the finest's; 1 where that has none."""
        return self.evaluated / self.evaluated_finest if self.evaluated_finest > 0.0 else 1.0
