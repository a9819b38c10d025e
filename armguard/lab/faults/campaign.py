"""`armguard faults`: injects one fault after the other into a running cell, and judges each.

Each fault begins when the people set out for the arm, in a cell that is sound by its verdicts, and
lasts while they come near. Then it ends, what was killed is started anew, what is latched is reset,
and the next one waits until nothing is wrong any more and the arm moves: up to a generous limit,
however slow the machine is. Whether anybody was touched is judged at the end, of all the time from
the first fault to the last.
"""

from __future__ import annotations

import functools
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.lab.faults.catalogue import Fault
from armguard.lab.faults.nodes import STEP, read_rows
from armguard.lab.faults.outcome import Outcome, find_detection
from armguard.lab.faults.scene import (
    LATENCY,
    ROBOT,
    make_trajectory,
    sample_people,
    sample_pillar,
    visit_period,
)
from armguard.lab.faults.session import FaultyCell
from armguard.lab.faults.truth import Closest, Witness
from armguard.lab.simulation.trajectory import JointTrajectory
from armguard.lab.study_facts import Tell
from armguard.robot.robot import Robot
from armguard.verdict import Effect, ReasonKind

Array = NDArray[np.float64]

SETTING_OUT = 0.15
"""Share of the time between two visits after which a fault begins: the people have set out."""

SOUND_FOR = 0.2
"""A cell is sound that was so for so long, in [s]."""

PATIENCE = 120.0
"""How long a cell may take until nothing is wrong and until the arm moves, in [s]: a slow machine
needs long for a start of the monitor, or to get over a crowd."""

RESET_INTERVAL = 0.2
"""Between two resets of what is latched, in [s]."""

LOOK_INTERVAL = 0.005
"""Between two looks at what was heard, in [s]."""

SIGNS_UNTIL = 2.0
"""After its end, a fault's sign counts for so long, in [s]: lines are written once a second."""


class Trial(NamedTuple):
    """A fault that was made; times of the machine's monotonic clock, in [s]."""

    fault: Fault
    begin: float
    end: float
    sound: float | None
    """When nothing was wrong any more; None: that did not come."""
    resets: int
    foreign: tuple[str, ...] = ()
    """What was latched before them and is no sign of the fault, in words."""
    was_tried: bool = True
    """Whether the fault was made: not where the cell did not get sound, or the arm did not move,
    before."""


class Replayed(NamedTuple):
    """What a replay of one recording proved."""

    name: str
    compared: int
    """Verdicts."""
    identical: bool
    cut_off: bool
    """Whether its writer was killed."""
    lost: int
    """Events that are missing in it."""


class CampaignReport(NamedTuple):
    """What a campaign found."""

    outcomes: list[Outcome]
    replayed: list[Replayed]
    whole: Closest
    """Of the arm that obeys, over the whole campaign."""
    duration: float
    """In [s]."""

    @property
    def passed(self) -> bool:
        """Whether all is as it must be."""
        return (
            any(outcome.was_tried for outcome in self.outcomes)
            and not any(outcome.problem for outcome in self.outcomes)
            and not self.whole.contacts
            and all(one.identical for one in self.replayed)
        )


def run_campaign(faults: Sequence[Fault], tell: Tell = lambda text, share: None) -> CampaignReport:
    """Make faults in a running cell, and judge what came of them.

    Args:
        faults: In their order.
        tell: Is told what is under way, and which share of the faults is done.

    Raises:
        ArmguardError: The cell does not start, or a process ends that no fault ended.
    """
    with tempfile.TemporaryDirectory(prefix="armguard-") as name:
        tell("starting", 0.0)
        robot = Robot.load(ROBOT)
        trajectory = make_trajectory(robot)
        period = visit_period(trajectory)
        with FaultyCell(Path(name)) as cell:
            trials = []
            for done, fault in enumerate(faults):
                tell(f"{fault.name}, {done + 1} of {len(faults)}", done / len(faults))
                trials.append(make_trial(cell, fault, period))
            over = time.monotonic() + period
            _sleep_until(over)
        tell("judging", 1.0)
        outcomes, whole = judge(cell, trials, over, robot, trajectory)
        tell("replaying", 1.0)
        replayed = [replay(path) for path in sorted(cell.recordings.iterdir())]
        return CampaignReport(outcomes, replayed, whole, over - trials[0].begin)


def make_trial(cell: FaultyCell, fault: Fault, period: float) -> Trial:
    """Make one fault, end it, and wait until nothing is wrong any more.

    Args:
        cell: Where.
        fault: Which.
        period: Between two visits of the people, in [s].
    """
    cell.check()
    begin = _await_visit(cell, period)
    if begin is None:
        now = time.monotonic()
        return Trial(fault, now, now, None, 0, was_tried=False)
    end_it = cell.strike(fault, begin)
    _sleep_until(begin + fault.duration)
    end_it()
    end = time.monotonic()
    sound, resets, latched = _recover(cell, end, end + PATIENCE)
    if sound is not None:
        # The arm is to be seen at work, however long the machine took.
        _await_motion(cell, sound + PATIENCE)
    foreign = sorted(kind.text for kind in latched if kind.name not in fault.signs)
    return Trial(fault, begin, end, sound, resets, tuple(foreign))


