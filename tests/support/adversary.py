"""A world at war: balls and an arm that try to beat a monitor, who read its schedule.

The truth is simulated; the monitor sees it late, seldom, and with errors as large as declared, as
it suits the attackers. The arm goes where it likes while it may, and obeys each STOP as late as it
may, with any deceleration between guaranteed and greatest. In each tick what could truly happen
next is tried out, of every ball against points of the true surface of the arm:

- after a GO: the arm goes on for as long as it then may, brakes, and is touched before it rests;
- after a GO: the arm keeps to its speed scale, as it has done before, for as long as a STOP takes
  to reach the brakes, is told to stop, and is touched before it rests;
- after any verdict: the arm goes on, and is touched before the contact time that it was given.

Either would be a miss, and so would a contact with an arm that is not at rest.

Some balls may be touched, up to a limit. Then a contact is a miss if a point of the leaf that
touches is truly faster than the limit at that moment, or at any later one before the arm rests; or,
where another ball or link comes within a gap of the leaf, if a point goes farther, or comes nearer
to that link, than the limit permits.
What limits permit is counted, so that there is something to be missed.
"""

import itertools
from typing import NamedTuple

import numpy as np

from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.scheduling.timing_wheel import SLOTS
from armguard.settings.contact_limits import ContactLimit, ContactLimits
from armguard.verdict import Level
from support import attackers, true_arm
from support.adversary_score import Score
from support.attackers import BANG, EDGE, HOARD, HUNT, SPEND, WANDER, Balls
from support.hostile_joints import brake_joints, limits_of

HISTORY = 256  # ticks of truth that are remembered, for messages that come late
DELAYS = (0, 0, 0, 3, 15, 40)  # of messages, in ticks
GAPS = (1, 1, 4, 10, 33, 33, 100, 400)  # between two messages about the same ball, in ticks
EPISODE, STUCK = 1000, 300  # ticks until all begins anew, and of a STOP that nobody ends
SAMPLES = 14  # instants at which what could happen is tried out
NEAR = np.array([0.01, 0.02, 0.03, 0.04, 0.05])  # when contacts are tried of near pairs, in [s]
SLOW = 0.02, 0.05, 0.1  # fractions of its speeds that an arm keeps to at close quarters
CLOSE = 0.1, 0.7  # how far from the arm attacks begin at close quarters, in [m]
VAGUE = 0.3, 2.0  # errors of a vague message, in [m] and [m/s]
AWAY = 0.3  # from where on an arm that works surely rests before it touches anything, in [m]
RECONSIDERED = 0.01  # share of messages that say of a ball that it is another part of a body
HORIZON = 0.4  # for which a contact time is tried, in [s]
NAMES = itertools.count()


class Permission(NamedTuple):
    """A limit that a hunt's monitor is told of a region, and what is true of it."""

    region: str
    told: ContactLimit
    limit: float
    """How fast a surface may truly be, in [m/s]."""
    way: float
    """How far one may truly go on that clamps it, in [m]."""


def permit(region, speed, way, gap=0.0, *, truth=1.0):
    """A permission; of a speed in [m/s] and a way in [m], `truth` times as much is permitted.

    No part is so thin that it could be clamped between links that share a joint.
    """
    stiffness = 1000.0
    force = stiffness * way
    told = ContactLimit(
        force=force, stiffness=stiffness, body_mass=force * way / speed**2, source="hunt",
        gap=gap, thickness=10.0,
    )  # fmt: skip
    return Permission(region, told, truth * speed, truth * way)


def _draw_name():
    """Of a ball that is a part of no other ball's person."""
    return f"{next(NAMES)}/ball"


