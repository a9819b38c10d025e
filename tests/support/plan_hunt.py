"""Worlds of an arm that moves on committed pieces: what may happen to it does, and does it touch?

A controller shows pieces that overlap, begin later, and replace one another, at times two in a
tick. Some answers are lost, the others take up to the latency. It shows what goes on from the piece
that it follows, or from one whose answer is still to come; until the answer arrives some pieces
lead aside, as far as the piece before may be left, and allow for less themselves. The arm follows
the piece that it was last told was safe, as far off it as was stated; on a STOP it finishes its
piece, or brakes within latency and reaction time. Where joints may leave a piece, brakes also
engage at any time, each joint at a moment of its own. Joint states may be a tick late.

Balls appear at any time, at rest or in motion, where a piece leads that was answered safe. They
keep to their bounds. Some are hidden for a while, some samples are vaguer than others, and messages
come before a step or between that and what is shown after it. One premise takes care: a ball must
not appear so late that the arm touches something though it brakes on the first verdict after that.
That is tried out before.
"""

import copy
import functools
from typing import NamedTuple

import numpy as np

from armguard.bounds import Plan
from armguard.exceptions import ArmguardError
from armguard.jit.kernels import kernel
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.verdict import PlanVerdict
from support.true_arm import get_point, make_room, make_skeleton, place_leaves

STEP = 1e-3
"""Between the instants at which the truth is looked at, in [s]."""
TICK_STEPS = 5
PERIOD = TICK_STEPS * STEP
TICKS = 120
"""Of a world."""
BALLS = 4
"""In a world, at most."""
ALIKE = 1e-7
"""Below this two curves are the same, in [rad], [m] and those in [s]."""


class Score(NamedTuple):
    """What became of worlds."""

    worlds: int = 0
    contacts: int = 0
    """Worlds in which a ball touched an arm that moved."""
    astray: int = 0
    """Worlds in which the arm was at some time on a piece that was answered safe, and not kept."""
    shown: int = 0
    """Pieces that were shown."""
    safe: int = 0
    lost: int = 0
    """Safe answers that were lost."""
    followed: int = 0
    """Pieces that the arm took up."""
    balls: int = 0
    late: int = 0
    """Balls that would have appeared too late, and did not."""
    brakes: int = 0
    """How often brakes engaged."""
    near: int = 0
    """Worlds in which a ball came within 2 cm of an arm that moved."""
    aside: int = 0
    """Pieces that the arm took up and that led aside before."""
    vague: int = 0
    """Samples that were vaguer than others of the same ball."""

    def __add__(self, other):
        return Score(*(a + b for a, b in zip(self, other, strict=True)))


class Leg(NamedTuple):
    """What the arm follows from some time on."""

    begin: float
    plan: Plan
    swung: float
    """For how long it has swung about its curves when the leg begins, in [s]."""

    is_moving: bool
    """Whether the plan is a piece; else the arm rests."""

    @property
    def end(self):
        return find_end(self.plan)


class Ball(NamedTuple):
    """From rest or from the start in motion, straight on, at one acceleration up to a speed."""

    name: str
    start: np.ndarray
    heading: np.ndarray
    since: float
    accel: float
    speed: float
    radius: float
    errors: tuple[float, float]
    gap: int
    """Ticks between two messages."""
    delay: int
    """Ticks that a message takes."""
    is_static: bool

    def place(self, times):
        """Where it is, (n, 3), and how fast."""
        gone = np.maximum(np.asarray(times, dtype=float) - self.since, 0.0)
        ramp = self.speed / self.accel if self.accel > 0.0 else 0.0
        speeding = np.minimum(gone, ramp)
        way = 0.5 * self.accel * speeding**2 + self.speed * (gone - speeding)
        pace = self.accel * speeding if self.accel > 0.0 else 0.0 * gone
        return self.start + way[..., None] * self.heading, pace[..., None] * self.heading


def find_end(plan):
    """When an arm on a plan comes to rest, in [s]."""
    return plan.stamp + float(plan.times[-1])


