"""What point clouds cost: to take in, in ticks, and in STOP beside a person.

    python benchmarks/bench_cloud.py [--seconds 8] [--rays 160 125] [--voxel 0.05] …

A Panda works, supervised at 250 Hz unless told otherwise, while a person comes, reaches into the
cell and leaves. A camera beside them casts rays at 30 Hz among the person's bodies, the arm and a
background, and what it sees goes the way of a user: `CloudFilter.find_others` leaves out the arm,
the background tells where nothing is, and `Obstacles.update_cloud` takes the rest. Beside that the
same person as nine bodies at the same 30 Hz, with velocities and without. The arm obeys nobody, so
that all see the same motion:

- bodies: balls and capsules with their velocities;
- no velocities: the same, whose velocities are not known;
- voxels: those of the camera, which go where rays have passed;
- snapshot: the same, all of them anew in each cloud;
- voxels + door: with an entrance behind the person, 2 m from the arm's base.

Printed: seconds of the scene that were supervised, rows in the table, what a cloud takes to filter
and to take in, what the tick after a message takes and the others, in milliseconds, and the share
of ticks in STOP. Times are of one core. A row ends when it has taken `--limit` seconds: its share
of STOP is then that of the scene's beginning.
"""

from __future__ import annotations

import argparse
import gc
import time

import numpy as np

from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.pairs import CloudFilter
from armguard.robot import Kinematics, Robot
from armguard.simulation.bodies import BODIES, POINTS, publish_person
from armguard.simulation.person import ProceduralPerson
from armguard.verdict import Level
from scene.crowds import RATE, Work
from scene.machine import describe_machine

EVERY = 32  # thousandths of a second between clouds
WAYS = ("bodies", "no velocities", "voxels", "snapshot", "voxels + door")
CAMERA, TARGET = np.array([2.4, -1.2, 1.3]), np.array([0.0, -0.7, 0.3])
BACKGROUND = 6.0  # along the camera's axis, [m]
LINKS_A_CAPSULE = 7


def make_rays(shape: tuple[int, int], view: float = 1.05) -> np.ndarray:
    """Directions of a camera's rays, of length 1 along its axis. Shape (n, 3)."""
    forward = (TARGET - CAMERA) / np.linalg.norm(TARGET - CAMERA)
    aside = np.cross(forward, [0.0, 0.0, 1.0])
    aside /= np.linalg.norm(aside)
    half = np.tan(0.5 * view)
    u, v = np.meshgrid(
        np.linspace(-half, half, shape[0]),
        np.linspace(-half, half, shape[1]) * shape[1] / shape[0],
    )
    return forward + u.reshape(-1, 1) * aside + v.reshape(-1, 1) * np.cross(aside, forward)


def cast(rays: np.ndarray, balls: np.ndarray) -> np.ndarray:
    """Where rays end among balls (n, 4) and before the background, in [m]. Shape (n, 3)."""
    depth, forward = np.full(len(rays), BACKGROUND), TARGET - CAMERA
    forward = forward / np.linalg.norm(forward)
    square = (rays**2).sum(axis=1)
    for *center, radius in balls:
        offset = np.array(center) - CAMERA
        axial = offset @ forward
        if not axial > 2.0 * radius:
            continue
        # Of length 1 along the axis, rays that may meet it pass this near its centre there.
        near = np.abs(rays - offset / axial).max(axis=1) <= 2.0 * radius / (axial - radius)
        near = np.flatnonzero(near)
        along = rays[near] @ offset
        root = along**2 - square[near] * (offset @ offset - radius**2)
        hit = np.where(root > 0.0, (along - np.sqrt(np.maximum(root, 0.0))) / square[near], np.inf)
        depth[near] = np.minimum(depth[near], hit)
    return CAMERA + depth[:, None] * rays


def fill_bodies(position: np.ndarray) -> np.ndarray:
    """The person's bodies as balls, centre and radius in [m]. Shape (n, 4)."""
    balls = []
    for body in BODIES:
        ends = [position[POINTS.index(name)] for name in (body.points[0], body.points[-1])]
        for share in np.linspace(0.0, 1.0, LINKS_A_CAPSULE if len(body.points) > 1 else 1):
            balls.append([*(ends[0] + share * (ends[1] - ends[0])), body.radius])
    return np.array(balls)


