"""A monitor's eventful second: people with glitches, faults of every kind, resets, plans."""

import contextlib

import numpy as np

from armguard import ContactLimit, ContactLimits
from armguard.bounds import Plan
from armguard.exceptions import ArmguardError
from armguard.monitor import Monitor
from armguard.obstacles import Frame, Obstacles, Source
from armguard.pairs import SeparationRule
from armguard.robot import OperatingLimits, Robot
from support.panda_monitor import HOME, STILL

PERIOD = 0.002
TICKS = 1500
NAMES = [f"part{number}" for number in range(6)]
RATE = 1.5
"""Of the arm's swing, in [rad/s]."""

POST_ROOM = [[x, y, z] for x in (-0.1, 0.3) for y in (-1.5, -1.1) for z in (0.0, 0.6)]
"""Corners of a zone around the post."""

MOTIONS = {
    "joint": {"certify": True},
    "isotropic": {"motion": "isotropic", "separation": SeparationRule(human_speed=1.6)},
    "operating": {"operating": "published", "budget": 400, "payload": 0.5},
    "scaled": {"operating": OperatingLimits(velocity=1.5, acceleration=[6.0] * 7)},
    "daa": {"schedule": "daa", "reaction_time": 0.05},
    "full": {"schedule": "full"},
    "touched": {
        "contact_limits": ContactLimits(
            {
                "hand": ContactLimit(speed=0.9, source="assumed"),
                "forearm": ContactLimit(
                    force=160.0, stiffness=4e4, body_mass=2.0, source="assumed"
                ),
            }
        )
    },
    "committed": {"motion": "planned"},
    "left": {"motion": "planned", "leave": "any", "operating": "published"},
}
"""Settings of monitors, by what is particular about them."""


def make_monitor(motion, robot=None):
    """A table with frames, sources and statics, and a monitor on it."""
    robot = Robot.load("panda") if robot is None else robot
    tilt = Frame([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]], [0.1, -0.2, 0.3], 0.004)
    obstacles = Obstacles(
        speed=1.9,
        sources=[Source("camera", timeout=0.3), Source("scanner", required=False)],
        frames={"tilted": tilt},
        bounds=[("part1*", 12.5, 2.5), ("thrown*", np.inf, np.inf)],
        regions={"part[012]": "hand", "part3": "forearm"},
    )
    obstacles.add_static("pillar", [[-1.0, 0.0, 0.0], [-1.0, 0.0, 2.0]], 0.2)
    obstacles.add_static("post", [0.1, -1.3, 0.3], 0.1)
    obstacles.add_entrance("door", [[-2.9, 2.0, 0.0], [-2.9, 2.6, 2.1]], 0.3, 0.07, accel=9.1)
    ignore = [("panda_hand", "pillar"), ("*", "hidden*", "scanner")]
    settings = {"rate": 1.0 / PERIOD, "ignore": ignore, "rise_delay": 0.1, **MOTIONS[motion]}
    return robot, obstacles, Monitor(robot, obstacles, **settings)


def swing(time):
    """Positions and velocities of the arm at a time, in [s]; at rest at 0."""
    size = np.array([0.3, 0.1, 0.2, 0.1, 0.2, 0.1, 0.3])
    return (
        HOME + size * (1.0 - np.cos(RATE * time)),
        size * RATE * np.sin(RATE * time),
    )


def make_plan(now, length=0.3):
    """The swing's next piece, slowed down to rest at its end."""
    times = np.linspace(0.0, length, 31)
    pace = np.where(times < 0.1, 1.0, 1.0 - (times - 0.1) / (length - 0.1))
    clock = now + np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]) * np.diff(times))])
    places = [swing(time) for time in clock]
    q = np.array([place[0] for place in places])
    v = np.array([place[1] for place in places]) * pace[:, None]
    return Plan(now, times, q, v, np.full(7, 0.01), np.full(7, 0.2))


