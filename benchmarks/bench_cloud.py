"""What point clouds cost: to take in, in ticks, and in STOP beside a person.

    python benchmarks/bench_cloud.py [--seconds 8] [--rays 160 125] [--voxel 0.08] …
    python benchmarks/bench_cloud.py --ways "20,000 around" "narrow margins" --seconds 8

A Panda works, supervised at 250 Hz unless told otherwise, while a person comes, reaches into the
cell and leaves. A camera beside them casts rays at 30 Hz among the person's bodies, the arm and a
background, and what it sees goes the way of a user: `CloudFilter.find_others` leaves out the arm,
the background tells where nothing is, and `Obstacles.update_cloud` takes the rest. Beside that the
same person as nine bodies at the same 30 Hz, with velocities and without. The arm obeys nobody, so
that all see the same motion:

- bodies: balls and capsules with their velocities;
- no velocities: the same, whose velocities are not known;
- snapshot: voxels of a camera that sees the whole visit, all of them anew in each cloud;
- voxels: the same, which go where rays have passed;
- voxels + door: with an entrance behind the person, 2 m from the arm's base;
- edge of view: voxels of a camera into whose view the person walks from aside, and out of it;
- 20,000 around: no person, and a cell as full as it can be: as many voxels of 5 cm between 1.6 and
  2 m from the middle of the arm's reach, all of them anew in each cloud;
- narrow margins: the same with `slow_margin` 20 ms and `aware_margin` 50 ms, so that no more is
  refined than what decides about a STOP. The first cloud, which makes the table, does not count.

Printed: seconds of the scene that were supervised, rows in the table, what a cloud takes to filter
and to take in, what the tick after a message takes and the others, in milliseconds, the share of
ticks in STOP, and when the first STOP and the last one were. Times are of the thread on its core,
without what other programs take meanwhile, or with `--wall` as they pass on the wall. A row ends
when it has taken `--limit` seconds: its share of STOP is then that of the scene's beginning.
"""

from __future__ import annotations

import argparse
import gc
import time

import numpy as np

from armguard.lab.simulation import JointTrajectory
from armguard.lab.simulation.bodies import BODIES, POINTS, publish_person
from armguard.lab.simulation.person import ProceduralPerson
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.pairs import CloudFilter
from armguard.robot import Kinematics, Robot
from armguard.verdict import Level
from scene.crowds import WAYPOINTS
from scene.machine import describe_machine

CLOUD_RATE = 30.0  # or next to it, such that every cloud comes with a tick, [Hz]
AROUND = {  # settings of the monitor
    "20,000 around": {},
    "narrow margins": {"slow_margin": 0.02, "aware_margin": 0.05},
}
COUNT_AROUND, VOXEL_AROUND = 20_000, 0.05  # voxels and their edge, [m]
SHELL = (0.0, 0.0, 0.33), 1.6, 2.0  # middle, and distances from it, [m]
WAYS = ("bodies", "no velocities", "snapshot", "voxels", "voxels + door", "edge of view", *AROUND)
CAMERAS = {  # place and target in [m], angle of view across in [rad]
    "whole": ((3.2, -1.6, 1.2), (0.0, -1.6, 0.3), 1.22),
    "edge of view": ((2.4, -1.2, 1.3), (0.0, -0.7, 0.3), 1.05),
}
BACKGROUND = 6.0  # along the camera's axis, [m]
LINKS_A_CAPSULE = 7


