"""Reads joints of people from body-tracking kits into one record, whatever the kit.

Each kit has its own list of joints, units, JSON layout, and meaning of confidence. This module
converts them to positions in [m] with one set of names. A joint below a threshold of confidence
counts as hidden: a predicted or guessed joint is not a measurement. `armguard.people.Skeleton`
makes obstacles from them. Axes are those of the kit: the cell's frames state the pose of the
camera.

| kit | joints | unit | confidence | hidden below | published in |
|---|---|---|---|---|---|
| OpenPose, `--3d` | 18 (COCO) or 25 | as calibrated, m | 0 or 1 | 0.5 | its `doc/02_output.md` |
| Azure Kinect | 32 | mm | 0 to 3 | 2 | `k4abttypes.h`, sample `offline_processor` |
| MediaPipe | 33, world | m, from the hips | 0 to 1 | 0.5 | guide of the Pose Landmarker |
| ZED | 18, 34 or 38 | m | 0 to 100 | 50 | `pyzed.sl`, sample `JSON export` |

Kinect's level 1 is "not observed (likely due to occlusion), predicted joint pose". A body of ZED
whose tracking state is SEARCHING is a prediction, too. ZED's and MediaPipe's thresholds are half of
their scales, which are unrelated to errors in metres: measure the errors of your camera with
`armguard people`.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError

Array = NDArray[np.float64]

LARGEST_BODY = 3.0
"""Most that joints are off their middle, in [m], in the median; more is another unit."""

SMALLEST_BODY = 0.03
"""Least that they are off it, in [m], where `JOINTS_OF_A_BODY` are seen."""

JOINTS_OF_A_BODY = 8
"""So many joints spread at least over a trunk."""

MOST_PROBLEMS = 50
"""Problems of frames that are counted by themselves."""

MILLIMETRE = 1e-3

_INVALID_ID = 2**32 - 1  # of Azure Kinect
_PREDICTED = {"SEARCHING", "TERMINATE", "2", "3"}  # of ZED, as text or as number


class JointModel(NamedTuple):
    """The list of joints of a kit, its unit and its confidence."""

    name: str
    joints: tuple[str, ...]
    """Names, in the kit's order."""
    unit: float
    """Unit of its positions, in [m]."""
    most: float
    """Greatest confidence; the least is 0."""
    threshold: float
    """Confidence below which a joint is hidden."""


def _both(*ends: str) -> tuple[str, ...]:
    """Names of joints of both sides, the left one first."""
    return tuple(f"{side}_{end}" for end in ends for side in ("left", "right"))


def _side(side: str, *ends: str) -> tuple[str, ...]:
    return tuple(f"{side}_{end}" for end in ends)


_ARM, _LEG = ("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle")
_EYES_AND_EARS = ("right_eye", "left_eye", "right_ear", "left_ear")
_COCO = (
    *("nose", "neck", *_side("right", *_ARM), *_side("left", *_ARM)),
    *(*_side("right", *_LEG), *_side("left", *_LEG), *_EYES_AND_EARS),
)
_BODY_25 = (
    *("nose", "neck", *_side("right", *_ARM), *_side("left", *_ARM), "pelvis"),
    *(*_side("right", *_LEG), *_side("left", *_LEG), *_EYES_AND_EARS),
    *(*_side("left", "toe", "small_toe", "heel"), *_side("right", "toe", "small_toe", "heel")),
)
_KINECT_ARM = ("clavicle", *_ARM, "hand", "hand_tip", "thumb")
_KINECT = (
    *("pelvis", "spine_navel", "spine_chest", "neck"),
    *(*_side("left", *_KINECT_ARM), *_side("right", *_KINECT_ARM)),
    *(*_side("left", *_LEG, "toe"), *_side("right", *_LEG, "toe")),
    *("head", "nose", "left_eye", "left_ear", "right_eye", "right_ear"),
)
_MEDIAPIPE = (
    *("nose", *_side("left", "eye_inner", "eye", "eye_outer")),
    *(*_side("right", "eye_inner", "eye", "eye_outer"), *_both("ear"), "mouth_left", "mouth_right"),
    *_both(*_ARM, "pinky", "index", "thumb", *_LEG, "heel", "toe"),
)
_ZED_34 = (
    *("pelvis", "spine_navel", "spine_chest", "neck"),
    *(*_side("left", *_KINECT_ARM), *_side("right", *_KINECT_ARM)),
    *(*_side("left", *_LEG, "toe"), *_side("right", *_LEG, "toe")),
    *("head", "nose", "left_eye", "left_ear", "right_eye", "right_ear", *_both("heel")),
)
_ZED_38 = (
    *("pelvis", "spine_1", "spine_2", "spine_3", "neck", "nose"),
    *_both("eye", "ear", "clavicle", *_ARM, *_LEG, "toe", "small_toe", "heel"),
    *_both("thumb", "index", "middle_tip", "pinky"),
)

