"""A depth camera beside an arm, from exposures to verdicts, with noise, holes and flying pixels.

Needs the extra `mujoco`, and EGL or OSMesa to render without a screen: `apt-get install libegl1`.

    python demos/10_depth_camera.py --seconds 60 [--no-view]

It runs three processes. The *camera* renders depth images at 30 Hz, adds the errors that its
manufacturer states, and publishes point clouds with the stamps of their exposure. The *monitor*
removes the arm from them and makes voxels from the rest (`depth_camera.toml`). The *arm*, in this
process, publishes its joint states at 500 Hz and obeys the verdicts, while a person walks up to it,
reaches in, and leaves. MuJoCo measures the true distances. With `main(is_obeying=False)` the arm
ignores the monitor.

A body that the camera does not see does not exist for the monitor (`snapshot=True`). So this cell
has premises. Fences close all sides except the gate. No person is in the shadow of the arm or of
another person. No part of a person is in a hole of the image, flat on the table, or within the
blind shell around the arm without another part in view beside it. Errors of depths are within four
standard deviations.
"""

import argparse
import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
import pinocchio

from armguard.app.cell.cell import Cell
from armguard.app.loop import Observer, RunOptions, run
from armguard.app.processes import end_with
from armguard.app.view_feed import MonitorFeed
from armguard.bridges.depth import Background, PinholeCamera, find_flying, stereo_error
from armguard.bridges.mujoco import MujocoJoints, add_arm, find_renderer
from armguard.exceptions import ArmguardError
from armguard.lab.simulation import JointTrajectory, SimulatedArm
from armguard.lab.simulation.depth_sensor import StereoSensor
from armguard.lab.simulation.mujoco_person import MujocoPerson
from armguard.lab.simulation.person import ProceduralPerson
from armguard.streams import Publisher, VerdictReader
from armguard.verdict import Effect, Verdict
from armguard.view.process import launch
from armguard.view.publisher import FramePublisher

CELL = Path(__file__).with_name("depth_camera.toml")
PERIOD, CHECK_TICKS = 0.002, 5  # [s] between joint states; true distances at 100 Hz
WAY = [[-1.4, 0.2, 0.0, -2.0, 0.0, 2.1, 0.8], [0.7, 0.3, 0.0, -1.9, 0.0, 2.2, 0.8]]  # [rad]
FAR = 1.2  # a STOP with the person farther away than this is a false one, [m]
VISIT = 20.0  # of the person, again and again, [s]
FLOOR = -0.75  # [m]
LATENCIES = 4096  # that are kept
TOKEN = "demo"  # of resets

# A RealSense D455: 848 x 480 pixels, decimated to 256 x 144; its field of view is 87 by 58 degrees.
RATE, SIZE = 30.0, (144, 256)
CAMERA = PinholeCamera((135.0, 135.0), (127.5, 71.5), nearest=0.5, farthest=6.0)
SENSOR = StereoSensor(CAMERA, 447.0, 0.095)
RIM = 16  # pixels at the border of an image that only tell what is empty: voxels need rays around
RANGE = 2.6  # what is farther away only tells what is empty, [m]
STEP = 0.12  # between two depths of one surface, at most, [m]
VOXEL = 0.08  # [m]
ERROR = CAMERA.position_error(RANGE, float(stereo_error(RANGE, *SENSOR[1:])), SIZE)


class Outcome(NamedTuple):
    """What happened."""

    contacts: int
    """How often the true person touched the arm while it moved."""
    least_moving_distance: float
    """Of the true person from the arm while it moved, in [m]."""
    latency: tuple[float, float]
    """From exposure to verdict, in [s]: of half of the clouds, and of 99 %."""
    levels: dict[str, float]
    """Share of time in each level."""
    false_stops: float
    """Share of the time with the person far away in which the verdict was STOP."""


