"""What benchmarks beside the first seconds of each recording have in common: options and cases."""

from __future__ import annotations

import argparse
from typing import Any, TypeVar

from bench_recordings import BOUNDS, PLACEMENTS, Case, Run, find_recordings, place_base
from scene.contestants import Scope
from scene.recorded_people import People

RATE = 100.0
"""Of ticks, in [Hz]."""
USUAL = next(iter(BOUNDS))
"""Name of the bounds on people."""

AnyPeople = TypeVar("AnyPeople", bound=People)


def add_options(parser: argparse.ArgumentParser, *, placements: int) -> None:
    """Add what all of them can be told; `placements` is the default."""
    parser.add_argument("--speeds", type=float, nargs="+", default=[0.3, 0.8], help="[rad/s]")
    parser.add_argument("--seconds", type=float, default=8.0, help="of each recording, at most")
    text = f"at most {len(PLACEMENTS)}"
    parser.add_argument("--placements", type=int, default=placements, help=text)
    parser.add_argument("--recordings", type=int, default=None, help="only so many of them")


def list_cases(options: argparse.Namespace, speed: float) -> list[Case]:
    """All cases at a speed of the fastest joint in [rad/s]."""
    return [
        Case(speed, path, placement, 0)
        for path in find_recordings()[: options.recordings]
        for placement in range(options.placements)
    ]


def make_run(scope: Scope, seconds: float) -> Run:
    """What all cases have in common."""
    return Run(scope, False, RATE, seconds)


def place_people(case: Case, kind: type[AnyPeople], *arguments: Any) -> AnyPeople:
    """The recorded person of a case, of one kind of `People`, with its further arguments."""
    base = place_base(*PLACEMENTS[case.placement])
    return kind(case.path, base, {USUAL: BOUNDS[USUAL]}, *arguments)