MODELS: Mapping[str, tuple[JointModel, ...]] = {
    "openpose": (
        JointModel("OpenPose COCO", _COCO, 1.0, 1.0, 0.5),
        JointModel("OpenPose BODY_25", _BODY_25, 1.0, 1.0, 0.5),
    ),
    "kinect": (JointModel("Azure Kinect", _KINECT, MILLIMETRE, 3.0, 2.0),),
    "mediapipe": (JointModel("MediaPipe Pose", _MEDIAPIPE, 1.0, 1.0, 0.5),),
    "zed": (
        JointModel("ZED BODY_18", _COCO, 1.0, 100.0, 50.0),
        JointModel("ZED BODY_34", _ZED_34, 1.0, 100.0, 50.0),
        JointModel("ZED BODY_38", _ZED_38, 1.0, 100.0, 50.0),
    ),
}
"""Lists of joints, by kit."""


class TrackedBody(NamedTuple):
    """One person in one frame."""

    person: str
    """Id by the kit's tracking; "person" for a single person without tracking."""
    model: JointModel
    position: Array
    """Positions in [m]; NaN where missing. Shape (n, 3)."""
    confidence: Array
    """Confidence on the kit's scale; NaN where missing. Shape (n,)."""

    def find_seen(self, threshold: float | None = None) -> dict[str, Array]:
        """Positions of joints that are not hidden, by name, in [m].

        Args:
            threshold: Confidence below which a joint is hidden; None: the model's. With 0, joints
                without a confidence are visible as well.
        """
        least = self.model.threshold if threshold is None else threshold
        sure = self.confidence >= least
        if least == 0.0:
            sure |= np.isnan(self.confidence)
        seen = sure & np.isfinite(self.position).all(axis=1)
        return {self.model.joints[k]: self.position[k] for k in np.flatnonzero(seen)}


class Frame(NamedTuple):
    """The people that a camera saw at one time."""

    stamp: float
    """Time of measurement in [s], on the camera's clock unless another was given."""
    bodies: tuple[TrackedBody, ...]


class SkeletonRecording(NamedTuple):
    """The content of a recording."""

    kit: str
    frames: list[Frame]
    bad_frames: Counter[str]
    """Number of unreadable frames, by their fault."""