class Shared:
    """Memory that the processes share: the true state, and figures to print."""

    def __init__(self, folder: Path, *, is_new: bool = False) -> None:
        kept = np.memmap(folder / "shared", float, "w+" if is_new else "r+", shape=LATENCIES + 16)
        # Eight numbers are written at once, or nearly so: a reader may find joints of two ticks.
        self.state = kept[:8]
        """When the arm was there, in [s], and its joints, in [rad]."""
        self.begin = kept[8:9]
        """When the person's first visit begins, in [s]."""
        self.counts = kept[9:13]
        """Of the newest cloud: its pixels, holes, flying pixels, and points of obstacles."""
        self.done = kept[13:14]
        """How many latencies there are."""
        self.latencies = kept[16:]
        """The newest ones, in [s]."""


class World:
    """The true arm, table and person."""

    def __init__(self, robot, pose: pinocchio.SE3) -> None:
        kinds, spec = mujoco.mjtGeom, mujoco.MjSpec()
        add_arm(spec, robot)
        self.body = MujocoPerson(spec, FLOOR, group=1)
        spec.worldbody.add_geom(type=kinds.mjGEOM_PLANE, pos=[0, 0, FLOOR], size=[9, 9, 1])
        spec.worldbody.add_geom(type=kinds.mjGEOM_BOX, pos=[0.3, 0, -0.045], size=[0.6, 0.6, 0.02])
        # MuJoCo's cameras look along -z, and their y is up.
        turned = pinocchio.Quaternion(pose.rotation * [1.0, -1.0, -1.0])
        view = np.degrees(2.0 * np.arctan(0.5 * SIZE[0] / CAMERA.focal_length[1]))
        quat = [turned.w, turned.x, turned.y, turned.z]
        spec.worldbody.add_camera(name="camera", pos=pose.translation, quat=quat, fovy=view)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.person = ProceduralPerson(1, VISIT)
        links, parts = [self.model.geom(link).id for link in robot.links], self.body.find_geoms
        self.model.geom_group[links] = 1
        self.pairs = [(link, part) for link in links for part in parts(self.model)]
        self.dofs = MujocoJoints(self.model, robot).dofs

    def place(self, q, time: float) -> None:
        """Put the arm there, and the person where they are at a time in [s]."""
        self.data.qpos[self.dofs] = q
        self.body.place(self.model, self.data, self.person.sample(max(0.0, time) % VISIT)[0])
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def measure(self) -> float:
        """Distance of the person from the arm, in [m]; below 0 they overlap, 4 is 4 or more."""
        return min(
            mujoco.mj_geomDistance(self.model, self.data, *pair, 4.0, None) for pair in self.pairs
        )


def run_camera(folder: Path) -> None:
    """Look at the true state, and publish clouds, until this process is told to end."""
    cell, shared, random = Cell.load(CELL), Shared(folder), np.random.default_rng(0)
    world = World(cell.make_robot(), cell.frames["camera"].transform)
    renderer = mujoco.Renderer(world.model, *SIZE)
    renderer.enable_depth_rendering()
    empty, background = mujoco.MjvOption(), Background()
    empty.geomgroup[1] = 0
    mujoco.mj_forward(world.model, world.data)
    renderer.update_scene(world.data, "camera", empty)
    true = renderer.render().astype(float)
    for _ in range(30):
        background.learn(CAMERA.read(SENSOR.expose(true, random)))
    inner = np.zeros(SIZE, bool)
    inner[RIM:-RIM, RIM:-RIM] = True
    publisher, exposed = Publisher(f"ipc://{folder}/obstacles", source="camera"), None
    tick = time.monotonic()
    while True:
        if exposed is not None:
            stamp, image = exposed  # a camera takes one period to hand over what it saw
            depth = CAMERA.read(image)
            flying = find_flying(depth, STEP)
            occupied = background.find_nearer(depth, stereo_error(depth, *SENSOR[1:]))
            occupied &= inner & ~flying & (depth <= RANGE)
            publisher.cloud(
                CAMERA.place(depth),
                stamp,
                np.zeros(3),
                VOXEL,
                occupied=occupied.ravel(),
                position_error=ERROR,
                frame="camera",
                snapshot=True,
            )
            holes = np.isnan(depth).sum()
            shared.counts[:] = depth.size, holes, flying.sum(), occupied.sum()
            exposed = None
        stamp, *q = shared.state
        if stamp > 0.0:
            world.place(q, stamp - shared.begin[0])
            renderer.update_scene(world.data, "camera")
            exposed = stamp, SENSOR.expose(renderer.render().astype(float), random)
        tick = max(tick + 1.0 / RATE, time.monotonic() - 1.0 / RATE)
        time.sleep(max(0.0, tick - time.monotonic()))


