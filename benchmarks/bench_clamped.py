"""Clamped contact attacked with physics: how hard an arm presses a part that cannot give way.

    python benchmarks/bench_clamped.py --contacts 3000 --jobs 2 --out table.md

The arm is in MuJoCo, and its surface is that of its cover: no room is left that would spare the
part. The part is between the arm and a fixed block, a cart that follows it, or another link of the
arm. The monitor has contact limits, and the arm brakes as late and as little as is stated; its loop
knows of no contact. Arms creep, each task within other operating velocities. Before that comes a
control: the same limits, but gaps of 0, so that nothing counts as clamped, and arms four times as
fast, as nothing else asks for less. It has to exceed limits. The file has what was found so far.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from armguard.robot.operating_limits import OperatingLimits
from support.clamp_attacks import (
    BLOCK,
    CART,
    LINK,
    ClampFight,
    make_clamp_limits,
    make_tight_robot,
)
from support.contact_attacks import LOOPS, PARTS
from support.contact_physics import RIGID, Arm, make_cover_surface

ARMS = "panda", "ur5", "xarm7"
KINDS = {BLOCK: "a fixed block", CART: "a cart", LINK: "another link"}
STIFF = tuple(loop for loop in LOOPS if loop >= 5e4)
CREEP = 0.05, 0.1, 0.2, 0.3
"""Operating velocities, in [rad/s]: one for each of `PARTS`, which may be pressed farther each."""
SPEED_UP = 0.1  # operating acceleration, in [rad/s²]
CHUNK = 60  # contacts of each kind that one process simulates before it reports
ROUNDING = 1e-3  # of the simulation, as a share of a limit
CONTROL_PACE = 4.0  # as multiples of those velocities: nothing but that rule asks for less
CONTROL_SHARE = 0.05  # of the contacts
MOST_TRIES = 12  # attacks for each contact that is asked for


class Task(NamedTuple):
    """What one process simulates."""

    arm: str
    velocity: float
    """[rad/s]"""
    seed: int
    contacts: int
    """Of each kind."""
    with_clamping: bool


Shares = dict[tuple[str, int, float], list[float]]
"""Forces as shares of their limits, by arm, kind and stiffness of the loop."""


def simulate(task: Task) -> tuple[Task, Shares]:
    """All attacks of one task."""
    robot = make_tight_robot(task.arm)
    joints = len(robot.joints)
    velocity = task.velocity * (1.0 if task.with_clamping else CONTROL_PACE)
    operating = OperatingLimits(np.full(joints, velocity), np.full(joints, SPEED_UP))
    limits = make_clamp_limits(with_clamping=task.with_clamping)
    fight = ClampFight(Arm(robot, make_cover_surface(robot)), operating, [task.seed], limits)
    random = np.random.default_rng([task.seed, 1])
    shares: Shares = defaultdict(list)
    for kind in KINDS:
        left = task.contacts
        for _ in range(MOST_TRIES * task.contacts):
            loop = STIFF[random.integers(len(STIFF))]
            usual = PARTS[CREEP.index(task.velocity)]
            part = usual if random.random() < 0.7 else PARTS[random.integers(len(PARTS))]
            attack = fight.attack(part, kind, loop)
            if attack is not None:
                share = max(attack.share(touch) for touch in attack.touches)
                shares[task.arm, kind, loop].append(share)
                left -= 1
            if not left:
                break
    return task, dict(shares)


def plan_tasks(
    arms: list[str], contacts: int, seed: int, chunk: int, *, with_clamping: bool
) -> list[Task]:
    """Tasks for as many contacts in all, at each operating velocity in turn."""
    count = max(len(CREEP), math.ceil(contacts / (chunk * len(KINDS) * len(arms))))
    size = max(1, math.ceil(contacts / (count * len(KINDS) * len(arms))))
    return [
        Task(arm, CREEP[k % len(CREEP)], seed + k, size, with_clamping)
        for k in range(count)
        for arm in arms
    ]


def run(tasks: list[Task], jobs: int) -> Iterator[Shares]:
    """What has come of some tasks, after each of them."""
    found: Shares = defaultdict(list)
    began = time.monotonic()
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        for done, (task, shares) in enumerate(pool.imap_unordered(simulate, tasks), 1):
            for key, some in shares.items():
                found[key] += some
            best = {
                KINDS[kind]: round(max(find(shares, kind=kind), default=0.0), 3) for kind in KINDS
            }
            print(
                f"{done} of {len(tasks)} tasks, {time.monotonic() - began:.0f} s: {task.arm} at "
                f"{task.velocity:g} rad/s, {len(find(shares))} contacts, best {best}",
                flush=True,
            )
            yield dict(found)


def find(
    shares: Shares, *, arm: str | None = None, kind: int | None = None, loop: float | None = None
) -> list[float]:
    """All shares of an arm, a kind and a loop; None: any."""
    return [
        share
        for key, some in shares.items()
        for share in some
        if all(wanted in (None, one) for wanted, one in zip((arm, kind, loop), key, strict=True))
    ]


def count_beyond(shares: list[float]) -> int:
    """How many exceed their limit."""
    return sum(not share <= 1.0 + ROUNDING for share in shares)


def describe(shares: Shares, control: Shares) -> str:
    """Tables in Markdown."""
    lines = [
        "| clamped against | arm | contacts | beyond the limit | median | best attack ÷ limit | "
        "control: contacts | beyond | most |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for kind, text in KINDS.items():
        for arm in dict.fromkeys(key[0] for key in shares):
            some, others = (find(one, arm=arm, kind=kind) for one in (shares, control))
            middle = f"{np.median(some or [0.0]):.2f}"
            lines.append(
                f"| {text} | {arm} | {len(some):,} | {count_beyond(some)} | {middle} | "
                f"{max(some, default=0.0):.2f} | {len(others)} | {count_beyond(others)} | "
                f"{max(others, default=0.0):.1f} |"
            )
    lines += ["", "| loop where it is touched | contacts | best attack ÷ limit |", "|---|---|---|"]
    for loop in STIFF:
        some = find(shares, loop=loop)
        text = "nothing can hold the arm up" if loop == RIGID else f"{loop:.0e} N/m"
        lines.append(f"| {text} | {len(some):,} | {max(some, default=0.0):.2f} |")
    return "\n".join(lines) + "\n"


def main(arguments: list[str] | None = None) -> bool:
    """Attack with and without the rule for clamped parts; whether all is as it must be."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--contacts", type=int, default=3000, help="in all")
    parser.add_argument("--arms", nargs="+", default=list(ARMS))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--chunk", type=int, default=CHUNK, help="contacts of a kind in one task")
    parser.add_argument("--out", type=Path, help="file for the tables, in Markdown")
    options = parser.parse_args(arguments)
    tasks = [
        plan_tasks(options.arms, count, options.seed, options.chunk, with_clamping=clamps)
        for count, clamps in (
            (math.ceil(CONTROL_SHARE * options.contacts), False),
            (options.contacts, True),
        )
    ]
    print("control: nothing counts as clamped", flush=True)
    *_, control = run(tasks[0], options.jobs)
    print("with the rule for clamped parts", flush=True)
    for found in run(tasks[1], options.jobs):
        text = describe(found, control)
        if options.out:
            options.out.write_text(text)
    print(text)
    can_fail = count_beyond(find(control)) > 0
    if not can_fail:
        print("the control exceeds no limit")
    return can_fail and not count_beyond(find(found))


if __name__ == "__main__":
    sys.exit(0 if main() else 1)
