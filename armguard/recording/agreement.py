"""Checks that proofs of a recording agree with its verdicts, obstacles, settings and arm.

A valid proof may be about another tick, another pair or an arm with other limits. This module finds
that with armguard's own code; `armguard_check` checks whether a proof holds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from armguard.bounds.limits import read_limits
from armguard.bounds.reach import ReachMotion
from armguard.bounds.sums import compute_sphere_levers
from armguard.exceptions import ArmguardError
from armguard.messages.answers import VerdictMessage
from armguard.messages.events import Payload
from armguard.messages.proof import ObstacleState, Proof
from armguard.messages.reasons import read_reasons
from armguard.monitor.proof import describe_state
from armguard.monitor.trusted import TrustedParts, is_same_cover, rests_in_time
from armguard.obstacles.possible_states import list_states
from armguard.obstacles.regions import RegionLimits, strictest_limit
from armguard.recording.events import BodiesChanged, Event, Gap, JointState
from armguard.recording.reading import Recording
from armguard.recording.replay import UNREADABLE, apply_to_table, read_bodies
from armguard.recording.settings import make_obstacles, make_settings
from armguard.robot.kinematics import Kinematics
from armguard.robot.portable import RestoredRobot
from armguard.verdict import BRAKE, Level, ReasonKind

SETTINGS = "period", "latency", "reaction_time", "margin"
"""Settings that proofs repeat."""

EQUAL = "stamp", "points", "velocities"
NOT_SMALLER = "radius", "position_error", "velocity_error", "accel", "speed"
"""What the state of an obstacle in a proof has in common with the recorded one, or more of."""


class Agreement:
    """Takes all events of a recording in order, and compares its proofs.

    Args:
        recording: The recording.

    Attributes:
        agreeing: How many proofs agree so far.

    Raises:
        ArmguardError: Its settings or its arm cannot be read.
    """

    def __init__(self, recording: Recording) -> None:
        self.agreeing = 0
        self._path = str(recording.path)
        self._configuration = recording.provenance.get("configuration")
        try:
            self._settings = make_settings(recording.settings["monitor"])
            self._robot = RestoredRobot(recording.robot)
            self._obstacles = make_obstacles(recording.settings["obstacles"])
            self._limits = [self._settings.put_in_force(self._robot) for _ in range(2)]
        except UNREADABLE as error:
            raise ArmguardError(
                self._path,
                f"has settings that cannot be read ({type(error).__name__}: {error})",
            ) from None
        # Operating limits that were broken give way to the hardware's.
        self._limits[1].suspend()
        self._contact = RegionLimits(*self._settings.tabulate_contact_limits())
        self._parts: list[TrustedParts] = []
        self._broken_at = -math.inf
        """Time of the last tick in which operating limits were broken, in [s]."""
        self._state: JointState | None = None
        self._verdict: VerdictMessage | None = None

    def take(self, event: Event) -> str:
        """Take in an event.

        Returns:
            The contradiction, in words; empty: none, or the event is no proof.

        Raises:
            ArmguardError: It cannot be read, or is about a payload or bodies that the arm cannot
                have.
        """
        try:
            return self._take(event)
        except (*UNREADABLE, ArmguardError) as error:
            name = type(event).__name__
            raise ArmguardError(self._path, f"has a {name} that cannot be read ({error})") from None

    def _take(self, event: Event) -> str:
        if isinstance(event, JointState):
            self._state, self._verdict = event, None
        elif isinstance(event, VerdictMessage):
            self._verdict = event
            kinds = {reason.kind for reason in read_reasons(event.reasons)}
            if self._state is not None and ReasonKind.OPERATING_LIMITS_BROKEN in kinds:
                self._broken_at = self._state.now
        elif isinstance(event, Gap):
            self._state = self._verdict = None
        elif isinstance(event, Payload):
            for limits in self._limits:
                limits.load(event.payload)
        elif isinstance(event, BodiesChanged):
            self._robot.replace_bodies(read_bodies(event))
            self._parts = []
        elif isinstance(event, Proof):
            try:
                problem = next(self._compare(event), "")
            except (ArithmeticError, LookupError, TypeError, ValueError) as error:
                problem = f"it or its joint state is malformed ({error})"
            self.agreeing += not problem
            return problem
        else:
            apply_to_table(self._obstacles, event)
        return ""

    def _compare(self, proof: Proof) -> Iterator[str]:
        state, verdict = self._state, self._verdict
        if state is None or verdict is None or verdict.sequence != proof.sequence:
            yield "the verdict of its tick does not precede it"
            return
        if verdict.configuration not in (None, self._configuration):
            yield f"its verdict has configuration {verdict.configuration}, not the recording's"
        of_verdict = {key: getattr(verdict, key) for key in ("stamp", "level", "link", "obstacle")}
        of_state = {key: np.frombuffer(getattr(state, key)).tolist() for key in ("q", "v")}
        of_settings = {key: getattr(self._settings, key) for key in SETTINGS}
        for beside, values in (
            ("verdict", of_verdict),
            ("joint state", of_state | {"now": state.now}),
            ("settings", of_settings),
        ):
            for key, value in values.items():
                if getattr(proof, key) != value:
                    yield f"{key} is {getattr(proof, key)}, that of the {beside} is {value}"
        limit = self._find_contact_limit(proof.obstacle)
        if not 0.0 <= proof.max_speed <= limit:
            yield f"max_speed is {proof.max_speed}, its obstacle's contact limit is {limit} m/s"
        brakes = "this" if verdict.level == Level.STOP.name else "next"
        for motion in proof.motions:
            if motion.told == "never":
                continue
            if motion.told != brakes or verdict.stop not in (None, BRAKE):
                yield f"its arm brakes after {motion.told} verdict; its own verdict differs"
            rest, stop_time = motion.times[-1], verdict.stop_time
            if not rests_in_time(rest, math.inf if stop_time is None else stop_time):
                yield f"the arm rests in {rest} s, by the verdict in {stop_time} s"
        if not self._has_recorded_state(proof):
            yield "its obstacle has no state as recorded, with its errors and bounds"
        yield from self._compare_trusted(proof, state.now)

    def _find_contact_limit(self, obstacle: str) -> float:
        """How fast a surface may be that touches an obstacle, in [m/s]; 0 where it is unknown.

        Of obstacles with the same name the strictest limit counts: a proof names no source.
        """
        table = self._obstacles.table
        return min(
            (
                float(strictest_limit.py_func(self._contact, int(table.regions[row])).max_speed)
                for row, name in enumerate(self._obstacles.ids)
                if name == obstacle and table.alive[row]
            ),
            default=0.0,
        )

    def _has_recorded_state(self, proof: Proof) -> bool:
        """Whether a state of the proof is as wide as an obstacle's newest state.

        The newest are the accepted state, and samples that were refused later. Which refused ones
        the proof must have as well, and how far they were widened, is not compared.
        """
        table = self._obstacles.table
        for row, name in enumerate(self._obstacles.ids):
            if name != proof.obstacle or not table.alive[row]:
                continue
            known = list_states(table.accepted, table.refused_states, table.marks, row, proof.now)
            recorded = [describe_state(*one, proof.now) for one in known]
            newest = [one for one in recorded if one.stamp >= recorded[0].stamp]
            if any(_is_as_wide(state, one) for state in proof.states for one in newest):
                return True
        return False

    def _compare_trusted(self, proof: Proof, now: float) -> Iterator[str]:
        if not self._parts:
            robot, place = self._robot, self._settings.base_placement
            kinematics, reach = Kinematics(robot, place), ReachMotion(robot, place)
            levers = compute_sphere_levers(robot)
            self._parts = [
                TrustedParts(kinematics, read_limits(robot, limits), levers, reach.link_balls)
                for limits in self._limits
            ]
        # With the hardware's limits, a proof claims more.
        is_broken = now - self._broken_at < self._settings.rise_delay
        admitted = self._parts[1:] if is_broken else self._parts
        if proof.arm not in [parts.describe_arm() for parts in admitted]:
            yield "its arm has other joints, limits, errors or brakes than the recorded one"
        links = self._robot.links
        cover = proof.cover
        nodes = [ball.node for ball in cover.balls]
        if cover.link not in links or not all(0 <= node < len(cover.parents) for node in nodes):
            yield "its cover belongs to no link of the recorded arm"
            return
        own = self._parts[0].describe_cover(cover.link, links.index(cover.link), nodes)
        if not is_same_cover(cover, own):
            yield "its cover has other spheres, levers or reach than the recorded arm"


def _is_as_wide(state: ObstacleState, recorded: ObstacleState) -> bool:
    """Whether a state is where a recorded one is, with errors and bounds that are no smaller."""
    return all(getattr(state, key) == getattr(recorded, key) for key in EQUAL) and all(
        getattr(state, key) >= getattr(recorded, key) for key in NOT_SMALLER
    )