class Camera:
    """A pinhole camera whose rays are a grid in its image plane.

    Attributes:
        place: Where it is, in [m]. Shape (3,).
        forward: Its axis, of length 1. Shape (3,).
        rays: Directions, of length 1 along the axis, row by row. Shape (down * across, 3).
        spacing: Between neighbouring rays, 1 m along the axis, in [m].
    """

    def __init__(self, place, target, view: float, across: int, down: int) -> None:
        self.place = np.array(place)
        self.forward = np.array(target) - self.place
        self.forward /= np.linalg.norm(self.forward)
        aside = np.cross(self.forward, [0.0, 0.0, 1.0])
        aside /= np.linalg.norm(aside)
        self._axes = np.array([aside, np.cross(aside, self.forward)])
        half = np.tan(0.5 * view)
        self._slopes = (
            np.linspace(-half, half, across),
            np.linspace(-half, half, down) * down / across,
        )
        u, v = np.meshgrid(*self._slopes)
        self.rays = self.forward + u.reshape(-1, 1) * aside + v.reshape(-1, 1) * self._axes[1]
        self.spacing = float(2.0 * half / (across - 1))
        self._square = 1.0 + u**2 + v**2

    def cast(self, balls: np.ndarray) -> np.ndarray:
        """Where rays end among balls (n, 4) and before the background, in [m]. Shape (n, 3)."""
        depth = np.full(self._square.shape, BACKGROUND)
        for *center, radius in balls:
            offset = np.array(center) - self.place
            axial, sides = offset @ self.forward, self._axes @ offset
            if not axial > 2.0 * radius:
                continue
            # What is in the ball, at (side + a) / (axial + b) with a² + b² ≤ radius², is no
            # farther from its centre's slope than this.
            slopes = sides / axial
            reach = radius * np.sqrt(1.0 + slopes**2) / (axial - radius)
            (left, right), (top, bottom) = (
                np.searchsorted(grid, [slope - width, slope + width])
                for grid, slope, width in zip(self._slopes, slopes, reach, strict=True)
            )
            window = np.s_[top:bottom, left:right]
            across, down = self._slopes[0][left:right], self._slopes[1][top:bottom, None]
            along, square = axial + sides[0] * across + sides[1] * down, self._square[window]
            root = along**2 - square * (offset @ offset - radius**2)
            hit = (along - np.sqrt(np.maximum(root, 0.0))) / square
            depth[window] = np.minimum(depth[window], np.where(root > 0.0, hit, np.inf))
        return self.place + depth.reshape(-1, 1) * self.rays

    def find_foreground(self, points: np.ndarray) -> np.ndarray:
        """Which points are nearer than the background. Shape (n,)."""
        return (points - self.place) @ self.forward < 0.999 * BACKGROUND


def fill_bodies(position: np.ndarray) -> np.ndarray:
    """The person's bodies as balls, centre and radius in [m]. Shape (n, 4)."""
    balls = []
    for body in BODIES:
        ends = [position[POINTS.index(name)] for name in (body.points[0], body.points[-1])]
        for share in np.linspace(0.0, 1.0, LINKS_A_CAPSULE if len(body.points) > 1 else 1):
            balls.append([*(ends[0] + share * (ends[1] - ends[0])), body.radius])
    return np.array(balls)


def surround() -> np.ndarray:
    """A point in each of the voxels around the arm, in [m]. Shape (n, 3)."""
    middle, nearest, farthest = SHELL
    across = np.arange(-farthest, farthest, VOXEL_AROUND) + 0.5 * VOXEL_AROUND
    up = across[across > 0.0]
    centers = np.stack(np.meshgrid(across, across, up), axis=-1).reshape(-1, 3)
    away = np.linalg.norm(centers - middle, axis=1)
    within = centers[(away > nearest) & (away < farthest)]
    return np.random.default_rng(0).permutation(within)[:COUNT_AROUND]


class View:
    """What a camera sees, cloud by cloud, and what its points may be off by, in [m]."""

    def __init__(self, camera: Camera, bodies: list[np.ndarray]) -> None:
        self.camera = camera
        self.clouds = [camera.cast(balls) for balls in bodies]
        self.farthest = max(
            float(((points - camera.place) @ camera.forward)[camera.find_foreground(points)].max())
            for points in self.clouds
        )
        # Half a diagonal between four rays, where they are farthest apart.
        self.error = self.farthest * camera.spacing / np.sqrt(2.0)


class Scene:
    """The arm's states in the monitor's ticks, and what the camera sees in every few of them."""

    def __init__(self, robot: Robot, options: argparse.Namespace) -> None:
        self.options = options
        self.ticks = round(options.rate * options.seconds)
        self.every = max(1, round(options.rate / CLOUD_RATE))
        trajectory = JointTrajectory(
            robot, WAYPOINTS, speed_fraction=options.speed, acceleration_fraction=0.5, loop=True
        )
        self.states = [trajectory.sample(tick / options.rate) for tick in range(self.ticks)]
        self.person = ProceduralPerson(1, options.seconds)
        bodies = self._place_bodies(robot)
        self.views = {
            way: View(Camera(*place, *options.rays), bodies) for way, place in CAMERAS.items()
        }
        self.around = surround()

    def _place_bodies(self, robot: Robot) -> list[np.ndarray]:
        """Arm and person as balls, centre and radius in [m], for each cloud. Shapes (n, 4)."""
        kinematics = Kinematics(robot)
        leaves = kinematics.spheres.child_count == 0
        bodies = []
        for tick in range(0, self.ticks, self.every):
            kinematics.compute(*self.states[tick])
            arm = np.column_stack([kinematics.centers, kinematics.spheres.radius])[leaves]
            person = fill_bodies(self.person.sample(tick / self.options.rate)[0])
            bodies.append(np.concatenate([arm, person]))
        return bodies


