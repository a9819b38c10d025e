"""Frames as body-tracking kits write them, made by us from their published layouts.

The lists of joints are written out as their publishers have them, so that they check the ones of
`armguard.bridges.skeletons`.
"""

import json

import numpy as np


def list_words(text):
    """The words of a text."""
    return text.split()


COCO = list_words(
    "Nose Neck RShoulder RElbow RWrist LShoulder LElbow LWrist RHip RKnee RAnkle LHip LKnee LAnkle "
    "REye LEye REar LEar"
)
BODY_25 = list_words(
    "Nose Neck RShoulder RElbow RWrist LShoulder LElbow LWrist MidHip RHip RKnee RAnkle LHip LKnee "
    "LAnkle REye LEye REar LEar LBigToe LSmallToe LHeel RBigToe RSmallToe RHeel"
)
KINECT = list_words(
    "PELVIS SPINE_NAVEL SPINE_CHEST NECK CLAVICLE_LEFT SHOULDER_LEFT ELBOW_LEFT WRIST_LEFT "
    "HAND_LEFT HANDTIP_LEFT THUMB_LEFT CLAVICLE_RIGHT SHOULDER_RIGHT ELBOW_RIGHT WRIST_RIGHT "
    "HAND_RIGHT HANDTIP_RIGHT THUMB_RIGHT HIP_LEFT KNEE_LEFT ANKLE_LEFT FOOT_LEFT HIP_RIGHT "
    "KNEE_RIGHT ANKLE_RIGHT FOOT_RIGHT HEAD NOSE EYE_LEFT EAR_LEFT EYE_RIGHT EAR_RIGHT"
)
MEDIAPIPE = list_words(
    "NOSE LEFT_EYE_INNER LEFT_EYE LEFT_EYE_OUTER RIGHT_EYE_INNER RIGHT_EYE RIGHT_EYE_OUTER "
    "LEFT_EAR RIGHT_EAR MOUTH_LEFT MOUTH_RIGHT LEFT_SHOULDER RIGHT_SHOULDER LEFT_ELBOW RIGHT_ELBOW "
    "LEFT_WRIST RIGHT_WRIST LEFT_PINKY RIGHT_PINKY LEFT_INDEX RIGHT_INDEX LEFT_THUMB RIGHT_THUMB "
    "LEFT_HIP RIGHT_HIP LEFT_KNEE RIGHT_KNEE LEFT_ANKLE RIGHT_ANKLE LEFT_HEEL RIGHT_HEEL "
    "LEFT_FOOT_INDEX RIGHT_FOOT_INDEX"
)
ZED_34 = list_words(
    "PELVIS NAVAL_SPINE CHEST_SPINE NECK LEFT_CLAVICLE LEFT_SHOULDER LEFT_ELBOW LEFT_WRIST "
    "LEFT_HAND LEFT_HANDTIP LEFT_THUMB RIGHT_CLAVICLE RIGHT_SHOULDER RIGHT_ELBOW RIGHT_WRIST "
    "RIGHT_HAND RIGHT_HANDTIP RIGHT_THUMB LEFT_HIP LEFT_KNEE LEFT_ANKLE LEFT_FOOT RIGHT_HIP "
    "RIGHT_KNEE RIGHT_ANKLE RIGHT_FOOT HEAD NOSE LEFT_EYE LEFT_EAR RIGHT_EYE RIGHT_EAR LEFT_HEEL "
    "RIGHT_HEEL"
)
ZED_38 = list_words(
    "PELVIS SPINE_1 SPINE_2 SPINE_3 NECK NOSE LEFT_EYE RIGHT_EYE LEFT_EAR RIGHT_EAR LEFT_CLAVICLE "
    "RIGHT_CLAVICLE LEFT_SHOULDER RIGHT_SHOULDER LEFT_ELBOW RIGHT_ELBOW LEFT_WRIST RIGHT_WRIST "
    "LEFT_HIP RIGHT_HIP LEFT_KNEE RIGHT_KNEE LEFT_ANKLE RIGHT_ANKLE LEFT_BIG_TOE RIGHT_BIG_TOE "
    "LEFT_SMALL_TOE RIGHT_SMALL_TOE LEFT_HEEL RIGHT_HEEL LEFT_HAND_THUMB_4 RIGHT_HAND_THUMB_4 "
    "LEFT_HAND_INDEX_1 RIGHT_HAND_INDEX_1 LEFT_HAND_MIDDLE_4 RIGHT_HAND_MIDDLE_4 LEFT_HAND_PINKY_1 "
    "RIGHT_HAND_PINKY_1"
)

