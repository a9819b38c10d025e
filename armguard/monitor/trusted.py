"""Trusted data of a proof: the arm with its limits, and the spheres that cover a link."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from armguard.bounds.limits import JointLimits
from armguard.jit.arrays import FloatArray
from armguard.jit.numerics import REPEAT_SLACK, STOP_TIME_SLACK
from armguard.messages.proof import (
    BrakeColumns,
    CoverBall,
    JointPlace,
    TrustedArm,
    TrustedCover,
    seal,
)
from armguard.robot.joints import find_axis, is_prismatic
from armguard.robot.kinematics import Kinematics


class TrustedParts:
    """Describes an arm for proofs.

    Args:
        kinematics: Its joints and spheres.
        limits: Of its joints; shared, so they may change.
        lever: Of all spheres, as in `JointMotion`. Shape (n, nv).
        link_balls: Balls that links cannot leave, as in `ReachMotion`. Shape (L, 4).
    """

    def __init__(
        self,
        kinematics: Kinematics,
        limits: JointLimits,
        lever: FloatArray,
        link_balls: FloatArray,
    ) -> None:
        self._kinematics, self._limits = kinematics, limits
        self._lever, self._link_balls = lever, link_balls
        model = kinematics.model
        self._places = {number: int(model.idx_vs[number]) for number in range(1, model.njoints)}
        """Where joints stand in lists, by Pinocchio's number."""
        self._joints = [
            JointPlace(
                name=model.names[number],
                parent=self._places.get(int(model.parents[number]), -1),
                slides=is_prismatic(model, number),
                axis=find_axis(model, number).tolist(),
                placement=[
                    *model.jointPlacements[number].rotation.ravel().tolist(),
                    *model.jointPlacements[number].translation.tolist(),
                ],
            )
            for number in sorted(self._places, key=self._places.__getitem__)
        ]
        self._arm: TrustedArm | None = None
        self._arm_of: tuple[bytes, ...] = ()

    def describe_arm(self) -> TrustedArm:
        """The arm as it is now."""
        limits = self._limits
        brakes = limits.brakes
        # What may change from tick to tick; all else of the arm stands.
        changing = (*brakes, limits.operating_velocity, limits.operating_acceleration)
        stated = tuple(one.tobytes() for one in changing)
        if self._arm is not None and self._arm_of == stated:
            return self._arm
        arm = TrustedArm(
            digest="",
            joints=self._joints,
            lower=limits.lower.tolist(),
            upper=limits.upper.tolist(),
            acceleration=limits.acceleration.tolist(),
            operating_velocity=limits.operating_velocity.tolist(),
            operating_acceleration=limits.operating_acceleration.tolist(),
            position_error=limits.position_error.tolist(),
            velocity_error=limits.velocity_error.tolist(),
            brakes=[
                BrakeColumns(
                    speed=brakes.speed[j].tolist(),
                    deceleration=brakes.deceleration[j].tolist(),
                    time=brakes.time[j].tolist(),
                    distance=brakes.distance[j].tolist(),
                )
                for j in range(len(limits.lower))
            ],
        )
        seal(arm)
        self._arm, self._arm_of = arm, stated
        return arm

    def describe_cover(self, name: str, link: int, nodes: Iterable[int]) -> TrustedCover:
        """The part of a link's cover with the given spheres.

        Args:
            name: Of the link.
            link: Its number.
            nodes: Indices of the spheres in the link's tree.
        """
        spheres = self._kinematics.spheres
        first = int(spheres.root[link])
        own = np.flatnonzero(spheres.link == link)
        cover = TrustedCover(
            digest="",
            link=name,
            carrier=self._places.get(int(spheres.joint[first]), -1),
            reach=self._link_balls[link].tolist(),
            parents=[max(int(spheres.tree.parent[node]) - first, -1) for node in own],
            balls=[
                CoverBall(
                    node=node,
                    center=spheres.local[first + node].tolist(),
                    radius=float(spheres.radius[first + node]),
                    lever=self._lever[first + node].tolist(),
                )
                for node in sorted(nodes)
            ],
        )
        seal(cover)
        return cover


def is_same_cover(cover: TrustedCover, own: TrustedCover) -> bool:
    """Whether a proof's cover is the arm's own, or one with larger levers."""
    shares = 1.0 + REPEAT_SLACK
    same = (cover.link, cover.carrier, cover.parents) == (own.link, own.carrier, own.parents)
    return (
        same
        and len(cover.reach) == len(own.reach)
        and np.allclose(cover.reach, own.reach, rtol=REPEAT_SLACK, atol=REPEAT_SLACK)
        and len(cover.balls) == len(own.balls)
        and all(
            (ball.node, ball.center, ball.radius) == (known.node, known.center, known.radius)
            and len(ball.lever) == len(known.lever)
            and all(a * shares >= b for a, b in zip(ball.lever, known.lever, strict=True))
            for ball, known in zip(cover.balls, own.balls, strict=True)
        )
    )


def rests_in_time(rest: float, stop_time: float) -> bool:
    """Whether a proof ends by the stop time of its verdict, both in [s]; not if either is NaN."""
    return rest <= stop_time * (1.0 + STOP_TIME_SLACK)
