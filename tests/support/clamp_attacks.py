"""Attacks on the rule for clamped parts: a part that cannot give way is pressed to the very end.

The arm is made of the spheres of its cover, so that no room is left between what the monitor bounds
and what presses. A part is between the arm and something else: a fixed block, a cart that goes on
towards the arm until that rests, or another link. It cannot get away. The surface of the arm comes
at the shortest lead that the monitor permits, and nobody but the monitor stops it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from armguard.cover.cover import Cover, CoverTree
from armguard.robot import Robot
from armguard.robot.operating_limits import OperatingLimits
from armguard.settings.contact_limits import ContactLimit, ContactLimits
from support.contact_attacks import HORIZON, NAMES, PARTS, RATE, Fight, Part
from support.contact_physics import (
    REACH,
    STEP,
    Arm,
    Push,
    Skin,
    Touch,
    find_leaves,
)

BLOCK, CART, LINK = range(3)
"""What the part is clamped against."""

BLOCK_SIZE = 0.03, 0.02  # half its width and half its height, in [m]
CART_RADIUS = 0.03  # [m]
THICKNESS = 0.02  # of all parts, in [m]
RADII = 0.5 * THICKNESS, 0.045  # of parts, in [m]: thinner than the gap in which one is clamped
POSITION_ERROR, VELOCITY_ERROR = 1e-6, 1e-4  # of encoders, in [rad] and [rad/s]
POSES = 300  # from which distances between spheres are known to vary
QUICKEST = 10  # pairs of spheres of which one is chosen
TRIES = 50  # to find two links with a part between them


def make_clamp_limits(*, with_clamping: bool) -> ContactLimits:
    """Of all parts; without clamping no gap counts as one that can close."""
    return ContactLimits(
        {
            part.region: ContactLimit(
                force=part.force, stiffness=part.stiffness, body_mass=part.mass,
                source="example: figures quoted in the literature", thickness=THICKNESS,
                gap=None if with_clamping else 0.0,
            )
            for part in PARTS
        }
    )  # fmt: skip


def make_tight_robot(name: str) -> Robot:
    """An arm with nothing between what is watched and what presses.

    Its cover is all of its smallest spheres, each as a whole: of a tree's spheres the monitor
    watches only what is inside the larger ones above them as well, and here these contain all.
    Its encoders are nearly exact.
    """
    robot = Robot.load(name)
    trees, digests = {}, {}
    for link in robot.links:
        leaves = find_leaves(robot, link)
        middle = leaves[:, :3].mean(axis=0)
        reach = np.linalg.norm(leaves[:, :3] - middle, axis=1) + leaves[:, 3]
        spheres = np.vstack([[*middle, (1.0 + 1e-9) * reach.max()], leaves])
        first, count = np.full(len(spheres), -1), np.zeros(len(spheres), dtype=int)
        first[0], count[0] = 1, len(leaves)
        trees[link] = CoverTree(spheres, first, count)
        digests[link] = robot.cover.digest(link)
    robot.cover = Cover(trees, digests)
    robot.position_error = np.full(len(robot.joints), POSITION_ERROR)
    robot.velocity_error = np.full(len(robot.joints), VELOCITY_ERROR)
    return robot


class ClampPlan(NamedTuple):
    """All that is drawn for one attack."""

    part: Part
    mode: int
    q: np.ndarray
    """Where the arm starts, in [rad] or [m]. Shape (nv,)."""
    velocities: np.ndarray
    """What it has there, what the controller wants next, and what it wants from `turn` on, in
    [rad/s] or [m/s]. Shape (3, nv)."""
    turn: float
    """[s]"""
    sphere: int
    """Of the arm, which is to press."""
    other: int
    """Of the arm, against which it presses; -1: none."""
    radius: float
    """Of the part, in [m]; between two links it fills the gap."""
    tilt: np.ndarray
    """What its direction differs by from that of the surface's motion. Shape (3,)."""
    speed: float
    """Of the cart, in [m/s]."""
    bounds: tuple[float, float]
    """On the part's acceleration and speed, as stated, in [m/s²] and [m/s]."""
    lead: None = None
    """They meet as soon as the monitor lets them."""

    def target(self, t: float) -> np.ndarray:
        return self.velocities[2 if t >= self.turn else 1]


