"""Measurements of tracked people: broken bounds, hidden joints, bone lengths, errors.

Two errors are computed from the samples themselves. *Jitter*: fourth differences of positions
contain little of people's motion, and 8.4 times the noise of each sample. Jumps do not change their
median, from which the 99.9 % bound of white noise follows. The rest of a fast motion counts as
noise, which makes errors larger. *Placement*: a bone has one length, the median of its samples. A
sample that differs by d shows that an end was off by d / 2; the 99.9 % percentile counts. The
larger error is proposed as position error. Neither shows a constant offset or errors that a kit has
smoothed: compare with an independent measurement.

A bound counts as broken if neither jitter nor the stated position error explains the sample.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.lab.people import (
    HALF_WINDOW,
    SLOWEST_RATE,
    BoundReport,
    Motion,
    check_bounds,
    measure_motion,
)
from armguard.lab.tracked_people.tracks import Track, Tracked
from armguard.people.body_parts import BOUNDS, PartBounds
from armguard.people.proportions import SEGMENTS

Array = NDArray[np.float64]

EXPLAINED = 99.9
"""So many of 100 samples are explained by a proposed error: as many as keep published bounds."""

NOISE_FACTOR = 2.33
"""Three-dimensional white noise is below so many times its root of the mean square in `EXPLAINED` %
of samples: 4.03 deviations of an axis."""

ENOUGH = 1000
"""Clean samples from which a percentile of 99.9 can be told."""

LEAST_ERROR = 0.001
"""What is proposed at the least, in [m]."""

_PARTS = {
    "hip": "trunk", "pelvis": "trunk", "collar": "trunk", "clavicle": "trunk",
    "shoulder": "shoulder", "elbow": "elbow", "wrist": "hand", "hand": "hand", "hand_tip": "hand",
    "thumb": "hand", "index": "hand", "pinky": "hand", "middle_tip": "hand", "knee": "thigh",
    "ankle": "foot", "toe": "foot", "small_toe": "foot", "heel": "foot",
}  # fmt: skip
"""Part of the body, of `BOUNDS`, by joint without its side; spines are the trunk's, all else is the
head's."""

_BONES = {
    "upper arm": (("shoulder", "elbow"), ("upper_arm",)),
    "forearm": (("elbow", "wrist"), ("forearm",)),
    "forearm and hand": (("elbow", "hand"), ("forearm", "palm")),
    "palm": (("wrist", "index"), ("palm",)),
    "thigh": (("hip", "knee"), ("thigh",)),
    "shank": (("knee", "ankle"), ("shank",)),
}
"""By name: the joints of one side, and the segments between them."""


class Hidden(NamedTuple):
    """How often, and for how long, joints of a part were hidden."""

    share: float
    """Of samples since a joint was first seen; NaN where none was."""
    times: int
    """That a joint was hidden."""
    median: float
    """How long, in [s]; NaN where none was."""
    p99: float
    """[s]."""
    longest: float
    """[s]."""
    never: tuple[str, ...]
    """Joints that were never seen."""


class Bone(NamedTuple):
    """Measured lengths of a bone, both sides and all people together."""

    samples: int
    stated: float
    """The longest that it can be, in [m]."""
    median: float
    """[m]."""
    p999: float
    """[m]."""
    placement: float
    """Placement error of its ends, in [m]."""
    broken: float
    """Share of samples that are longer than is stated, errors included."""


class Findings(NamedTuple):
    """Results of recordings."""

    rates: tuple[float, ...]
    """Of the recordings, in [Hz]."""
    position_error: float
    """That is stated, or else the one that is proposed, in [m]."""
    proposed_error: float
    """The larger of jitter and placement, in [m]."""
    jitter: dict[str, float]
    """By part, in [m]; empty where frames are too rare to tell."""
    hidden: dict[str, Hidden]
    """By part."""
    bounds: dict[str, BoundReport]
    """By part, errors included; empty where frames are too rare to tell."""
    proposed: dict[str, PartBounds]
    """Bounds by part: the published ones, or what is seen, errors taken off, where that is more."""
    bones: dict[str, Bone]
    """By name."""


_Moved = tuple[Motion, list[str], float]
"""A person's motion, the part of each joint, and half of the window of differences, in [s]."""


