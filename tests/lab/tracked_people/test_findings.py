import math
from collections import Counter

import numpy as np
import pytest

from armguard.bridges.skeletons import MODELS
from armguard.lab.tracked_people.findings import find_part, measure_people
from armguard.lab.tracked_people.tracks import Track, Tracked
from armguard.people import BOUNDS
from armguard.people.proportions import SEGMENTS
from support.walking_person import WalkingPerson

RATE = 30.0
STEPS = 1200


def record(noise=0.0, rate=RATE, steps=STEPS, change=None):
    """A walk as a recording, of every joint that has a name."""
    rng = np.random.default_rng(1)
    person = WalkingPerson(3)
    walk = [person.locate(step / rate) for step in range(steps)]
    joints = tuple(name for name in walk[0] if "knuckles" not in name)
    position = np.array([[truth[name] for name in joints] for truth in walk])
    position += rng.normal(0.0, noise, position.shape)
    if change is not None:
        change(position, joints)
    track = Track("person1", joints, position)
    return Tracked("walk", "kinect", rate, steps / rate, (track,), Counter())


def test_every_joint_of_every_kit_moves_with_a_part_that_has_bounds():
    for models in MODELS.values():
        for model in models:
            assert {find_part(joint) for joint in model.joints} <= set(BOUNDS)
    assert find_part("left_wrist") == "hand"
    assert find_part("spine_navel") == "trunk"
    assert find_part("mouth_left") == "head"


@pytest.mark.parametrize("noise", [0.002, 0.006, 0.02])
def test_jitter_is_what_all_but_one_in_a_thousand_positions_are_off_by(noise):
    found = measure_people([record(noise)])
    true = np.percentile(
        np.linalg.norm(np.random.default_rng(0).normal(0, noise, (99999, 3)), axis=1), 99.9
    )
    for part, jitter in found.jitter.items():
        assert jitter == pytest.approx(true, rel=0.15), part
    assert found.proposed_error >= max(found.jitter.values())
    assert found.proposed_error == pytest.approx(max(found.jitter.values()), abs=1e-3)
    # Noise alone breaks no bound and no bone, and makes none wider.
    for part, report in found.bounds.items():
        assert report.broken <= 0.001, part
    assert all(found.proposed[part] == BOUNDS[part] for part in found.proposed)
    assert all(bone.broken == 0.0 for bone in found.bones.values())


def test_a_motion_beyond_the_bounds_is_seen_and_proposed():
    def shake(position, joints):
        # 12 m/s² of a head that is believed to keep 5 m/s².
        times = np.arange(len(position)) / 100.0
        wave = 2.0 * math.pi * 1.5
        for joint in ("left_ear", "right_ear", "nose", "left_eye", "right_eye", "head", "neck"):
            swing = 12.0 / wave**2 * np.sin(wave * times)
            position[:, joints.index(joint), 1] += swing

    found = measure_people([record(0.0002, rate=100.0, change=shake)])
    assert found.bounds["head"].broken > 0.3
    assert 10.0 <= found.proposed["head"].accel <= 15.0
    assert found.proposed["elbow"] == BOUNDS["elbow"]
    # A position error that explains all of it leaves the bound as it is.
    told = measure_people([record(0.0002, rate=100.0, change=shake)], position_error=0.05)
    assert told.proposed["head"] == BOUNDS["head"]
    assert told.position_error == 0.05


def test_hidden_joints_are_counted_with_how_long_they_were():
    def hide(position, joints):
        wrist = joints.index("left_wrist")
        position[:50, wrist] = np.nan  # not come yet
        for start, count in ((100, 3), (200, 6), (300, 30)):
            position[start : start + count, wrist] = np.nan
        position[-9:, wrist] = np.nan  # and never back
        position[:, joints.index("right_ankle")] = np.nan

    found = measure_people([record(change=hide)])
    hidden = found.hidden["hand"]
    assert hidden.times == 4
    assert (hidden.median, hidden.longest) == pytest.approx((7.5 / RATE, 30 / RATE))
    assert 9 / RATE < hidden.p99 <= 30 / RATE
    hands = [name for name in record().tracks[0].joints if find_part(name) == "hand"]
    assert hidden.share == pytest.approx(48 / (len(hands) * STEPS - 50))
    assert hidden.never == ()
    assert found.hidden["foot"].never == ("right_ankle",)
    assert found.hidden["head"].times == 0
    assert math.isnan(found.hidden["head"].longest)


def test_bones_that_are_too_long_are_counted_and_spread_is_placement():
    def misplace(position, joints):
        position[:100, joints.index("left_elbow")] += [0.0, 0.0, -0.6]

    person = WalkingPerson(3)
    found = measure_people([record()])
    assert found.bones["upper arm"].median == pytest.approx(person.lengths["upper_arm"], abs=1e-6)
    assert found.bones["upper arm"].stated == SEGMENTS["upper_arm"].length
    assert found.bones["upper arm"].placement < 1e-6
    told = measure_people([record(change=misplace)], position_error=0.02, height=1.8)
    arm = told.bones["upper arm"]
    assert arm.stated == pytest.approx(1.8 * SEGMENTS["upper_arm"].per_height)
    assert arm.broken == pytest.approx(100 / (2 * STEPS), abs=0.01)
    assert arm.placement > 0.1


def test_frames_that_are_too_rare_say_nothing_of_bounds():
    found = measure_people([record(0.005, rate=15.0)])
    assert (found.bounds, found.proposed, found.jitter) == ({}, {}, {})
    assert found.proposed_error > 0.005
    assert found.hidden["hand"].times == 0
