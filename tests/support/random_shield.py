"""A shield to which anything happens: what it is asked, what it sees, and what the arm does.

Balls move beside a Panda within their bounds, near it or far away, and most of the time they hunt
it. Some samples of them are late, wrong by as much as is stated, or wrong beyond all bounds; at
times there are none. The arm is as far off its commands as it may be, and its joint states are off
by their errors, late, or no numbers. Callers fall silent, ask for what cannot be done, tell times
that are none, change the payload, and reset.

Every command is looked at by other means than those that made it, see `RandomShield`.
"""

from __future__ import annotations

import functools
from collections import Counter, deque
from typing import NamedTuple

import numpy as np

from armguard.bounds import Plan
from armguard.jit.kernels import kernel
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot import OperatingLimits, Robot
from armguard.shield import Command, Path, Shield
from armguard.shield.path import SAME_PLACE
from armguard.verdict import BRAKE, Effect
from support.shielded_arm import ACCEL, HOME, RADIUS, SPEED, Ball
from support.true_arm import get_point, make_room, make_skeleton, place_leaves

STEP = 2e-3
"""Between the instants at which the truth is looked at, in [s]."""
ERRORS = 1e-3, 1e-2
"""Of tracking, in [rad] and [rad]/[s]."""
SHARE = 0.9
"""Of what errors may be, how large they are."""
BALL_ERROR = 1e-3
"""Of samples of balls, in [m] and [m]/[s]."""
JERK_SLACK = 1.02
JUMP = 3e-3
"""In which the greatest jerk makes what a command may differ by from the one before, in [s]: a
motion along a path is no cubic, as what is between the samples of a command is."""
OVER = 5
"""So many steps of the truth a jerk is looked at, so that rounding does not count."""
SHORTEST = 1e-3
"""A jerk lasts so long at least, in [s]: at the end of a path that is hardly one, such as one back
to where the arm was pushed from by a micrometre, the acceleration jumps a little."""
WITHIN = 1.0 - 1e-6
"""Of their bounds, what attackers use."""


@functools.cache
def load_panda():
    robot = Robot.load("panda")
    skeleton = make_skeleton(robot)
    return robot, skeleton, make_room(skeleton)


@kernel
def find_gap(arm, room, q, places, radius):
    """Least distance of the arm's surface from balls, in [m]."""
    rotations, origins, centers = room
    place_leaves(arm, q, rotations, origins, centers)
    least = np.inf
    for ball in range(places.shape[0]):
        x, y, z = places[ball]
        for leaf in range(centers.shape[0]):
            a, b, c = centers[leaf, 0] - x, centers[leaf, 1] - y, centers[leaf, 2] - z
            if np.sqrt(a * a + b * b + c * c) - radius - arm.radius[leaf] > least:
                continue
            for index in range(arm.first[leaf], arm.first[leaf + 1]):
                a, b, c = get_point(arm, rotations, origins, leaf, index)
                a, b, c = a - x, b - y, c - z
                least = min(least, np.sqrt(a * a + b * b + c * c) - radius)
    return least


@kernel
def find_attack(arm, room, q, t, place, velocity, radius, accel, top):
    """How far a ball gets towards the nearest point of an arm at a time, of the way that is left.

    It accelerates towards where the point will be, from where it would be by itself, and goes on as
    fast as it may. 1 or more: it touches the arm.
    """
    rotations, origins, centers = room
    place_leaves(arm, q, rotations, origins, centers)
    x, y, z = place + velocity * t
    most = 0.0
    for leaf in range(centers.shape[0]):
        a, b, c = centers[leaf, 0] - x, centers[leaf, 1] - y, centers[leaf, 2] - z
        if np.sqrt(a * a + b * b + c * c) - radius - arm.radius[leaf] > accel * t * t:
            continue
        for index in range(arm.first[leaf], arm.first[leaf + 1]):
            a, b, c = get_point(arm, rotations, origins, leaf, index)
            a, b, c = a - x, b - y, c - z
            away = np.sqrt(a * a + b * b + c * c)
            left = away - radius
            if left <= 0.0:
                return np.inf
            along = (velocity[0] * a + velocity[1] * b + velocity[2] * c) / away
            aside = max((velocity * velocity).sum() - along * along, 0.0)
            until = max(np.sqrt(max(top * top - aside, 0.0)) - along, 0.0) / accel
            ramp = min(t, until)
            most = max(most, accel * ramp * (0.5 * ramp + t - ramp) / left)
    return most