def find_part(joint: str) -> str:
    """The part of the body, of `BOUNDS`, that a joint moves with.

    Args:
        joint: Its name, as of `armguard.bridges.skeletons`.
    """
    end = joint.removeprefix("left_").removeprefix("right_")
    if end.startswith("spine"):
        return "trunk"
    return _PARTS.get(end, "head")


def measure_people(
    recordings: Sequence[Tracked],
    *,
    position_error: float | None = None,
    height: float | None = None,
) -> Findings:
    """Measure recordings, all together.

    Args:
        recordings: At least one.
        position_error: That is stated, in [m]; None: the one that is proposed.
        height: Of the people, in [m]; None: of anybody.
    """
    motions = [
        (
            measure_motion(track.position, recording.rate),
            [find_part(joint) for joint in track.joints],
            _half_window(recording.rate),
        )
        for recording in recordings
        if recording.rate >= SLOWEST_RATE
        for track in recording.tracks
    ]
    jitter = _find_jitter(motions)
    bones = _measure_bones(recordings, height)
    # In whole millimetres, upwards.
    found = [LEAST_ERROR, *jitter.values(), *(bone.placement for bone in bones.values())]
    proposed_error = 1e-3 * math.ceil(1e3 * max(found) - 1e-9)
    error = proposed_error if position_error is None else position_error
    explained = dict.fromkeys(BOUNDS, position_error) if position_error is not None else jitter
    reports, proposed = _check_motion(motions, explained)
    return Findings(
        tuple(one.rate for one in recordings),
        error,
        proposed_error,
        jitter,
        _find_hidden(recordings),
        reports,
        proposed,
        {name: _count_broken(bone, error) for name, bone in bones.items()},
    )


def _group(track: Track) -> dict[str, list[int]]:
    """Columns of joints by part, in the order of `BOUNDS`."""
    columns: dict[str, list[int]] = {part: [] for part in BOUNDS}
    for column, joint in enumerate(track.joints):
        columns[find_part(joint)].append(column)
    return {part: found for part, found in columns.items() if found}


def _half_window(rate: float) -> float:
    """From the middle of a second difference to its ends, in [s], as `measure_motion` rounds it."""
    return max(1, round(HALF_WINDOW * rate)) / rate


def _find_jitter(motions: Iterable[_Moved]) -> dict[str, float]:
    """Noise that explains `EXPLAINED` % of samples, by part, of its noisiest joint, in [m]."""
    found: dict[str, float] = {}
    for motion, parts, half in motions:
        noise = NOISE_FACTOR * motion.noise * half**2 / math.sqrt(6.0)
        for part, value in zip(parts, noise.tolist(), strict=True):
            if not math.isnan(value):
                found[part] = max(found.get(part, 0.0), value)
    return {part: found[part] for part in BOUNDS if part in found}


def _find_lengths(track: Track, near: str, far: str) -> list[Array]:
    """Distances of two joints of each side, where both were seen, in [m]."""
    found = []
    for side in ("left", "right"):
        names = f"{side}_{near}", f"{side}_{far}"
        if all(name in track.joints for name in names):
            a, b = (track.position[:, track.joints.index(name)] for name in names)
            length = np.linalg.norm(a - b, axis=1)
            found.append(length[np.isfinite(length)])
    return found


def _find_hidden(recordings: Iterable[Tracked]) -> dict[str, Hidden]:
    """From the first time that a joint was seen until its person was seen no more."""
    samples = dict.fromkeys(BOUNDS, 0)
    missing = dict.fromkeys(BOUNDS, 0)
    runs: dict[str, list[Array]] = {}
    shown: dict[str, set[str]] = {part: set() for part in BOUNDS}
    known: dict[str, set[str]] = {part: set() for part in BOUNDS}
    for recording in recordings:
        for track in recording.tracks:
            for part, columns in _group(track).items():
                for column in columns:
                    joint = track.joints[column]
                    known[part].add(joint)
                    is_seen = np.all(np.isfinite(track.position[:, column]), axis=1, keepdims=False)
                    at = np.flatnonzero(is_seen).astype(np.float64)
                    if not len(at):
                        continue
                    shown[part].add(joint)
                    gaps = np.diff(at, append=len(is_seen)) - 1
                    samples[part] += len(is_seen) - int(at[0])
                    missing[part] += int(gaps.sum())
                    runs.setdefault(part, []).append(gaps[gaps > 0] / recording.rate)
    hidden = {}
    for part in BOUNDS:
        if known[part]:
            lengths = np.concatenate([*runs.get(part, []), np.empty(0)])
            times = (math.nan,) * 3
            if len(lengths):
                times = tuple(np.percentile(lengths, [50.0, 99.0, 100.0]).tolist())
            share = missing[part] / samples[part] if samples[part] else math.nan
            never = tuple(sorted(known[part] - shown[part]))
            hidden[part] = Hidden(share, len(lengths), *times, never)
    return hidden