class ClampPlace(NamedTuple):
    """Where the part is that an arm clamps."""

    center: np.ndarray
    """When the arm touches it, in [m]. Shape (3,)."""
    velocity: np.ndarray
    """In [m/s]. Shape (3,)."""
    lead: float
    """When that is, in [s]."""
    direction: np.ndarray
    """From the sphere that presses to what is behind the part. Shape (3,)."""
    radius: float
    """Of the part, in [m]."""
    head: None = None

    def part_state(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        return self.center - self.velocity * (self.lead - t), self.velocity


class Press:
    """A part that is clamped between the arm and something else.

    The part is no mass: its force is its stiffness times its compression, at any moment.

    Args:
        arm: Placed at the start.
        skin: Of the part.
        center: Of the part, in [m]. Shape (3,).
        velocity: With which what is behind the part pushes it until the arm rests, in [m/s].
        pair: The spheres of the arm between which it is; None: something else is behind it.

    Attributes:
        center: As given, but midway between the spheres once they touch it.
        velocity: As given.
        gap: How far the arm is from pressing the part, in [m].
    """

    def __init__(
        self,
        arm: Arm,
        skin: Skin,
        center: np.ndarray,
        velocity: np.ndarray,
        pair: tuple[Sphere, Sphere] | None,
    ) -> None:
        self.arm, self.skin, self._pair = arm, skin, pair
        self.center, self.velocity = np.array(center, float), np.array(velocity, float)
        self._point, self._touch = np.zeros(3), None
        self._pushes: list[Push] = []
        self.look()

    @property
    def is_pressed(self) -> bool:
        return self.gap < 0.0

    def look(self) -> None:
        """Measure the gap, and the forces from it."""
        arm, skin = self.arm, self.skin
        if self._pair is None:
            away, group = arm.find_nearest(self.center, math.inf, self._point)
            self.gap = away - skin.radius
            outwards = (self.center - self._point) / away
            ends = [(self._point, int(arm.surface.joint[group]), outwards)]
        else:
            one, two = self._pair
            places = [sphere.place(arm) for sphere in self._pair]
            apart = places[1] - places[0]
            distance = float(np.linalg.norm(apart))
            outwards = apart / distance
            self.gap = distance - one.radius - two.radius - 2.0 * skin.radius
            surfaces = places[0] + one.radius * outwards, places[1] - two.radius * outwards
            ends = [(surfaces[0], one.joint, outwards), (surfaces[1], two.joint, -outwards)]
            if self.is_pressed:
                self.center[:] = 0.5 * (surfaces[0] + surfaces[1])
        force = skin.stiffness * max(-self.gap, 0.0)
        self._pushes = []
        if force > 0.0:
            self._pushes = [Push(-force * away, point, joint) for point, joint, away in ends]
            self._note(force, *ends[0])

    def _note(self, force: float, point: np.ndarray, joint: int, outwards: np.ndarray) -> None:
        arm = self.arm
        touch = self._touch
        if touch is None:
            touch = Touch(0.0, 0.0, 0.0, math.nan, joint, 0.0, True)
            if arm.is_free and arm.stiffness < math.inf:
                arm.hold_by_loop(point, outwards, joint)
        self._touch = touch._replace(
            energy=max(touch.energy, 0.5 * force**2 / self.skin.stiffness),
            force=max(touch.force, force),
            joint_error=max(touch.joint_error, arm.joint_error),
        )

    def choose_step(self, most: float) -> float:
        """How long the next step may be, in [s], so that the first touch is met."""
        if self.is_pressed or self.gap <= 1e-6:
            return min(STEP, most)
        closing = float(np.linalg.norm(self.velocity)) + 1e-9
        closing += 2.0 * float(np.abs(self.arm.v).sum()) * REACH
        return min(max(0.9 * self.gap / closing, 1e-5), most)

    def advance(self, dt: float) -> None:
        """Let what is behind the part move for a step, and the arm that presses against it."""
        if self.arm.v.any():
            self.center += dt * self.velocity
        self.arm.step(dt, self._pushes)
        self.look()

    def finish(self) -> list[Touch]:
        """What it did; nothing where it did not press."""
        return [] if self._touch is None else [self._touch]


class Sphere(NamedTuple):
    """One of the smallest spheres of the arm's cover."""

    joint: int
    """Which moves it."""
    center: np.ndarray
    """In the frame of the joint, in [m]. Shape (3,)."""
    radius: float
    """[m]"""

    def place(self, arm: Arm) -> np.ndarray:
        """Where its centre is, in [m]. Shape (3,)."""
        return arm.turns[self.joint].reshape(3, 3) @ self.center + arm.places[self.joint]


class ClampFight(Fight):
    """As `Fight`, of an arm that clamps a part.

    Args:
        arm: Whose surface is that of its cover.
        operating: What its controller keeps to.
        seed: Of all that is drawn.
        limits: Of contact.
    """

    def __init__(
        self, arm: Arm, operating: OperatingLimits, seed: Sequence[int], limits: ContactLimits
    ) -> None:
        super().__init__(arm, operating, seed, limits=limits)
        self._spheres = [
            Sphere(arm.joint_of[number], center, radius)
            for number, link in enumerate(self.robot.links)
            for *center, radius in find_leaves(self.robot, link)
        ]
        self._spheres = [one._replace(center=np.array(one.center)) for one in self._spheres]
        self._joints = np.array([one.joint for one in self._spheres])
        self._centers = np.array([one.center for one in self._spheres])
        self._radii = np.array([one.radius for one in self._spheres])
        self._can_clamp = self._find_clamping()

    def _place(self, q: np.ndarray) -> np.ndarray:
        """Centres of all spheres. Shape (n, 3)."""
        self.arm.q[:] = q
        self.arm.place()
        turns = self.arm.turns[self._joints].reshape(-1, 3, 3)
        return np.einsum("nij,nj->ni", turns, self._centers) + self.arm.places[self._joints]

    def _find_clamping(self) -> np.ndarray:
        """Pairs of spheres whose distance varies by more than a part is thick. Shape (n, n)."""
        low, high = np.inf, -np.inf
        for _ in range(POSES):
            centers = self._place(self.random.uniform(self.lower, self.upper))
            distance = np.linalg.norm(centers[:, None] - centers[None], axis=2)
            low, high = np.minimum(low, distance), np.maximum(high, distance)
        return high - low > THICKNESS

    def _draw(self, part: Part, mode: int) -> ClampPlan:
        random, nv = self.random, len(self.top)
        for _ in range(TRIES):
            q = self.lower + (self.upper - self.lower) * random.uniform(0.05, 0.95, nv)
            pace = self.top * random.choice([0.2, 0.5, 1.0, 1.0])
            v = random.choice([-1.0, 1.0], nv) * pace
            v[random.random(nv) < random.choice([0.0, 0.0, 0.5])] = 0.0
            if not v.any():
                continue
            sphere, other = int(random.integers(len(self._spheres))), -1
            if mode == LINK:
                found = self._find_pair(q, v)
                if found is None:
                    continue
                sphere, other = found
            elif not v[: self._joints[sphere] + 1].any():
                continue
            break
        velocities = np.array([v, v, v])
        if random.random() < 0.3:  # comes slower, and speeds up
            velocities[0] *= random.uniform(0.0, 1.0)
        speed = random.choice([0.01, 0.03, 0.1]) if mode == CART else 0.0
        bounds = (0.0, speed)
        if random.random() < 0.3:
            bounds = (5.0, max(speed, 0.5))
        return ClampPlan(
            part=part,
            mode=mode,
            q=q,
            velocities=velocities,
            turn=random.uniform(0.0, 0.5 * HORIZON),
            sphere=sphere,
            other=other,
            radius=float(random.uniform(*RADII)),
            tilt=random.normal(size=3) * random.choice([0.0, 0.3]),
            speed=speed,
            bounds=bounds,
        )

    def _find_pair(self, q: np.ndarray, v: np.ndarray) -> tuple[int, int] | None:
        """Two spheres that close a gap in which a part fits, and are among the quickest."""
        before, after = self._place(q), self._place(q + 1e-3 * v)
        distances = [np.linalg.norm(some[:, None] - some[None], axis=2) for some in (before, after)]
        gap = distances[0] - self._radii[:, None] - self._radii[None]
        fits = self._can_clamp & (gap > 2.0 * RADII[0]) & (gap < 2.0 * RADII[1])
        closing = np.where(fits, distances[0] - distances[1], 0.0)
        quickest = np.argsort(closing, axis=None)[-QUICKEST:]
        one, two = np.unravel_index(self.random.choice(quickest), closing.shape)
        if not closing[one, two] > 0.0:
            return None
        # That nothing of the arm is between them.
        middle = 0.5 * (before[one] + before[two])
        middle += (
            0.5
            * (self._radii[one] - self._radii[two])
            / distances[0][one, two]
            * (before[two] - before[one])
        )
        nearest = float((np.linalg.norm(before - middle, axis=1) - self._radii).min())
        return (int(one), int(two)) if nearest > 0.5 * gap[one, two] - 1e-3 else None

    def _change(self, plan: ClampPlan) -> ClampPlan:
        random, nv = self.random, len(self.top)
        size = random.choice([0.01, 0.05, 0.2])
        shift = size * random.normal(size=(2, nv)) * (random.random((2, nv)) < 0.5)
        velocities = plan.velocities + shift[1] * self.top
        if random.random() < 0.5:
            velocities = velocities * (1.0 + size * random.normal())
        return plan._replace(
            q=np.clip(plan.q + shift[0], self.lower, self.upper),
            velocities=np.clip(velocities, -self.top, self.top),
            tilt=plan.tilt + size * random.normal(size=3),
            radius=float(np.clip(plan.radius + 0.1 * size * random.normal(), *RADII)),
        )

    def _arrange(self, plan: ClampPlan, places: np.ndarray, lead: int) -> ClampPlace | None:
        before, after = self._place(places[lead]), self._place(places[lead + 1])
        one, two = plan.sphere, plan.other
        velocity = np.zeros(3)
        if plan.mode == LINK:
            apart = before[two] - before[one]
            distance = np.linalg.norm(apart)
            gap = distance - self._radii[one] - self._radii[two]
            if not 2.0 * RADII[0] < gap < 2.0 * RADII[1]:
                return None
            direction, radius = apart / distance, 0.5 * gap
        else:
            moved = (after[one] - before[one]) * RATE
            speed = np.linalg.norm(moved)
            if not speed > 0.002:
                return None
            direction, radius = moved / speed + plan.tilt, plan.radius
            direction /= np.linalg.norm(direction)
            velocity = -plan.speed * direction
        center = before[one] + (self._radii[one] + radius) * direction
        self._place(places[lead])
        away, _ = self.arm.find_nearest(center, math.inf, np.zeros(3))
        if not away > radius - 1e-4:
            return None
        return ClampPlace(center, velocity, lead / RATE, direction, radius)

    def _start(self, plan: ClampPlan, place: ClampPlace, stiffness: float) -> Press | None:
        self.arm.start(plan.q, plan.velocities[0], stiffness)
        pair = None
        if plan.mode == LINK:
            pair = self._spheres[plan.sphere], self._spheres[plan.other]
        skin = Skin(plan.part.mass, plan.part.stiffness, 0.0, place.radius)
        press = Press(self.arm, skin, *place.part_state(0.0), pair)
        return press if press.gap > 1e-4 else None

    def _begin(self, plan: ClampPlan, place: ClampPlace) -> None:
        super()._begin(plan, place)
        number = next(NAMES)
        if plan.mode == BLOCK:
            wide, high = BLOCK_SIZE
            _, _, axes = np.linalg.svd(place.direction[None])
            sides = itertools.product((-wide, wide), (-wide, wide), (0.0, 2.0 * high))
            behind = place.center + place.radius * place.direction
            axes[0] = place.direction
            corners = [behind + z * axes[0] + x * axes[1] + y * axes[2] for x, y, z in sides]
            self.names.append(f"block-{number}")
            self.obstacles.add_static(self.names[-1], corners, 0.0)
        elif plan.mode == CART:
            self.names.append(f"cart-{number}")

    def _tell(self, t: float, plan: ClampPlan, place: ClampPlace, press: Press) -> None:
        stamp = self.now + t
        velocity = press.velocity if self.arm.v.any() else np.zeros(3)
        self.obstacles.update(
            self.names[:1], stamp, press.center[None], velocity[None], radius=place.radius,
            accel=plan.bounds[0], speed=plan.bounds[1], region=plan.part.region,
        )  # fmt: skip
        if plan.mode == CART:
            behind = press.center + (place.radius + CART_RADIUS) * place.direction
            self.obstacles.update(
                self.names[2:3], stamp, behind[None], velocity[None], radius=CART_RADIUS,
                accel=0.0, speed=plan.speed,
            )  # fmt: skip