class SkeletonReader:
    """Reads frames of one kit, from a stream or a file.

    Args:
        unit: Of positions, in [m]; None: the kit's.

    Attributes:
        kit: Kit of the frames so far; "" before the first one.
        bad_frames: Number of unreadable frames, by their fault.

    Raises:
        ArmguardError: The unit is no length.
    """

    def __init__(self, unit: float | None = None) -> None:
        if unit is not None and not (0.0 < unit < math.inf):
            raise ArmguardError("unit", f"is {unit}", expected="a length in [m]")
        self._unit = unit
        self.kit = ""
        self.bad_frames: Counter[str] = Counter()

    def take(self, message: object, stamp: float | None = None) -> Frame | None:
        """Reads a frame of a stream; a bad frame is counted, and None is returned.

        Then nothing may be sent for it, not even a heartbeat: a camera with unreadable frames must
        count as silent.

        Args:
            message: See `read`.
            stamp: See `read`.
        """
        try:
            return self.read(message, stamp)
        except ArmguardError as error:
            self.count_bad(error.problem)
            return None

    def count_bad(self, problem: str) -> None:
        """Count a frame that could not be read.

        Args:
            problem: The fault; after `MOST_PROBLEMS` different faults, all others are counted
                together.
        """
        is_known = problem in self.bad_frames or len(self.bad_frames) < MOST_PROBLEMS
        self.bad_frames[problem if is_known else "something else was wrong"] += 1

    def read(self, message: object, stamp: float | None = None) -> Frame:
        """Reads one frame.

        Args:
            message: An object of JSON, as text or decoded.
            stamp: Time of measurement, in [s] of the monitor's clock; None: the frame's own stamp.

        Raises:
            ArmguardError: It is not a frame of a kit, or is malformed; the message says what is
                wrong.
        """
        if isinstance(message, str | bytes):
            message = _decode(message)
        if not isinstance(message, Mapping):
            raise _bad(f"is {_show(message)}", "an object")
        kit = _find_kit(message)
        if self.kit and kit != self.kit:
            raise _bad(f"is of {kit}", f"one of {self.kit}, as before")
        time = _read_stamp(kit, message) if stamp is None else _read_number("stamp", stamp)
        if not math.isfinite(time):
            raise _bad("has no stamp", "one, in the frame or beside it")
        people = [
            self._read_body(kit, name, *found)
            for name, *found in _name_people(list(_LIST_BODIES[kit](message)))
        ]
        self.kit = kit
        return Frame(time, tuple(people))

    def _read_body(self, kit: str, person: str, values: Any, confidence: Any) -> TrackedBody:
        position = _read_array("positions", values, 3)
        count = len(position)
        model = next((model for model in MODELS[kit] if len(model.joints) == count), None)
        if model is None:
            known = " or ".join(str(len(model.joints)) for model in MODELS[kit])
            raise _bad(f"has a body of {count} joints", f"{known} of {kit}")
        if confidence is None:
            rated = np.full(count, math.nan)
        else:
            rated = _read_array("confidences", confidence, 0)
        if len(rated) != count:
            raise _bad(f"has {len(rated)} confidences for {count} joints", "one for each")
        known_rates = rated[~np.isnan(rated)]
        if not ((known_rates >= 0.0) & (known_rates <= model.most)).all():
            raise _bad("has a confidence out of range", f"0 to {model.most:g}")
        body = TrackedBody(person, model, position * (self._unit or model.unit), rated)
        _check_size(body)
        return body


def read_recording(
    path: Path, *, rate: float | None = None, unit: float | None = None
) -> SkeletonRecording:
    """Reads a recording: JSON, lines of JSON with one frame each, or a folder of OpenPose's files.

    Args:
        path: The file or folder.
        rate: Frame rate, in [Hz], if frames have no stamps, as those of OpenPose.
        unit: Of positions, in [m]; None: the kit's.

    Raises:
        ArmguardError: It cannot be read, or has no frame of a kit.
    """
    reader = SkeletonReader(unit)
    if rate is not None and not (0.0 < rate < math.inf):
        raise ArmguardError("rate", f"is {rate}", expected="frames a second, in [Hz]")
    frames: list[Frame] = []
    first = ""
    for number, message in enumerate(_list_messages(path)):
        try:
            frame = reader.read(message, None if rate is None else number / rate)
            if frames and not frame.stamp > frames[-1].stamp:
                raise _bad("is not later than the frame before", "growing stamps")
        except ArmguardError as error:
            reader.count_bad(error.problem)
            first = first or f"frame {number} {error.problem}; expected {error.expected}"
            continue
        frames.append(frame)
    if not frames:
        problem = f"is no recording of a body-tracking kit: {first or 'it has no frame'}"
        raise ArmguardError(str(path), problem)
    return SkeletonRecording(reader.kit, frames, reader.bad_frames)


def _bad(problem: str, expected: str) -> ArmguardError:
    return ArmguardError("frame", problem, expected=expected)


