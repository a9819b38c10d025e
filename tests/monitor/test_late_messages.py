"""Messages that come late, twice, in another order or after a removal, and what verdicts say.

One simple model of what is known stands beside the monitor: of each obstacle the newest sample that
was told and not removed since. Bodies follow true paths within their bounds; no verdict may promise
more time than a known body truly takes to touch the arm.
"""

import math

import coal
import numpy as np
import pinocchio
import pytest

from armguard.bounds.planned.plan import Plan
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot import Robot
from armguard.verdict import Effect, Level, ReasonKind
from support import true_arm
from support.panda_monitor import FAR, HOME, STILL, kinds, make_monitor, panda, see, subjects

PERIOD = 0.01
TICKS = 500
BODIES = 4
ACCEL, SPEED = 10.0, 2.0
FINE = 2e-3
"""Between two instants at which the truth is looked at, [s]."""


@pytest.mark.hazard("H-01")
def test_a_flush_of_late_messages_promises_nothing():
    """The radius is told to be 0.8 m; five messages under way since before say 0.05 m."""
    promised = []
    for late in (False, True):
        obstacles, monitor = make_monitor("full")

        def tell(stamp, radius, obstacles=obstacles):
            position, velocity = [2.4 - 1.5 * stamp, 0.0, 0.6], [[-1.5, 0.0, 0.0]]
            see(obstacles, stamp, position, velocity=velocity, radius=radius, accel=0.0)

        for tick in range(42):
            tell(0.01 * tick, 0.05)
            monitor.step(0.01 * tick, HOME, STILL)
        tell(0.49, 0.8)
        monitor.step(0.45, HOME, STILL, 0.49)
        for stamp in (0.431, 0.441, 0.451, 0.461, 0.471) if late else ():
            tell(stamp, 0.05)
        after = monitor.step(0.491, HOME, STILL)
        promised.append(after.contact_time)
        assert ReasonKind.OBSTACLE_REFUSED not in kinds(after)
        assert obstacles.late_count == (5 if late else 0)
    assert promised[0] == promised[1]


@pytest.mark.parametrize("rate", [100, 500])
def test_jitter_stops_nobody(rate):
    """A source whose messages are under way for up to 100 ms, in any order."""
    random = np.random.default_rng(rate)
    obstacles, monitor = make_monitor(rate=500.0)
    times = np.arange(0.0, 6.0, 1.0 / rate)
    arrival = times + random.uniform(0.0, 0.1, len(times))
    order = np.argsort(arrival)
    told = 0
    for tick in range(3000):
        now = 0.002 * tick
        while told < len(order) and arrival[order[told]] <= now:
            time = times[order[told]]
            x, v = 4.0 + 0.275 * math.sin(6.0 * time), 1.65 * math.cos(6.0 * time)
            see(obstacles, time, [x, 0.0, 0.6], velocity=[[v, 0.0, 0.0]])
            told += 1
        verdict = monitor.step(now, HOME, STILL)
        if tick > 250:
            assert verdict.level > Level.STOP, verdict.reasons
    assert (monitor.faults, obstacles.late_count > 100) == (0, True)


def test_a_source_that_names_a_static_makes_a_body_of_its_own():
    obstacles, monitor = make_monitor()
    obstacles.add_static("table", [0.0, 0.0, -3.0], 0.1)
    see(obstacles, 0.0, FAR, ids=["table"])
    first = monitor.step(0.0, HOME, STILL)
    assert kinds(first) == {ReasonKind.ID_SHARED}
    assert first.level is Level.CLEAR
    see(obstacles, 0.001, [0.7, 0.0, 0.6], ids=["table"], source="other")
    assert monitor.step(0.001, HOME, STILL).level is Level.STOP
    obstacles.remove(["table"], 0.002, source="other")
    verdicts = [monitor.step(0.002 + 0.001 * k, HOME, STILL) for k in range(150)]
    assert verdicts[-1].contact_time > 1.0
    assert len(obstacles) == 2


@pytest.mark.hazard("H-05")
@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"position": [[3000.0, 0.0, 600.0]]}, "position is 3000.0"),
        ({"speed": 2000.0}, "speed is 2000.0"),
        ({"accel": 9810.0}, "accel is 9810.0"),
    ],
)
def test_obstacles_in_millimetres_are_a_stop_that_says_so(change, field):
    obstacles, monitor = make_monitor()
    told = {"position": [FAR], "radius": 0.1} | change
    for tick in range(20):
        obstacles.update(["ball"], 0.001 * tick, **told)
        verdict = monitor.step(0.001 * tick, HOME, STILL)
        assert verdict.level is Level.STOP
        assert verdict.contact_time == 0.0
        (reason,) = [r for r in verdict.reasons if r.kind is ReasonKind.OBSTACLE_REFUSED]
        assert field in str(reason)


