"""Chooses the cheapest settings whose verdicts in a scene match those of the finest settings.

Every candidate is sound, so the choice is about cost and caution, never about safety: no candidate
leaves out a link, obstacle, source or pair. Each is tried on the same joint states and the same
messages, with its own table. Its verdicts are compared with those of the finest settings, which
evaluate every pair in every tick.

Cost is counted in evaluations, not in time, which differs between machines and runs. So the same
trial gives the same choice.

There is no setting for links that cannot be reached. For each new state of an obstacle, the monitor
first tests the ball that the whole arm cannot leave, then that of each link (`pairs.contact_time`).
A link that is proved out of reach costs two evaluations. A trial reports these links.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError
from armguard.lab.recorded_trial import read_trial
from armguard.lab.tradeoff.scene import Site
from armguard.lab.trial import list_ticks, make_visit
from armguard.monitor.monitor import Monitor
from armguard.monitor.settings import read_settings
from armguard.monitor.trial import Choice, TrialTick
from armguard.obstacles.obstacles import Obstacles
from armguard.pairs.scene import REACH
from armguard.robot.robot import Robot
from armguard.settings.declarations import read_declarations
from armguard.settings.schedule import DEADLINE
from armguard.settings.settings import CHOSEN, Settings
from armguard.verdict import Level

SAME_LEVEL = 0.99
"""Least share of ticks with the same level for verdicts that match."""

SAME_SCALE = 0.01
"""Greatest mean difference of speed scales for verdicts that match."""

AS_NEAR = 0.002
"""If no candidate matches: tolerance within which shares of equal levels count as the same."""

AS_CHEAP = 1.02
"""Factor within which costs count as the same."""

ROOM, LEAST_BUDGET = 4, 5000
"""A budget is this multiple of the evaluations of the most expensive tick, and at least the second
number."""

TRIED = {
    name: declared
    for name in CHOSEN
    if (declared := read_declarations(Settings)[name]).default is not None
}
"""Settings of which every example is tried, one after the other; a budget follows from them."""

LEVEL = "level"
"""Name of an axis beside them: the finest level of the cover that is used."""

FINEST_SCHEDULE = "full"
"""Of the finest: every pair in every tick."""

LOOK = 50
"""Ticks between two looks at which links can be reached."""

MOST_PAIRS = 1 << 16
"""That are looked at."""


class _Rungs(NamedTuple):
    """One candidate."""

    settings: Mapping[str, Any]
    level: int | None = None


class _Outcome(NamedTuple):
    """What a candidate said, tick by tick, and how that compares."""

    rungs: _Rungs
    levels: NDArray[np.int64]
    scales: NDArray[np.float64]
    evaluated: NDArray[np.int64]
    unreached: frozenset[int]
    """Numbers of the links that nothing came within reach of, where that was looked for."""
    same_level: float = 1.0
    scale_difference: float = 0.0

    @property
    def price(self) -> float:
        return float(self.evaluated.mean())

    @property
    def is_same(self) -> bool:
        return self.same_level >= SAME_LEVEL and self.scale_difference <= SAME_SCALE


def choose_settings(
    robot: Robot,
    obstacles: Obstacles,
    trial: Iterable[TrialTick] | str | Path | None = None,
    *,
    keeps_cover: bool = False,
    **given: Any,
) -> Choice:
    """Try settings, and choose the cheapest whose verdicts match those of the finest settings.

    The axes are tried in turn, each with the choices on those before: staleness, level of the
    cover, motion model. Of settings with the same cost, the finer one is chosen. The budget is that
    of the most expensive tick, with a reserve. If no candidate matches the finest settings, the
    nearest is chosen, and a reason says so. If the finest settings give only one level, only STOP
    or only CLEAR, the trial shows nothing, and the defaults are kept.

    Args:
        robot: The arm; it is not changed.
        obstacles: The table, which must have no obstacles except statics; it is not changed.
        trial: The ticks to judge, or the path of a recording, whose part with the most changes of
            level is used. None: a simulated person approaches the working arm.
        keeps_cover: Whether to keep all levels of the robot's cover.
        **given: Settings of the monitor that are not chosen. The finest settings use them too,
            except for a budget.

    Raises:
        ArmguardError: A setting is unusable, the table has obstacles already, or the trial is
            empty, unreadable, or has elements other than `TrialTick`.
    """
    if trial is None or isinstance(trial, str | Path):
        trial = _make_trial(robot, obstacles, trial, given)
    ticks = _list_ticks(trial)
    if not obstacles.is_untouched:
        raise ArmguardError(
            "obstacles",
            "are in the table already",
            expected="only statics: settings are tried from the start",
        )
    schedule = given.get("schedule", DEADLINE)
    if schedule != DEADLINE:
        raise ArmguardError(
            "schedule",
            f"is {schedule!r}" if isinstance(schedule, str) else "is one of the application's own",
            expected=f'"{DEADLINE}" where settings are chosen: it alone has them all',
        )
    # What verdicts carry beside their answer is not compared, and takes time.
    fixed = {**given, "certify": False, "separation": None}
    # What a monitor has that is told nothing; kept where a trial shows nothing.
    usual = {name: one.default for name, one in TRIED.items() if name not in given}
    whole = _Rungs({**usual, "schedule": FINEST_SCHEDULE, "budget": None})
    finest = _run(robot, obstacles, ticks, fixed, whole, looks=True)

    def attempt(rungs: _Rungs) -> _Outcome:
        outcome = _run(robot, obstacles, ticks, fixed, rungs)
        return outcome._replace(
            same_level=float((outcome.levels == finest.levels).mean()),
            scale_difference=float(np.abs(outcome.scales - finest.scales).mean()),
        )

    best = attempt(_Rungs(usual))
    budget, story = None, []
    shows = len(np.unique(finest.levels)) >= 2
    levels = max(robot.cover.levels(link) for link in robot.cover.links)
    coarser = [] if keeps_cover else list(range(levels - 1))[::-1]
    # How stale an answer may look decides about most of the price.
    *others, first = TRIED
    axes = [first, *([LEVEL] if coarser else []), *others]
    if shows:
        for axis in (one for one in axes if one not in given):
            outcomes = [
                best if rungs == best.rungs else attempt(rungs)
                for rungs in _list_candidates(axis, best.rungs, coarser)
            ]
            best = _pick(outcomes)
            story.append(_explain(axis, best, outcomes))
        if "budget" not in given:
            most = int(best.evaluated.max())
            budget = max(LEAST_BUDGET, 1 << max(ROOM * most - 1, 0).bit_length())
            story.append(f"budget {budget}: the dearest tick took {most} evaluations")
    return _conclude(robot, best, finest, given, budget, story, shows=shows)


def _make_trial(
    robot: Robot, obstacles: Obstacles, recording: str | Path | None, given: Mapping[str, Any]
) -> list[TrialTick]:
    rate = read_settings(None, given).rate
    if recording is not None:
        return read_trial(recording, robot, rate)
    site = Site(robot, lambda: copy.deepcopy(obstacles), given, tuple(obstacles.source_names))
    return list_ticks(make_visit(site), rate)


def _list_ticks(trial: Iterable[TrialTick]) -> list[TrialTick]:
    expected = "joint states to try settings on, each a TrialTick; its `tell` a function, or None"
    ticks = list(trial) if isinstance(trial, Iterable) else []
    if not ticks:
        raise ArmguardError("trial", f"has no ticks: {trial!r}", expected=expected)
    for number, tick in enumerate(ticks):
        if not isinstance(tick, TrialTick) or not (tick.tell is None or callable(tick.tell)):
            kind = type(tick).__name__
            raise ArmguardError(f"trial[{number}]", f"is a {kind}", expected=expected)
    return ticks


def _list_candidates(axis: str, best: _Rungs, coarser: Sequence[int]) -> list[_Rungs]:
    """What can be chosen on an axis beside what was chosen before; first what is preferred."""
    if axis == LEVEL:
        return [best, *(best._replace(level=level) for level in coarser)]
    examples = TRIED[axis].examples
    return [best._replace(settings={**best.settings, axis: value}) for value in examples]


def _run(
    robot: Robot,
    obstacles: Obstacles,
    ticks: Sequence[TrialTick],
    fixed: Mapping[str, Any],
    rungs: _Rungs,
    *,
    looks: bool = False,
) -> _Outcome:
    """Lead a monitor of its own through the trial, and look for links that are out of reach."""
    arm = copy.copy(robot)
    if rungs.level is not None:
        arm.cover = robot.cover.cut(rungs.level)
    monitor = Monitor(arm, copy.deepcopy(obstacles), **{**fixed, **rungs.settings})
    said: NDArray[np.float64] = np.zeros((len(ticks), 3))
    unreached = set(range(len(robot.links)))
    aware_margin = monitor.settings.aware_margin
    for number, tick in enumerate(ticks):
        if tick.tell is not None:
            tick.tell(monitor)
        verdict = monitor.step(tick.stamp, tick.q, tick.v, tick.now)
        said[number] = int(verdict.level), verdict.speed_scale, verdict.evaluated
        if looks and number % LOOK == 0:
            near = monitor.snapshot(pair_limit=MOST_PAIRS, row_limit=0)
            is_far = near.pair_bounds == REACH
            is_far &= near.pair_times > verdict.stop_time + aware_margin
            unreached -= set((near.pairs[~is_far] % len(robot.links)).tolist())
    return _Outcome(
        rungs,
        said[:, 0].astype(np.int64),
        said[:, 1],
        said[:, 2].astype(np.int64),
        frozenset(unreached),
    )


def _pick(outcomes: Sequence[_Outcome]) -> _Outcome:
    """The cheapest of those as good as the finest; without any, the cheapest of the nearest."""
    pool = [one for one in outcomes if one.is_same]
    if not pool:
        nearest = max(one.same_level for one in outcomes) - AS_NEAR
        pool = [one for one in outcomes if one.same_level >= nearest]
    least = min(one.price for one in pool)
    return next(one for one in pool if one.price <= AS_CHEAP * least)


def _explain(axis: str, best: _Outcome, outcomes: Sequence[_Outcome]) -> str:
    """What was chosen on one axis, beside what else was tried."""

    def tell(one: _Outcome) -> str:
        value = one.rungs.level if axis == LEVEL else one.rungs.settings[axis]
        name = "all levels of the cover" if value is None else f"{axis} {value}"
        return f"{name}: {one.same_level:.1%} at {one.price:.3g}"

    others = ", ".join(tell(one) for one in outcomes if one is not best)
    return f"{tell(best)} evaluations a tick ({others})"


def _conclude(
    robot: Robot,
    best: _Outcome,
    finest: _Outcome,
    given: Mapping[str, Any],
    budget: int | None,
    story: Sequence[str],
    *,
    shows: bool,
) -> Choice:
    """The record of a choice."""
    settings, level = dict(best.rungs.settings), best.rungs.level
    if "budget" not in given:
        settings["budget"] = budget
    unreached = finest.unreached
    choice = Choice(
        settings,
        level,
        len(best.levels),
        best.same_level,
        best.scale_difference,
        best.price,
        int(best.evaluated.max()),
        finest.price,
        best.is_same,
        tuple(link for number, link in enumerate(robot.links) if number in unreached),
        (),
    )
    names = [f"{name} {value}" for name, value in settings.items() if value is not None]
    names.append("all levels of the cover" if level is None else f"level {level} of the cover")
    kept = [name for name in CHOSEN if name in given]
    stands = f"; {' and '.join(kept)} as given" if kept else ""
    nearness = "cannot be told from" if best.is_same else "is the nearest that was found to"
    levels = " and ".join(Level(one).name for one in np.unique(finest.levels))
    near = (
        f"{nearness} the finest: its level in {best.same_level:.1%} of {choice.ticks:,} ticks of "
        f"{levels}, at "
        f"{choice.price:.1%} of its evaluations ({best.price:.3g} of {finest.price:.4g} a tick)"
    )
    if not shows:
        near = f"what is usual: the trial, of {choice.ticks:,} ticks, is nothing but {levels}"
    links = "all links are watched"
    if unreached:
        links += f"; nothing came within reach of {', '.join(choice.out_of_reach)}"
    return choice._replace(reasons=(f"{', '.join(names)}{stands}", near, links, *story))