def _show(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _decode(text: str | bytes) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise _bad(f"is no JSON: {reason}", "an object of JSON") from None


def _list_messages(path: Path) -> Iterator[object]:
    """What a file or folder has, frame by frame; what is no JSON stays text."""
    try:
        if path.is_dir():
            for file in sorted(path.glob("*.json")):
                yield file.read_bytes()
            return
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ArmguardError(str(path), f"cannot be read: {error}") from None
    try:
        whole = json.loads(text)
    except (ValueError, RecursionError):
        yield from (line for line in text.splitlines() if line.strip())
        return
    if isinstance(whole, Mapping) and isinstance(whole.get("frames"), list):
        yield from whole["frames"]
    elif isinstance(whole, Mapping) and any(
        isinstance(one, Mapping) and "body_list" in one for one in whole.values()
    ):
        yield from whole.values()
    elif isinstance(whole, list):
        yield from whole
    else:
        yield whole


def _find_kit(message: Mapping[Any, Any]) -> str:
    for key, kit in _KEYS.items():
        if key in message:
            return kit
    if "pose_landmarks" in message or "landmarks" in message:
        raise _bad("has landmarks of the image alone", "world landmarks, and their origin")
    names = ", ".join(_KEYS)
    raise _bad(f"has keys {_show(list(message))}", f"one of {names}")


_KEYS = {
    "people": "openpose",
    "bodies": "kinect",
    "body_list": "zed",
    "pose_world_landmarks": "mediapipe",
    "worldLandmarks": "mediapipe",
}
"""Which kit writes which key."""

_STAMPS = {
    "openpose": (),
    "kinect": (("timestamp_usec", 1e-6),),
    "zed": (("timestamp", 1e-9),),
    "mediapipe": (("timestamp_ms", 1e-3),),
}
"""Names of stamps by kit, and their units in [s]; `stamp`, in [s], may stand in any frame."""


def _read_stamp(kit: str, message: Mapping[Any, Any]) -> float:
    for key, unit in (("stamp", 1.0), *_STAMPS[kit]):
        if key in message:
            return unit * _read_number(key, message[key])
    return math.nan


def _read_number(name: str, value: object) -> float:
    """A number; NaN for null, as JSON writes what is none."""
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        raise _bad(f"has {_show(value)} among its {name}", "numbers")
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _read_array(name: str, values: Any, width: int) -> Array:
    """Numbers of shape (n,), or with a width of shape (n, width)."""
    if isinstance(values, np.ndarray) and values.dtype.kind in "fiu":
        array = values.astype(np.float64)
    else:
        array = np.array(_read_rows(name, values, width), dtype=np.float64)
        if width and not len(array):
            array = np.empty((0, width))
    if array.ndim != (2 if width else 1) or (width and array.shape[1] != width):
        shape = f"(n, {width})" if width else "(n,)"
        raise _bad(f"has {name} of shape {array.shape}", shape)
    return array


def _read_rows(name: str, values: Any, width: int) -> list[Any]:
    if isinstance(values, str | bytes | Mapping) or not isinstance(values, Sequence):
        raise _bad(f"has {_show(values)} for its {name}", "a list")
    if not width:
        return [_read_number(name, value) for value in values]
    rows = [_read_rows(name, row, 0) for row in values]
    for row in rows:
        if len(row) != width:
            raise _bad(f"has {len(row)} numbers for a joint among its {name}", f"{width}")
    return rows


def _take_list(message: Mapping[Any, Any], key: str) -> list[Any]:
    found = message.get(key)
    if found is None:
        return []  # as the C++ samples write a frame without people
    if not isinstance(found, list | tuple):
        raise _bad(f"has {_show(found)} for {key!r}", "a list")
    for one in found:
        if not isinstance(one, Mapping) and key not in ("pose_world_landmarks", "worldLandmarks"):
            raise _bad(f"has {_show(one)} in {key!r}", "objects")
    return list(found)


def _take(body: Mapping[Any, Any], key: str) -> Any:
    if key not in body:
        raise _bad(f"has a body without {key!r}", "that key")
    return body[key]


def _list_openpose(message: Mapping[Any, Any]) -> Iterator[tuple[object, Any, Any]]:
    for body in _take_list(message, "people"):
        id = body.get("person_id", -1)
        values = _take(body, "pose_keypoints_3d")
        numbers = np.array(_read_rows("pose_keypoints_3d", values, 0))
        if not len(numbers):
            raise _bad("has no keypoints in space", "those of OpenPose with --3d")
        if len(numbers) % 4:
            raise _bad(f"has {len(numbers)} numbers for keypoints", "four for each")
        rows = numbers.reshape(-1, 4)
        # What was not found is at the origin, with confidence 0.
        position = np.where(rows[:, 3:] > 0.0, rows[:, :3], math.nan)
        yield (id[0] if isinstance(id, list) and len(id) == 1 else id), position, rows[:, 3]


def _list_kinect(message: Mapping[Any, Any]) -> Iterator[tuple[object, Any, Any]]:
    for body in _take_list(message, "bodies"):
        id = body.get("body_id", -1)
        yield (
            -1 if id == _INVALID_ID else id,
            _take(body, "joint_positions"),
            body.get("confidence_levels"),
        )


def _list_zed(message: Mapping[Any, Any]) -> Iterator[tuple[object, Any, Any]]:
    for body in _take_list(message, "body_list"):
        values, confidence = _take(body, "keypoint"), body.get("keypoint_confidence")
        state = str(body.get("tracking_state", "OK")).upper().rpartition(".")[2]
        if state in _PREDICTED:
            # All of it is where it is thought to be, and nothing of it was seen.
            values = np.full((len(_read_array("keypoint", values, 3)), 3), math.nan)
        yield body.get("id", -1), values, confidence


def _list_mediapipe(message: Mapping[Any, Any]) -> Iterator[tuple[object, Any, Any]]:
    key = "pose_world_landmarks" if "pose_world_landmarks" in message else "worldLandmarks"
    poses = _take_list(message, key)
    if not poses:
        return
    if message.get("origin") is None:
        raise _bad(
            "has world landmarks without an origin",
            "`origin`, where the middle of the hips is, in [m]: landmarks are relative to it",
        )
    origins = message["origin"]
    if isinstance(origins, list) and len(origins) == 3 and not isinstance(origins[0], list):
        origins = [origins]
    places = _read_array("origin", origins, 3)
    ids = message.get("ids", [-1] * len(poses))
    if not (isinstance(ids, list) and len(ids) == len(poses) == len(places)):
        raise _bad(f"has {len(poses)} poses", "an origin and, of several, an id for each")
    for id, pose, place in zip(ids, poses, places, strict=True):
        if not isinstance(pose, list) or not all(isinstance(one, Mapping) for one in pose):
            raise _bad(f"has {_show(pose)} for a pose", "a list of landmarks")
        rows = [[_take(one, axis) for axis in "xyz"] for one in pose]
        rated = [
            min(
                _read_number("visibility", one.get("visibility")),
                _read_number("presence", one.get("presence", one.get("visibility"))),
            )
            for one in pose
        ]
        yield id, _read_array("landmarks", rows, 3) + place, rated


_LIST_BODIES = {
    "openpose": _list_openpose,
    "kinect": _list_kinect,
    "zed": _list_zed,
    "mediapipe": _list_mediapipe,
}


def _name_people(
    bodies: list[tuple[object, Any, Any]],
) -> Iterator[tuple[str, Any, Any]]:
    """Bodies with names. Two people whom nothing tracks could be mistaken for each other."""
    names = []
    for id, _, _ in bodies:
        if isinstance(id, bool) or not isinstance(id, int | str):
            raise _bad(f"has the id {_show(id)}", "a number or a name")
        if id == -1:
            names.append("person")
        elif isinstance(id, str) and (not id or "/" in id):
            raise _bad(f"has the id {_show(id)}", "a name without '/'")
        else:
            names.append(f"person{id}" if isinstance(id, int) else id)
    if len(bodies) > 1 and "person" in names:
        raise _bad(f"has {len(bodies)} people, not all with a tracking id", "one for each")
    if len(set(names)) != len(names):
        raise _bad("has a tracking id twice", "one for each person")
    for name, (_, values, confidence) in zip(names, bodies, strict=True):
        yield name, values, confidence


def _check_size(body: TrackedBody) -> None:
    """Refuse bodies of other units."""
    points = np.array(list(body.find_seen().values()))
    if len(points) < JOINTS_OF_A_BODY:
        return
    off = float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))
    if not (SMALLEST_BODY <= off <= LARGEST_BODY):
        raise _bad(
            f"has a body whose joints are {off:.3g} m off its middle",
            f"{SMALLEST_BODY:g} to {LARGEST_BODY:g} m: positions may be in another unit",
        )