def test_no_source_at_all_is_a_stop_until_one_speaks_or_none_is_said_to_come():
    obstacles, monitor = make_monitor(obstacles=Obstacles())
    obstacles.add_static("table", [0.0, 0.0, -3.0], 0.1)
    for tick in range(400):
        verdict = monitor.step(0.001 * tick, HOME, STILL)
        assert (verdict.level, kinds(verdict)) == (Level.STOP, {ReasonKind.NO_SOURCES})
    assert "sources=[]" in str(verdict.reasons[0])
    levels = []
    for tick in range(400, 1000):
        see(obstacles, 0.001 * tick, FAR)
        levels.append(monitor.step(0.001 * tick, HOME, STILL).level)
    assert levels[0] is Level.STOP
    assert levels[-1] is Level.CLEAR
    _, monitor = make_monitor()
    verdict = monitor.step(0.0, HOME, STILL)
    assert (verdict.level, kinds(verdict)) == (Level.CLEAR, {ReasonKind.NO_SOURCES_EXPECTED})


class Body:
    """A ball that truly moves within its bounds, and grows now and then."""

    def __init__(self, random, surface):
        count = round((PERIOD * TICKS + 1.5) / FINE)
        side = random.normal(size=3)
        x = 2.5 * side / np.linalg.norm(side)
        v = np.zeros(3)
        self.x, self.v = np.empty((count, 3)), np.empty((count, 3))
        self.radius = np.full(count, 0.05)
        push = np.zeros(3)
        for k in range(count):
            self.x[k], self.v[k] = x, v
            if k % 50 == 0:
                home = np.array([0.0, 0.0, 0.5]) + random.normal(scale=0.5, size=3)
                push = (home - x) * random.uniform(0.0, 4.0) - v * random.uniform(0.0, 2.0)
                push *= min(1.0, 0.99 * ACCEL / np.linalg.norm(push))
            after = v + push * FINE
            if np.linalg.norm(after) > 0.99 * SPEED:
                push = np.zeros(3)
            x, v = x + v * FINE + push * FINE**2 / 2, v + push * FINE
        self.radius[count // 3 :] += random.uniform(0.0, 0.2)
        self.distance = np.min([np.linalg.norm(self.x - point, axis=1) for point in surface], 0)

    def sample(self, stamp):
        k = round(stamp / FINE)
        return self.x[k], self.v[k], self.radius[k]

    def first_contact(self, now, radius):
        """When it truly touches the arm, from `now` on, in [s]; inf if never."""
        near = self.distance[round(now / FINE) :] <= radius
        return now + FINE * np.argmax(near) if near.any() else math.inf


def place_surface(robot):
    """Points of the true surface of the resting arm; its cover's spheres may stand out of it."""
    arm = true_arm.make_skeleton(robot)
    data = robot.model.createData()
    pinocchio.forwardKinematics(robot.model, data, HOME)
    joints = np.repeat(arm.joint, np.diff(arm.first))
    return np.array(
        [
            data.oMi[int(joint) + 1].act(point)
            for joint, point in zip(joints, arm.points, strict=True)
        ]
    )


class Known:
    """What is known, and nothing else: the newest sample of each obstacle, unless removed since."""

    def __init__(self):
        self.told = {}
        self.removed = {}

    def tell(self, name, stamp, radius):
        if stamp < self.removed.get(name, -math.inf):
            return
        before = self.told.get(name)
        if before is None or stamp > before[0]:
            self.told[name] = stamp, radius
        elif stamp == before[0]:
            self.told[name] = stamp, max(radius, before[1])

    def remove(self, name, stamp):
        if name in self.told and not stamp >= self.told[name][0]:
            return
        self.told.pop(name, None)
        self.removed[name] = max(stamp, self.removed.get(name, -math.inf))


@pytest.mark.parametrize("seed", range(6))
def test_any_interleaving_of_messages_agrees_with_what_is_known(seed):
    random = np.random.default_rng(seed)
    surface = place_surface(panda())
    bodies = {f"body{k}": Body(random, surface) for k in range(BODIES)}
    obstacles, monitor = make_monitor(rate=1.0 / PERIOD, source_timeout=10.0)
    known = Known()
    under_way = []  # (arrival, number, what, stamp, name)
    checked = clear = 0
    for tick in range(TICKS):
        now = PERIOD * tick
        for name in bodies:
            if random.random() < 0.4:
                delay = random.choice([0.0, 0.0, 0.03, 0.15]) * random.random()
                under_way.append((now + delay, random.random(), "update", now, name))
            if random.random() < 0.1:
                # The same once more, later.
                under_way.append(
                    (now + 0.2 * random.random(), random.random(), "update", now, name)
                )
            if random.random() < 0.02:
                under_way.append(
                    (now + 0.1 * random.random(), random.random(), "remove", now, name)
                )
        if random.random() < 0.03:
            under_way.append((now + 0.05, random.random(), "snapshot", now, ""))
        under_way.sort()
        while under_way and under_way[0][0] <= now:
            _, _, what, stamp, name = under_way.pop(0)
            if what == "update":
                x, v, radius = bodies[name].sample(stamp)
                see(obstacles, stamp, x, ids=[name], velocity=[v], radius=radius)
                known.tell(name, stamp, radius)
            elif what == "remove":
                obstacles.remove([name], stamp, source="default")
                known.remove(name, stamp)
            else:
                late = obstacles.table.stamp[obstacles.table.alive].max(initial=-math.inf) > stamp
                if not late:
                    obstacles.update([], stamp, snapshot=True)
                    for gone in list(known.told):
                        known.remove(gone, stamp)
        if random.random() < 0.005:
            monitor.reset()
        verdict = monitor.step(now, HOME, STILL)
        rows = {name: obstacles.row(name) for name in bodies}
        assert {name for name, row in rows.items() if row >= 0} == set(known.told)
        for name, (stamp, radius) in known.told.items():
            assert obstacles.table.stamp[rows[name]] == stamp
            assert obstacles.table.radius[rows[name]] == radius
            assert not obstacles.table.refused[rows[name]]
            touch = bodies[name].first_contact(now, radius)
            assert now + verdict.contact_time <= touch + FINE, name
            checked += 1
            clear += touch - now < 0.3
        assert not subjects(verdict, ReasonKind.OBSTACLE_REFUSED)
        assert not subjects(verdict, ReasonKind.BOUND_BROKEN)
    assert checked > TICKS
    assert clear > 20


@pytest.mark.parametrize("seed", range(3))
def test_a_plan_is_safe_only_by_what_the_last_step_knew(seed):
    """Messages, silences, tools and commits in any order; each plan is to stay where the arm is."""
    random = np.random.default_rng(100 + seed)
    robot = Robot.load("panda")
    obstacles = Obstacles(sources=["steady", "fickle"])
    monitor = Monitor(robot, obstacles, rate=1.0 / PERIOD, motion="planned")
    error = np.full(7, 1e-3)
    known, attached, quiet_until = {"steady": 0, "fickle": 0}, False, 0.0
    safe = refused = 0
    for tick in range(400):
        now = PERIOD * tick
        if random.random() < 0.02:
            quiet_until = now + random.uniform(0.1, 0.5)
        for source in known:
            if source == "steady" or now >= quiet_until:
                ids = [f"{source}{k}" for k in range(known[source])]
                see(obstacles, now, [FAR] * len(ids), ids=ids, source=source)
        verdict = monitor.step(now, HOME, STILL)
        stepped = robot.revision, len(obstacles)
        action = random.choice(["nothing", "nothing", "nothing", "new", "gone", "tool", "late"])
        source = str(random.choice(list(known)))
        if action == "new":
            see(obstacles, now, FAR, ids=[f"{source}{known[source]}"], source=source)
            known[source] += 1
        elif action == "gone" and known[source]:
            known[source] -= 1
            obstacles.remove([f"{source}{known[source]}"], source=source)
        elif action == "tool" and random.random() < 0.2:
            if attached:
                robot.detach("ball")
            else:
                ball = pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, 0.2]))
                robot.attach("ball", "panda_hand", coal.Sphere(0.05), ball)
            attached = not attached
        elif action == "late" and known[source]:
            see(obstacles, now - 0.005, FAR, ids=[f"{source}0"], source=source)
        times, stay = np.array([0.0, 0.1]), np.array([HOME, HOME])
        answer = monitor.commit(Plan(now, times, stay, np.zeros((2, 7)), error, error))
        standing = [one for one in verdict.reasons if one.kind.effect is not Effect.NOTE]
        changed = (robot.revision, len(obstacles)) != stepped
        if standing or changed or not verdict.complete:
            assert not answer.safe
            assert answer.reasons
            refused += 1
        else:
            assert answer.safe, answer.reasons
            safe += 1
    assert min(safe, refused) > 30