class Hunt:
    """One robot, one monitor, and balls.

    Args:
        robot: The arm.
        seed: Of all that happens.
        count: Balls.
        hunting: Those that attack.
        top: Fractions of its speeds that the arm keeps to, one of them in each episode.
        true_reaction: From a STOP to braking torque, in [s]; None: as the monitor believes.
        close: Whether attacks begin right beside the arm, which is slow, and whose brakes bite at
            once: others are stopped long before anything is within 50 ms of contact.
        vague: Share of messages whose errors are larger than those of the others, by up to `VAGUE`.
        permissions: Limits of contact; each ball has one of them, or none.
        gap: How near another ball truly clamps what is touched, in [m]; 0: none does.
        static: Share of the balls that attack, and stand still.
        settings: Of the monitor.
    """

    def __init__(
        self,
        robot,
        seed,
        count=60,
        hunting=12,
        *,
        top=(0.05, 0.15, 0.3, 0.6, 1.0),
        true_reaction=None,
        close=False,
        vague=0.0,
        permissions=(),
        gap=0.0,
        static=0.1,
        **settings,
    ):
        self.settings = {"rate": 1000.0, "latency": 0.002, "reaction_time": 0.02, "rise_delay": 0.0}
        self.settings |= {"source_timeout": 1e6, "slow_margin": 0.02, "aware_margin": 0.05}
        if close:
            self.settings |= {"latency": 0.0, "reaction_time": 0.002}
        self.settings |= settings
        self.permissions, self.true_gap, self.static = tuple(permissions), gap, static
        if permissions:
            told = ContactLimits({one.region: one.told for one in permissions})
            self.settings["contact_limits"] = told
        self.random = np.random.default_rng(seed)
        self.robot, self.count, self.hunting, self.close = robot, count, hunting, close
        self.vague = vague
        self.top = SLOW if close else top
        self.arm, self.limits = true_arm.make_skeleton(robot), limits_of(robot)
        self.room = true_arm.make_room(self.arm)
        self.before = self.room[2].copy()
        self.care = np.zeros(len(robot.joints), np.int64)
        self.traced = true_arm.make_trace(self.arm, SAMPLES)
        self.rates = np.zeros((SAMPLES, len(robot.joints)))
        self.harm = attackers.Harm(
            *np.zeros((2, SAMPLES, len(self.arm.joint))),
            *np.zeros((2, SAMPLES, len(self.arm.joint)), np.int64),
            np.zeros((SAMPLES, len(self.arm.joint))),
        )
        self.pairs = attackers.list_link_pairs(self.arm)
        self.soon = true_arm.make_trace(self.arm, len(NEAR))
        self.step = 1.0 / self.settings["rate"]
        reaction = self.settings["reaction_time"] if true_reaction is None else true_reaction
        self.obeying = int((self.settings["latency"] + reaction) / self.step + 1e-6)
        response = self.step + self.settings["latency"]
        self.free = response + reaction
        self.keeping = response + self.settings["reaction_time"]
        self.obstacles = Obstacles()
        self.monitor = Monitor(robot, self.obstacles, **self.settings)
        if permissions and not gap > 0.0:
            # Nothing of the arm counts: some link is always near, and nothing harmless for long.
            scene = self.monitor._scheduler.arm.state.scene
            scene.contact_limits.thickness.fill(np.inf)
            scene.link_gaps.base[:, 3] = -np.inf
        self.score = Score()
        self.start = self.tick = 0
        self.begin()

    def begin(self):
        """A new truth, and a monitor that knows nothing."""
        random, n = self.random, self.count
        for name in filter(None, list(self.obstacles.ids)):
            self.obstacles.remove([name])
        self.obstacles.take_faults()
        self.monitor.reset()
        # Time goes on: removals are remembered.
        self.start += self.tick + HISTORY
        self.tick, self.stopped, self.last = 0, 0, 0.0
        self.level, self.said_stop = Level.CLEAR, [True] * self.obeying
        lower = np.maximum(self.limits.lower, -3.0)
        upper = np.minimum(self.limits.upper, 3.0)
        self.q = lower + (upper - lower) * random.uniform(0.25, 0.75, len(lower))
        self.v = np.zeros(len(lower))
        self.pace, self.push = random.choice(self.top), self.v.copy()
        self.plan, self.strength = 0, self.v.copy()
        true_arm.place_leaves(self.arm, self.q, *self.room)
        mode = np.full(n, WANDER)
        hunting = min(self.hunting, n)
        mode[:hunting] = random.choice([HUNT, SPEND, HOARD, EDGE, BANG], hunting)
        far = np.where(mode == WANDER, random.uniform(2.5, 8.0, n), random.uniform(1.3, 2.6, n))
        states = np.zeros((n, 6))
        states[:, :3] = self._directions(n) * far[:, None]
        speed = np.where(mode == WANDER, random.uniform(0.1, 1.0, n), random.uniform(0.3, 2.2, n))
        if self.close:
            for b in np.flatnonzero(mode != WANDER):
                self._draw_close(states[b])
        accel = random.uniform(1.0, 12.0, n)
        accel[random.random(n) < 0.05] = 60.0
        radius = random.uniform(0.02, 0.15, n)
        self.balls = Balls(
            states, accel, speed, radius, mode, self._directions(n), random.integers(1, 200, n),
            np.zeros(n), np.zeros(n),
        )  # fmt: skip
        self.regions = [""] * n
        for b in range(n if self.permissions else 0):
            self._draw_region(b)
        self.home = np.full(n, 8.0)
        self.errors = random.choice([0.0, 0.005, 0.02], n), random.choice([0.0, 0.02, 0.1], n)
        self.gap = random.choice(GAPS, n)
        self.gap[mode != WANDER] = random.choice(GAPS[:-2], hunting)
        self.delay = random.choice(DELAYS, n)
        if random.random() < 0.5:
            # All is known as well as can be, so that verdicts let them come closer.
            self.gap[:], self.delay[:] = 1, 0
            self.errors = np.zeros(n), np.zeros(n)
        self.next = np.zeros(n, np.int64)
        self.names = [_draw_name() for _ in range(n)]
        self.stamped = 0
        self.truth = np.zeros((HISTORY, n, 6))
        self.joints = np.zeros((HISTORY, 2, len(self.q)))
        for b in range(n):
            if mode[b] != WANDER and random.random() < self.static:
                self._make_static(b)

    def _draw_region(self, b, at_most=np.inf):
        """Let a ball have one of the limits up to some speed, or none."""
        allowed = [one for one in self.permissions if one.limit <= at_most]
        self.regions[b], self.balls.limit[b], self.balls.way[b] = "", 0.0, 0.0
        number = self.random.integers(-1, len(allowed))
        if number >= 0:
            self.regions[b], _, self.balls.limit[b], self.balls.way[b] = allowed[number]

    def _directions(self, count):
        directions = self.random.normal(size=(count, 3))
        return directions / np.linalg.norm(directions, axis=1)[:, None]

    def _is_away(self, b):
        """Whether an arm at work surely stops before it touches a ball."""
        state, radius = self.balls.states[b], self.balls.radius[b]
        return attackers.nearest_leaf(self.arm, self.room[2], state[:3], radius)[1] > AWAY

    def _draw_close(self, state):
        """Place a ball that attacks right beside the arm."""
        random, centers = self.random, self.room[2]
        away = 0.0
        while not away > 0.0:
            state[:3] = centers[random.integers(len(centers))]
            state[:3] += self._directions(1)[0] * random.uniform(*CLOSE)
            _, away = attackers.nearest_leaf(self.arm, centers, state[:3], 0.15)

    def _make_static(self, b):
        balls = self.balls
        balls.accel[b] = balls.speed[b] = balls.limit[b] = balls.way[b] = 0.0
        balls.states[b, :3] *= 0.6
        _, away = attackers.nearest_leaf(
            self.arm, self.room[2], balls.states[b, :3], balls.radius[b]
        )
        if away < 0.15:
            balls.states[b, :3] *= 4.0
        self._add_static(b)

    def _add_static(self, b):
        balls = self.balls
        self.next[b] = np.iinfo(np.int64).max
        self.obstacles.add_static(self.names[b], balls.states[b, :3], balls.radius[b])

    def speak(self):
        """Messages of this tick: what suits the attackers."""
        balls, random, n = self.balls, self.random, self.tick
        self.truth[n % HISTORY] = balls.states
        due = self.next <= n
        delay = self.delay if n >= HISTORY else np.minimum(self.delay, 0 if n == 0 else n)
        for ticks in set(delay[due]):
            chosen = np.flatnonzero(due & (delay == ticks))
            seen = self.truth[(n - ticks) % HISTORY, chosen]
            away = self._directions(len(chosen))
            lies = random.random(len(chosen))
            for b in chosen if self.permissions else ():
                if random.random() < RECONSIDERED and self._is_away(b):
                    self._draw_region(b, at_most=balls.limit[b])
            # Most messages say that a ball is farther, and more on its way out, than it is.
            outwards = seen[:, :3] - self.room[2][random.integers(len(self.room[2]))]
            outwards /= np.linalg.norm(outwards, axis=1)[:, None] + 1e-9
            away = np.where((lies < 0.7)[:, None], outwards, away)
            errors = [error[chosen] for error in self.errors]
            if self.vague > 0.0:
                much = random.random(len(chosen)) * (random.random(len(chosen)) < self.vague)
                errors = [error + much * most for error, most in zip(errors, VAGUE, strict=True)]
            self.obstacles.update(
                [self.names[b] for b in chosen],
                (self.start + n - ticks) * self.step,
                seen[:, :3] + away * (errors[0] * (1 - 1e-9))[:, None],
                seen[:, 3:] + away * (errors[1] * (1 - 1e-9))[:, None],
                radius=balls.radius[chosen],
                accel=balls.accel[chosen],
                speed=balls.speed[chosen],
                position_error=errors[0],
                velocity_error=errors[1],
                region=[self.regions[b] for b in chosen] if self.permissions else None,
            )
            self.next[chosen] = n + self.gap[chosen]

    def swap_one(self):
        """A ball that roams leaves, and another one comes in from far away.

        One that stands still is moved to another place near the arm, where there may be contact.
        """
        still = np.flatnonzero(self.balls.speed == 0.0)
        if self.permissions and len(still):
            b = self.random.choice(still)
            self.obstacles.remove([self.names[b]])
            self.names[b] = _draw_name()
            self._draw_close(self.balls.states[b])
            self._add_static(b)
        roaming = np.flatnonzero(self.balls.mode == WANDER)
        if not len(roaming):
            return
        b = self.random.choice(roaming)
        self.obstacles.remove([self.names[b]])
        self.names[b] = _draw_name()
        self.balls.states[b] = 0.0
        self.balls.states[b, :3] = 9.0 * self._directions(1)[0]
        self.truth[:, b] = self.balls.states[b]
        self.next[b] = self.tick

    def read_schedule(self):
        """Ticks since each ball was looked at, until it will be, and from one to the other."""
        scheduler = self.monitor._scheduler
        certificates = scheduler.certificates
        rows = [self.obstacles.row(name) for name in self.names]
        age = self.tick * self.step - certificates.evaluated_at[rows]
        since = np.clip(age / self.step, 0.0, 1e6)
        slots = certificates.wheel.slot[rows]
        until = np.where(slots >= 0, (slots - self.tick) % SLOTS, 0)
        since = np.rint(since).astype(np.int64)
        return since, until, since + until

    def plan_arm(self, looked):
        """What the arm does next: at times, to turn right after a look."""
        random, arm = self.random, self.arm
        prey, leaf = attackers.find_prey(arm, self.balls, self.room[2])
        turns = self.turns and looked[prey] == 0
        if self.plan > 0 and not turns:
            self.plan -= 1
            return
        self.plan, self.turns = random.integers(10, 200), random.random() < 0.3
        kind = random.random()
        self.push = random.choice([-1.0, 0.0, 1.0], len(self.q))
        if kind < 0.6 or turns:
            rotations, origins, centers = self.room
            attackers.push_towards(
                arm, rotations, origins, centers[leaf], leaf, self.balls.states[prey, :3], self.push
            )
        if kind > 0.85:
            self.push[:] = 0.0

    turns = False

    def _attack(self, push, free, *, scale=1.0, end=None, harms=True):
        """What the worst attack on an arm lacks that goes on so, and how many balls were near.

        And how near to its limit a contact comes that is permitted, and how fast. Unless only
        what `harms` is looked for, every contact counts.
        """
        random, limits, nv = self.random, self.limits, len(self.q)
        strength = np.zeros(nv) if random.random() < 0.7 else random.random(nv)
        times = np.empty(SAMPLES)
        if end is None:
            speed = np.minimum(np.abs(self.v) + limits.accel * free, scale * limits.velocity)
            slowest = np.max(speed / limits.braking)
            times[:4] = free * np.arange(1, 5) / 4
            times[4:] = free + slowest * (np.arange(1, SAMPLES - 3) / (SAMPLES - 4)) ** 1.5
        else:
            times[:] = end * np.arange(1, SAMPLES + 1) / SAMPLES
        count = true_arm.trace_arm(
            self.arm, limits, self.q, self.v, push, strength, free, scale, times,
            self.traced, self.rates,
        )  # fmt: skip
        harm = self.harm
        if self.permissions and harms:
            true_arm.fill_paces(self.arm, self.traced, self.rates, count, harm.pace)
            true_arm.fill_ways(self.arm, self.traced, count, harm.way)
            attackers.find_company(
                self.arm, self.balls, self.traced, times, count, self.true_gap, harm
            )
            attackers.fill_closing(
                self.arm, self.pairs, self.traced, count, self.true_gap, harm.closing
            )
        else:
            harm.pace.fill(np.inf)
        return self._attack_all(times, count)

    def _attack_all(self, times, count):
        """The same of an arm whose motion is traced."""
        lacks, _, _, tried, gentle, pace = attackers.attack_all(
            self.arm, self.balls, self.traced, times, count, self.harm
        )
        return lacks, tried, gentle, pace

    def try_attacks(self, verdict, late):
        """What could truly happen now, against what was said."""
        score, random = self.score, self.random
        push = self.push if random.random() < 0.5 else random.choice([-1.0, 1.0], len(self.q))
        free = late + self.free
        if verdict.level > Level.STOP:
            lacks, tried, gentle, pace = self._attack(push, free)
            score = score._replace(
                goes=score.goes + 1,
                tried=score.tried + tried,
                missed=score.missed + int(lacks <= 0.0),
                worst=min(score.worst, lacks),
                allowed=score.allowed + int(gentle > 0.0),
                closest=max(score.closest, gentle),
                understated=score.understated + int(gentle > 0.0 and pace > verdict.contact_speed),
            )
        if verdict.level is Level.SLOW:
            # In higher levels a scale of 1 promises nothing for longer than the verdict is valid.
            lacks, _, _, _ = self._attack(push, free + self.keeping, scale=verdict.speed_scale)
            score = score._replace(
                too_fast=score.too_fast + int(lacks <= 0.0),
                worst_scale=min(score.worst_scale, lacks),
            )
        if verdict.contact_time > 0.0 and self.tick % 2 == 0:
            end = min(late + verdict.contact_time, HORIZON) * (1.0 - 1e-9)
            lacks, _, _, _ = self._attack(push, np.inf, end=end, harms=False)
            score = score._replace(
                early=score.early + int(lacks <= 0.0), worst_time=min(score.worst_time, lacks)
            )
        if self.permissions and verdict.harm_time > 0.0 and self.tick % 2 == 1:
            end = min(late + verdict.harm_time, HORIZON) * (1.0 - 1e-9)
            lacks, _, _, _ = self._attack(push, np.inf, end=end)
            score = score._replace(
                harmful=score.harmful + int(lacks <= 0.0), worst_harm=min(score.worst_harm, lacks)
            )
        self.score = score

    def count_near(self, verdict, late):
        """Pairs that could truly touch within 50 ms, and whether before their contact time."""
        true_arm.trace_arm(
            self.arm, self.limits, self.q, self.v, self.push, np.zeros(len(self.q)), np.inf, 1.0,
            NEAR, self.soon, self.rates,
        )  # fmt: skip
        near, soonest = attackers.count_near(
            self.arm, self.balls, self.room, self.soon, NEAR, len(self.robot.links)
        )
        is_open = verdict.level > Level.STOP or bool((self.v != 0.0).any())
        score = self.score
        self.score = score._replace(
            near=score.near + near,
            near_open=score.near_open + near * is_open,
            early=score.early + int(late + verdict.contact_time > soonest * (1.0 + 1e-9)),
        )

    def advance(self):
        """One tick: messages, a verdict, what it leaves possible, and a step of the truth."""
        random, robot, n = self.random, self.robot, self.tick
        if n % 50 == 49:
            self.swap_one()
        self.speak()
        self.joints[n % HISTORY] = self.q, self.v
        # Now and then a state that is some ticks old; never an older one than before.
        self.stamped = max(self.stamped, n - int(random.choice([0, 0, 0, 1, 4])))
        q, v = self.joints[self.stamped % HISTORY]
        wrong = random.choice([-1.0, 1.0], (2, len(q))) * (random.random() < 0.8)
        late = self.settings["latency"] * random.choice([0.0, 0.0, 0.5, 0.9])
        # Ticks that come late may come close upon each other.
        now = (self.start + n) * self.step
        late = max(late, self.last - now)
        self.last = now + late
        verdict = self.monitor.step(
            (self.start + self.stamped) * self.step,
            np.clip(q + wrong[0] * robot.position_error, self.limits.lower, self.limits.upper),
            v + wrong[1] * robot.velocity_error,
            self.last,
        )
        self.try_attacks(verdict, late)
        self.count_near(verdict, late)
        stop = verdict.level is Level.STOP
        broken = not verdict.complete or any(r.kind.effect.value != "note" for r in verdict.reasons)
        score = self.score
        self.score = score._replace(
            pair_ticks=score.pair_ticks + self.count * len(robot.links),
            ticks=score.ticks + 1,
            stops=score.stops + int(stop and self.stopped == 0),
            faults=score.faults + int(broken),
        )
        self.stopped = self.stopped + 1 if stop else 0
        self.said_stop.append(stop)
        self._move(len(self.said_stop) - 1 - self.obeying)
        self.tick += 1
        if self.tick >= EPISODE or self.stopped > STUCK or self.monitor._rule.latched:
            self.begin()
        return verdict

    def _move(self, heard):
        looked, until, between = self.read_schedule()
        self.before[:] = self.room[2]
        if heard >= 0 and self.said_stop[heard]:
            strength = self.random.random(len(self.q))
            strength = np.where(strength < 0.3, 0.0, np.where(strength > 0.8, 1.0, strength))
            brake_joints(self.q, self.v, strength, self.limits, self.step)
        else:
            self.plan_arm(looked)
            true_arm.move_freely(
                self.q, self.v, self.push, self.limits, self.pace, self.care, self.step
            )
        true_arm.place_leaves(self.arm, self.q, *self.room)
        self._steer(looked, until, between)
        touching, hurt, gentle = attackers.count_touching(self.arm, self.balls, self.room, self.v)
        if touching:
            score = self.score
            moving = bool((self.v != 0.0).any())
            self.score = score._replace(
                hits=score.hits + int(hurt > 0),
                gentle=score.gentle + int(gentle > 0.0),
                closest=max(score.closest, gentle),
                touches=score.touches + int(not moving),
            )

    def _steer(self, looked, until, between):
        attackers.steer_balls(
            self.arm, self.balls, self.room[2], self.before, self.step, self.stopped, looked,
            until, between, self.home, self.random,
        )  # fmt: skip

    def run(self, pair_ticks):
        """Go on until so many pair-ticks have been watched in all."""
        while self.score.pair_ticks < pair_ticks:
            self.advance()
        return self.score
