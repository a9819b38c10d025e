"""What messages ask of the monitor, for the loop to answer."""

from __future__ import annotations

import dataclasses
import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.verdict import ResetVerdict


class PlanRequest(NamedTuple):
    """What a controller asks about its plan, in the order of the watched joints."""

    ask: Literal["commit", "share"]
    number: int
    """Of the plan, as its sender counts."""
    problem: str
    """What makes it unusable, in words; empty: nothing, and all below is there."""
    stamp: float = math.nan
    """When the arm is at the first sample, in [s] of the monitor's time."""
    times: NDArray[np.float64] = np.zeros(0)
    """Of the samples, in [s] from `stamp`. Shape (k,)."""
    q: NDArray[np.float64] = np.zeros((0, 0))
    """[rad] or [m]. Shape (k, nv)."""
    v: NDArray[np.float64] = np.zeros((0, 0))
    """[rad/s] or [m/s]. Shape (k, nv)."""
    tracking_error: NDArray[np.float64] = np.zeros(0)
    """[rad] or [m]. Shape (nv,)."""
    velocity_tracking_error: NDArray[np.float64] | None = None
    """[rad/s] or [m/s]. Shape (nv,); None where the sender does not say."""


class ExemptionRequest(NamedTuple):
    """What a sender asks about contact that it wants for the time being."""

    number: int
    """Of the exemption, as its sender counts."""
    is_end: bool
    """Whether it is to end; then nothing else is said."""
    link: str = ""
    """Name of a link; "*" is any."""
    ids: str = ""
    """Pattern of obstacle ids."""
    source: str | None = None
    """Whose obstacles alone are meant."""
    until: float | None = None
    """Until when, in [s] of the monitor's time, never too late; None: the zone decides."""
    zone: NDArray[np.float64] | None = None
    """Where, as corners in [m], shape (k, 3); None: anywhere."""


@dataclasses.dataclass
class Requests:
    """What was asked in the last drain."""

    plans: list[PlanRequest] = dataclasses.field(default_factory=list)
    """Plans, oldest first."""
    exemptions: list[ExemptionRequest] = dataclasses.field(default_factory=list)
    """What was asked about contact that is wanted, oldest first."""
    reset_verdicts: list[tuple[int, ResetVerdict]] = dataclasses.field(default_factory=list)
    """Answers to the resets that want one, by number, oldest first."""
    is_reset: bool = False
    """Whether a reset with the right token came; the loop that obeys it sets it back."""

    def begin_drain(self) -> None:
        """Forget what was asked in the drain before; a reset that was not obeyed stays."""
        if self.plans or self.exemptions or self.reset_verdicts:
            self.plans, self.exemptions, self.reset_verdicts = [], [], []
