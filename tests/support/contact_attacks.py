"""Attacks on contact limits: a body part that meets a moving arm at the worst place and time.

An attack draws a motion of the arm, and the place where its surface will be after some time, the
lead. There it puts a body part, or sends it there. The arm obeys each STOP as late as it may, with
the least braking that is stated, and goes on in all other verdicts. The lead is as short as the
monitor's first verdict lets it be: with less that verdict is a STOP, which promises nothing of an
arm that moves already. Half of the attacks are changes of the best ones so far.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot.brakes import find_stop
from armguard.robot.operating_limits import LimitsInForce, OperatingLimits
from armguard.settings.contact_limits import ContactLimit, ContactLimits
from armguard.verdict import Level
from support.contact_physics import (
    RIGID,
    Arm,
    Contact,
    Skin,
    Touch,
    advance_joints,
    find_leaves,
)

RATE = 500.0  # ticks a second
LATENCY, REACTION = 0.002, 0.02  # [s]
HORIZON = 0.8  # for which motions are drawn, in [s]
AFTER = 0.25  # for which an arm is watched that has touched, in [s]
HEAD_RADIUS = 0.09  # [m]
LOOKS = 7  # with which the shortest lead is found
BEST = 8  # attacks of each kind that are remembered
NAMES = itertools.count()

REST, LUNGE, THROW = range(3)
"""What the body part does: rests; speeds up from rest as hard as its bounds allow; flies."""

LOOPS = 2e3, 5e4, 5e5, RIGID
"""Stiffness of the arm where it is touched, in [N/m]."""


class Part(NamedTuple):
    """A region of the body, by figures that are quoted in the literature: an example."""

    region: str
    mass: float
    """[kg]"""
    stiffness: float
    """[N/m]"""
    force: float
    """In an impact, in [N]."""

    @property
    def energy(self) -> float:
        return self.force**2 / (2.0 * self.stiffness)

    @property
    def max_speed(self) -> float:
        """Of a surface that strikes it at rest, in [m/s]."""
        return math.sqrt(2.0 * self.energy / self.mass)


PARTS = (
    Part("hand", 0.6, 75e3, 280.0),
    Part("forearm", 2.0, 40e3, 320.0),
    Part("upper_arm", 3.0, 30e3, 300.0),
    Part("chest", 40.0, 25e3, 280.0),
)


def make_limits() -> ContactLimits:
    """Of all parts, clamped as well."""
    return ContactLimits(
        {
            part.region: ContactLimit(
                force=part.force,
                stiffness=part.stiffness,
                body_mass=part.mass,
                source="example: figures quoted in the literature",
            )
            for part in PARTS
        }
    )


class Plan(NamedTuple):
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
    link: int
    """Which is to touch."""
    rank: float
    """Which of its points is to touch, by speed: 0 is the fastest."""
    is_bare: bool
    """Whether that is one of the points that the cover has next to no room around."""
    radius: float
    """Of the part, in [m]."""
    damping: float
    """Of its skin, as a share of the critical damping."""
    speed: float
    """Of the part where it meets the arm, in [m/s]."""
    tilt: np.ndarray
    """What its direction differs by from the one against the surface's motion. Shape (3,)."""
    bounds: tuple[float, float]
    """On its acceleration and speed, as stated, in [m/s²] and [m/s]."""
    head: float | None
    """How far behind it there is a head, in [m]; None: there is none."""
    lead: float | None
    """After which share of the motion they meet; None: as soon as the monitor lets them."""

    def target(self, t: float) -> np.ndarray:
        return self.velocities[2 if t >= self.turn else 1]

    @property
    def skin(self) -> Skin:
        mass, stiffness = self.part.mass, self.part.stiffness
        critical = 2.0 * math.sqrt(mass * stiffness)
        return Skin(mass, stiffness, self.damping * critical, self.radius)


