import json
import math
import random

import numpy as np
import pytest

from armguard.bridges.skeletons import (
    MODELS,
    MOST_PROBLEMS,
    SkeletonReader,
    read_recording,
)
from armguard.exceptions import ArmguardError
from support.kits import LAYOUTS, translate, write_frame

KITS = [(kit, len(names)) for kit, lists in LAYOUTS.items() for names in lists]


def make_joints(kit, count, seed=0):
    """A body's worth of points by armguard's names, near (1, 0, 2)."""
    rng = np.random.default_rng(seed)
    names = next(one for one in LAYOUTS[kit] if len(one) == count)
    middle, spread = [1.0, 0.0, 2.0], [0.3, 0.3, 0.8]
    return {translate(name): rng.normal(middle, spread) for name in names}


@pytest.mark.parametrize("kit", LAYOUTS)
def test_lists_of_joints_are_those_that_were_published(kit):
    ours = [model.joints for model in MODELS[kit]]
    assert ours == [tuple(map(translate, names)) for names in LAYOUTS[kit]]
    assert all(len(set(joints)) == len(joints) for joints in ours)


@pytest.mark.parametrize(("kit", "count"), KITS)
def test_what_a_kit_writes_comes_back_in_metres_without_what_is_hidden(kit, count):
    joints = make_joints(kit, count)
    hidden = {"left_wrist", "right_ear"}
    shown = {name: at for name, at in joints.items() if name not in hidden}
    message = write_frame(kit, 12.5, {7: shown}, count)
    frame = SkeletonReader().read(json.dumps(message))
    (body,) = frame.bodies
    assert frame.stamp == pytest.approx(12.5)
    assert body.person == "person7"
    assert len(body.model.joints) == count
    seen = body.find_seen()
    assert seen.keys() == shown.keys()
    for name, position in seen.items():
        assert position == pytest.approx(shown[name], abs=1e-9)
    # Told when it was seen, that counts.
    assert SkeletonReader().read(message, 3.0).stamp == 3.0


def test_thresholds_are_the_kits_unless_stated():
    message = write_frame("kinect", 0.0, {1: make_joints("kinect", 32)})
    levels = message["bodies"][0]["confidence_levels"]
    levels[:4] = [0, 1, 2, 3]
    (body,) = SkeletonReader().read(message).bodies
    assert len(body.find_seen()) == 30
    assert len(body.find_seen(1.0)) == 31
    assert len(body.find_seen(3.0)) == 1
    # Without confidences nobody knows what was predicted.
    del message["bodies"][0]["confidence_levels"]
    (body,) = SkeletonReader().read(message).bodies
    assert body.find_seen() == {}
    assert len(body.find_seen(0.0)) == 32


@pytest.mark.parametrize("state", ["OBJECT_TRACKING_STATE.SEARCHING", "Searching", 2, 3])
def test_a_body_that_the_kit_only_predicts_is_hidden(state):
    message = write_frame("zed", 0.0, {1: make_joints("zed", 38)}, 38)
    message["body_list"][0]["tracking_state"] = state
    (body,) = SkeletonReader().read(message).bodies
    assert body.find_seen(0.0) == {}


def test_several_people_are_told_apart_by_their_ids_alone():
    bodies = {3: make_joints("zed", 38), 5: make_joints("zed", 38, 1)}
    frame = SkeletonReader().read(write_frame("zed", 0.0, bodies, 38))
    assert [body.person for body in frame.bodies] == ["person3", "person5"]
    alone = SkeletonReader().read(write_frame("zed", 0.0, {-1: bodies[3]}, 38))
    assert [body.person for body in alone.bodies] == ["person"]
    with pytest.raises(ArmguardError, match="2 people, not all with a tracking id"):
        SkeletonReader().read(write_frame("zed", 0.0, {-1: bodies[3], 5: bodies[5]}, 38))
    twice = write_frame("zed", 0.0, bodies, 38)
    twice["body_list"][1]["id"] = 3
    with pytest.raises(ArmguardError, match="tracking id twice"):
        SkeletonReader().read(twice)
    nobody = write_frame("zed", 0.0, {})
    assert SkeletonReader().read(nobody).bodies == ()
    assert SkeletonReader().read(nobody | {"body_list": None}).bodies == ()


