"""The results of commissioning, and the figures that could not be measured, by name."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armguard.lab.commission.joints import (
    KeptLimits,
    StateErrors,
    TrackingErrors,
    measure_errors,
    measure_limits,
    measure_tracking,
)
from armguard.lab.commission.observations import Observations
from armguard.lab.commission.sources import SourceFindings, measure_source
from armguard.lab.commission.stops import (
    JointStop,
    UnmeasuredStop,
    find_response,
    measure_stops,
)
from armguard.robot.brakes import BrakeEntry

LEVEL_STEP = 0.6
"""Share of a joint's fastest stop; stops below this share get an entry of their own."""

LEVEL_WIDTH = 0.95
"""Stops from this share of a speed on count as from that speed."""


class Findings(NamedTuple):
    """Results of a recording; each figure is on the safe side of its measurement."""

    seen: Observations
    stops: list[JointStop]
    response: float
    """From a STOP to the first slowing, the longest of all stops, in [s]; NaN: there was none, or
    one of the STOPs may have been obeyed later, or not at all."""
    unmeasured: list[UnmeasuredStop]
    """STOPs while a joint moved from which its brakes cannot be measured."""
    brakes: dict[str, list[BrakeEntry]]
    """Entries of each joint with a measured STOP, by rising speed."""
    limits: dict[str, KeptLimits]
    """Of each joint that moved."""
    errors: dict[str, StateErrors]
    tracking: TrackingErrors | None
    """None: no plan was recorded that the arm was allowed to do."""
    sources: dict[str, SourceFindings]
    missing: list[str]
    """Figures that were not found, with the reason, one line each."""


def commission(seen: Observations) -> Findings:
    """Measure an arm, its controller and its sources from a recording."""
    joints = seen.robot.joints
    stops, unmeasured = measure_stops(seen)
    missing = [str(one) for one in unmeasured]
    if seen.has_gaps:
        missing.insert(0, "lost events: the recording has gaps")
    response, open_ones = find_response(stops, unmeasured)
    if open_ones:
        response = float("nan")
        missing.append(
            "reaction time: a STOP may have been obeyed later than measured, or not at all: "
            + ", ".join(f"{told:.3f} s" for told in sorted({one.command.told for one in open_ones}))
        )
    if not stops:
        what = (
            "the recording has no STOP of a moving joint"
            if not seen.stops
            else "no stop could be measured"
        )
        missing.append(f"latency, reaction time and stopping times: {what}")
    brakes, limits, errors = {}, {}, {}
    for joint, name in enumerate(joints):
        if own := [stop for stop in stops if stop.joint == name]:
            open_count = sum(one.joint == name for one in unmeasured)
            brakes[name] = _list_entries(own, open_count, seen.payload)
        if name not in brakes:
            missing.append(f"{name}, brakes: the joint was never fast enough at a STOP")
        elif all(entry.deceleration == 0.0 for entry in brakes[name]):
            missing.append(f"{name}, deceleration: it is not constant")
        kept, state = measure_limits(seen, joint), measure_errors(seen, joint)
        if kept is None:
            missing.append(f"{name}, operating limits: the joint hardly moved")
        else:
            limits[name] = kept
            if np.isnan(kept.acceleration):
                why = (
                    "noise of its velocity hides it"
                    if np.isnan(kept.window)
                    else f"it lasts hardly longer than the window, {1e3 * kept.window:.3g} ms"
                )
                missing.append(f"{name}, operating acceleration: {why}")
        if state is None:
            missing.append(f"{name}, measurement errors: too few consecutive states")
        else:
            errors[name] = state
    tracking = measure_tracking(seen)
    if tracking is None:
        missing.append("tracking errors: the recording has no plan that was allowed")
    sources = {}
    for name, sent in seen.sources.items():
        source = measure_source(sent)
        if source is None:
            missing.append(f"source {name}: {len(sent.stamps)} messages are too few")
        else:
            sources[name] = source
            if np.isnan(source.spread):
                missing.append(f"source {name}, spread: no obstacle was reported often enough")
    if not seen.sources:
        missing.append("sources: the recording has no message of obstacles")
    return Findings(
        seen, stops, response, unmeasured, brakes, limits, errors, tracking, sources, missing
    )


def _list_entries(stops: list[JointStop], unmeasured: int, payload: float) -> list[BrakeEntry]:
    """Entries of one joint's brakes, by rising speed; an entry holds for all lower speeds."""
    entries: list[BrakeEntry] = []
    besides = f"; {unmeasured} more could not be measured" if unmeasured else ""
    fastest = max(stop.speed for stop in stops)
    slow = max((stop.speed for stop in stops if stop.speed <= LEVEL_STEP * fastest), default=0.0)
    for level in (slow, fastest):
        if level == 0.0:
            continue
        # It holds up to the slowest of the stops that are about as fast, for all that is slower.
        speed = min(stop.speed for stop in stops if level * LEVEL_WIDTH <= stop.speed <= level)
        included = [stop for stop in stops if stop.speed <= level]
        is_steady = all(stop.deceleration > 0.0 for stop in included)
        entries.append(
            BrakeEntry(
                payload,
                speed,
                max(stop.stopping_time for stop in included),
                max(stop.stopping_distance for stop in included),
                min(stop.deceleration for stop in included) if is_steady else 0.0,
                f"commissioned: the worst of {len(included)} stops{besides}",
            )
        )
    return entries