def judge(
    cell: FaultyCell,
    trials: Sequence[Trial],
    over: float,
    robot: Robot,
    trajectory: JointTrajectory,
) -> tuple[list[Outcome], Closest]:
    """What came of the faults, and how near the arm came to the people in all of the time.

    Args:
        cell: That has ended.
        trials: What was done in it.
        over: Until when it counts, in [s].
        robot: The arm.
        trajectory: What it does that obeys nothing.
    """
    witness = Witness(robot)
    truth = read_rows(cell.truth, len(robot.joints))
    period = visit_period(trajectory)
    outcomes = []
    ends = [trial.begin for trial in trials[1:]] + [over]
    for trial, until in zip(trials, ends, strict=True):
        fault, begin = trial.fault, trial.begin
        bodies = functools.partial(place_bodies, trial, cell.start, period)
        rows = truth[(truth[:, 0] >= begin) & (truth[:, 0] < until)]
        q, v = np.split(rows[:, 3:], 2, axis=1)
        times = np.arange(begin, min(until, begin + max(fault.duration, period)), STEP)
        states = [trajectory.sample(moment - cell.start) for moment in times]
        found = find_detection(
            fault, begin, trial.end + SIGNS_UNTIL, cell.verdicts.heard, cell.lines, truth
        )
        missing = sum(count for now, count in cell.verdicts.missing if begin <= now <= until)
        outcomes.append(
            Outcome(
                fault,
                None if found is None else found.time - begin,
                "–" if found is None else found.level,
                "" if found is None else found.words,
                None if trial.sound is None else trial.sound - trial.end,
                trial.resets,
                trial.foreign,
                witness.follow(rows[:, 0], q, v, bodies),
                witness.follow(
                    times,
                    np.array([state[0] for state in states]),
                    np.array([state[1] for state in states]),
                    bodies,
                    only_first=True,
                ),
                missing,
                trial.was_tried,
            )
        )
    every = [outcome.obeying for outcome in outcomes]
    return outcomes, Closest(
        sum(one.contacts for one in every),
        min((one.distance for one in every), default=np.inf),
        float(np.mean([one.moving for one in every])) if every else 0.0,
    )


def place_bodies(trial: Trial, start: float, period: float, now: float) -> Array:
    """Where the people truly are during a trial, and the thing that drifts, if it does.

    Args:
        trial: What was done.
        start: Of the campaign, in [s].
        period: Between two visits, in [s].
        now: In [s].

    Returns:
        Ends of their axes in [m]. Shape (n, 2, 3).
    """
    people = sample_people(now - start, period)[0]
    drifts = trial.was_tried and trial.fault.kind == "static"
    if not drifts or not trial.begin <= now <= trial.begin + trial.fault.duration:
        return people
    return np.concatenate([people, sample_pillar(now - trial.begin)[0]])


def replay(path: Path) -> Replayed:
    """Run the monitor again over one of the campaign's recordings, as its users do."""
    command = [sys.executable, "-m", "armguard", "replay", str(path), "--json"]
    output = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    told: dict[str, Any] = json.loads(output.stdout or "{}")
    return Replayed(
        path.name,
        int(told.get("compared", 0)),
        bool(told.get("identical", False)),
        bool(told.get("cut_off", True)),
        int(told.get("lost", 0)),
    )


def _await_visit(cell: FaultyCell, period: float) -> float | None:
    """When a visit begins, in [s], that finds a cell that is sound and was at work; None: none."""
    deadline = time.monotonic() + PATIENCE
    while (now := time.monotonic()) < deadline:
        if _recover(cell, now, deadline)[0] is None or not _await_motion(cell, deadline):
            break
        begin = _next_visit(cell.start, period)
        _sleep_until(begin - SOUND_FOR)
        if _is_sound_until(cell, begin):
            return begin
    return None


def _recover(
    cell: FaultyCell, end: float, deadline: float
) -> tuple[float | None, int, set[ReasonKind]]:
    """Wait until nothing is wrong by a verdict later than `end` [s]; reset what is latched.

    Returns:
        When that was, in [s], None: it did not come; how many resets it took, and of what.
    """
    log = cell.verdicts
    resets, next_reset = 0, end
    latched: set[ReasonKind] = set()
    while (now := time.monotonic()) < deadline:
        if log.last_time > end and log.is_sound(now, LATENCY):
            return now, resets, latched
        kinds = log.heard[-1].kinds if log.heard else frozenset()
        found = {kind for kind in kinds if kind.effect is Effect.LATCHED}
        if now >= next_reset and found:
            latched |= found
            cell.reset()
            resets, next_reset = resets + 1, now + RESET_INTERVAL
        time.sleep(LOOK_INTERVAL)
    return None, resets, latched


def _await_motion(cell: FaultyCell, deadline: float) -> bool:
    """Wait until the arm moves; whether it does."""
    while not (moves := cell.is_moving()) and time.monotonic() < deadline:
        time.sleep(LOOK_INTERVAL)
    return moves


def _next_visit(start: float, period: float) -> float:
    """When the people set out the next time, in [s], with time to see that the cell is sound."""
    visits = (time.monotonic() + SOUND_FOR - start) / period - SETTING_OUT
    return start + (math.ceil(visits) + SETTING_OUT) * period


def _is_sound_until(cell: FaultyCell, end: float) -> bool:
    """Whether nothing is wrong from now until `end` [s]."""
    while (now := time.monotonic()) < end - 2.0 * LOOK_INTERVAL:
        if not cell.verdicts.is_sound(now, LATENCY):
            return False
        time.sleep(LOOK_INTERVAL)
    return True


def _sleep_until(moment: float) -> None:
    time.sleep(max(0.0, moment - time.monotonic()))