class Scene:
    """The arm's states, and what the camera sees every `EVERY` ticks."""

    def __init__(self, robot: Robot, options: argparse.Namespace) -> None:
        self.ticks = round(RATE * options.seconds)
        self.work = Work(robot, self.ticks, options.speed)
        self.person = ProceduralPerson(1, options.seconds)
        self.options = options
        kinematics = Kinematics(robot)
        leaves = kinematics.spheres.child_count == 0
        rays = make_rays(tuple(options.rays))
        self.clouds = []
        for tick in range(0, self.ticks, EVERY):
            kinematics.compute(self.work.q[tick], self.work.v[tick])
            arm = np.column_stack([kinematics.centers, kinematics.spheres.radius])[leaves]
            body = fill_bodies(self.person.sample(tick / RATE)[0])
            self.clouds.append(cast(rays, np.concatenate([arm, body])))
        spacing = np.linalg.norm(rays[1] - rays[0]) * np.linalg.norm(TARGET - CAMERA)
        # Half a diagonal between four rays.
        self.error = float(spacing / np.sqrt(2.0))


def run(way: str, robot: Robot, scene: Scene) -> list[str]:
    """The cells of one row of the table."""
    options, work = scene.options, scene.work
    obstacles = Obstacles(sources=["camera"])
    if way == "voxels + door":
        obstacles.add_entrance("door", [[-0.6, -2.0, 0.0], [0.6, -2.0, 0.0]], 0.3, 0.1)
    monitor = Monitor(robot, obstacles, rate=options.rate, operating="published")
    own = CloudFilter(robot)
    # Compiled before the first tick.
    obstacles.update_cloud("camera", 0.0, [], CAMERA, options.voxel)
    stops = 0
    filtering, intake, after, others, rows = [], [], [], [], []
    gc.collect()
    gc.disable()
    end = time.monotonic() + options.limit
    ticks = range(0, scene.ticks, round(RATE / options.rate))
    for tick in ticks:
        if time.monotonic() > end:
            break
        now, is_seen = tick / RATE, tick % EVERY == 0
        if is_seen and way in WAYS[:2]:
            position, velocity = scene.person.sample(now)
            error = np.zeros(len(POINTS))
            if way == "no velocities":
                velocity, error = np.zeros_like(velocity), np.full(len(POINTS), 2.0)
            begin = time.perf_counter()
            publish_person(obstacles, "camera", now, position, velocity, error)
            intake.append(time.perf_counter() - begin)
        elif is_seen:
            points = scene.clouds[tick // EVERY]
            begin = time.perf_counter()
            occupied = own.find_others(points, work.q[tick])
            # A user's own background model; here what is as far as nothing is.
            occupied &= (points - CAMERA) @ (TARGET - CAMERA) < (
                0.999 * BACKGROUND * np.linalg.norm(TARGET - CAMERA)
            )
            filtering.append(time.perf_counter() - begin)
            begin = time.perf_counter()
            obstacles.update_cloud(
                "camera",
                now,
                points,
                CAMERA,
                options.voxel,
                occupied=occupied,
                position_error=scene.error,
                snapshot=way == "snapshot",
            )
            intake.append(time.perf_counter() - begin)
        begin = time.perf_counter()
        verdict = monitor.step(now, work.q[tick], work.v[tick])
        (after if is_seen else others).append(time.perf_counter() - begin)
        stops += verdict.level is Level.STOP
        rows.append(len(obstacles))
    gc.enable()
    spent = [
        f"{1e3 * np.median(taken):.2f} / {1e3 * np.quantile(taken, 0.99):.2f}" if taken else "-"
        for taken in (filtering, intake, after, others)
    ]
    share = f"{100.0 * stops / len(rows):.1f} %"
    seconds = f"{len(rows) / options.rate:.2f}"
    return [seconds, f"{np.median(rows):.0f} / {max(rows)}", *spent, share]


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=8.0, help="of the person's visit")
    parser.add_argument("--rate", type=float, default=250.0, help="of the monitor, in [Hz]")
    parser.add_argument("--rays", type=int, nargs=2, default=(160, 125), help="across and down")
    parser.add_argument("--voxel", type=float, default=0.05, help="edge, in [m]")
    parser.add_argument("--speed", type=float, default=0.1, help="share of the joints' limits")
    parser.add_argument("--limit", type=float, default=120.0, help="seconds that a row may take")
    parser.add_argument("--ways", choices=WAYS, nargs="+", default=WAYS)
    options = parser.parse_args(arguments)
    robot = Robot.load("panda")
    print(describe_machine())
    scene = Scene(robot, options)
    across, down = options.rays
    print(
        f"{across * down:,} points at {RATE / EVERY:.0f} Hz, voxels of {options.voxel:g} m, "
        f"errors of {1e3 * scene.error:.0f} mm; ms, median / p99"
    )
    columns = ("seconds", "rows, most", "filter", "intake", "tick after", "other ticks", "STOP")
    print(f"{'':<14}" + "".join(f"{title:>16}" for title in columns))
    for way in options.ways:
        cells = run(way, robot, scene)
        print(f"{way:<14}" + "".join(f"{cell:>16}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
