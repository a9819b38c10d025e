"""People of tethered parts at war with a monitor that often does not see them.

Each person is a chain of three balls: a shoulder, an elbow and a hand. They keep to their bounds
and to their tethers exactly. A part moves by the acceleration of the one before it and one of its
own, which lets it stop, relatively, within its tether. Elbows and hands are hidden for a while
again and again; they know when, and attack then.

What could truly happen next is tried out as well: a whole person accelerates alike, so that the
offsets between parts change evenly, and the tethers that hold at the end have held all the time.
"""

import numpy as np

from armguard.jit.kernels import kernel
from support import attackers
from support.adversary import Hunt
from support.true_arm import get_point

PARTS = 3
SHORTEST, LONGEST = 0.03, 0.5
"""For how long a part is hidden, in [s]."""


@kernel
def steer_people(arm, balls, lengths, hidden, centers, step, stopped, random):
    """One step of all people, each part within its bounds and its tethers."""
    accel, velocity, want, offset = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    for first in range(0, balls.accel.shape[0], PARTS):
        flees = stopped > balls.shy[first]
        base, base_velocity = np.zeros(3), np.zeros(3)
        before = np.zeros((PARTS, 6))
        before[:] = balls.states[first : first + PARTS]
        for part in range(PARTS):
            b = first + part
            # A third of the bounds for each part, beside what the ones before it do.
            rate, top = balls.accel[b] / PARTS, balls.speed[b] / PARTS
            leaf, _ = attackers.nearest_leaf(arm, centers, before[part, :3], balls.radius[b])
            size = 0.0
            for i in range(3):
                want[i] = centers[leaf, i] - before[part, i]
                size += want[i] ** 2
            size = np.sqrt(size) + 1e-12
            push = -1.0 if flees else 1.0
            if not flees and not hidden[first + PARTS - 1] and random.random() < 0.5:
                push = 0.0
            # Relative to the part before, or to the world.
            pace = 0.0
            for i in range(3):
                offset[i] = before[part, i] - (before[part - 1, i] if part > 0 else 0.0)
                velocity[i] = before[part, 3 + i] - (before[part - 1, 3 + i] if part > 0 else 0.0)
                accel[i] = push * rate * want[i] / size
                pace += (velocity[i] + accel[i] * step) ** 2
            pace = np.sqrt(pace)
            if pace > top:
                for i in range(3):
                    accel[i] = ((velocity[i] + accel[i] * step) * top / pace - velocity[i]) / step
            if part > 0 and not can_stop(offset, velocity, accel, rate, lengths[b], step):
                pace = np.sqrt(velocity[0] ** 2 + velocity[1] ** 2 + velocity[2] ** 2)
                slower = min(rate, pace / step)
                for i in range(3):
                    accel[i] = -slower * velocity[i] / max(pace, 1e-12)
            for i in range(3):
                offset[i] += velocity[i] * step + 0.5 * accel[i] * step * step
                velocity[i] += accel[i] * step
                base[i] += offset[i]
                base_velocity[i] += velocity[i]
                balls.states[b, i], balls.states[b, 3 + i] = base[i], base_velocity[i]


@kernel
def can_stop(offset, velocity, accel, rate, length, step):
    """Whether a part, after a step, still stops within its tether by braking straight on."""
    pace = square = 0.0
    for i in range(3):
        pace += (velocity[i] + accel[i] * step) ** 2
    pace = np.sqrt(pace)
    for i in range(3):
        v = velocity[i] + accel[i] * step
        end = offset[i] + velocity[i] * step + 0.5 * accel[i] * step * step
        end += v * (pace / (2.0 * rate) + step)
        square += end * end
    return square <= (0.999 * length) ** 2