def spoil(kit, change):
    message = write_frame(kit, 1.0, {1: make_joints(kit, len(LAYOUTS[kit][-1]))}, None)
    change(message)
    return message


@pytest.mark.parametrize(
    ("message", "problem"),
    [
        ("{", "is no JSON"),
        ("[" * 100_000, "is no JSON: it is nested too deeply"),
        ("[1]", r"is \[1\]; expected an object"),
        ({}, r"has keys \[\]; expected one of people, bodies"),
        ({"pose_landmarks": []}, "landmarks of the image alone"),
        ({"bodies": []}, "has no stamp"),
        ({"bodies": 7, "stamp": 0.0}, "has 7 for 'bodies'"),
        ({"bodies": [7], "stamp": 0.0}, "has 7 in 'bodies'"),
        ({"bodies": [], "stamp": "noon"}, "has 'noon' among its stamp"),
        ({"bodies": [], "stamp": True}, "has True among its stamp"),
        ({"bodies": [], "stamp": math.nan}, "has no stamp"),
        ({"bodies": [], "stamp": 10**400}, "has no stamp"),
        ({"bodies": [{}], "stamp": 0.0}, "a body without 'joint_positions'"),
        (spoil("kinect", lambda m: m["bodies"][0]["joint_positions"].pop()), "a body of 31 joints"),
        (spoil("kinect", lambda m: m["bodies"][0]["joint_positions"][3].pop()), "has 2 numbers"),
        (
            spoil("kinect", lambda m: m["bodies"][0]["joint_positions"][3].insert(0, "x")),
            "has 'x' among its positions",
        ),
        (
            spoil("kinect", lambda m: m["bodies"][0].update(joint_positions="far")),
            "has 'far' for its positions",
        ),
        (spoil("kinect", lambda m: m["bodies"][0].update(body_id=1.5)), "has the id 1.5"),
        (spoil("kinect", lambda m: m["bodies"][0].update(body_id="a/b")), "has the id 'a/b'"),
        (
            spoil("kinect", lambda m: m["bodies"][0]["confidence_levels"].pop()),
            "31 confidences for 32 joints",
        ),
        (
            spoil("kinect", lambda m: m["bodies"][0]["confidence_levels"].__setitem__(0, 4)),
            "a confidence out of range; expected 0 to 3",
        ),
        (spoil("mediapipe", lambda m: m.pop("origin")), "world landmarks without an origin"),
        (
            {"people": [{"pose_keypoints_2d": [1.0], "pose_keypoints_3d": []}], "stamp": 0.0},
            "has no keypoints in space",
        ),
        ({"people": [{"pose_keypoints_3d": [1.0] * 5}], "stamp": 0.0}, "has 5 numbers"),
    ],
)
def test_what_is_no_frame_is_refused_by_name(message, problem):
    with pytest.raises(ArmguardError, match=problem):
        SkeletonReader().read(message)
    reader = SkeletonReader()
    assert reader.take(message) is None
    assert reader.bad_frames.total() == 1


def test_positions_of_another_unit_are_refused():
    message = write_frame("zed", 0.0, {1: make_joints("zed", 38)}, 38)
    body = message["body_list"][0]
    body["keypoint"] = (1e3 * np.array(body["keypoint"], dtype=float)).tolist()
    with pytest.raises(ArmguardError, match="may be in another unit"):
        SkeletonReader().read(message)
    assert len(SkeletonReader(1e-3).read(message).bodies[0].find_seen()) == 38
    with pytest.raises(ArmguardError, match="unit: is 0"):
        SkeletonReader(0.0)


def test_numbers_that_are_none_are_hidden():
    message = write_frame("zed", 0.0, {1: make_joints("zed", 38)}, 38)
    message["body_list"][0]["keypoint"][3] = [math.nan, 0.0, 0.0]
    message["body_list"][0]["keypoint"][4] = [math.inf, 0.0, 0.0]
    message["body_list"][0]["keypoint_confidence"][5] = math.nan
    (body,) = SkeletonReader().read(json.dumps(message)).bodies
    assert len(body.find_seen()) == 35