class Wish(NamedTuple):
    """What is asked of a step."""

    velocity: object = None
    chunk: object = None


class State(NamedTuple):
    """Of the arm, at a time in [s]. Shape (7,) each."""

    time: float
    q: np.ndarray
    v: np.ndarray


class RandomShield:
    """A shield, its arm and what is beside it, and what must hold.

    - A command that moves is what the monitor has proved last, and is proved still, or its arm is
      told to brake.
    - No ball that moves within its bounds touches the arm while it moves, wherever on its surface,
      and none could by going straight for a place that the command leads to.
    - A monitor that is made for it alone, and knows only what was seen last, proves it as well.
    - Its samples keep the limits of position, velocity, acceleration and jerk. So does what the arm
      follows, every two milliseconds, also where one command replaces another.
    - It goes on from the one before without a jump, also where the arm has come to rest.
    - Where the caller is silent until its end, the arm rests there, and goes on from there.

    Args:
        seed: Of all that is random.

    Attributes:
        counts: Of what happened.
        closest: How near an attack came to touch, of 1.
        widest: By how much positions, velocities and accelerations differed where one command
            replaced another, of what is allowed (`JUMP`).
        hardest: Greatest jerk that was followed, of its limit.
    """

    def __init__(self, seed: int) -> None:
        self._random = random = np.random.default_rng(seed)
        robot, self._skeleton, self._room = load_panda()
        self._robot = robot
        rate = float(random.choice([100.0, 250.0]))
        self.period = 1.0 / rate
        speed, accel = random.uniform(0.15, 0.6), random.uniform(0.1, 0.5)
        limits = OperatingLimits.fraction(robot, velocity=speed, acceleration=accel)
        self._settings = {
            "rate": rate,
            "motion": "planned",
            "operating": None if random.random() < 0.1 else limits,
            "reaction_time": float(random.choice([0.02, 0.1])),
            "latency": float(random.choice([0.002, 0.9 * self.period])),
            "joint_timeout": float(random.choice([0.1, 1.0])),
            "leave": str(random.choice(["never", "any"], p=[0.8, 0.2])),
        }
        self.obstacles = Obstacles(sources=["camera"])
        payload = float(random.choice([0.0, 0.5, 1.0]))
        self.monitor = Monitor(robot, self.obstacles, payload=payload, **self._settings)
        self.shield = Shield(
            self.monitor,
            jerk=float(np.exp(random.uniform(np.log(50.0), np.log(1000.0)))),
            rate=rate,
            look_ahead=float(random.uniform(1e-3, 0.1)),
            chunk_period=random.choice([None, 0.02, 0.04]),
            tracking_error=ERRORS[0],
            velocity_tracking_error=ERRORS[1],
        )
        self._note_commits()
        self.counts: Counter[str] = Counter()
        self.closest = 0.0
        self.widest = np.zeros(3)
        self.hardest = 0.0
        self.balls = [Ball(random) for _ in range(random.integers(1, 4))]
        for ball in self.balls:
            ball.place = ball.place * random.choice([1.0, random.uniform(2.0, 6.0)])
        self._seen: list[tuple[float, np.ndarray, np.ndarray]] = []
        # Whether the last sample of a ball was a lie that nobody can know for one.
        self._is_misled = False
        self.now = 0.0
        self.q, self.v = HOME.copy(), np.zeros(7)
        self._was: deque[State] = deque([State(0.0, self.q, self.v)], maxlen=150)
        self._followed: deque[tuple[np.ndarray, ...]] = deque(maxlen=OVER + 1)
        self._command: Command | None = None
        # Whether the arm is where it is, and not where its command has it.
        self._is_elsewhere, self._brakes_itself, self._is_latched = True, False, False
        self._off, self._off_to = np.zeros(7), np.zeros(7)
        self._wish = Wish()
        self._blind = self._silent = 0
        self._has_told = False
        self._last_seen: tuple[float, np.ndarray, np.ndarray] | None = None
        self._asked = 0.0
        self._change_wish()

    def run(self, steps: int) -> None:
        """Take so many steps."""
        for _ in range(steps):
            self._see()
            if self._silent > 0:
                self._silent -= 1
            else:
                self._ask()
            self._move()

    def _note_commits(self) -> None:
        fastest = self.monitor.fastest
        self._committed: Plan | None = None

        def note(candidates):
            shown = []

            def show():
                for one in candidates:
                    shown.append(one)
                    yield one

            choice = fastest(show())
            if choice.number is not None:
                self._committed = shown[choice.number]
            return choice

        self.monitor.fastest = note

    def _see(self) -> None:
        """Tell of the balls, or not; at times what is late, or wrong."""
        random = self._random
        places = np.array([ball.place for ball in self.balls])
        velocities = np.array([ball.velocity for ball in self.balls])
        self._seen = [*self._seen[-3:], (self.now, places, velocities)]
        if self._blind > 0:
            self._blind -= 1
            return
        chance = random.random()
        if chance < 0.005:
            self._blind = int(random.integers(1, 80))
        late = random.integers(len(self._seen)) if chance < 0.1 else len(self._seen) - 1
        stamp, places, velocities = self._seen[late]
        noise = random.uniform(-1.0, 1.0, (2, *places.shape)) * BALL_ERROR / np.sqrt(3.0)
        places, velocities = places + noise[0], velocities + noise[1]
        if chance > 0.997:
            places[0] += random.uniform(-2.0, 2.0, 3)
            self._is_misled = True
        elif late == len(self._seen) - 1 and not np.abs(self.v).max() > 1e-12:
            self._is_misled = False
        if 0.1 < chance < 0.102:
            places[0] = np.nan
        elif self._last_seen is None or stamp >= self._last_seen[0]:
            self._last_seen = stamp, places, velocities
        self._tell(self.obstacles, stamp, places, velocities)

    def _tell(self, obstacles, stamp, places, velocities) -> None:
        obstacles.update(
            [f"ball{k}" for k in range(len(places))], stamp, places, velocities, radius=RADIUS,
            accel=ACCEL, speed=SPEED, position_error=BALL_ERROR, velocity_error=BALL_ERROR,
            source="camera",
        )  # fmt: skip

    def _ask(self) -> None:
        """One step of the shield, and a look at its command."""
        random = self._random
        if random.random() < 0.02:
            self._change_wish()
        if random.random() < 0.02:
            self._silent = int(random.choice([1, 3, 20, 60]))
        if random.random() < 0.002:
            self.monitor.payload = float(random.choice([0.0, 0.5, 1.0]))
        rests = not np.abs(self.v).max() > 1e-12
        if rests and random.random() < (0.5 if self._is_latched else 0.002):
            self.shield.reset()
            self._is_elsewhere, self._has_told = True, False
            self.counts["resets"] += 1
        now = self.now
        if random.random() < 0.001:
            now = random.choice([np.nan, np.inf, -np.inf, None, "noon"])
            if self._has_told and random.random() < 0.3:
                # After a reset, no time is too early.
                now = self._asked - random.choice([1.0, 1e-9])
        stamp, q, v = self._measure()
        command = self.shield.step(now, q, v, stamp, **self._wish._asdict())
        if self._wish.chunk is not None:
            self._wish = Wish()
        reasons = command.verdict.reasons
        self._is_latched = any(one.kind.effect is Effect.LATCHED for one in reasons)
        self.counts.update(steps=1, moving=command.moving, latched=self._is_latched)
        if now is not self.now:
            self.counts["at no time"] += 1
            assert not command.is_new, "new, but at no time"
        self._asked = self.now
        self._take(command, stamp, q, v)

    def _measure(self) -> tuple[object, np.ndarray, np.ndarray]:
        """What is said of the arm, and of when: at times late, or nonsense."""
        random, robot, chance = self._random, self._robot, self._random.random()
        late = 0
        if chance > 0.95:
            late = int(random.choice([1, 3, 10, 149], p=[0.45, 0.45, 0.09, 0.01]))
        state = self._was[-1 - min(late, len(self._was) - 1)]
        noise = random.uniform(-1.0, 1.0, (2, 7))
        q = state.q + noise[0] * robot.position_error
        v = state.v + noise[1] * robot.velocity_error
        if chance < 0.001:
            junk = [np.full(7, np.nan), np.zeros(3), "no", None]
            return state.time, junk[random.integers(4)], v
        if chance < 0.002:
            v[random.integers(7)] = random.choice([np.nan, np.inf, 1e3])
        elif chance < 0.0025:
            return random.choice([np.nan, np.inf, "noon", self.now + 1.0, -1e9]), q, v
        elif chance < 0.003 and self._has_told:
            # Nobody can tell that the first state is so far off.
            q = q + 1.0
        else:
            self._has_told = True
        return state.time, q, v

    def _take(self, command: Command, stamp, q, v) -> None:
        """Look at a command, and follow it."""
        random, before = self._random, self._command
        if command.moving:
            self._check_proved(command)
        if command.stop == BRAKE:
            self.counts["told to brake"] += 1
            self._is_elsewhere = True
            if not command.is_new and before is not None:
                self._brakes_itself |= bool(random.random() < 0.02)
        elif command.moving and not command.is_new:
            assert command.verdict.proved_until is not None, "moves on what is not proved"
        if command.is_new:
            self._check_new(command, None if self._is_elsewhere else before, stamp, q, v)
            if self._is_elsewhere:
                start = command.at(self.now)[0]
                self._off = self.q - start
                # It is taken to be where it was measured, or where it was led to.
                assert (np.abs(self._off) <= ERRORS[0] + 2.0 * self._robot.position_error).all()
                self._followed.clear()
            self._command, self._is_elsewhere, self._brakes_itself = command, False, False
        elif before is not None and len(command.times) and not self._is_elsewhere:
            assert np.array_equal(command.times, before.times), "another, but not new"
            assert np.array_equal(command.q, before.q), "another, but not new"

    def _change_wish(self) -> None:
        """Ask for something else."""
        random, kind = self._random, self._random.integers(9)
        if kind < 3:
            start = self.q if self._command is None else self._command.q[-1]
            paths = []
            for _ in range(random.integers(1, 3)):
                spread = random.choice([0.1, 0.5, 3.0], p=[0.4, 0.55, 0.05])
                places = HOME + random.uniform(-spread, spread, (random.integers(1, 5), 7))
                begin = start if random.random() < 0.8 else start + random.uniform(-0.1, 0.1, 7)
                paths.append(Path(np.concatenate([[begin], places])))
            self.shield.set_path(paths)
            self._wish = Wish()
        elif kind < 5:
            spread = random.choice([0.2, 1.0, 5.0])
            self._wish = Wish(velocity=random.uniform(-spread, spread, 7))
        elif kind == 5:
            self._wish = Wish()
        elif kind < 8:
            step = random.choice([0.001, 0.01, 0.2])
            moves = np.cumsum(random.uniform(-step, step, (random.integers(1, 30), 7)), axis=0)
            self._wish = Wish(chunk=self.q + moves)
        else:
            junk = [np.full(7, np.nan), "no", np.zeros(3), [np.inf] * 7, np.full((2, 7), np.nan)]
            thing = junk[random.integers(len(junk))]
            self._wish = Wish(velocity=thing) if random.random() < 0.5 else Wish(chunk=thing)

    def _check_proved(self, command: Command) -> None:
        """That it is what the monitor has said yes to last."""
        plan = self._committed
        assert plan is not None
        assert np.allclose(command.times, plan.stamp + plan.times, rtol=0.0, atol=1e-9)
        assert np.array_equal(command.q, plan.q)
        assert np.array_equal(command.v, plan.v)

    def _check_new(self, command: Command, before: Command | None, stamp, q, v) -> None:
        """All that must hold of a command when it is given."""
        self.counts["new"] += 1
        self._check_proved(command)
        self._check_limits(command)
        if before is not None:
            self._check_going_on(before, command)
        if self._is_misled:
            return
        for time, place in zip(command.times, command.q, strict=True):
            if not self.now < time < command.times[-1]:
                continue
            for ball in self.balls:
                found = find_attack(
                    self._skeleton, self._room, place, time - self.now, ball.place, ball.velocity,
                    RADIUS, WITHIN * ACCEL, WITHIN * SPEED,
                )  # fmt: skip
                self.closest = max(self.closest, found)
                assert found < 1.0, f"touched {time - self.now:.3f} s later"
        if self._random.random() < 0.02:
            self._check_by_another(self._committed, stamp, q, v)

    def _check_limits(self, command: Command) -> None:
        limits, robot = self.shield.limits, self._robot
        times, q, v, a = command.times, command.q, command.v, command.a
        assert (q >= robot.lower_position_limit - 1e-9).all()
        assert (q <= robot.upper_position_limit + 1e-9).all()
        assert not v[-1].any()
        assert not a[-1].any()
        assert (np.abs(v) <= limits.velocity + 1e-6).all()
        self._check_accelerations(v, a)
        lasting = np.diff(times)
        assert (lasting > 0.0).all()
        jerk = np.diff(a, axis=0) / np.maximum(lasting, SHORTEST)[:, None]
        assert (np.abs(jerk) <= JERK_SLACK * limits.jerk).all(), (np.abs(jerk) / limits.jerk).max()

    def _check_accelerations(self, v, a) -> None:
        speeding = self.shield.limits.acceleration
        most = np.where(v * a > 0.0, speeding, np.maximum(speeding, self.shield.limits.braking))
        assert (np.abs(a) <= most + 1e-3).all(), (np.abs(a) / most).max()

    def _check_going_on(self, before: Command, command: Command) -> None:
        """That it is the one before until it can be taken up, and goes on from there."""
        latency = self.monitor.settings.latency
        # A path that begins so near to where the arm rests begins there.
        near = SAME_PLACE, 2.0 * SAME_PLACE / latency, 0.0
        for time in np.linspace(self.now, self.now + latency, 4):
            old, new = before.at(time), command.at(time)
            for k, most in enumerate((JUMP**3 / 6.0, JUMP**2 / 2.0, JUMP)):
                jumps = np.abs(new[k] - old[k]) / (most * self.shield.limits.jerk + near[k])
                self.widest[k] = max(self.widest[k], jumps.max())
                assert jumps.max() <= 1.0, f"jumps in derivative {k}, {jumps.max():.3f}"
        if before.valid_until <= self.now:
            assert np.abs(command.at(self.now)[0] - before.q[-1]).max() <= 1e-12
            self.counts["resumed"] += 1

    def _check_by_another(self, plan: Plan, stamp, q, v) -> None:
        """That a monitor proves it that knows nothing but what was seen last."""
        obstacles = Obstacles(sources=["camera"])
        assert self._last_seen is not None
        self._tell(obstacles, *self._last_seen)
        other = Monitor(self._robot, obstacles, payload=self.monitor.payload, **self._settings)
        other.step(stamp, q, v, self.now)
        answer = other.commit(plan)
        self.counts["looked at again"] += 1
        # One that has proved nothing yet stops by itself where a sample is old, or an arm fast.
        assert answer.safe or answer.reasons[0].subject == "last step", answer.reasons

    def _move(self) -> None:
        """Arm and balls go on by a period."""
        random, command = self._random, self._command
        if random.random() < 0.1:
            self._off_to = random.uniform(-1.0, 1.0, 7) * SHARE * ERRORS[0]
        for _ in range(round(self.period / STEP)):
            self.now += STEP
            if self._brakes_itself:
                slower = np.maximum(np.abs(self.v) - STEP * self.shield.limits.braking, 0.0)
                slower *= np.sign(self.v)
                self.q, self.v = self.q + 0.5 * STEP * (self.v + slower), slower
                self._followed.clear()
            elif command is None or (self._is_elsewhere and self.now > command.valid_until):
                self.v = np.zeros(7)
            else:
                self._follow(command)
            self._was.append(State(self.now, self.q, self.v))
            moves = np.abs(self.v).max() > 1e-9 and not self._brakes_itself
            for ball in self.balls:
                ball.move(self._room[2][-1], STEP)
            places = np.array([ball.place for ball in self.balls])
            gap = find_gap(self._skeleton, self._room, self.q, places, RADIUS)
            assert gap > 0.0 or not moves or self._is_misled, "touched"
            self.counts["touched at rest"] += bool(gap <= 0.0)

    def _follow(self, command: Command) -> None:
        """Go where the command is now, and off it as far as is allowed for."""
        q, v, a = command.at(self.now)
        self._followed.append((q, v, a))
        off = np.zeros(7)
        if self.now < command.valid_until:
            most = STEP * SHARE * ERRORS[1]
            off = np.clip(self._off_to - self._off, -most, most)
        else:
            assert np.array_equal(q, command.q[-1])
            assert not v.any(), "moves after its end"
            assert not a.any()
            self.counts["rested"] += 1
        self._off = self._off + off
        self.q, self.v = q + self._off, v + off / STEP
        limits = self.shield.limits
        if len(self._followed) < 2:
            return
        last_q, last_v, _ = self._followed[-2]
        assert (np.abs(v) <= limits.velocity + 1e-6).all()
        self._check_accelerations(v, a)
        most = (STEP**3 / 12.0 + JUMP**3 / 6.0) * limits.jerk
        assert (np.abs(q - last_q - 0.5 * STEP * (v + last_v)) <= most).all(), "jumps"
        assert (
            np.abs(v - last_v) <= STEP * np.maximum(limits.acceleration, limits.braking) + 1e-5
        ).all()
        if len(self._followed) > OVER:
            jerk = np.abs(a - self._followed[0][2]) / (OVER * STEP)
            self.hardest = max(self.hardest, (jerk / limits.jerk).max())
            assert (jerk <= JERK_SLACK * limits.jerk).all(), (jerk / limits.jerk).max()
