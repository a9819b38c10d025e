"""Evaluates a tick once more with changed data, to find what lowered its level.

The answers are for people, and never change a verdict.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from armguard.jit.arrays import IntArray
from armguard.monitor.levels import VerdictRule
from armguard.monitor.stop_decision import StopDecision
from armguard.pairs.evaluate import evaluate, find_unsafe_pair
from armguard.robot.joint_states import JointStates
from armguard.scheduling.scheduler import Scheduler, Tick
from armguard.settings.settings import Settings
from armguard.verdict import Level

MOST_PAIRS = 128
"""Greatest number of pairs that are evaluated once more: the most imminent ones."""


class NearPairs(NamedTuple):
    """The near pairs, which could make the level of a tick low."""

    pairs: IntArray
    """Their numbers, row × links + link, at most `MOST_PAIRS`. Shape (m,)."""
    rows: IntArray
    """Rows of their obstacles. Shape (r,)."""
    rest: float
    """Lower bound on the contact times of all other pairs, in [s]."""


class SecondLook:
    """Evaluates near pairs once more.

    Args:
        scheduler: Knows the pairs.
        states: Knows the joint states.
        rule: Makes levels.
        settings: Of the monitor.
        stopping: Decides about stops; None: contact times alone decide.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        states: JointStates,
        rule: VerdictRule,
        settings: Settings,
        stopping: StopDecision | None,
    ) -> None:
        self._scheduler = scheduler
        self._states = states
        self._rule = rule
        self._response_time = settings.response_time
        self._stopping = stopping
        self._times = np.zeros(MOST_PAIRS)
        self._nodes = np.zeros(MOST_PAIRS, dtype=np.int64)
        self._bounds = np.zeros(MOST_PAIRS, dtype=np.int8)

    def find_near(self, tick: Tick) -> NearPairs:
        """The pairs that are imminent enough to matter."""
        horizon = tick.stop_time + self._rule.aware_margin
        listing = self._scheduler.list_imminent(tick.time, row_limit=0, pair_limit=MOST_PAIRS)
        near = listing.pairs[~(listing.expiry > tick.time + horizon)]
        # What is not listed has certificates that last at least as long.
        is_full = len(near) == MOST_PAIRS
        rest = float(listing.expiry[-1]) - tick.time if is_full else math.inf
        return NearPairs(near, np.unique(near // len(self._scheduler.arm.links)), rest)

    def grade_rest(self, tick: Tick, near: NearPairs) -> Level:
        """The lowest level that pairs outside the near ones could give."""
        return self._rule.grade(near.rest, tick.stop_time)

    def grade(self, tick: Tick, pairs: IntArray, arm_late: float = 0.0) -> Level:
        """The level of the pairs with a joint state that is newer by a time in [s]."""
        age = tick.arm_age - arm_late
        stop_time, _ = self._states.stop_times(age) if arm_late > 0.0 else (tick.stop_time, 0.0)
        times = self._times[: len(pairs)]
        with self._at_age(tick, age):
            evaluate(self._scheduler.arm.state, pairs, times, self._nodes, self._bounds)
            contact_time = float(times.min(initial=math.inf))
            rests, whole = contact_time > stop_time, False
            if self._stopping is not None:
                rests = rests or self._stops(tick, age, pairs, self._response_time)
                whole = rests and self._stops(tick, age, pairs, self._stopping.looks_ahead)
        return self._rule.grade(contact_time, stop_time, rests=rests, whole=whole)

    def _stops(self, tick: Tick, age: float, pairs: IntArray, horizon: float) -> bool:
        """Whether an arm with a STOP after a time, in [s], is at rest before contact."""
        braking = self._scheduler.arm.motion.braking
        if not braking.covers(tick.q, tick.v, age, horizon):
            return False
        braking.tabulate(tick.q, tick.v, age, horizon)
        return bool(find_unsafe_pair(self._scheduler.arm.state, pairs)[0] < 0)

    @contextmanager
    def _at_age(self, tick: Tick, age: float) -> Iterator[None]:
        """Context in which the joint state has another age; restores it afterwards."""
        scheduler = self._scheduler
        scheduler.prepare(tick)
        state = scheduler.arm.state
        threshold, sphere_time = state.refinement_threshold, state.sphere_time.copy()
        try:
            state.arm_age, state.refinement_threshold = age, tick.refinement_threshold
            state.prepare_arm(tick.q, tick.v)
            yield
        finally:
            state.arm_age, state.refinement_threshold = tick.arm_age, threshold
            state.prepare_arm(tick.q, tick.v)
            state.sphere_time[:] = sphere_time