@kernel
def fill_hermite(times, q, v, at, place, pace):
    """Fill the cubic through samples, and its derivative; at rest before it begins and after."""
    count = times.shape[0]
    for i in range(at.shape[0]):
        t = min(max(at[i], times[0]), times[count - 1])
        k = min(max(np.searchsorted(times, t, side="right") - 1, 0), count - 2)
        h = times[k + 1] - times[k]
        s = (t - times[k]) / h
        moves = times[0] <= at[i] < times[count - 1]
        for j in range(q.shape[1]):
            a, b, m, n = q[k, j], q[k + 1, j], h * v[k, j], h * v[k + 1, j]
            c, d = 3.0 * (b - a) - 2.0 * m - n, 2.0 * (a - b) + m + n
            place[i, j] = a + s * (m + s * (c + s * d))
            pace[i, j] = (m + s * (2.0 * c + s * 3.0 * d)) / h if moves else 0.0


def read_plan(plan, times):
    """Where a plan has the arm at times on the clock, and how fast. Shape (n, nv) each."""
    at = np.asarray(times, dtype=float) - plan.stamp
    place, pace = np.empty((2, len(at), plan.q.shape[1]))
    fill_hermite(plan.times, plan.q, plan.v, at, place, pace)
    return place, pace


@kernel
def find_least_gap(arm, room, qs, moving, places, radii):
    """The least gap of balls, (steps, balls, 3), and an arm that moves, in [m]; and at which step.

    Only what is nearer than 5 cm is looked at closely.
    """
    rotations, origins, centers = room
    best, step = 0.05, -1
    for k in range(qs.shape[0]):
        if not moving[k]:
            continue
        place_leaves(arm, qs[k], rotations, origins, centers)
        for b in range(radii.shape[0]):
            x, y, z = places[k, b, 0], places[k, b, 1], places[k, b, 2]
            for leaf in range(centers.shape[0]):
                dx, dy, dz = x - centers[leaf, 0], y - centers[leaf, 1], z - centers[leaf, 2]
                reach = best + radii[b] + arm.radius[leaf]
                if not dx * dx + dy * dy + dz * dz < reach * reach:
                    continue
                for index in range(arm.first[leaf], arm.first[leaf + 1]):
                    px, py, pz = get_point(arm, rotations, origins, leaf, index)
                    away = np.sqrt((x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2) - radii[b]
                    if away < best:
                        best, step = away, k
    return best, step


class TrueArm:
    """An arm as it truly moves: along its legs, off them, and braked.

    Attributes:
        legs: What it follows, those to come included.
        mail: Answers on their way: when they arrive, and the piece.
    """

    def __init__(self, q, off, rate, phase):
        self.off, self.rate, self.phase = off, rate, phase
        self.legs, self.mail = [], []
        self.rest(0.0, q)

    def rest(self, now, q):
        """It rests where it is, off nothing."""
        still = Plan(now, np.array([0.0, STEP]), np.array([q, q]), np.zeros((2, len(q))), None)
        self.legs = [Leg(now, still, 0.0, False)]
        self.mail = []
        self.leaving = self.braked = None
        # Off by nothing where it begins.
        self.shift = self.off * np.sin(self.phase)

    def copy(self):
        other = copy.copy(self)
        other.legs, other.mail = list(self.legs), list(self.mail)
        return other

    def leg(self, time):
        """What it follows at a time."""
        return next(leg for leg in reversed(self.legs) if leg.begin <= time + 1e-9)

    @staticmethod
    def read(legs, times):
        """Where legs have it, and how fast. Shape (n, nv) each."""
        times = np.asarray(times, dtype=float)
        q, v = read_plan(legs[0].plan, times)
        for leg in legs[1:]:
            first = np.searchsorted(times, leg.begin - 1e-9)
            if first < len(times):
                q[first:], v[first:] = read_plan(leg.plan, times[first:])
        return q, v

    def free(self, times):
        """Where it truly is, and how fast, as long as no brake engages."""
        times = np.asarray(times, dtype=float)
        begun = [k for k, leg in enumerate(self.legs) if leg.begin <= times[0] + 1e-9]
        legs = self.legs[begun[-1] if begun else 0 :]
        q, v = self.read(legs, times)
        swung, moves = np.zeros(len(times)), np.zeros(len(times), dtype=bool)
        for leg in legs:
            on = times >= leg.begin - 1e-9
            since = leg.swung + np.minimum(times, leg.end) - leg.begin
            swung = np.where(on, np.maximum(since, leg.swung), swung)
            moves = np.where(on, (times < leg.end) & leg.is_moving, moves)
        turn = swung[:, None] * self.rate + self.phase
        q = q + self.off * np.sin(turn) - self.shift
        return q, v + moves[:, None] * self.off * self.rate * np.cos(turn)

    def state(self, times):
        """Where it truly is, and how fast. Shape (n, nv) each."""
        q, v = self.free(times)
        if self.leaving is None:
            return q, v
        begin, rates, (q0, v0) = self.leaving
        after = np.asarray(times, dtype=float)[:, None] - begin
        until = np.clip(after, 0.0, np.abs(v0) / rates)
        place = q0 + np.sign(v0) * until * (np.abs(v0) - 0.5 * rates * until)
        pace = np.sign(v0) * np.maximum(np.abs(v0) - rates * until, 0.0)
        pace[after >= np.abs(v0) / rates] = 0.0
        return np.where(after >= 0.0, place, q), np.where(after >= 0.0, pace, v)

    def brake(self, begin, rates):
        """Joints leave at times of their own, (nv,), and decelerate. It takes up nothing more."""
        if self.leaving is not None:
            begin = np.minimum(begin, self.leaving[0])
            rates = self.leaving[1]
        both = [self.free(begin[j : j + 1]) for j in range(len(begin))]
        at = tuple(np.array([both[j][k][0, j] for j in range(len(begin))]) for k in (0, 1))
        self.leaving, self.mail = (begin, rates, at), []

    def rests_by(self):
        """When it rests."""
        if self.leaving is None:
            return self.legs[-1].end
        begin, rates, (_, v0) = self.leaving
        return float(max((begin + np.abs(v0) / rates).max(), 0.0))

    def take(self, now, plan, drops_all):
        """Take up a piece that goes on from what it follows; whether it did."""
        begin = max(now, plan.stamp)
        legs = [leg for leg in self.legs if leg.begin < begin - 1e-9]
        if drops_all:
            legs = [leg for leg in legs if leg.begin <= now + 1e-9]
        if not legs or begin >= find_end(plan):
            return False
        # It goes straight over to it, so that it has to be on it already.
        had, had_pace = self.read(legs, [begin])
        wanted, pace = read_plan(plan, [begin])
        off = max(np.abs(had - wanted).max(), np.abs(had_pace - pace).max())
        if not off <= ALIKE:
            return False
        last = legs[-1]
        swung = last.swung + max(min(begin, last.end) - last.begin, 0.0)
        self.legs = [*legs, Leg(begin, plan, swung, True)]
        return True


class PlanHunt:
    """One robot, one monitor, world after world.

    Args:
        robot: The arm; its brakes hold at every speed.
        seed: Of all that happens.
        latency: Of answers and verdicts, in [s].
        reaction: From a STOP that has arrived to braking torque, in [s].
        leave: Whether joints may leave their pieces.
        trusts_all: A control: the arm takes every piece for safe, and obeys no STOP.
    """

    def __init__(self, robot, seed, *, latency, reaction=0.05, leave="never", trusts_all=False):
        self.random = np.random.default_rng(seed)
        self.robot, self.latency, self.reaction, self.leave = robot, latency, reaction, leave
        self.trusts_all = trusts_all
        self.skeleton = make_skeleton(robot)
        self.room = make_room(self.skeleton)
        self.obstacles = Obstacles(sources=[])
        self.monitor = Monitor(
            robot, self.obstacles, rate=1.0 / PERIOD, motion="planned", leave=leave,
            latency=latency, reaction_time=reaction, rise_delay=0.0, source_timeout=1e6,
        )  # fmt: skip
        self.lower = np.maximum(robot.lower_position_limit, -3.0)
        self.upper = np.minimum(robot.upper_position_limit, 3.0)
        self.tick = self.named = 0
        self.score = Score()

    def begin(self):
        """A new truth, and a monitor that knows nothing."""
        random, robot = self.random, self.robot
        self.obstacles.remove([name for name in self.obstacles.ids if name])
        self.obstacles.take_faults()
        self.monitor.reset()
        self.tick += 400
        self.last = self.tick + TICKS
        nv = len(robot.joints)
        self.error = random.choice([5e-4, 2e-3, 5e-3])
        self.pace_error = random.choice([0.005, 0.02])
        self.states_pace = random.random() < 0.7
        self.ticks_late = int(random.choice([0, 0, 1]))
        off = random.choice([0.0, 0.5, 0.95], nv) * 0.5 * self.error
        rate = random.uniform(0.0, 1.0, nv) * 0.9 * self.pace_error / np.maximum(off, 1e-9)
        rate = np.minimum(rate, 30.0)
        q = self.lower + (self.upper - self.lower) * random.uniform(0.25, 0.75, nv)
        self.arm = TrueArm(q, off, rate, random.uniform(0.0, 6.0, nv))
        self.arm.rest(self.now, q)
        self.top = random.choice([0.1, 0.3, 0.5])
        self.loss = random.choice([0.0, 0.3, 0.7])
        self.busy = random.choice([0.2, 0.6, 1.0])
        self.foresees = random.random() < 0.5
        self.drops_all = random.random() < 0.5
        self.obeys = self.latency * random.choice([0.0, 1.0]), self.reaction * random.random()
        spread = random.choice([0.0, 1.0, 0.4], nv)
        braking = robot.braking_deceleration
        self.rates = braking + spread * (robot.acceleration_limit - braking)
        self.cuts = self.tick + random.integers(10, TICKS) if self.leave == "any" else None
        self.balls, self.answered, self.wants = [], [], int(random.integers(1, BALLS + 1))
        self.appears = np.sort(self.tick + random.integers(2, TICKS - 10, self.wants))
        self.told_brake = None
        self.least, self.is_astray = np.inf, False

    @property
    def now(self):
        return self.tick * PERIOD

    def play(self):
        """One world."""
        self.begin()
        while self.tick < self.last:
            self.advance()
            if self.least <= 0.0:
                break
        self.score += Score(
            worlds=1,
            contacts=self.least <= 0.0,
            near=self.least < 0.02,
            astray=self.is_astray,
        )

    def advance(self):
        """One tick."""
        now, arm, random, nv = self.now, self.arm, self.random, len(self.lower)
        self.appear()
        # Only what is known already may be told of so late that this verdict does not rest on it.
        known = [ball.name for ball in self.balls if ball.name in self.obstacles.ids]
        told_late = known if random.random() < 0.3 else []
        self.speak([ball for ball in self.balls if ball.name not in told_late])
        # Not a difference, which would be rounded to before what begins in that tick.
        stamp = (self.tick - self.ticks_late) * PERIOD
        (q,), (v,) = arm.state([stamp])
        noise = random.choice([-1.0, 0.0, 1.0], (2, nv))
        verdict = self.monitor.step(
            stamp,
            q + noise[0] * self.robot.position_error,
            v + noise[1] * self.robot.velocity_error,
            now,
        )
        self.speak([ball for ball in self.balls if ball.name in told_late])
        if verdict.stop == "brake" and self.told_brake is None and not self.trusts_all:
            self.told_brake = now + self.obeys[0]
            self.stop(arm, now)
        if self.told_brake is None and arm.leaving is None and self.tick == self.cuts:
            # Emergency stop: each joint at a moment of its own.
            arm.brake(now + random.choice([0.0, 0.02, 0.1], nv) * random.random(), self.rates)
            self.score += Score(brakes=1)
        if arm.leaving is not None and stamp > arm.rests_by() + STEP:
            arm.rest(now, arm.state([now])[0][0])
            self.told_brake = None
        for _ in range(random.choice([1, 1, 1, 2])):
            if arm.leaving is None and random.random() < self.busy:
                self.show()
        self.watch()
        self.move()
        self.tick += 1

    def stop(self, arm, now):
        """A STOP that was said now engages the brakes."""
        begin = now + self.obeys[0] + self.obeys[1]
        arm.mail = [one for one in arm.mail if one[0] <= now + self.obeys[0]]
        self.deliver(arm, begin)
        arm.brake(np.full(len(self.lower), begin), self.rates)
        self.score += Score(brakes=arm.rests_by() > begin)

    def deliver(self, arm, until):
        """Answers that arrive by then."""
        while arm.mail and arm.mail[0][0] <= until:
            arrival, plan, leads_aside = arm.mail.pop(0)
            took = arm.take(arrival, plan, self.drops_all)
            self.score += Score(followed=took, aside=took and leads_aside)

    def move(self):
        """The truth until the next tick: does anything touch?"""
        arm, now = self.arm, self.now
        while len(arm.legs) > 1 and arm.legs[1].begin <= now - 2.0 * PERIOD:
            del arm.legs[0]
        self.deliver(arm, now + PERIOD - 0.5 * STEP)
        times = now + STEP * np.arange(TICK_STEPS)
        self.least = min(self.least, self.find_gap(arm, times))

    def find_gap(self, arm, times, balls=None):
        """The least gap of an arm that moves, in [m]."""
        balls = self.balls if balls is None else balls
        if not balls:
            return np.inf
        q, v = arm.state(times)
        places = np.stack([ball.place(times)[0] for ball in balls], axis=1)
        radii = np.array([ball.radius for ball in balls])
        moving = (v != 0.0).any(axis=1)
        gap, step = find_least_gap(self.skeleton, self.room, q, moving, places, radii)
        return gap if step >= 0 else np.inf

    def show(self):
        """Show a piece, and take the answer."""
        arrival = self.now + self.latency * self.random.choice([0.0, 1.0, self.random.random()])
        arrival = max([arrival, *(one[0] for one in self.arm.mail)])
        plan = self.make_piece()
        if plan is None:
            return
        aside = self.lead_aside(plan, arrival) if self.random.random() < 0.3 else None
        try:
            plan = self.monitor.with_stop(plan if aside is None else aside)
        except ArmguardError:
            return
        answer = self.monitor.commit(plan)
        if self.trusts_all and answer.contact_time > 0.0:
            answer = PlanVerdict(True, np.inf, None, None, ())
        self.score += Score(shown=1, safe=answer.safe)
        if not answer.safe:
            return
        self.answered = [*self.answered[-8:], plan]
        if self.random.random() < self.loss:
            self.score += Score(lost=1)
            return
        self.arm.mail.append((arrival, plan, aside is not None))

    def lead_aside(self, plan, arrival):
        """The piece as one that leads aside until its answer arrives; None where it cannot.

        On the piece before, the arm may then be farther off it than it allows.
        """
        begin, before = max(plan.stamp, self.now), self.arm.leg(self.now)
        lasting = arrival - begin
        if not (before.is_moving and lasting > 0.02 and arrival <= plan.stamp + plan.times[-1]):
            return None
        size = 0.8 * before.plan.tracking_error
        # No harder than the share of what joints can do that the piece itself leaves.
        size = np.minimum(size, 0.35 * self.robot.acceleration_limit * lasting**2 / 32.0)
        size = size * self.random.choice([-1.0, 0.0, 1.0], len(size))
        knots = np.union1d(plan.stamp + plan.times, begin + lasting * np.linspace(0.0, 1.0, 9))
        knots = knots[np.append(np.diff(knots) > 1e-6, True)]
        q, v = read_plan(plan, knots)
        # As the last sample has it, where the piece need not rest.
        q[-1], v[-1] = plan.q[-1], plan.v[-1]
        part = np.clip((knots - begin) / lasting, 0.0, 1.0)[:, None]
        q += size * 16.0 * part**2 * (1.0 - part) ** 2
        v += size * 32.0 * part * (1.0 - part) * (1.0 - 2.0 * part) / lasting
        return plan._replace(times=np.append(0.0, knots[1:] - plan.stamp), q=q, v=v)

    def make_piece(self):
        """The next piece: some time along what the arm follows then, and on at random."""
        arm, random, now, robot = self.arm, self.random, self.now, self.robot
        legs = arm.legs
        if self.foresees:
            legs = self.look_ahead().legs
        elif self.drops_all:
            legs = [leg for leg in legs if leg.begin <= now + 1e-9]
        lead = random.choice([0.0, 0.0, random.uniform(0.0, 0.1), -random.uniform(0.0, 0.01)])
        stamp = max(now + lead, legs[0].begin)
        until = max(stamp, now + self.latency) + random.choice([1e-3, random.uniform(0.0, 0.05)])
        knots = [stamp, until]
        for leg in legs:
            knots += list(leg.plan.stamp + leg.plan.times)
            knots.append(leg.begin)
        knots = np.unique([knot for knot in knots if stamp <= knot <= until])
        knots = knots[np.append(np.diff(knots) > 1e-6, True)]
        if len(knots) < 2 or knots[0] != stamp:
            return None
        q, v = arm.read(legs, knots)
        # What it follows ends in a corner where it comes to rest: in a sample of its own.
        times, q, v = list(knots - stamp), list(q), list(v)
        accel = np.minimum(0.6 * robot.acceleration_limit, 0.9 * robot.braking_deceleration)
        for _ in range(random.integers(0, 5)):
            lasting = random.uniform(0.02, 0.15)
            goal = self.top * robot.velocity_limit * random.choice([-1.0, 0.0, 1.0], len(accel))
            pace = np.clip(goal, v[-1] - accel * lasting, v[-1] + accel * lasting)
            way = 0.5 * (v[-1] + pace) * lasting
            ahead = q[-1] + way + np.sign(pace) * pace**2 / robot.braking_deceleration
            is_out = (ahead < self.lower + 0.05) | (ahead > self.upper - 0.05)
            pace = np.where(
                is_out, np.clip(0.0, v[-1] - accel * lasting, v[-1] + accel * lasting), pace
            )
            q.append(q[-1] + 0.5 * (v[-1] + pace) * lasting)
            v.append(pace)
            times.append(times[-1] + lasting)
        ones = np.ones(len(accel))
        error = self.error * random.choice([1.0, 1.0, 3.0])
        return Plan(
            stamp, np.array(times), np.array(q), np.array(v), error * ones,
            self.pace_error * ones if self.states_pace else None,
        )  # fmt: skip

    def appear(self):
        """A ball comes, if one is due, where a piece leads that the arm may be on."""
        if not len(self.appears) or self.tick < self.appears[0]:
            return
        self.appears = self.appears[1:]
        now, random = self.now, self.random
        truth = self.look_ahead().state
        lasting = self.look_ahead().rests_by() - now
        if random.random() < 0.75 and lasting > 0.02:
            # As soon as an arm that is told so by the next verdict can still brake before.
            meets = now + lasting * np.linspace(0.05, 1.0, 12)
        else:
            # Where the arm may not get to at all.
            ahead = [plan for plan in self.answered if find_end(plan) > now + 0.05]
            if not ahead:
                return
            plan = ahead[random.integers(len(ahead))]
            truth = functools.partial(read_plan, plan)
            meets = random.uniform(now, find_end(plan), 2)
        heading = random.normal(size=3)
        kind = random.random(7)
        for meet in meets:
            ball = self.make_ball(meet, truth([meet])[0][0], heading, kind)
            balls = [*self.balls, ball]
            if self.is_in_time(balls):
                self.balls = balls
                self.score += Score(balls=1)
                return
            self.score += Score(late=1)

    def look_ahead(self):
        """The arm as it moves once all answers that are on their way have arrived."""
        arm, score = self.arm.copy(), self.score
        self.deliver(arm, np.inf)
        self.score = score
        return arm

    def make_ball(self, meet, q, heading, kind):
        """One that is to meet a leaf of an arm at a place, (nv,), at a time; shape (7,) of luck."""
        random, now, skeleton = self.random, self.now, self.skeleton
        place_leaves(skeleton, q, *self.room)
        radius = 0.01 + 0.05 * kind[0]
        leaf = int(kind[1] * len(skeleton.radius))
        heading = heading / np.linalg.norm(heading)
        # It is to be reached by the arm's surface, which is anywhere within the leaf.
        target = self.room[2][leaf] - heading * radius * kind[2]
        is_static = bool(kind[3] < 0.6)
        speed = 0.0 if is_static else 0.1 + kind[4]
        accel = 0.0 if is_static else 0.5 + 10.0 * kind[5]
        since = now + kind[6] * max(meet - now, 0.0)
        self.named += 1
        ball = Ball(
            f"ball-{self.named}", np.zeros(3), heading, since, accel, speed, radius,
            (random.choice([0.0, 0.01]), random.choice([0.0, 0.05])),
            int(random.choice([1, 4, 10, 25])), int(random.choice([0, 0, 2])), is_static,
        )  # fmt: skip
        return ball._replace(start=target - ball.place([meet])[0][0])

    def is_in_time(self, balls):
        """Whether an arm that is told to brake by the next verdict touches nothing."""
        arm, now = self.arm.copy(), self.now
        score = self.score
        if arm.leaving is None:
            self.stop(arm, now)
        self.score = score
        times = np.arange(now, max(arm.rests_by(), now) + STEP, STEP)
        q, _ = arm.state(times[:1])
        clear = find_least_gap(
            self.skeleton, self.room, q, np.ones(1, dtype=np.bool_),
            np.stack([ball.place(times[:1])[0] for ball in balls], axis=1),
            np.array([ball.radius for ball in balls]),
        )[0]  # fmt: skip
        return clear > 0.0 and self.find_gap(arm, times, balls) > 0.0

    def speak(self, balls):
        """Messages about balls in this tick."""
        random, now = self.random, self.now
        for ball in balls:
            known = ball.name in self.obstacles.ids
            if ball.is_static:
                if not known:
                    self.obstacles.add_static(ball.name, ball.start, ball.radius)
                continue
            if known and self.tick % ball.gap:
                continue
            stamp = now - (ball.delay * PERIOD if known else 0.0)
            (place,), (pace,) = ball.place([stamp])
            away = random.normal(size=(2, 3))
            away /= np.linalg.norm(away, axis=1)[:, None]
            is_vague = random.random() < 0.25
            errors = np.array(ball.errors) + is_vague * random.choice([0.0, 1.0], 2) * [0.1, 1.0]
            place = place + 0.999 * errors[0] * away[0]
            pace = pace + 0.999 * errors[1] * away[1]
            self.obstacles.update(
                [ball.name], stamp, place[None], pace[None], radius=ball.radius,
                accel=ball.accel, speed=ball.speed,
                position_error=errors[0], velocity_error=errors[1],
            )  # fmt: skip
            self.score += Score(vague=is_vague)

    def watch(self):
        """Whether the piece that the arm is on is among those that are kept."""
        arm, now = self.arm, self.now
        leg = arm.leg(now)
        if not leg.is_moving or now >= leg.end or arm.leaving is not None or self.tick % 4:
            return
        kept = self.monitor.plans
        for one in kept:
            # One that has yet to begin says itself where the arm may be until then.
            begin = max(now, one.stamp)
            times = np.linspace(begin, max(leg.end, one.end, begin), 24)
            apart = np.abs(read_plan(leg.plan, times)[0] - read_plan(one, times)[0])
            if (apart <= one.deviation - self.error - self.robot.position_error + 1e-6).all():
                return
        if not kept:
            return
        self.is_astray = True
