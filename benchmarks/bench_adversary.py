"""Obstacles and an arm that try to beat the monitor, and know its schedule: contacts missed.

    python benchmarks/bench_adversary.py --pair-ticks 1e8 --seed 0
    python benchmarks/bench_adversary.py --close --near 1e6 --pair-ticks 0 --obstacles 60

A pair-tick is one link and one obstacle in one tick. In each tick after which the arm may go on,
attacks that every bound allows are tried out on the true state: a miss is one that touches the arm
before it rests, though the arm obeys the STOP of the next tick.

Pair-ticks within 50 ms of contact are counted by themselves: those that do not touch, and truly
could by then, by motions that are tried out on the true state; in them the contact time must not
come later than these. Of an arm that needs longer to stop they are few, and all in a STOP. So with
`--close` all obstacles attack from right beside an arm that is slow and whose brakes bite at once;
the second line takes some ten minutes of a core.

A control follows, a tenth as long: an arm that takes `--control` seconds to brake, of which the
monitor does not know. What is looked for has to be found there.
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
CONTROL_SHARE = 0.1  # of what is asked for


def show(score: Score, spent: float) -> str:
    """One line of progress."""
    return (
        f"{score.pair_ticks:.3g} pair-ticks in {spent:.0f} s, {score.near:,} within 50 ms of "
        f"contact ({score.near_open:,} of an arm that moved or might): missed {score.missed}, "
        f"hits {score.hits}, contact times too late {score.early}, scales too fast "
        f"{score.too_fast}; GO {score.goes / max(score.ticks, 1):.0%}, {score.stops} stops, "
        f"{score.tried} attacks at close range, closest {1e3 * score.worst:.2f} mm "
        f"({1e3 * score.worst_time:.2f} mm within contact times, {1e3 * score.worst_scale:.2f} mm "
        f"at the speed scale)"
    )


def hunt(options: argparse.Namespace, share: float, true_reaction: float | None) -> Score:
    """Hunt for a share of what is asked for, and print what comes of it."""
    hunting = options.obstacles if options.close else options.hunting
    world = Hunt(
        Robot.load(options.robot),
        options.seed,
        options.obstacles,
        hunting,
        true_reaction=true_reaction,
        close=options.close,
        rate=options.rate,
        max_staleness=options.max_staleness,
        schedule=options.schedule,
    )
    pair_ticks, near = share * options.pair_ticks, share * options.near
    began = shown = time.monotonic()
    while world.score.pair_ticks < pair_ticks or world.score.near < near:
        world.advance()
        now = time.monotonic()
        if now - shown > REPORT_EVERY:
            shown = now
            print(show(world.score, now - began), flush=True)
    print(show(world.score, time.monotonic() - began), flush=True)
    return world.score


def main(arguments: list[str] | None = None) -> tuple[Score, Score | None]:
    """Hunt, and again with the control; print what came of it, and return that."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pair-ticks", type=float, default=1e8)
    parser.add_argument(
        "--near", type=float, default=0.0, help="and so many within 50 ms of contact"
    )
    parser.add_argument("--close", action="store_true", help="all attack from beside the arm")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--robot", default="panda")
    parser.add_argument("--obstacles", type=int, default=400)
    parser.add_argument("--hunting", type=int, default=16, help="of these, how many attack")
    parser.add_argument("--rate", type=float, default=1000.0, help="ticks a second")
    parser.add_argument("--max-staleness", type=float, default=0.1)
    parser.add_argument("--schedule", default="deadline")
    parser.add_argument(
        "--control",
        type=float,
        default=0.2,
        help="seconds that its arm takes to brake, much more than the monitor knows of; 0: none",
    )
    options = parser.parse_args(arguments)
    score = hunt(options, 1.0, None)
    for field, value in score._asdict().items():
        print(f"  {field:12} {value:.6g}" if math.isfinite(value) else f"  {field:12} none")
    if not options.control > 0.0:
        return score, None
    print(f"control, an arm that takes {options.control:g} s to brake:", flush=True)
    return score, hunt(options, CONTROL_SHARE, options.control)


if __name__ == "__main__":
    found, control = main()
    is_blind = control is not None and not control.missed
    sys.exit(1 if found.missed or found.hits or found.early or found.too_fast or is_blind else 0)
