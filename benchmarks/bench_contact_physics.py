"""Contact limits attacked with physics: energy and force in a body part that an arm in MuJoCo hits.

    python benchmarks/bench_contact_physics.py --contacts 10000 --jobs 2 --out table.md

A body part, a mass in a skin, rests in the arm's way, lunges at it, or flies at it. It is where
the monitor lets the arm hit it hardest, and at times a head is behind it. The arm goes on in all
verdicts but STOP, and brakes as late and as little as is stated. Its position loop has one of three
stiffnesses, or nothing can hold the arm up. `--contacts` counts contacts of a part at rest; those
of moving parts come on top. Before that comes a control, in which the arm obeys nobody: it has to
exceed limits on each arm. The file has what was found so far.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from armguard.robot import Robot
from armguard.robot.operating_limits import OperatingLimits
from support.contact_attacks import LOOPS, LUNGE, PARTS, REST, THROW, Attack, Fight, make_limits
from support.contact_physics import Arm, make_surface

ARMS = "panda", "ur5", "xarm7"
MODES = *(REST,) * 4, LUNGE, THROW
AT_REST, MOVING, CLAMPED, FLUNG = "at rest", "moving", "clamped", "moving, clamped"
JUDGED = AT_REST, MOVING, CLAMPED
"""What a part does when it is touched. One that is clamped while it moves presses by its own
motion, which no limit of the arm's covers."""
CHUNK = 250  # contacts of a part at rest that one process simulates before it reports
ROUNDING = 1e-3  # of the simulation, as a share of a limit
CONTROL_SHARE = 0.02  # of the contacts


class Task(NamedTuple):
    """What one process simulates."""

    arm: str
    pace: float
    """Operating velocities, as a share of the arm's."""
    accel: float
    """Operating accelerations, at most, in [rad/s²]."""
    seed: int
    contacts: int
    with_limits: bool


class Tally:
    """What came of attacks on one arm."""

    def __init__(self) -> None:
        self.shares: dict[str, list[float]] = {kind: [] for kind in (*JUDGED, FLUNG)}
        self.best_by_loop = dict.fromkeys(LOOPS, 0.0)
        self.true_share = 0.0
        self.heads = self.heads_touched = self.attacks = 0
        self.head_gap = math.inf

    def add(self, attack: Attack) -> None:
        """Count one attack."""
        self.attacks += 1
        if attack.head_gap < math.inf:
            self.heads += 1
            self.heads_touched += not attack.head_gap > 0.0
            self.head_gap = min(self.head_gap, attack.head_gap)
        for touch in attack.touches:
            share, is_moving = attack.share(touch), touch.part_speed > 0.0
            kind = MOVING if is_moving else AT_REST
            if touch.is_clamped:
                kind = FLUNG if is_moving else CLAMPED
            else:
                self.true_share = max(self.true_share, attack.true_share(touch))
                if not is_moving:
                    best = self.best_by_loop
                    best[attack.stiffness] = max(best[attack.stiffness], share)
            self.shares[kind].append(share)

    def merge(self, other: Tally) -> None:
        """Count the attacks of another tally as well."""
        for kind, some in other.shares.items():
            self.shares[kind] += some
        for loop, best in other.best_by_loop.items():
            self.best_by_loop[loop] = max(self.best_by_loop[loop], best)
        self.true_share = max(self.true_share, other.true_share)
        self.attacks += other.attacks
        self.heads += other.heads
        self.heads_touched += other.heads_touched
        self.head_gap = min(self.head_gap, other.head_gap)

    def count_beyond(self, kind: str) -> int:
        """How many contacts of a kind exceed their limit."""
        return sum(not share <= 1.0 + ROUNDING for share in self.shares[kind])

    @property
    def is_kept(self) -> bool:
        """Whether no limit was exceeded, and no head touched."""
        beyond = sum(self.count_beyond(kind) for kind in JUDGED)
        return not (beyond or self.heads_touched) and self.true_share <= 1.0 + ROUNDING


def simulate(task: Task) -> tuple[Task, Tally]:
    """All attacks of one task."""
    robot = Robot.load(task.arm)
    operating = OperatingLimits(
        np.minimum(task.pace * robot.velocity_limit, 1.5),
        np.minimum(robot.acceleration_limit, task.accel),
    )
    limits = make_limits() if task.with_limits else None
    fight = Fight(Arm(robot, make_surface(robot)), operating, [task.seed], limits)
    random, tally = np.random.default_rng([task.seed, 1]), Tally()
    while len(tally.shares[AT_REST]) < task.contacts:
        part, loop = PARTS[random.integers(len(PARTS))], LOOPS[random.integers(len(LOOPS))]
        attack = fight.attack(part, MODES[random.integers(len(MODES))], loop)
        if attack is not None:
            tally.add(attack)
    return task, tally


