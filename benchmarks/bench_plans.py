"""Arms on committed pieces, to which all happens that may: is one ever touched while it moves?

    python benchmarks/bench_plans.py --worlds 10000
    python benchmarks/bench_plans.py --worlds 300 --arms panda --seed 1

Pieces overlap, begin later, replace one another, and lead aside until their answers arrive; answers
are lost or late; balls appear at any time, are hidden for a while, and are seen more or less
exactly; joint states may be late, and brakes engage at any time. `tests/support/plan_hunt.py` says
what a world is, and by which premises it keeps. Worlds are shared out among arms, latencies, and
joints that may leave a piece or not. Nothing must touch an arm that moves, and the piece that an
arm is on must always be among those that are kept.

A control follows, a twentieth as long: an arm that takes every piece for safe that is in order, and
obeys no STOP. Contacts have to be found there.
"""

from __future__ import annotations

import argparse
import sys
import time

from support.example_arms import load_holding
from support.plan_hunt import PlanHunt, Score

ARMS = ("panda", "ur10", "kinova")
LATENCIES = (0.0, 0.02, 0.1)  # [s]
REPORT_EVERY = 20.0  # [s]
CONTROL_SHARE = 0.05


def show(score: Score, spent: float) -> str:
    """One line of progress."""
    return (
        f"{score.worlds:,} worlds in {spent:.0f} s: {score.contacts} with a contact, "
        f"{score.astray} with an arm on a piece that is not kept; {score.shown:,} pieces shown, "
        f"{score.safe:,} safe, {score.lost:,} of these answers lost, {score.followed:,} followed, "
        f"{score.aside:,} of them led aside before; {score.balls:,} balls appeared, {score.near:,} "
        f"worlds with one within 2 cm, {score.vague:,} vague samples; brakes engaged "
        f"{score.brakes:,} times"
    )


def hunt(arms: list[str], worlds: int, seed: int, *, trusts_all: bool) -> Score:
    """Play worlds, as many of each kind, and print what comes of them."""
    kinds = [(arm, latency, leave) for arm in arms for latency in LATENCIES
             for leave in ("never", "any")]  # fmt: skip
    whole = Score()
    began = shown = time.monotonic()
    for k, (arm, latency, leave) in enumerate(kinds):
        world = PlanHunt(
            load_holding(arm), [seed, k], latency=latency, leave=leave, trusts_all=trusts_all
        )
        for _ in range((worlds + k) // len(kinds)):
            world.play()
            now = time.monotonic()
            if now - shown > REPORT_EVERY:
                shown = now
                print(show(whole + world.score, now - began), flush=True)
        whole += world.score
    print(show(whole, time.monotonic() - began), flush=True)
    return whole


def main(arguments: list[str] | None = None) -> tuple[Score, Score | None]:
    """Play worlds, and those of the control; print what came of them, and return that."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--arms", nargs="+", default=list(ARMS))
    parser.add_argument("--no-control", action="store_true")
    options = parser.parse_args(arguments)
    found = hunt(options.arms, options.worlds, options.seed, trusts_all=False)
    if options.no_control:
        return found, None
    print("control, an arm that takes every piece for safe, and obeys no STOP:", flush=True)
    worlds = max(round(CONTROL_SHARE * options.worlds), 1)
    return found, hunt(options.arms, worlds, options.seed, trusts_all=True)


if __name__ == "__main__":
    found, control = main()
    is_blind = control is not None and not control.contacts
    sys.exit(1 if found.contacts or found.astray or is_blind else 0)