def see_people(obstacles, rng, tick, now):
    """Messages of this tick, with whatever perception gets wrong."""
    if tick % 5 == 0 and not 600 <= tick < 800:  # gone for 0.4 s: silent
        phase = 0.6 * now
        centre = np.array([1.9 + 0.5 * np.cos(phase), 0.4 * np.sin(phase), 0.5])
        speed = np.array([-0.3 * np.sin(phase), 0.24 * np.cos(phase), 0.0])
        offsets = np.linspace([-0.1, -0.2, 0.0], [0.1, 0.2, 0.6], len(NAMES))
        position = centre + offsets + rng.normal(scale=0.001, size=(len(NAMES), 3))
        velocity = np.tile(speed, (len(NAMES), 1))
        if tick % 505 == 500:
            position[2] = np.nan
        if tick % 375 == 370:
            position[3] += 0.5
        if tick % 655 == 650:
            velocity[1, 0] = np.inf
        late = 0.03 if tick % 45 == 0 else 0.001
        obstacles.update(
            NAMES,
            now - late,
            position,
            None if tick % 3 == 0 else velocity,
            radius=np.linspace(0.05, 0.15, len(NAMES)),
            speed=None if tick % 2 else 1.8,
            position_error=0.01,
            velocity_error=0.1,
            source="camera",
            # One is taken for another part from some time on, and one is none.
            region=["hand", "hand", "forearm", "forearm", "", "chest"] if tick > 700 else None,
        )
    if tick % 20 == 0:
        middles = np.array([[[2.0, -1.0, 0.5]], [[-2.0, 1.5, 0.5]]])
        boxes = middles + rng.normal(scale=0.02, size=(2, 8, 3))
        ids = ["cart", "hidden crate"] if tick % 40 else ["cart"]
        obstacles.update(
            ids,
            now,
            boxes[: len(ids)],
            radius=0.02,
            source="scanner",
            frame="tilted",
            snapshot=True,
        )
    if tick % 300 == 250:
        obstacles.update(["thrown 1"], now, [[3.0, 0.0, 1.0]], radius=0.1, source="camera")
        obstacles.remove(["thrown 1", "never seen"], now + 1e-4, "camera")
    if tick % 400 == 390:
        obstacles.remove(["part5"])
    if tick % 350 == 340:
        with contextlib.suppress(ArmguardError):
            obstacles.update(["x", "x"], now, [[0, 0, 9]] * 2, radius=0.1, source="camera")
    if tick % 500 == 333:
        obstacles.take_faults()


def take_step(monitor, tick, now):
    """One step, or what stands in its place; a reset follows what latches."""
    q, v = swing(now)
    if tick == 300:
        verdict = monitor.step(now, q * np.nan, v, now)
    elif tick == 450:
        verdict = monitor.step(now, list(q[:5]), v, now)
    elif tick == 470:
        verdict = monitor.step(now, "nothing", {"v": 1}, now)
    elif tick == 500:
        verdict = monitor.step(now - 0.5, q, v, now - 0.5)
    elif tick == 900:
        verdict = monitor.step(now, q + 0.5, v, now)
    elif tick == 1000:
        verdict = monitor.step(np.float32(now), q, v, np.inf)
    elif tick == 1100:
        verdict = monitor.step(now, q, v + 0.9, now)  # beyond the operating limits
    else:
        verdict = monitor.step(now - 0.0005, q, v, now)
    if tick in (340, 480, 550, 950, 1050, 1150):
        monitor.reset()
    return verdict


def drive(monitor, obstacles, *, ticks=TICKS, seed=0, start=0):
    """Lead a monitor through it; its verdicts and its answers to plans."""
    rng = np.random.default_rng(seed)
    verdicts, answers = [], []
    motion = monitor.settings.motion
    for tick in range(start, start + ticks):
        now = PERIOD * tick
        see_people(obstacles, rng, tick, now)
        if tick in (60, 620, 1200):
            monitor.ignore("panda_hand", "part*", "camera", until=now + 0.5)
            monitor.ignore("*", "post", zone=POST_ROOM)
        if tick in (140, 1250):
            for one in monitor.exemptions[-1:]:
                monitor.watch(one.number)
        verdicts.append(take_step(monitor, tick, now))
        if tick == 700:
            monitor.payload = 0.25
        if motion == "planned" and tick % 40 == 20:
            if tick % 280 == 20 + 240:
                plan = make_plan(now)._replace(q=np.full((31, 7), np.nan))
            elif tick % 360 == 20 + 320:
                plan = "no plan"
            else:
                plan = make_plan(now - 0.0005, 0.3)
            answers.append(monitor.commit(plan))
    return verdicts, answers


def stand(monitor, count, start=0, q=HOME):
    """Steps of an arm at rest."""
    return [monitor.step(PERIOD * tick, q, STILL) for tick in range(start, start + count)]