class Place(NamedTuple):
    """Where everything is that an arm may touch."""

    center: np.ndarray
    """Of the part when it meets the arm, in [m]. Shape (3,)."""
    velocity: np.ndarray
    """Then, in [m/s]. Shape (3,)."""
    accel: float
    """With which it came to that velocity from rest, in [m/s²]; 0: it always had it."""
    lead: float
    """When that is, in [s]."""
    head: np.ndarray | None

    def part_state(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        before = self.lead - t
        if not self.accel > 0.0:
            return self.center - self.velocity * before, self.velocity
        speed = float(np.linalg.norm(self.velocity))
        ramp = min(max(before, 0.0), speed / self.accel)
        share = max(1.0 - self.accel * ramp / speed, 0.0)
        way = 0.5 * ramp * (1.0 + share) + min(before, 0.0)
        return self.center - self.velocity * way, self.velocity * share


class Attack(NamedTuple):
    """What came of one attack."""

    plan: Plan
    stiffness: float
    """Of the arm where it was touched, in [N/m]."""
    touches: list[Touch]
    head_gap: float
    """The least distance of the head from the arm while that moved, in [m]; inf: no head."""

    def share(self, touch: Touch) -> float:
        """What a contact did, as a share of what the limit allows.

        Energy in the tissue, or the force where the part was clamped.
        """
        part = self.plan.part
        if touch.is_clamped:
            return touch.force / part.force
        return touch.energy / (0.5 * part.mass * (part.max_speed + touch.part_speed) ** 2)

    def true_share(self, touch: Touch) -> float:
        """The energy as a share of what the true speed of the surface allows."""
        speed = touch.surface_speed + touch.part_speed
        return touch.energy / (0.5 * self.plan.part.mass * speed**2)


class Fight:
    """An arm, its monitor, and attacks on them.

    Args:
        arm: The simulated arm.
        operating: What its controller keeps to.
        seed: Of all that is drawn.
        limits: Of contact, for the monitor; None: there is no monitor, and the arm obeys nobody.
    """

    def __init__(
        self,
        arm: Arm,
        operating: OperatingLimits,
        seed: Sequence[int],
        limits: ContactLimits | None,
    ) -> None:
        self.arm, self.robot = arm, arm.robot
        self.random = np.random.default_rng(seed)
        self.top, self.up = operating.resolve(self.robot)
        self.brakes = LimitsInForce(self.robot, operating, 0.0).brakes
        self.obstacles = Obstacles(sources=[])
        self.monitor: Monitor | None = None
        if limits is not None:
            self.monitor = Monitor(
                self.robot, self.obstacles, rate=RATE, latency=LATENCY, reaction_time=REACTION,
                rise_delay=0.0, source_timeout=1e6, payload=0.0, operating=operating,
                contact_limits=limits,
            )  # fmt: skip
        self.lower = np.maximum(self.robot.lower_position_limit, -math.pi)
        self.upper = np.minimum(self.robot.upper_position_limit, math.pi)
        self.bare = [self._find_bare(link) for link in self.robot.links]
        self.now = 0.0
        self.obeying = int((LATENCY + REACTION) * RATE + 1e-6)
        self.names: list[str] = []
        # What is measured of the arm at the start: one time has one joint state.
        self.first: tuple[np.ndarray, np.ndarray] | None = None
        self.best: dict[tuple[str, int], list[tuple[float, int, Plan]]] = {}

    def attack(self, part: Part, mode: int, stiffness: float) -> Attack | None:
        """One attack; None where nothing was touched, or nothing promised."""
        best = self.best.setdefault((part.region, mode), [])
        if best and self.random.random() < 0.5:
            plan = self._change(best[self.random.integers(len(best))][2])
        else:
            plan = self._draw(part, mode)
        places = self._trace(plan)
        margin = 0.02 + 0.2 * self.top
        if not ((places > self.lower + margin) & (places < self.upper - margin)).all():
            return None
        self.first = None
        found = self._choose_place(plan, places)
        if found is None:
            return None
        attack = self._run(plan, found, stiffness)
        if attack is None or not attack.touches:
            return None
        share = max(attack.share(touch) for touch in attack.touches)
        best.append((share, next(NAMES), plan))
        best.sort(reverse=True)
        del best[BEST:]
        return attack

    def _find_bare(self, link: str) -> tuple[np.ndarray, np.ndarray]:
        """Vertices of a link near the surface of its cover, and which way it is nearest."""
        leaves, points = find_leaves(self.robot, link), self.robot.hull(link)
        apart = points[:, None] - leaves[None, :, :3]
        away = np.linalg.norm(apart, axis=2)
        depth = leaves[:, 3] - away
        deepest = depth.argmax(axis=1)
        rows = np.arange(len(points))
        bare = np.argsort(depth[rows, deepest])[: max(8, len(points) // 10)]
        outwards = apart[bare, deepest[bare]] / away[bare, deepest[bare], None]
        return bare, outwards

    def _draw(self, part: Part, mode: int) -> Plan:
        random, nv = self.random, len(self.top)
        q = self.lower + (self.upper - self.lower) * random.uniform(0.1, 0.9, nv)
        if random.random() < 0.3:  # stretched, or folded
            q[1:-1] = np.where(random.random(nv - 2) < 0.7, 0.0, q[1:-1])
            q = np.clip(q, self.lower + 0.05, self.upper - 0.05)
        pace = self.top * random.choice([0.15, 0.3, 0.6, 1.0])
        velocities = np.clip(random.uniform(-1.5, 1.5, (3, nv)), -1.0, 1.0) * pace
        velocities[:, random.random(nv) < random.choice([0.0, 0.5, 0.8])] *= 0.1
        if random.random() < 0.6:  # goes on, and speeds up
            velocities[1:] = np.sign(velocities[0]) * pace
        speed = random.uniform(0.2, 2.0) if mode in (LUNGE, THROW) else 0.0
        bounds = (0.0, 0.0)
        if mode == LUNGE:
            bounds = (random.uniform(1.0, 10.0), speed)
        elif mode == THROW or random.random() < 0.3:
            bounds = (random.choice([0.0, 5.0]), max(speed, random.choice([0.1, 0.5])))
        count = len(self.robot.links)
        return Plan(
            part=part,
            mode=mode,
            q=q,
            velocities=velocities,
            turn=random.uniform(0.0, 0.3),
            link=count - 1 - int(count * random.random() ** 2),
            rank=random.random() ** 3,
            is_bare=random.random() < 0.5,
            radius=float(random.choice([0.03, 0.05, 0.08])),
            damping=float(random.choice([0.0, 0.05, 0.3])),
            speed=speed,
            tilt=random.normal(size=3) * random.choice([0.0, 0.5, 2.0]),
            bounds=bounds,
            head=random.uniform(0.0, 0.4) if random.random() < 0.4 else None,
            lead=random.uniform(0.1, 0.9) if random.random() < 0.15 else None,
        )

    def _change(self, plan: Plan) -> Plan:
        random, nv = self.random, len(self.top)
        size = random.choice([0.02, 0.1, 0.3])
        few = random.random((4, nv)) < 0.5
        shift = size * random.normal(size=(4, nv)) * few
        velocities = plan.velocities + shift[1:] * self.top
        if random.random() < 0.3:
            velocities = velocities * (1.0 + size)
        return plan._replace(
            q=np.clip(plan.q + shift[0], self.lower, self.upper),
            velocities=np.clip(velocities, -self.top, self.top),
            turn=abs(plan.turn + 0.1 * size * random.normal()),
            rank=min(abs(plan.rank + 0.1 * size * random.normal()), 0.999),
            damping=plan.damping if random.random() < 0.8 else 0.0,
            tilt=plan.tilt + size * random.normal(size=3) * (plan.mode != REST),
        )

    def _trace(self, plan: Plan) -> np.ndarray:
        """Joint positions at each tick of an arm that nobody stops. Shape (ticks, nv)."""
        q, v, accel = plan.q.copy(), plan.velocities[0].copy(), np.zeros(len(plan.q))
        places = []
        for tick in range(int(HORIZON * RATE)):
            places.append(q.copy())
            target = plan.target(tick / RATE)
            advance_joints(q, v, accel, target, self.up, self.up, accel, False, 1.0 / RATE)
        return np.array(places)

    def _choose_place(self, plan: Plan, places: np.ndarray) -> Place | None:
        last = len(places) - 2
        if self.monitor is None:
            return self._arrange(plan, places, last // 4)
        if plan.lead is not None:
            return self._arrange(plan, places, int(plan.lead * last))
        found = self._arrange(plan, places, last)
        if found is None or not self._is_allowed(plan, found):
            return None
        least, most = 0, last
        for _ in range(LOOKS):
            middle = (least + most) // 2
            place = self._arrange(plan, places, middle)
            if place is not None and self._is_allowed(plan, place):
                found, most = place, middle
            else:
                least = middle
        return found

    def _arrange(self, plan: Plan, places: np.ndarray, lead: int) -> Place | None:
        """Where a ball is that the leading surface of a link meets after so many ticks."""
        arm, joint = self.arm, self.arm.joint_of[plan.link]
        where = []
        for tick in (lead, lead + 1):
            arm.q[:] = places[tick]
            arm.place()
            rotation = arm.turns[joint].reshape(3, 3)
            where.append(arm.hulls[plan.link] @ rotation.T + arm.places[joint])
        moved = (where[1] - where[0]) * RATE
        speed = np.linalg.norm(moved, axis=1)
        if plan.is_bare:
            bare, outwards = self.bare[plan.link]
            outwards = outwards @ rotation.T
            ahead = np.einsum("ij,ij->i", outwards, moved[bare])
            chosen = int(np.argsort(-ahead)[int(plan.rank * len(ahead))])
            front, direction = int(bare[chosen]), outwards[chosen]
            if not ahead[chosen] > 0.3 * speed[front]:
                return None
        else:
            # Of the points that move as the chosen one does, the one in front.
            chosen = np.argsort(-speed)[int(plan.rank * len(speed))]
            front = int(np.argmax(where[0] @ moved[chosen]))
            direction = moved[front] / max(speed[front], 1e-9)
        if not speed[front] > 0.005:
            return None
        center = where[0][front] + plan.radius * direction
        against = plan.tilt - direction
        velocity = plan.speed * against / np.linalg.norm(against)
        accel = plan.bounds[0] if plan.mode == LUNGE else 0.0
        head = None
        if plan.head is not None:
            head = center + direction * (plan.radius + HEAD_RADIUS + plan.head)
        return Place(center, velocity, accel, lead / RATE, head)

    def _start(self, plan: Plan, place: Place, stiffness: float) -> Contact | None:
        self.arm.start(plan.q, plan.velocities[0], stiffness)
        center, velocity = place.part_state(0.0)
        contact = Contact(self.arm, plan.skin, center, velocity)
        return contact if contact.gap > 1e-4 else None

    def _is_allowed(self, plan: Plan, place: Place) -> bool:
        contact = self._start(plan, place, RIGID)
        if contact is None:
            return False
        self._begin(plan, place)
        self._tell(0.0, plan, place, contact)
        return self._ask(0.0) is not Level.STOP

    def _begin(self, plan: Plan, place: Place) -> None:
        """Begin anew with another body, and let the monitor know nothing of other motions."""
        assert self.monitor is not None
        for name in self.names:
            self.obstacles.remove([name])
        self.obstacles.take_faults()
        if self.first is None:
            self.monitor.reset()
            self.now += 2.0
        number = next(NAMES)
        # One person's, by their names: else the arm could clamp the part against the head.
        self.names = [f"person-{number}/part", f"person-{number}/head"]

    def _tell(self, t: float, plan: Plan, place: Place, contact: Contact) -> None:
        stamp = self.now + t
        self.obstacles.update(
            self.names[:1], stamp, contact.center[None], contact.velocity[None],
            radius=plan.radius, accel=plan.bounds[0], speed=plan.bounds[1],
            region=plan.part.region,
        )  # fmt: skip
        if place.head is not None:
            self.obstacles.update(
                self.names[1:2], stamp, place.head[None], np.zeros((1, 3)), radius=HEAD_RADIUS,
                accel=0.0, speed=0.0, region="head",
            )  # fmt: skip

    def _ask(self, t: float) -> Level:
        assert self.monitor is not None
        seen = self._measure() if self.first is None or t > 0.0 else self.first
        if self.first is None:
            self.first = seen
        return self.monitor.step(self.now + t, *seen).level

    def _measure(self) -> tuple[np.ndarray, np.ndarray]:
        """The joint state as it is reported."""
        robot, random = self.robot, self.random
        q, v = self.arm.state
        wrong = random.uniform(-1.0, 1.0, len(q)) * robot.position_error
        # Mostly the arm seems slower than it is.
        slower = np.sign(v) * np.minimum(np.abs(v), robot.velocity_error)
        q = np.clip(q + wrong, robot.lower_position_limit, robot.upper_position_limit)
        return q, v - slower * (random.random() < 0.7)

    def _brake(self, hold: np.ndarray, rate: np.ndarray) -> None:
        """How each joint stops from now on: with the least that is stated."""
        for j, speed in enumerate(np.abs(self.arm.v)):
            stop = find_stop(self.brakes, j, speed)
            if stop.deceleration > 0.0 or not speed > 0.0:
                rate[j], hold[j] = max(stop.deceleration, 1e-3), 0.0
                continue
            # It goes on for as long as time and distance allow for what comes then.
            mean = max(speed / stop.time, 0.5 * speed**2 / stop.distance)
            rate[j] = min(2.0 * mean, self.robot.acceleration_limit[j])
            ramp = speed / rate[j]
            hold[j] = max(min(stop.time - ramp, stop.distance / speed - 0.5 * ramp), 0.0)

    def _run(self, plan: Plan, place: Place, stiffness: float) -> Attack | None:
        arm = self.arm
        contact = self._start(plan, place, stiffness)
        if contact is None:
            return None
        if self.monitor is not None:
            self._begin(plan, place)
        hold, rate = np.zeros_like(arm.q), np.zeros_like(arm.q)
        said: list[bool] = []
        t, tick, brakes, has_touched = 0.0, 0, False, False
        end, head_gap, nearest = HORIZON + AFTER, math.inf, np.zeros(3)
        while t < end:
            if t >= tick / RATE - 1e-9:
                if self.monitor is not None:
                    self._tell(t, plan, place, contact)
                    said.append(self._ask(t) is Level.STOP)
                    if said[0]:
                        return None
                    due = len(said) - 1 - self.obeying
                    is_told = due >= 0 and said[due]
                    if is_told and not brakes:
                        self._brake(hold, rate)
                    brakes = is_told
                if place.head is not None and np.abs(arm.state[1]).max() > 1e-3:
                    away, _ = arm.find_nearest(place.head, HEAD_RADIUS + 0.5, nearest)
                    head_gap = min(head_gap, away - HEAD_RADIUS)
                tick += 1
            if not has_touched:
                contact.center[:], contact.velocity[:] = place.part_state(t)
            dt = contact.choose_step(max(tick / RATE - t, 1e-6))
            advance_joints(arm.q, arm.v, arm.accel, plan.target(t), self.up, rate, hold, brakes, dt)
            contact.advance(dt)
            t += dt
            if contact.is_pressed and not has_touched:
                has_touched, end = True, t + AFTER
            rests = brakes and not arm.v.any()
            is_away = has_touched and contact.gap > 0.01 and place.head is None
            if not contact.is_pressed and (rests or is_away):
                break
        return Attack(plan, stiffness, contact.finish(), head_gap)