def test_hostile_frames_raise_one_kind_of_error_alone():
    """Values anywhere in a frame are replaced by anything that JSON can hold."""
    rng = random.Random(1)
    anything = [None, True, -1, 10**400, math.nan, "", "x", [], [[]], {}, {"x": 1}, 2.5, [1, "a"]]

    def replace(value, depth):
        if rng.random() < 0.12 * depth:
            return rng.choice(anything)
        if isinstance(value, dict):
            return {key: replace(one, depth + 1) for key, one in value.items()}
        if isinstance(value, list):
            return [replace(one, depth + 0.3) if rng.random() < 0.2 else one for one in value]
        return value

    good = [write_frame(kit, 1.0, {1: make_joints(kit, count)}, count) for kit, count in KITS]
    bad = 0
    for _ in range(3000):
        message = replace(rng.choice(good), 0)
        try:
            for body in SkeletonReader().read(message).bodies:
                assert all(np.isfinite(at).all() for at in body.find_seen(0.0).values())
        except ArmguardError:
            bad += 1
    assert bad > 300


def test_problems_of_a_long_stream_take_no_more_and_more_room():
    reader = SkeletonReader()
    for number in range(10 * MOST_PROBLEMS):
        assert reader.take({f"key {number}": 0}) is None
    assert len(reader.bad_frames) <= MOST_PROBLEMS + 1
    assert reader.bad_frames.total() == 10 * MOST_PROBLEMS


def test_files_of_all_layouts_are_read(tmp_path):
    joints = make_joints("zed", 38)
    frames = [write_frame("zed", 0.1 * k, {1: joints}, 38) for k in range(5)]
    lines = tmp_path / "lines.jsonl"
    lines.write_text("\n".join(map(json.dumps, frames)) + "\n")
    exported = tmp_path / "bodies.json"
    exported.write_text(json.dumps({str(k): frame for k, frame in enumerate(frames)}))
    listed = tmp_path / "list.json"
    listed.write_text(json.dumps(frames))
    for path in (lines, exported, listed):
        recording = read_recording(path)
        assert recording.kit == "zed"
        assert [frame.stamp for frame in recording.frames] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])
    kinect = tmp_path / "kinect.json"
    bodies = {1: make_joints("kinect", 32)}
    frames = [write_frame("kinect", 0.1 * k, bodies) for k in range(5)]
    kinect.write_text(json.dumps({"k4abt_sdk_version": "1.1.2", "frames": frames}))
    assert len(read_recording(kinect).frames) == 5
    folder = tmp_path / "openpose"
    folder.mkdir()
    for k in range(5):
        frame = write_frame("openpose", 0.0, {-1: make_joints("openpose", 18)}, 18)
        del frame["stamp"]
        (folder / f"clip_{k:012}_keypoints.json").write_text(json.dumps(frame))
    with pytest.raises(ArmguardError, match="has no stamp"):
        read_recording(folder)
    recording = read_recording(folder, rate=20.0)
    assert [frame.stamp for frame in recording.frames] == pytest.approx([0, 0.05, 0.1, 0.15, 0.2])
    with pytest.raises(ArmguardError, match="rate: is 0"):
        read_recording(folder, rate=0.0)


def test_bad_frames_of_a_file_are_counted_and_a_file_of_nothing_else_is_refused(tmp_path):
    path = tmp_path / "camera.jsonl"
    frame = json.dumps(write_frame("zed", 1.0, {1: make_joints("zed", 38)}, 38))
    path.write_text("\n".join([frame, "rubbish", '{"people": []}', frame]))
    recording = read_recording(path)
    assert len(recording.frames) == 1
    assert recording.bad_frames.total() == 3
    assert any("is of openpose" in problem for problem in recording.bad_frames)
    assert any("is not later" in problem for problem in recording.bad_frames)
    for text in ("", "hello", "[]", "{}", "[[[[", '{"frames": 7}', "name,x,y\n1,2,3\n"):
        path.write_text(text)
        with pytest.raises(ArmguardError, match="is no recording of a body-tracking"):
            read_recording(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ArmguardError, match="cannot be read"):
        read_recording(path)
    with pytest.raises(ArmguardError, match="cannot be read"):
        read_recording(tmp_path / "nothing.jsonl")