def plan_tasks(
    arms: list[str], contacts: int, seed: int, chunk: int, *, with_limits: bool
) -> list[Task]:
    """Tasks for as many contacts on each arm, half of them of an arm that is slow to speed up."""
    each = math.ceil(contacts / len(arms))
    count = max(2, math.ceil(each / chunk))
    size = math.ceil(each / count)
    return [
        Task(arm, *((0.45, 1.0), (0.6, 5.0))[k % 2], seed + k, size, with_limits)
        for k in range(count)
        for arm in arms
    ]


def run(tasks: list[Task], jobs: int) -> Iterator[dict[str, Tally]]:
    """What has come of some tasks, by arm, after each of them."""
    tallies = {task.arm: Tally() for task in tasks}
    began = time.monotonic()
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        for done, (task, tally) in enumerate(pool.imap_unordered(simulate, tasks), 1):
            tallies[task.arm].merge(tally)
            best = {kind: max(some, default=0.0) for kind, some in tally.shares.items()}
            print(
                f"{done} of {len(tasks)} tasks, {time.monotonic() - began:.0f} s: {task.arm}, "
                f"{tally.attacks} attacks, best {best[AT_REST]:.3f} at rest, "
                f"{best[MOVING]:.3f} moving, {best[CLAMPED]:.3f} clamped; of the true speed "
                f"{tally.true_share:.4f}; heads touched {tally.heads_touched} of {tally.heads}",
                flush=True,
            )
            yield tallies


def describe(tallies: dict[str, Tally]) -> str:
    """A table in Markdown."""
    lines = [
        "| arm | touched | contacts | beyond the limit | median | best attack ÷ limit |",
        "|---|---|---|---|---|---|",
    ]
    for arm, tally in tallies.items():
        for kind in JUDGED:
            shares = tally.shares[kind]
            middle, best = (f"{x:.2f}" for x in (np.median(shares or [0]), max(shares or [0])))
            lines.append(
                f"| {arm} | {kind} | {len(shares):,} | {tally.count_beyond(kind)} | "
                f"{middle} | {best} |"
            )
    lines += [
        "",
        "| arm | attacks | best at rest, by loop of 2e3, 5e4, 5e5 N/m, "
        "rigid | energy ÷ that of the true speed | heads near | touched | least distance [mm] | "
        "clamped while moving, not judged |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for arm, tally in tallies.items():
        loops = ", ".join(f"{best:.2f}" for best in tally.best_by_loop.values())
        lines.append(
            f"| {arm} | {tally.attacks:,} | {loops} "
            f"| {tally.true_share:.3f} | {tally.heads:,} | {tally.heads_touched} | "
            f"{1e3 * tally.head_gap:.1f} | {len(tally.shares[FLUNG])} |"
        )
    return "\n".join(lines) + "\n"


def main(arguments: list[str] | None = None) -> bool:
    """Attack without a monitor, and with one; whether all is as it must be."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--contacts", type=int, default=10_000, help="of parts at rest, in all")
    parser.add_argument("--arms", nargs="+", default=list(ARMS))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--chunk", type=int, default=CHUNK, help="contacts of one task")
    parser.add_argument("--out", type=Path, help="file for the tables so far, in Markdown")
    options = parser.parse_args(arguments)
    tasks = [
        plan_tasks(options.arms, count, options.seed, options.chunk, with_limits=with_limits)
        for count, with_limits in (
            (max(20 * len(options.arms), int(CONTROL_SHARE * options.contacts)), False),
            (options.contacts, True),
        )
    ]
    print("control: an arm that obeys nobody", flush=True)
    *_, control = run(tasks[0], options.jobs)
    can_fail = all(tally.count_beyond(AT_REST) for tally in control.values())
    if not can_fail:
        print("the control exceeds no limit")
    print("an arm that obeys a monitor with contact limits", flush=True)
    for tallies in run(tasks[1], options.jobs):
        text = describe(tallies) + "\nControl, an arm that obeys nobody:\n\n" + describe(control)
        if options.out:
            options.out.write_text(text)
    print(text)
    return can_fail and all(tally.is_kept for tally in tallies.values())


if __name__ == "__main__":
    sys.exit(0 if main() else 1)