LAYOUTS = {
    "openpose": (COCO, BODY_25),
    "kinect": (KINECT,),
    "mediapipe": (MEDIAPIPE,),
    "zed": (COCO, ZED_34, ZED_38),
}


def translate(name):
    """A publisher's name of a joint as armguard has it."""
    word = name.lower()
    side = ""
    for mark, found in (
        ("left_", "left"), ("right_", "right"), ("_left", "left"), ("_right", "right"),
    ):  # fmt: skip
        if mark in word and "mouth" not in word:
            word, side = word.replace(mark, ""), found
    if name[0] in "LR" and name[1].isupper() and not name.isupper():
        word, side = word[1:], {"L": "left", "R": "right"}[name[0]]
    same = {
        "bigtoe": "toe", "big_toe": "toe", "foot": "toe", "foot_index": "toe",
        "smalltoe": "small_toe", "handtip": "hand_tip", "midhip": "pelvis",
        "naval_spine": "spine_navel", "chest_spine": "spine_chest", "hand_thumb_4": "thumb",
        "hand_index_1": "index", "hand_middle_4": "middle_tip", "hand_pinky_1": "pinky",
    }  # fmt: skip
    word = same.get(word, word)
    return f"{side}_{word}" if side else word


def write_frame(kit, stamp, bodies, count=None):
    """A frame as a kit writes it.

    Args:
        kit: Its name.
        stamp: In [s].
        bodies: By tracking id, positions by armguard's names in [m]; the others are hidden.
        count: How many joints the kit lists, where it has several lists.
    """
    names = next(one for one in LAYOUTS[kit] if count in (None, len(one)))
    listed = []
    for id, joints in bodies.items():
        known = [joints.get(translate(name)) for name in names]
        listed.append((id, known))
    if kit == "openpose":
        people = []
        for id, known in listed:
            numbers = [[0.0] * 4 if one is None else [*map(float, one), 1.0] for one in known]
            flat = [number for four in numbers for number in four]
            person = {"person_id": [id], "pose_keypoints_2d": [], "pose_keypoints_3d": flat}
            people.append(person)
        return {"version": 1.3, "stamp": stamp, "people": people}
    if kit == "kinect":
        return {
            "timestamp_usec": round(1e6 * stamp),
            "num_bodies": len(listed),
            "bodies": [
                {
                    "body_id": id,
                    # What is hidden is predicted, and said to be.
                    "joint_positions": [
                        [0.0, 0.0, 2000.0] if one is None else (1e3 * np.array(one)).tolist()
                        for one in known
                    ],
                    "confidence_levels": [1 if one is None else 2 for one in known],
                }
                for id, known in listed
            ],
        }
    if kit == "zed":
        return {
            "is_new": True,
            "timestamp": round(1e9 * stamp),
            "body_list": [
                {
                    "id": id,
                    "tracking_state": "OBJECT_TRACKING_STATE.OK",
                    "keypoint": [
                        [None] * 3 if one is None else list(map(float, one)) for one in known
                    ],
                    "keypoint_confidence": [None if one is None else 80.0 for one in known],
                }
                for id, known in listed
            ],
        }
    origins, poses = [], []
    for _, known in listed:
        joints = dict(zip(map(translate, names), known, strict=True))
        hips = [joints[f"{side}_hip"] for side in ("left", "right")]
        is_known = all(one is not None for one in hips)
        origin = np.mean(hips, axis=0) if is_known else np.zeros(3)
        origins.append(origin.tolist())
        poses.append(
            [
                dict(zip("xyz", (np.zeros(3) if one is None else one - origin), strict=True))
                | {"visibility": 0.2 if one is None else 0.97, "presence": 0.99}
                for one in known
            ]
        )
    frame = {"timestamp_ms": 1e3 * stamp, "pose_world_landmarks": poses, "origin": origins}
    return json.loads(json.dumps(frame | {"ids": [id for id, _ in listed]}, default=float))