@kernel
def attack_people(arm, balls, lengths, trace, times, count):
    """What the most dangerous part lacks for a contact, in [m], and how many were near.

    All parts of a person accelerate alike, at one rate.
    """
    rotations, origins, centers = trace
    worst, tried = np.inf, 0
    for b in range(balls.accel.shape[0]):
        first = b - b % PARTS
        state, radius, top = balls.states[b], balls.radius[b], balls.speed[b]
        pace = 0.0
        for part in range(first, first + PARTS):
            other = balls.states[part]
            pace = max(pace, np.sqrt(other[3] ** 2 + other[4] ** 2 + other[5] ** 2))
        for k in range(count):
            t = times[k]
            if not stays_tethered(balls.states, lengths, first, t):
                break
            reach = pace * t + 0.5 * max(min(balls.accel[b], (top - pace) / t), 0.0) * t * t
            push = 0.5 * max(min(balls.accel[b], (top - pace) / t), 0.0) * t * t
            place = state[:3] + state[3:] * t
            for leaf in range(arm.joint.shape[0]):
                far = arm.radius[leaf] + radius + reach + min(worst, 1.0)
                square = 0.0
                for i in range(3):
                    square += (centers[k, leaf, i] - state[i]) ** 2
                if square > far * far:
                    continue
                tried += 1
                for index in range(arm.first[leaf], arm.first[leaf + 1]):
                    x, y, z = get_point(arm, rotations[k], origins[k], leaf, index)
                    away = np.sqrt((x - place[0]) ** 2 + (y - place[1]) ** 2 + (z - place[2]) ** 2)
                    worst = min(worst, away - radius - push)
    return worst, tried


@kernel
def stays_tethered(states, lengths, first, t):
    """Whether the parts of a person are within their tethers after a time of like motion."""
    for part in range(first + 1, first + PARTS):
        square = 0.0
        for i in range(3):
            apart = states[part, i] - states[part - 1, i]
            square += (apart + t * (states[part, 3 + i] - states[part - 1, 3 + i])) ** 2
        if square > lengths[part] ** 2:
            return False
    return True


class TetheredHunt(Hunt):
    """One robot, one monitor, and people whose parts are hidden at times.

    Args:
        robot: The arm.
        seed: Of all that happens.
        people: How many there are.
        told: By which factor the lengths of tethers are told; None: none is.
        hides: Whether parts are hidden at times.
        settings: As for `Hunt`.
    """

    def __init__(self, robot, seed, people=4, *, told=1.0, hides=True, **settings):
        self.told, self.hides = told, hides
        self.used = 0
        """Ticks times parts that were judged by a partner's state."""
        super().__init__(robot, seed, PARTS * people, PARTS * people, static=0.0, **settings)

    def begin(self):
        """A new truth."""
        for tether in self.obstacles.tethers:
            self.obstacles.untether(tether.a, tether.b)
        super().begin()
        random, balls, n = self.random, self.balls, self.count
        self.lengths = np.where(np.arange(n) % PARTS, random.uniform(0.15, 0.4, n), 0.0)
        self.hidden_until = np.zeros(n, np.int64)
        for first in range(0, n, PARTS):
            person = slice(first, first + PARTS)
            balls.accel[person] = random.uniform(4.0, 30.0)
            balls.speed[person] = random.uniform(0.8, 3.0)
            balls.shy[person] = balls.shy[first]
            for b in range(first + 1, first + PARTS):
                way = self._directions(1)[0] * self.lengths[b] * random.uniform(0.2, 0.95)
                balls.states[b, :3] = balls.states[b - 1, :3] + way
            # Often seen well and at once, so that the arm goes on near them.
            self.gap[person] = random.choice([1, 4, 10, 33])
            self.delay[person] = random.choice([0, 0, 3, 15])
        if self.told is not None:
            for b in np.flatnonzero(self.lengths):
                length = self.told * self.lengths[b]
                self.obstacles.tether(self.names[b], self.names[b - 1], length, "drawn")

    def speak(self):
        """Messages of this tick; what has been seen may then be hidden for a while."""
        due = self.next <= self.tick
        super().speak()
        for b in np.flatnonzero(due & (self.lengths > 0.0)) if self.hides else ():
            if self.random.random() < 0.05 * min(self.gap[b], 10):
                ticks = int(self.random.uniform(SHORTEST, LONGEST) / self.step)
                self.next[b] += ticks
                self.hidden_until[b] = self.tick + ticks

    def swap_one(self):
        """Nobody leaves."""

    def count_near(self, verdict, late):
        """What could be near is not counted; who is judged by whom is."""
        uses = self.monitor._scheduler.certificates.uses
        self.used += int(np.count_nonzero(uses.partner >= 0) > 0)

    def _attack_all(self, times, count):
        lacks, tried = attack_people(self.arm, self.balls, self.lengths, self.traced, times, count)
        return lacks, tried, 0.0, 0.0

    def _steer(self, looked, until, between):
        hidden = self.hidden_until > self.tick
        steer_people(
            self.arm, self.balls, self.lengths, hidden, self.room[2], self.step, self.stopped,
            self.random,
        )  # fmt: skip
