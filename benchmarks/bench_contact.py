"""The ladder of contact times: what each rung costs, and how much of the converged time it gives.

    python benchmarks/bench_contact.py [--pairs 20000] [--repetitions 60]

Pairs are what a cell is made of: people and things, each against an arm's spheres. Nanoseconds are
of one core, a pair, over whole passes: the fastest, median, 99 % and slowest of the repetitions.
Shares are of the converged time, over all pairs whose contact time is neither 0 nor inf. In the
relative form (one body moves; no speed bound, so that the quartic is exact) it stands beside what
else there is.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable

import numpy as np
from numba import njit

from armguard.contact import earliest_contact
from armguard.contact.advancement import row_contact_time
from armguard.contact.bodies import Ball, Bounds
from scene.contact_batch import batch_contact_times, finish_contact_times

ARM_ACCEL, ARM_SPEED = 120.0, 8.0  # the isotropic bounds of a quick arm's hand
PERSON_ACCEL, PERSON_SPEED = 10.0, 2.0
SPHERES = 50  # of the arm, each against the same obstacle, before the next obstacle's turn


@njit(error_model="numpy")
def _distances(points, velocities, centers, motions, count, distance, out):  # type: ignore[no-untyped-def]  # arrays and numbers of a sweep
    """The plain loop that anyone would write: distance over the sum of the speed bounds."""
    for i in range(out.size):
        square = 0.0
        for k in range(3):
            square += (points[i, 0, k] - centers[i, k]) ** 2
        out[i] = max(0.0, (math.sqrt(square) - distance[i]) / (ARM_SPEED + PERSON_SPEED))


@njit(error_model="numpy")
def _rung(
    points, velocities, centers, motions, count, distance, out, advances, age, speeds, accels
):  # type: ignore[no-untyped-def]  # arrays and numbers of a sweep
    for first in range(0, out.size, SPHERES):
        for i in range(first, min(first + SPHERES, out.size)):
            sphere = Ball(
                centers[i, 0], centers[i, 1], centers[i, 2],
                motions[i, 0], motions[i, 1], motions[i, 2],
                Bounds(ARM_ACCEL * accels, ARM_SPEED * speeds, 0.0, age),
            )  # fmt: skip
            out[i] = row_contact_time(
                sphere, points, velocities, first, count,
                Bounds(PERSON_ACCEL * accels, PERSON_SPEED * speeds, 0.0, age), distance[i],
                advances, None,
            )  # fmt: skip


def _numpy_roots(position, velocity, distance, accel):  # type: ignore[no-untyped-def]  # arrays and numbers of a sweep
    """The quartic's smallest positive root by numpy.roots, a pair at a time."""
    out = np.empty(len(position))
    for i, (x, v, eps, a) in enumerate(zip(position, velocity, distance, accel, strict=True)):
        roots = np.roots([-a * a / 4, 0, v @ v - eps * a, 2 * v @ x, x @ x - eps * eps])
        real = roots.real[(abs(roots.imag) < 1e-9 * abs(roots)) & (roots.real > 0)]
        out[i] = real.min() if real.size else math.inf
    return out


def _numpy_advances(position, velocity, distance, accel, advances):  # type: ignore[no-untyped-def]  # arrays and numbers of a sweep
    """Conservative advancement over whole NumPy arrays, without care for rounding."""
    t = np.zeros(len(position))
    for _ in range(advances):
        ahead = position + velocity * t[:, None]
        ahead /= np.linalg.norm(ahead, axis=1)[:, None]
        gap = np.einsum("ij,ij->i", ahead, position) - distance
        closing = -np.einsum("ij,ij->i", ahead, velocity)
        root = np.sqrt(np.maximum(closing**2 + 2 * accel * gap, 0.0))
        t = np.maximum(
            t, np.where(closing >= 0, 2 * gap / (closing + root), (root - closing) / accel)
        )
    return t


def _time(work: Callable[[], object], pairs: int, repetitions: int) -> list[float]:
    work()
    spent = []
    for _ in range(repetitions):
        start = time.perf_counter()
        work()
        spent.append((time.perf_counter() - start) / pairs * 1e9)
    return [min(spent), *np.quantile(spent, [0.5, 0.99]), max(spent)]


