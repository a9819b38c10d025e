"""People in recordings of any kind, as joint positions at equal time steps."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.bridges.skeletons import SkeletonRecording, read_recording
from armguard.exceptions import ArmguardError
from armguard.lab.simulation.bodies import POINTS
from armguard.lab.simulation.recordings import read_vicon_csv

Array = NDArray[np.float64]

FEWEST_FRAMES = 10
"""Of a recording that says anything."""

RATES = (1.0, 1000.0)
"""Frames a second of a camera, in [Hz]: others are stamps in another unit."""

LONGEST_ABSENCE = 10.0
"""A person who is not seen for longer, in [s], has left; after that a new track begins."""


class Track(NamedTuple):
    """One person, from the first frame with them to the last before a long absence."""

    person: str
    joints: tuple[str, ...]
    position: Array
    """NaN where a joint was hidden, in [m]. Shape (frames, joints, 3)."""


class Tracked(NamedTuple):
    """A recording of people."""

    name: str
    kit: str
    rate: float
    """Frames a second, in [Hz]."""
    duration: float
    """[s]."""
    tracks: tuple[Track, ...]
    bad_frames: Counter[str]
    """By what was wrong with them."""


def load_tracks(
    path: Path,
    *,
    threshold: float | None = None,
    rate: float | None = None,
    unit: float | None = None,
) -> Tracked:
    """Read a recording.

    Args:
        path: A kit's file or folder, or motion capture as Vicon exports it (.csv).
        threshold: Joints of less confidence are hidden; None: the kit's.
        rate: Frames a second, in [Hz], where the file has no stamps.
        unit: Of positions, in [m]; None: the kit's.

    Raises:
        ArmguardError: It cannot be read, is too short, or nobody is seen in it.
    """
    if path.suffix.lower() == ".csv":
        frequency, points = read_vicon_csv(path)
        tracks = (Track("person", POINTS, points),)
        duration = (len(points) - 1) / frequency
        found = Tracked(path.name, "vicon", frequency, duration, tracks, Counter())
    else:
        found = _lay_out(path.name, read_recording(path, rate=rate, unit=unit), threshold)
    if sum(len(track.position) for track in found.tracks) < FEWEST_FRAMES:
        raise ArmguardError(
            str(path), "shows people in too few frames", expected=f"at least {FEWEST_FRAMES}"
        )
    if not any(np.isfinite(track.position).any() for track in found.tracks):
        raise ArmguardError(
            str(path),
            "has no joint that counts as seen",
            remedy="state --threshold; 0 takes joints without a confidence as well",
        )
    return found


def _lay_out(name: str, recording: SkeletonRecording, threshold: float | None) -> Tracked:
    """Place frames on equal steps of the usual time between them; missing frames are hidden.

    Of two frames that fall into one step the later one counts.
    """
    stamps = np.array([frame.stamp for frame in recording.frames])
    if len(stamps) < FEWEST_FRAMES:
        raise ArmguardError(
            name, f"has {len(stamps)} good frames", expected=f"at least {FEWEST_FRAMES}"
        )
    step = float(np.median(np.diff(stamps)))
    rate = 1.0 / step
    if not (RATES[0] <= rate <= RATES[1]):
        raise ArmguardError(
            name,
            f"has {rate:.3g} frames a second",
            expected=f"{RATES[0]:g} to {RATES[1]:g} Hz",
            remedy="stamps may be in another unit; --rate states the frame rate",
        )
    places = np.rint((stamps - stamps[0]) / step).astype(int)
    joints: dict[str, tuple[str, ...]] = {}
    seen: dict[str, dict[int, dict[str, Array]]] = {}
    for place, frame in zip(places.tolist(), recording.frames, strict=True):
        for body in frame.bodies:
            joints[body.person] = body.model.joints
            seen.setdefault(body.person, {})[place] = body.find_seen(threshold)
    tracks = []
    for person, sights in seen.items():
        names = joints[person]
        columns = {joint: column for column, joint in enumerate(names)}
        for stay in _split(sorted(sights), LONGEST_ABSENCE * rate):
            first = stay[0]
            position = np.full((stay[-1] - first + 1, len(names), 3), np.nan)
            for place in stay:
                for joint, at in sights[place].items():
                    if joint in columns:
                        position[place - first, columns[joint]] = at
            tracks.append(Track(person, names, position))
    duration = float(stamps[-1] - stamps[0])
    return Tracked(name, recording.kit, rate, duration, tuple(tracks), recording.bad_frames)


def _split(places: list[int], longest: float) -> list[list[int]]:
    """Indices in order, cut where two neighbours are farther apart than the given gap."""
    stays = [[places[0]]]
    for place in places[1:]:
        if place - stays[-1][-1] > longest:
            stays.append([])
        stays[-1].append(place)
    return stays