class Latencies(Observer):
    """Notes how long it takes from an exposure to the verdict that rests on it; feeds the view."""

    def __init__(self, shared: Shared, publisher: FramePublisher | None) -> None:
        self.shared, self.publisher, self.newest, self.feed = shared, publisher, -np.inf, None

    def observe(self, loop, verdict) -> None:
        """Called with each verdict after it was published."""
        now, monitor = loop.clock.now(), loop.monitor
        newest = max((one[2] for one in monitor.obstacles.heard_sources), default=-np.inf)
        if newest > self.newest and verdict.sequence:
            self.newest, place = newest, int(self.shared.done[0])
            self.shared.latencies[place % LATENCIES] = now - newest
            self.shared.done[0] += 1
        if self.publisher is not None:
            self.feed = self.feed or MonitorFeed(monitor, self.publisher)
            self.feed.observe(verdict, now, loop.durations, loop.late)


def run_monitor(folder: Path, show: bool) -> None:
    """Supervise the cell until this process is told to end."""
    addresses = (f"ipc://{folder}/{name}" for name in ("obstacles", "joints", "verdicts"))
    with contextlib.ExitStack() as resources:
        publisher = None
        if show:
            publisher = resources.enter_context(FramePublisher("tcp://127.0.0.1:*"))
            page = resources.enter_context(launch(publisher.address, 0, floor=FLOOR))
            print(f"what the monitor sees: {page.url}", flush=True)
        observer = Latencies(Shared(folder), publisher)
        options = RunOptions(*addresses, reset_token=TOKEN)
        run(Cell.load(CELL), options, observer=observer)


