"""The data of a recording that commissioning uses, as arrays over time."""

from __future__ import annotations

import itertools
from collections import defaultdict
from typing import NamedTuple

import numpy as np

from armguard.bounds.planned.plan import Plan
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import BoolArray, FloatArray
from armguard.messages.answers import PlanVerdictMessage, VerdictMessage, read_verdict
from armguard.messages.batch import read_batch
from armguard.messages.incoming import ObstaclesMessage, PlanMessage
from armguard.recording.events import Gap, JointState, MalformedPlan, MalformedState
from armguard.recording.inputs import restore_plan, restore_state
from armguard.recording.reading import Recording
from armguard.robot.portable import RestoredRobot
from armguard.robot.robot import Robot

_FEWEST_STATES = 10


class StopCommand(NamedTuple):
    """A STOP that followed another level, in [s] of the monitor's clock."""

    told: float
    """Time of the tick of its first verdict."""
    ended: float
    """Time of the tick of the first verdict after it that is none; the recording's end if none."""


class PlanAccepted(NamedTuple):
    """A plan that the arm was allowed to do."""

    plan: Plan
    ended: float
    """When another plan took its place, or a STOP came, in [s]; the recording's end if neither."""


class SourceObservations(NamedTuple):
    """What one source of obstacles sent."""

    stamps: FloatArray
    """Of its messages, in [s], in the order in which they came. Shape (messages,)."""
    ages: FloatArray
    """When each was taken in, counted from its stamp, in [s]. Shape (messages,)."""
    tracks: dict[str, tuple[FloatArray, FloatArray]]
    """By id: stamps in [s], shape (n,), and positions of the first points in [m], shape (n, 3)."""
    timeout: float = float("inf")
    """Silence that it could keep without a STOP, by the recorded settings, in [s]."""


class Observations(NamedTuple):
    """What was seen of an arm, its stops and its sources; times in [s] of the monitor's clock."""

    robot: Robot
    stamps: FloatArray
    """When each joint state was measured, rising. Shape (n,)."""
    q: FloatArray
    """[rad] or [m]. Shape (n, nv)."""
    v: FloatArray
    """As the controller states them, in [rad/s] or [m/s]. Shape (n, nv)."""
    stops: list[StopCommand]
    plans: list[PlanAccepted]
    sources: dict[str, SourceObservations]
    payload: float
    """Stated in the recorded settings, in [kg]."""
    latency: float
    """Stated in the recorded settings, in [s]."""
    has_gaps: bool = False
    """Whether events are missing."""

    @property
    def period(self) -> float:
        """Usual time between two joint states, in [s]."""
        return float(np.median(np.diff(self.stamps)))

    def find_moving(self, joint: int, share: float) -> BoolArray:
        """States in which a joint has this share of its velocity limit or more. Shape (n,)."""
        return np.abs(self.v[:, joint]) >= share * self.robot.velocity_limit[joint]


def observe(recording: Recording) -> Observations:
    """Read a recording for commissioning.

    Joint states that were judged more than once count once; what is not finite does not count.

    Raises:
        ArmguardError: The recording is damaged, or has next to no joint states.
    """
    robot = RestoredRobot(recording.robot)
    count = len(robot.joints)
    rows: list[list[float]] = []
    verdicts: list[tuple[float, bool]] = []
    last = -np.inf
    asked: Plan | None = None
    plans: list[tuple[float, Plan]] = []
    messages: dict[str, list[tuple[float, float]]] = defaultdict(list)
    seen: dict[str, dict[str, list[list[float]]]] = defaultdict(lambda: defaultdict(list))
    waiting: list[tuple[str, float]] = []
    is_lossy = False
    for _, event, _ in recording.events():
        if isinstance(event, JointState | MalformedState):
            if np.isfinite(event.now):
                for source, stamp in waiting:
                    messages[source].append((stamp, event.now))
                waiting.clear()
            if isinstance(event, JointState):
                _, q, v, _ = restore_state(event)
                row = [event.stamp, *q, *v]
                if len(row) == 1 + 2 * count and np.isfinite(row).all():
                    rows.append(row)
        elif isinstance(event, VerdictMessage):
            last = read_verdict(event).stamp
            verdicts.append((last, event.level == "STOP"))
        elif isinstance(event, PlanMessage | MalformedPlan):
            restored = restore_plan(event)
            asked = restored if isinstance(restored, Plan) else None
        elif isinstance(event, PlanVerdictMessage):
            if event.safe and asked is not None:
                plans.append((last, asked))
            asked = None
        elif isinstance(event, ObstaclesMessage):
            # It arrived for the tick that comes next.
            waiting.append((event.source, event.stamp))
            if not event.ids:
                continue  # A heartbeat is a message like any other, but tells of no obstacle.
            positions = read_batch(event).position.reshape(len(event.ids), -1, 3)
            for name, points in zip(event.ids, positions, strict=True):
                seen[event.source][name].append([event.stamp, *points[0]])
        elif isinstance(event, Gap):
            is_lossy = True
    states = np.array(rows).reshape(-1, 1 + 2 * count)
    states = states[np.unique(states[:, 0], return_index=True)[1]]
    if len(states) < _FEWEST_STATES:
        raise ArmguardError(
            str(recording.path),
            f"has {len(states)} joint states",
            expected="a recording of an arm at work, with a few stops in it",
        )
    stops = _find_stops(verdicts)
    end = max(float(states[-1, 0]), last)
    settings = recording.settings["monitor"]
    stated = recording.settings["obstacles"]["sources"] or ()
    timeouts = {one["name"]: one["timeout"] for one in stated}
    return Observations(
        robot,
        states[:, 0],
        states[:, 1 : 1 + count],
        states[:, 1 + count :],
        stops,
        _find_plan_ends(plans, stops, end),
        {
            name: SourceObservations(
                np.array([stamp for stamp, _ in sent]),
                np.array([came - stamp for stamp, came in sent]),
                {
                    body: (rows[:, 0], rows[:, 1:])
                    for body, rows in ((id, np.array(track)) for id, track in seen[name].items())
                },
                float(timeouts.get(name) or settings["source_timeout"]),
            )
            for name, sent in messages.items()
        },
        float(settings["payload"]),
        float(settings["latency"]),
        is_lossy,
    )


def _find_stops(verdicts: list[tuple[float, bool]]) -> list[StopCommand]:
    """The STOPs that followed another level; the first verdicts of a run follow none."""
    runs = itertools.groupby(verdicts, key=lambda verdict: verdict[1])
    begins = [(next(run)[0], is_stop) for is_stop, run in runs]
    later = itertools.pairwise([*begins[1:], *verdicts[-1:]])
    return [StopCommand(told, ended) for (told, is_stop), (ended, _) in later if is_stop]


def _find_plan_ends(
    plans: list[tuple[float, Plan]], stops: list[StopCommand], end: float
) -> list[PlanAccepted]:
    accepted = []
    for number, (answered, plan) in enumerate(plans):
        ends = [end, *(stop.told for stop in stops if stop.told >= answered)]
        if number + 1 < len(plans):
            ends.append(plans[number + 1][1].stamp)
        accepted.append(PlanAccepted(plan, min(ends)))
    return accepted
