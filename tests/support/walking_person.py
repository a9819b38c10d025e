"""A person who walks and works, as positions of joints by time: known truth for tests."""

import math

import numpy as np

from armguard.people.proportions import SEGMENTS

SIDES = (("left", 1.0), ("right", -1.0))


class WalkingPerson:
    """Bones keep their lengths, and all joints keep the bounds of their parts.

    Args:
        seed: Decides the lengths of bones and all motion.
        size: Of bones, as a share of the longest that there are.
    """

    def __init__(self, seed, size=0.8):
        rng = np.random.default_rng(seed)
        self.lengths = {
            name: size * rng.uniform(0.85, 1.0) * one.length for name, one in SEGMENTS.items()
        }
        self.phase = rng.uniform(0.0, math.tau, 8)
        self.rate = rng.uniform(0.5, 1.0, 8)
        self.heading = rng.uniform(0.0, math.tau)

    def locate(self, time):
        """True positions of joints and of the points of parts, in [m], by name."""
        wave = np.sin(self.rate * math.tau * 0.8 * time + self.phase)
        lengths = self.lengths
        forward = np.array([math.cos(self.heading), math.sin(self.heading), 0.0])
        left = np.array([-forward[1], forward[0], 0.0])
        up = np.array([0.0, 0.0, 1.0])
        pelvis = 0.6 * time * forward + 0.03 * wave[0] * left + (0.95 + 0.01 * wave[1]) * up
        joints = {}
        trunk = 0.75 * lengths["trunk"]
        chest = pelvis + trunk * (up + 0.1 * wave[2] * forward)
        for side, sign in SIDES:
            joints[f"{side}_hip"] = pelvis + 0.25 * sign * lengths["hips"] * left
            joints[f"{side}_shoulder"] = chest + 0.4 * sign * lengths["shoulders"] * left
        joints["neck"] = np.mean([joints[f"{side}_shoulder"] for side, _ in SIDES], axis=0)
        head = chest + 0.7 * lengths["neck"] * (up + 0.1 * wave[3] * forward)
        for side, sign in SIDES:
            joints[f"{side}_ear"] = head + 0.07 * sign * left
            joints[f"{side}_eye"] = head + 0.03 * sign * left + 0.09 * forward
        joints["nose"] = head + 0.12 * forward
        for side, sign in SIDES:
            swing = wave[4] if sign > 0.0 else wave[5]
            arm = joints[f"{side}_shoulder"]
            for end, bone, angle in (
                ("elbow", "upper_arm", 0.3 + 0.35 * swing),
                ("wrist", "forearm", 0.9 + 0.6 * swing),
                ("knuckles", "palm", 1.0 + 0.8 * swing),
            ):
                along = math.sin(angle) * forward - math.cos(angle) * up
                joints[f"{side}_{end}"] = arm = arm + lengths[bone] * along
            for end, apart in (("index", 1.0), ("pinky", -1.0)):
                joints[f"{side}_{end}"] = arm + 0.035 * apart * left
            stride = 0.35 * sign * wave[6]
            leg = joints[f"{side}_hip"]
            for end, bone, angle in (
                ("knee", "thigh", stride),
                ("ankle", "shank", stride - 0.1),
                ("toe", "foot", 1.3 + 0.2 * stride),
            ):
                along = math.sin(angle) * forward - math.cos(angle) * up
                share = 0.75 if end == "toe" else 1.0
                joints[f"{side}_{end}"] = leg = leg + share * lengths[bone] * along
        return joints | {"head": head, "collar": joints["neck"]}
