"""Obstacles and an arm that try to beat the monitor, and know its schedule: contacts missed.

    python benchmarks/bench_adversary.py --pair-ticks 1e8 --seed 0

A pair-tick is one link and one obstacle in one tick. In each tick after which the arm may go on,
attacks that every bound allows are tried out on the true state: a miss is one that touches the arm
before it rests, though the arm obeys the STOP of the next tick.
"""

from __future__ import annotations

import argparse
import math
import sys
import time

from armguard.robot import Robot
from support.adversary import Hunt
from support.adversary_score import Score

REPORT_EVERY = 20.0  # seconds


def show(score: Score, spent: float) -> str:
    """One line of progress."""
    return (
        f"{score.pair_ticks:.3g} pair-ticks in {spent:.0f} s: missed {score.missed}, "
        f"hits {score.hits}, contact times too late {score.early}, scales too fast "
        f"{score.too_fast}; GO {score.goes / max(score.ticks, 1):.0%}, {score.stops} stops, "
        f"{score.tried} attacks at close range, closest {1e3 * score.worst:.2f} mm "
        f"({1e3 * score.worst_time:.2f} mm within contact times, {1e3 * score.worst_scale:.2f} mm "
        f"at the speed scale)"
    )


def main(arguments: list[str] | None = None) -> Score:
    """Hunt, print what came of it, and return that."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pair-ticks", type=float, default=1e8)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--robot", default="panda")
    parser.add_argument("--obstacles", type=int, default=400)
    parser.add_argument("--hunting", type=int, default=16, help="of these, how many attack")
    parser.add_argument("--rate", type=float, default=1000.0, help="ticks a second")
    parser.add_argument("--max-staleness", type=float, default=0.25)
    parser.add_argument("--schedule", default="deadline")
    parser.add_argument(
        "--true-reaction",
        type=float,
        default=None,
        help="what the arm takes to brake; more than the monitor's 0.02 s must show misses",
    )
    options = parser.parse_args(arguments)
    hunt = Hunt(
        Robot.load(options.robot),
        options.seed,
        options.obstacles,
        options.hunting,
        true_reaction=options.true_reaction,
        rate=options.rate,
        max_staleness=options.max_staleness,
        schedule=options.schedule,
    )
    began = shown = time.monotonic()
    part = min(options.pair_ticks, 1e5)
    while hunt.score.pair_ticks < options.pair_ticks:
        hunt.run(min(hunt.score.pair_ticks + part, options.pair_ticks))
        now = time.monotonic()
        if now - shown > REPORT_EVERY:
            shown = now
            print(show(hunt.score, now - began), flush=True)
    score = hunt.score
    print(show(score, time.monotonic() - began))
    for field, value in score._asdict().items():
        print(f"  {field:12} {value:.6g}" if math.isfinite(value) else f"  {field:12} none")
    return score


if __name__ == "__main__":
    found = main()
    sys.exit(1 if found.missed or found.hits or found.early else 0)
