"""Makes proofs about a verdict's deciding pair, for a checker that is independent of armguard.

A proof uses the joint state and obstacle states of its tick, even if the pair was evaluated in an
earlier tick. For a free arm it proves a time before which there is no contact. For an arm after a
STOP it proves that the arm is at rest by the end of its tube, and before it can touch the obstacle.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from armguard.bounds.joint_table import make_table
from armguard.jit.handle import machine_code, pack
from armguard.jit.numerics import SUM_ROUNDING
from armguard.messages.proof import ObstacleState, Proof, ProvedMotion, Separation
from armguard.monitor.trusted import TrustedParts
from armguard.obstacles.possible_states import list_states
from armguard.obstacles.regions import strictest_limit
from armguard.obstacles.table import States
from armguard.pairs.arm import WatchedArm
from armguard.pairs.evaluate import evaluate
from armguard.pairs.separations import (
    FAILED,
    REACH,
    ProofScene,
    find_separations,
    make_separations,
    tabulate,
)
from armguard.scheduling.scheduler import Tick
from armguard.settings.settings import Settings
from armguard.verdict import FINISH, Level, Verdict

NODES = 33
"""Of a tube."""

SHARES = 1.0 - 1e-6, 0.99, 0.95, 0.85, 0.7, 0.5, 0.25
"""Fractions of the evaluated contact time to try in turn, since intervals here have other ends."""

LONGEST = 1.0
"""How long free joints are followed, in [s]; after that an arm can be anywhere."""

DELAYS = "period", "latency", "reaction_time"
"""Settings that a proof states: times that pass before the brakes act, in [s]."""


class Prover:
    """Makes proofs of one arm's verdicts.

    Args:
        arm: The arm as the scheduler watches it.
        settings: Settings of the monitor, which say when verdicts are obeyed.

    Attributes:
        arm: The arm.
    """

    def __init__(self, arm: WatchedArm, settings: Settings) -> None:
        self.arm = arm
        self._settings = settings
        self._delays = {name: getattr(settings, name) for name in DELAYS}
        box = arm.motion.table.box
        self._free, self._brakes = (
            make_table(
                np.zeros(NODES),
                box.turning,
                box.position_error,
                interpolates=False,
                with_velocities=settings.permits_contact and brakes,
            )
            for brakes in (False, True)
        )
        tree = arm.state.tree
        most = int(np.bincount(arm.state.link_of).max())
        self._found = make_separations(most, NODES)
        self._still = np.zeros((len(box.turning), 6))
        self._first = tree.root
        motion = arm.motion
        self._trusted = TrustedParts(
            arm.kinematics, motion.joint.limits, motion.joint.lever, motion.reach.link_balls
        )
        self._pack()

    def _pack(self) -> None:
        """Pack the scene for compiled code, once for all ticks in which it is unchanged."""
        state = self.arm.state
        self._scene = state.scene
        self._handles = tuple(
            pack(ProofScene(state.scene, table, self._found, self._still))
            for table in (self._free, self._brakes)
        )
        joints = np.zeros((2, len(self._still)))
        self._tabulate = machine_code(tabulate, self._handles[0], *joints, 0.0, 0.0)
        self._find = machine_code(find_separations, self._handles[0], 0, 0, 0, 0.0, True)

    def prove(self, tick: Tick, pair: int, verdict: Verdict) -> Proof | None:
        """The proof about a pair in the last tick, whose arm was prepared.

        Returns None if the obstacle could be anywhere, if the joint state is newer than its tick,
        or if neither motion could be proved.

        Args:
            tick: The tick.
            pair: Row × links + link.
            verdict: Of the tick.
        """
        arm, state, settings = self.arm, self.arm.state, self._settings
        row, link = divmod(pair, len(arm.links))
        bodies = list_states(state.bodies, state.refused_bodies, state.marks, row, tick.now)
        if not bodies or tick.arm_age < 0.0:
            return None
        if state.scene is not self._scene:
            self._pack()
        # As compiled code was told of them.
        tick = tick._replace(q=np.ascontiguousarray(tick.q), v=np.ascontiguousarray(tick.v))
        told = "this" if verdict.level is Level.STOP else "next"
        # An arm that is to finish its piece does not brake.
        brakes = verdict.stop is not FINISH
        spheres: set[int] = set()
        free = self._prove_free(tick, link, row, len(bodies), spheres)
        stop = self._prove_stop(tick, link, row, len(bodies), spheres, told) if brakes else None
        motions = [motion for motion in (free, stop) if motion is not None]
        if not motions:
            return None
        limit = strictest_limit.py_func(state.scene.contact_limits, state.marks.regions[row])
        names = arm.names(pair)
        return Proof(
            stamp=float(verdict.stamp),
            now=tick.now,
            sequence=verdict.sequence,
            level=verdict.level.name,
            link=names[0],
            obstacle=names[1],
            q=tick.q.tolist(),
            v=tick.v.tolist(),
            **self._delays,
            margin=settings.margin,
            max_speed=float(limit.max_speed),
            arm=self._trusted.describe_arm(),
            cover=self._trusted.describe_cover(names[0], link, spheres),
            states=[describe_state(states, place, age, tick.now) for states, place, age in bodies],
            motions=motions,
        )

    def _prove_free(
        self, tick: Tick, link: int, row: int, count: int, spheres: set[int]
    ) -> ProvedMotion | None:
        """Prove that the free arm's link touches nothing before a time; None if this fails."""
        state, table = self.arm.state, self._free
        pairs = np.array([row * len(self.arm.links) + link])
        times, nodes = np.zeros(1), np.zeros(1, dtype=np.int64)
        # What others read of the tick stays as it was.
        threshold, sphere_time = state.refinement_threshold, state.sphere_time.copy()
        state.refinement_threshold = tick.refinement_threshold
        evaluate(state, pairs, times, nodes, np.zeros(1, dtype=np.int8))
        state.refinement_threshold, state.sphere_time[:] = threshold, sphere_time
        handle = self._handles[0]
        for share in SHARES:
            end = share * min(float(times[0]), LONGEST)
            if not end > 0.0:
                return None
            # Dense where displacements grow like t².
            table.time[:] = end * (np.arange(NODES) / (NODES - 1)) ** 2.0
            self._tabulate(handle, tick.q, tick.v, tick.arm_age, np.inf)
            found = self._separate(handle, tick.now, link, row, count, brakes=False)
            if found is not None:
                return self._describe_motion("never", table, found, spheres)
        return None

    def _prove_stop(
        self, tick: Tick, link: int, row: int, count: int, spheres: set[int], told: Any
    ) -> ProvedMotion | None:
        """Prove that the arm after a STOP is at rest, and before it can touch the obstacle."""
        braking, table = self.arm.motion.braking, self._brakes
        horizon = self._delays["latency"]
        horizon += self._delays["period"] if told == "next" else 0.0
        if not braking.covers(tick.q, tick.v, tick.arm_age, horizon):
            return None
        handle, free = self._handles[1], tick.arm_age + horizon + braking.reaction_time
        stop = braking.tabulate(tick.q, tick.v, tick.arm_age, horizon).time
        table.time[:] = stop * (1.0 + SUM_ROUNDING)
        self._tabulate(handle, tick.q, tick.v, tick.arm_age, free)
        found = self._separate(handle, tick.now, link, row, count, brakes=True)
        return self._describe_motion(told, table, found or [], spheres)

    def _separate(
        self, handle: Any, now: float, link: int, row: int, count: int, *, brakes: bool
    ) -> list[Separation] | None:
        """Separations of the link from all states of the obstacle; None if they are not found."""
        separations, found, first = [], self._found, int(self._first[link])
        begins = 0 if self.arm.state.marks.has_state[row] else 1
        for number in range(count):
            taken = self._find(handle, link, row, begins + number, now, brakes)
            if taken == FAILED:
                return None
            begin = 0
            for sphere, steps in zip(found.sphere[:taken], found.steps[:taken], strict=True):
                end = begin + int(steps)
                separations.append(
                    Separation(
                        node=REACH if sphere == REACH else int(sphere) - first,
                        state=number,
                        ends=found.end[begin:end].tolist(),
                        directions=found.normal[begin:end].ravel().tolist(),
                    )
                )
                begin = end
        return separations

    def _describe_motion(
        self, told: Any, table: Any, separations: list[Separation], spheres: set[int]
    ) -> ProvedMotion:
        spheres.update(one.node for one in separations if one.node != REACH)
        rows = (table.high, table.low, table.fastest, table.slowest)
        high, low, fastest, slowest = (one.ravel().tolist() for one in rows)
        return ProvedMotion(
            told=told,
            times=table.time.tolist(),
            high=high,
            low=low,
            fastest=fastest,
            slowest=slowest,
            separations=separations,
        )


def describe_state(states: States, place: int, age: float, now: float) -> ObstacleState:
    """A state of an obstacle, as proofs have it.

    Args:
        states: The arrays that have it.
        place: Its place in them.
        age: At `now`, in [s].
        now: Time of the tick, in [s].
    """
    count = states.point_count[place]
    return ObstacleState(
        # One that never moves is as old as the tick.
        stamp=now if age == 0.0 else float(states.stamp[place]),
        points=states.points[place, :count].ravel().tolist(),
        velocities=states.velocities[place, :count].ravel().tolist(),
        radius=float(states.radius[place]),
        position_error=float(states.position_error[place]),
        velocity_error=float(states.velocity_error[place]),
        accel=float(states.accel[place]),
        speed=float(states.speed[place]),
    )