def _line(name: str, spent: list[float], times=None, converged=None) -> None:  # type: ignore[no-untyped-def]  # arrays and numbers of a sweep
    text = f"{name:<44}" + "".join(f"{ns:10.1f}" for ns in spent)
    if times is not None:
        usual = (converged > 0.0) & np.isfinite(converged)
        share = times[usual] / converged[usual]
        text += f"   {share.mean():8.5f} {np.quantile(share, 0.01):8.5f} {share.min():8.5f}"
    print(text, flush=True)


def _head(title: str) -> None:
    print(
        f"\n{title}\n{'ns a pair':<44}{'fastest':>10}{'median':>10}{'p99':>10}{'max':>10}", end=""
    )
    print(f"   {'mean':>8} {'1 %':>8} {'worst':>8}  of the converged time")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=20_000)
    parser.add_argument("--repetitions", type=int, default=60)
    options = parser.parse_args()
    n, repetitions = options.pairs, options.repetitions
    rng = np.random.default_rng(0)
    centers = rng.normal(size=(n, 3)) * 0.4
    motions = rng.normal(size=(n, 3)) * 0.4
    distance = rng.uniform(0.05, 0.3, n)
    out = np.empty(n)

    for title, count, age, speeds in (
        ("Spheres, with speed bounds", 1, 0.0, 1.0),
        ("Spheres, with speed bounds, states 10 ms old", 1, 0.01, 1.0),
        ("Spheres, without speed bounds", 1, 0.0, math.inf),
        ("Capsules, with speed bounds", 2, 0.0, 1.0),
        ("Boxes, with speed bounds", 8, 0.0, 1.0),
    ):
        middle = rng.normal(size=(n, 1, 3)) * 1.5
        points = middle + rng.normal(size=(n, 8, 3)) * 0.15
        velocities = np.repeat(rng.normal(size=(n, 1, 3)) * 0.6, 8, axis=1)
        arrays = (points, velocities, centers, motions, count, distance, out)
        _head(title)
        _rung(*arrays, 60, age, speeds, 1.0)
        converged = out.copy()
        if count == 1 and age == 0.0 and speeds == 1.0:
            _line("plain distance loop", _time(lambda a=arrays: _distances(*a), n, repetitions))
        if speeds == 1.0:
            spent = _time(lambda a=arrays, s=age: _rung(*a, 1, s, 1.0, math.inf), n, repetitions)
            _line("distance over speed bounds", spent, out, converged)
        for advances in (1, 2, 3, 4, 8, 60):
            spent = _time(
                lambda a=arrays, k=advances, s=age, v=speeds: _rung(*a, k, s, v, 1.0),
                n,
                repetitions,
            )
            _line(f"{advances} advances", spent, out, converged)

    _head("Relative form, without speed bounds, beside what else there is")
    position = rng.normal(size=(n, 3)) * 1.5
    velocity = rng.normal(size=(n, 3)) * 0.7
    accel = np.full(n, 20.0)
    converged = np.asarray(earliest_contact(position, velocity, distance, accel, advances=60))
    few = slice(0, n // 20)
    pairs = [array[few] for array in (position, velocity, distance, accel)]
    spent = _time(lambda: _numpy_roots(*pairs), n // 20, 5)
    _line("numpy.roots", spent, _numpy_roots(*pairs), converged[few])
    for advances in (1, 3):
        arguments = (position, velocity, distance, accel, advances)
        spent = _time(lambda a=arguments: _numpy_advances(*a), n, repetitions)
        _line(f"NumPy, {advances} advances, unsafe", spent, _numpy_advances(*arguments), converged)
    speed = np.full(n, math.inf)
    columns = [np.ascontiguousarray(c) for c in (*position.T, *velocity.T, distance, accel, speed)]
    times, before = np.empty(n), np.empty(n)
    for advances in (1, 2, 3):
        spent = _time(
            lambda k=advances: batch_contact_times(*columns, k, times, before), n, repetitions
        )
        _line(f"batch, {advances} advances", spent, times, converged)

    def finished() -> None:
        batch_contact_times(*columns, 3, times, before)
        finish_contact_times(*columns, 60, times, before)

    _line("batch, 3 advances, finished", _time(finished, n, repetitions), times, converged)
    for advances in (1, 2, 3, 8):
        arguments = (position, velocity, distance, accel)
        result = earliest_contact(*arguments, advances=advances)
        spent = _time(
            lambda a=arguments, k=advances: earliest_contact(*a, advances=k), n, repetitions
        )
        _line(f"earliest_contact, {advances} advances", spent, result, converged)


if __name__ == "__main__":
    main()