def main(duration: float = 40.0, is_obeying: bool = True, show: bool = False) -> Outcome:
    """Let the arm work for `duration` seconds, once all processes run; what happened."""
    renderer = find_renderer()
    if renderer is None:
        raise ArmguardError(
            "MuJoCo",
            "cannot render without a screen here",
            remedy="apt-get install libegl1, or libosmesa6",
        )
    cell = Cell.load(CELL)
    robot = cell.make_robot()
    operating = cell.monitor_settings(robot)["operating"]
    way = JointTrajectory(robot, WAY, speed_fraction=0.24, acceleration_fraction=0.25, loop=True)
    arm, world = SimulatedArm(way, operating), World(robot, cell.frames["camera"].transform)
    levels, least, contacts, far, stopped, is_touching = {}, np.inf, 0, 0, 0, False
    with contextlib.ExitStack() as resources:
        folder = Path(resources.enter_context(tempfile.TemporaryDirectory()))
        shared = Shared(folder, is_new=True)
        shared.begin[0] = np.inf
        for role in ("camera", "monitor"):
            options = ["--role", role, "--folder", str(folder), *([] if show else ["--no-view"])]
            process = subprocess.Popen(
                [sys.executable, __file__, *options], env={**os.environ, "MUJOCO_GL": renderer}
            )
            resources.callback(process.wait)
            resources.callback(process.terminate)
        publisher = resources.enter_context(Publisher(f"ipc://{folder}/joints"))
        reader = resources.enter_context(VerdictReader(f"ipc://{folder}/verdicts"))
        tick, number, reset = time.monotonic(), 0, -np.inf
        patience = tick + 180.0  # a new machine compiles first
        while tick < shared.begin[0] + duration:
            verdict, scale = reader.latest(), reader.speed_scale()
            if shared.begin[0] == np.inf and scale > 0.0:
                shared.begin[0], shared.done[0] = tick, 0
            if shared.begin[0] == np.inf and tick > patience:
                reasons = "; ".join(map(str, verdict.reasons)) if verdict else "no verdicts"
                raise ArmguardError("monitor", f"does not let the arm move: {reasons}")
            if shared.begin[0] == np.inf and is_latched(verdict) and tick > reset + 1.0:
                # The start of the others held up this process, so joint states were missing.
                publisher.reset(TOKEN)
                reset = tick
            has_begun = shared.begin[0] < np.inf
            q, v = arm.step(PERIOD, 1.0 if has_begun and not is_obeying else scale)
            shared.state[:] = tick, *q
            publisher.joints(tick, robot.joints, q, v)
            now = tick - shared.begin[0]
            if now >= 0.0:
                name = "silence" if reader.silent() else verdict.level.name
                levels[name] = levels.get(name, 0) + 1
                if number % CHECK_TICKS == 0:
                    world.place(q, now)
                    distance = world.measure()
                    if v.any():
                        least = min(least, distance)
                        contacts += distance <= 0.0 and not is_touching
                        is_touching = distance <= 0.0
                    far += distance > FAR
                    if distance > FAR and name == "STOP":
                        stopped += 1
                        name = f"{name} (false: {verdict.reasons[0]})"
                number += 1
                if number % round(1.0 / PERIOD) == 1:
                    tell(now, name, distance, shared)
            tick += PERIOD
            time.sleep(max(0.0, tick - time.monotonic()))
    taken = shared.latencies[: int(min(shared.done[0], LATENCIES))]
    latency = tuple(np.percentile(taken, [50, 99])) if len(taken) else (np.nan, np.nan)
    shares = {name: count / number for name, count in levels.items()}
    outcome = Outcome(contacts, least, latency, shares, stopped / max(far, 1))
    print(
        f"contacts while the arm moved: {contacts}, least distance then {1000 * least:.0f} mm; "
        f"exposure to verdict {1000 * latency[0]:.0f} / {1000 * latency[1]:.0f} ms (p50 / p99); "
        f"false STOP {outcome.false_stops:.1%}; "
        + ", ".join(f"{name} {share:.0%}" for name, share in sorted(shares.items()))
    )
    return outcome


def is_latched(verdict: Verdict | None) -> bool:
    """Whether only a reset ends the STOP."""
    reasons = () if verdict is None else verdict.reasons
    return any(reason.kind.effect is Effect.LATCHED for reason in reasons)


def tell(now: float, name: str, distance: float, shared: Shared) -> None:
    """Print a line about the last second."""
    done = int(shared.done[0])
    newest = shared.latencies[np.arange(max(0, done - round(RATE)), done) % LATENCIES]
    half, most = 1000 * np.percentile(newest, [50, 99]) if done else (np.nan, np.nan)
    pixels, holes, flying, occupied = shared.counts.astype(int)
    print(
        f"{now:4.0f} s: {name:7} person {distance:4.2f} m; exposure to verdict {half:3.0f} / "
        f"{most:3.0f} ms; {occupied:,} points of {pixels:,}, without {holes:,} holes, "
        f"{flying:,} flying",
        flush=True,
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=40.0)
    parser.add_argument("--no-view", action="store_true")
    parser.add_argument("--role", choices=["camera", "monitor"], help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.role is None:
        main(options.seconds, show=not options.no_view)
    else:
        end_with(os.getppid())
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # what started it ends it
        if options.role == "camera":
            run_camera(options.folder)
        else:
            run_monitor(options.folder, not options.no_view)