def _check_motion(
    motions: Iterable[_Moved], errors: Mapping[str, float]
) -> tuple[dict[str, BoundReport], dict[str, PartBounds]]:
    """Bounds that were broken by more than errors explain, and bounds to state.

    Errors add 4 dp / h² to a second difference over h to either side, and dp / h to a speed.
    """
    reports: dict[str, list[BoundReport]] = {}
    proposed: dict[str, PartBounds] = {}
    for motion, parts, half in motions:
        added = {part: (4.0 * one / half**2, one / half) for part, one in errors.items()}
        allowed = {}
        for part, bound in BOUNDS.items():
            by_accel, by_speed = added.get(part, (0.0, 0.0))
            allowed[part] = bound._replace(
                accel=bound.accel + by_accel, speed=bound.speed + by_speed
            )
        for part, report in check_bounds([(motion, parts)], allowed).items():
            reports.setdefault(part, []).append(report)
            wider = proposed.get(part, BOUNDS[part])
            if report.clean >= ENOUGH:
                by_accel, by_speed = added.get(part, (0.0, 0.0))
                accel = float(math.ceil(report.accel[1] - by_accel))
                speed = 0.1 * math.ceil(10.0 * (report.speed[1] - by_speed))
                if accel > wider.accel or speed > wider.speed:
                    accel, speed = max(accel, wider.accel), max(speed, wider.speed)
                    wider = PartBounds(accel, speed, 99.9, "measured by armguard people")
            proposed[part] = wider
    pooled = {part: _pool(reports[part]) for part in BOUNDS if part in reports}
    return pooled, proposed


def _pool(reports: Sequence[BoundReport]) -> BoundReport:
    """Several recordings' as one: shares of all samples, and the largest of percentiles."""
    known = [one for one in reports if one.clean]
    if not known:
        return reports[0]
    clean = sum(one.clean for one in known)

    def share(name: str) -> float:
        return sum(getattr(one, name) * one.clean for one in known) / clean

    largest = [
        tuple(max(values) for values in zip(*(getattr(one, name) for one in known), strict=True))
        for name in ("accel", "speed")
    ]
    return BoundReport(
        sum(one.seen for one in reports),
        clean,
        largest[0],
        largest[1],
        share("accel_broken"),
        share("speed_broken"),
        share("broken"),
    )


class _Lengths(NamedTuple):
    """Samples of a bone."""

    samples: Array
    """[m]."""
    stated: float
    """[m]."""
    placement: float
    """[m]."""


def _measure_bones(recordings: Iterable[Tracked], height: float | None) -> dict[str, _Lengths]:
    """Lengths by bone, with the spread of each side of each person about its median."""
    lengths: dict[str, list[Array]] = {}
    for recording in recordings:
        for track in recording.tracks:
            for name, ((near, far), _) in _BONES.items():
                found = [one for one in _find_lengths(track, near, far) if len(one)]
                lengths.setdefault(name, []).extend(found)
    bones = {}
    for name, (_, segments) in _BONES.items():
        if lengths.get(name):
            stated = sum(
                SEGMENTS[one].length if height is None else SEGMENTS[one].per_height * height
                for one in segments
            )
            off = np.concatenate([np.abs(one - np.median(one)) / 2.0 for one in lengths[name]])
            placement = float(np.percentile(off, EXPLAINED))
            bones[name] = _Lengths(np.concatenate(lengths[name]), stated, placement)
    return bones


def _count_broken(bone: _Lengths, error: float) -> Bone:
    median, p999 = np.percentile(bone.samples, [50.0, 99.9]).tolist()
    broken = float(np.mean(~(bone.samples <= bone.stated + 2.0 * error)))
    return Bone(len(bone.samples), bone.stated, median, p999, bone.placement, broken)
