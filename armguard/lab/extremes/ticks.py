"""Whole ticks at the extremes, against an adversary."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pinocchio

from armguard.exceptions import ArmguardError
from armguard.lab.extremes.adversary import Adversary, Body
from armguard.lab.extremes.arms import make_arm
from armguard.lab.extremes.report import REFUSED, SOUND, UNSOUND, Line
from armguard.monitor.monitor import Monitor
from armguard.obstacles.obstacles import Obstacles
from armguard.robot.robot import Robot
from armguard.verdict import Effect, ReasonKind, Verdict

TICKS = 12
"""Of a case; the first of them evaluates everything, and is no measure of the price."""

HUNTERS = 3
"""Balls that hunt the arm, of those that are nearest."""


class Case(NamedTuple):
    """An arm, balls, and a monitor."""

    group: str
    name: str
    robot: Callable[[], Robot]
    place: tuple[float, float, float] = (1.3, 0.0, 0.5)
    """Of the first ball, relative to the arm's base, in [m]."""
    balls: int = 1
    """How many; the others are farther away."""
    radius: float = 0.1
    """[m]."""
    accel: float = 10.0
    """[m]/[s²]."""
    speed: float = 2.0
    """[m]/[s]."""
    start: float = 0.0
    """First stamp, in [s]."""
    silence: float = 0.0
    """How long ago the balls were seen last, in [s]."""
    base: float = 0.0
    """Of the arm along x, in [m]."""
    table: Mapping[str, Any] = {}  # nobody writes to it
    """Of `Obstacles`."""
    settings: Mapping[str, Any] = {}  # nobody writes to it
    """Of `Monitor`."""

    def measure(self, seed: int) -> Line:
        """The line of this case."""
        try:
            return _measure(self, seed)
        except ArmguardError as error:
            return Line(self.group, self.name, REFUSED, note=str(error))


def list_cases() -> list[Case]:
    """All of them."""
    panda = _load_panda
    hour = {"source_timeout": 1e4}
    near = (0.6, 0.0, 0.3)
    return [
        *(Case("rate", f"{rate:g} Hz", panda, settings={"rate": rate})
          for rate in (1.0, 10.0, 100.0, 1000.0, 5000.0, 20_000.0)),
        *(Case("obstacles", f"{count:,}", panda, balls=count)
          for count in (0, 1, 100, 1000, 10_000, 100_000)),
        *(Case("radius in a tick", f"{radius:g} m", panda, (1.2 + radius, 0.0, 0.5), radius=radius)
          for radius in (1e-6, 1e-3, 10.0)),
        *(Case("bounds in a tick", f"1e{k} m/s², 1e{k} m/s", panda, accel=10.0**k, speed=10.0**k)
          for k in (-6, -3, 0, 3, 6)),
        Case("bounds in a tick", "none", panda, accel=math.inf, speed=math.inf),
        Case("coordinates", "1e6 m, as tables are", panda, base=1e6),
        Case("coordinates", "1e6 m, extent=2e6", panda, base=1e6, table={"extent": 2e6}),
        Case("stamps", "since 1970", panda, start=1.7e9),
        Case("stamps", "1e12 s", panda, start=1e12),
        Case("age in a tick", "0.1 s", panda, silence=0.1),
        Case("age in a tick", "1 s", panda, silence=1.0),
        Case("age in a tick", "1 s, source_timeout=1e4", panda, silence=1.0, settings=hour),
        Case("age in a tick", "1 h, source_timeout=1e4", panda, silence=3600.0, settings=hour),
        Case("age in a tick", "1 h, of what rests", panda, accel=0.0, speed=0.0, silence=3600.0,
             settings=hour),
        *(Case("spheres a link", f"{edge**3}", functools.partial(make_arm, 2, edge), near)
          for edge in (1, 2, 4, 6, 8)),
        *(Case("joints", f"{count}", functools.partial(make_arm, count),
               near if count < 5 else (1.6, 0.0, 0.5))
          for count in (1, 2, 4, 7, 10, 14)),
    ]  # fmt: skip