def run(way: str, robot: Robot, scene: Scene) -> list[str]:
    """The cells of one row of the table."""
    options = scene.options
    view = scene.views.get(way, scene.views["whole"])
    camera, clock = view.camera, time.perf_counter if options.wall else time.thread_time
    obstacles = Obstacles(sources=["camera"])
    if way == "voxels + door":
        obstacles.add_entrance("door", [[-0.6, -2.0, 0.0], [0.6, -2.0, 0.0]], 0.3, 0.1)
    voxel = VOXEL_AROUND if way in AROUND else options.voxel
    settings = AROUND.get(way, {})
    monitor = Monitor(robot, obstacles, rate=options.rate, operating="published", **settings)
    own = CloudFilter(robot)
    # Compiled before the first tick.
    obstacles.update_cloud("camera", 0.0, [], camera.place, voxel)
    stops = []
    filtering, intake, after, others, rows = [], [], [], [], []
    gc.collect()
    gc.disable()
    end = time.monotonic() + options.limit
    for tick, (q, v) in enumerate(scene.states):
        if time.monotonic() > end:
            break
        now, is_seen = tick / options.rate, tick % scene.every == 0
        if is_seen and way in WAYS[:2]:
            position, velocity = scene.person.sample(now)
            error = np.zeros(len(POINTS))
            if way == "no velocities":
                velocity, error = np.zeros_like(velocity), np.full(len(POINTS), 2.0)
            begin = clock()
            publish_person(obstacles, "camera", now, position, velocity, error)
            intake.append(clock() - begin)
        elif is_seen:
            points = scene.around if way in AROUND else view.clouds[tick // scene.every]
            begin = clock()
            occupied = own.find_others(points, q)
            if way not in AROUND:
                # A user's own background model; here what is as far as nothing is.
                occupied &= camera.find_foreground(points)
            filtering.append(clock() - begin)
            begin = clock()
            obstacles.update_cloud(
                "camera",
                now,
                points,
                camera.place,
                voxel,
                occupied=occupied,
                position_error=view.error,
                snapshot=way in ("snapshot", *AROUND),
            )
            intake.append(clock() - begin)
        begin = clock()
        verdict = monitor.step(now, q, v)
        (after if is_seen else others).append(clock() - begin)
        if verdict.level is Level.STOP:
            stops.append(now)
        rows.append(len(obstacles))
    gc.enable()
    if way in AROUND:
        filtering, intake, after = filtering[1:], intake[1:], after[1:]
    spent = [
        f"{1e3 * np.median(taken):.2f} / {1e3 * np.quantile(taken, 0.99):.2f}" if taken else "-"
        for taken in (filtering, intake, after, others)
    ]
    share = f"{100.0 * len(stops) / len(rows):.1f} %"
    between = f"{stops[0]:.1f} to {stops[-1]:.1f} s" if stops else "-"
    seconds = f"{len(rows) / options.rate:.2f}"
    return [seconds, f"{np.median(rows):.0f} / {max(rows)}", *spent, share, between]


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--seconds", type=float, default=8.0, help="of the person's visit, 8 or more"
    )
    parser.add_argument("--rate", type=float, default=250.0, help="of the monitor, in [Hz]")
    parser.add_argument("--rays", type=int, nargs=2, default=(160, 125), help="across and down")
    parser.add_argument("--voxel", type=float, default=0.08, help="edge, in [m]")
    parser.add_argument("--speed", type=float, default=0.1, help="share of the joints' limits")
    parser.add_argument("--limit", type=float, default=40.0, help="seconds that a row may take")
    parser.add_argument("--ways", choices=WAYS, nargs="+", default=WAYS)
    parser.add_argument("--wall", action="store_true", help="times as they pass on the wall")
    options = parser.parse_args(arguments)
    robot = Robot.load("panda")
    print(describe_machine())
    scene = Scene(robot, options)
    across, down = options.rays
    errors = ", ".join(f"{1e3 * view.error:.0f} mm ({way})" for way, view in scene.views.items())
    print(
        f"{across * down:,} points at {options.rate / scene.every:.1f} Hz, voxels of "
        f"{options.voxel:g} m, errors of points {errors}; monitor at {options.rate:g} Hz, arm at "
        f"{options.speed:.0%} of its joints' speeds; {'wall' if options.wall else 'thread'} time "
        "in ms, median / p99"
    )
    columns = (
        "seconds",
        "rows, most",
        "filter",
        "intake",
        "tick after",
        "other ticks",
        "STOP",
        "first to last",
    )
    print(f"{'':<14}" + "".join(f"{title:>16}" for title in columns))
    for way in options.ways:
        cells = run(way, robot, scene)
        print(f"{way:<14}" + "".join(f"{cell:>16}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