@functools.cache
def _load_panda() -> Robot:
    return Robot.load("panda")


def _measure(case: Case, seed: int) -> Line:
    robot, random = case.robot(), np.random.default_rng(seed)
    base = pinocchio.SE3(np.eye(3), np.array([case.base, 0.0, 0.0]))
    obstacles = Obstacles(**case.table)
    monitor = Monitor(robot, obstacles, base_placement=base, **case.settings)
    period, width = monitor.period, len(robot.joints)
    places = _place_balls(case, random)
    ids = [f"ball-{number}" for number in range(case.balls)]
    middle = 0.5 * (
        np.maximum(robot.lower_position_limit, -2.0) + np.minimum(robot.upper_position_limit, 2.0)
    )
    sway, pace = 0.1, 0.5
    spent = []
    verdict: Verdict | None = None
    q = v = np.zeros(width)
    for tick in range(TICKS):
        now = case.start + case.silence + tick * period
        if tick == 0 or not case.silence:
            stamp = now - case.silence
            obstacles.update(
                ids, stamp, places + base.translation, np.zeros(places.shape),
                radius=case.radius, accel=case.accel, speed=case.speed,
            )  # fmt: skip
        phase = pace * tick * period
        q = middle + sway * math.sin(phase)
        v = np.full(width, sway * pace * math.cos(phase))
        begin = time.thread_time_ns()
        verdict = monitor.step(now, q, v)
        spent.append(1e-3 * (time.thread_time_ns() - begin))
    assert verdict is not None
    found = _hunt(case, robot, base, q, v, places)
    is_sound = not verdict.contact_time > found
    tight = verdict.contact_time / found if 0.0 < found < math.inf else math.nan
    standing = [reason for reason in verdict.reasons if reason.kind.effect is not Effect.NOTE]
    note = f"first tick {spent[0]:,.0f} µs" if case.balls > 1 else "against an adversary"
    if not math.isfinite(found):
        note = "no contact within a second" if case.balls else "nothing is there"
    return Line(
        case.group,
        case.name,
        UNSOUND if not is_sound else REFUSED if standing else SOUND,
        tight,
        tight,
        float(np.median(spent[1:])),
        _tell_stop(verdict) if standing else note,
    )


def _tell_stop(verdict: Verdict) -> str:
    """Why it is one, and why rows were refused where they were."""
    kinds = Effect.STANDING, Effect.LATCHED
    reasons = [reason for reason in verdict.reasons if reason.kind.effect in kinds][:1]
    reasons += [one for one in verdict.reasons if one.kind is ReasonKind.OBSTACLE_REFUSED][:1]
    return "STOP: " + "; ".join(map(str, reasons))


def _place_balls(case: Case, random: np.random.Generator) -> Any:
    """Relative to the arm's base, in [m]. Shape (n, 3)."""
    if not case.balls:
        return np.empty((0, 3))
    directions = random.normal(size=(case.balls, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    places = directions * random.uniform(3.0, 50.0, (case.balls, 1))
    places[0] = case.place
    return places


def _hunt(case: Case, robot: Robot, base: pinocchio.SE3, q: Any, v: Any, places: Any) -> float:
    """The first contact that an arm and balls at their worst reach, in [s]."""
    if not (math.isfinite(case.accel) and math.isfinite(case.speed)):
        return 0.0
    adversary = Adversary(robot, base, robot.velocity_limit, robot.acceleration_limit)
    nearest = places[np.argsort(np.linalg.norm(places, axis=1))[:HUNTERS]]
    found = math.inf
    # They may have done anything since they were seen; here they rested.
    for place in nearest:
        body = Body(
            (place + base.translation)[None], np.zeros(3), case.radius, case.accel, case.speed
        )
        found = min(found, adversary.find_contact(q, v, body))
    return found
