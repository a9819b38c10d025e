"""Recorded people whose bodies yield where the arm presses on them, and the arm, both in MuJoCo.

Each body is a mass that a spring and a damper draw to where it was recorded. Its skin is another
spring and damper, between the body and the true surface of each link. The skin is computed here,
and not by MuJoCo's soft contacts, whose stiffness depends on the masses that touch. Each body
yields by itself, so a forearm that is pushed aside leaves its hand behind.

The arm has the masses of its description. A position loop holds it to what its controller wants,
with as much torque as that takes. What is measured of it is where it really is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from armguard.body_regions import NUMBERS
from armguard.bridges.mujoco import add_arm
from armguard.obstacles import Obstacles
from armguard.robot import Robot
from scene.clearance import Leaves
from scene.example_limits import FIGURES, PATTERNS_OF_REGIONS
from scene.recorded_people import IDS, NAMES, RADII, People, Stream
from scene.working_arm import WorkingArm

HEAD = (0.0, 150e3, 4.4)
"""Force in [N], stiffness in [N]/[m] and mass in [kg] of the head, assumed: it has no limit."""
RETURN = 2.0 * math.pi
"""How fast a body comes back to where it was recorded, in [1]/[s]; critically damped."""
DAMPING = 0.3
"""Of the skin, as a share of the critical one."""
BANDWIDTH = 2.0 * math.pi * 20.0
"""Of the position loop of each joint, in [1]/[s]; critically damped."""
FINE_STEP, NEAR = 2.5e-4, 0.03
"""Steps in [s] while a body is so near to a link, in [m]: skin is stiff."""


class Squeeze(NamedTuple):
    """What a link does to a body at one moment."""

    body: int
    link: int
    depth: float
    """How far it is in the skin, in [m]."""
    normal: np.ndarray
    """From the link to the body. Shape (3,)."""
    point: np.ndarray
    """Of the link's surface, the deepest, in [m]. Shape (3,)."""
    speed: float
    """Of that point, in [m]/[s]."""
    force: float
    """Of the skin, in [N]."""


class YieldingPeople(People):
    """As `People`, but the bodies yield; one case at a time.

    Attributes:
        limit_force: What a skin may be pressed with where it is clamped, in [N]. Shape (9,).
        stiffness: Of the skins, in [N]/[m]. Shape (9,).
        mass: Of the bodies, in [kg]. Shape (9,).
        squeezes: All that pressed a body in the last `advance`.
    """

    def __init__(
        self,
        path: Path,
        placement: np.ndarray,
        bounds: Mapping[str, tuple[float, float] | None],
        robot: Robot,
    ) -> None:
        super().__init__(path, placement, bounds)
        self._recorded_seen = self.seen
        self._recorded_streams = self.streams
        self.limit_force, self.stiffness, self.mass = find_figures()
        spec = mujoco.MjSpec()
        spec.option.gravity = [0.0, 0.0, 0.0]
        add_arm(spec, robot)
        for name, radius, mass in zip(NAMES, RADII, self.mass, strict=True):
            body = spec.worldbody.add_body(name=f"body {name}")
            body.explicitinertial, body.mass, body.inertia = True, mass, [1.0, 1.0, 1.0]
            for axis in np.eye(3):
                body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
            body.add_geom(
                name=f"body {name}", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[radius, 1e-3, 0.0],
                contype=0, conaffinity=0,
            )  # fmt: skip
        self._model = model = spec.compile()
        self._data = mujoco.MjData(model)
        self._joints = len(robot.joints)
        self._links = [model.geom(link).id for link in robot.links]
        self._geoms = [model.geom(f"body {name}").id for name in NAMES]
        self._carriers = model.geom_bodyid[self._links]
        self._matrix = np.zeros((model.nv, model.nv))
        self._jacobian = np.zeros((3, model.nv))
        self.reset()

    def reset(self) -> None:
        """Begin a case: all bodies are where they were recorded."""
        mujoco.mj_resetData(self._model, self._data)
        self.seen = self._recorded_seen.copy()
        self.streams = {
            key: _YieldingStream(stream, self) for key, stream in self._recorded_streams.items()
        }
        self.squeezes: list[Squeeze] = []
        self._gap = 0.0
        self._since: float | None = None
        self._middle, self._velocity = np.zeros((len(NAMES), 3)), np.zeros((len(NAMES), 3))

    @property
    def offset(self) -> np.ndarray:
        """How far each body is from where it was recorded, in [m]. Shape (9, 3)."""
        if self._since is None:
            return np.zeros((len(NAMES), 3))
        found: np.ndarray = self._data.qpos[self._joints :].reshape(-1, 3) - self._middle
        return found

    @property
    def drift(self) -> np.ndarray:
        """The derivative of that, in [m]/[s]. Shape (9, 3)."""
        if self._since is None:
            return np.zeros((len(NAMES), 3))
        return self.velocity - self._velocity

    @property
    def velocity(self) -> np.ndarray:
        """Of the bodies, in [m]/[s]. Shape (9, 3)."""
        found: np.ndarray = self._data.qvel[self._joints :].reshape(-1, 3)
        return found

    @property
    def is_arm_moved(self) -> bool:
        """Whether the arm's controller moves it; one that rests is still pushed."""
        return bool(self._wanted[1].any())

    @property
    def recorded_speed(self) -> np.ndarray:
        """At which the recording moves each body now, in [m]/[s]. Shape (9,)."""
        found: np.ndarray = np.linalg.norm(self._velocity, axis=1)
        return found

    def ends_at(self, time: float) -> np.ndarray:
        """Where the bodies are now, if the time in [s] is the present one. Shape (9, 2, 3)."""
        found: np.ndarray = super().ends_at(time) + self.offset[:, None]
        return found

    def advance(self, since: float, dt: float, arm: WorkingArm) -> None:
        """Let all move until a time in [s], for so long, as the arm's controller wants it."""
        data, joints = self._data, self._joints
        if self._since is None:
            data.qpos[:joints], data.qvel[:joints] = arm.q - dt * arm.v, arm.v
            self._wanted = data.qpos[:joints].copy(), arm.v.copy()
            self._lay_bodies(since - dt, dt)
            data.qpos[joints:] = self._middle.ravel()
            data.qvel[joints:] = self._velocity.ravel()
            self._since = since
        self.squeezes = []
        steps = math.ceil(dt / FINE_STEP) if self._gap < NEAR else 1
        before, wanted = self._wanted, (arm.q, arm.v)
        for step in range(steps):
            self._lay_bodies(since - dt * (1.0 - (step + 1) / steps), dt / steps)
            share = step / steps
            q, v = (a + share * (b - a) for a, b in zip(before, wanted, strict=True))
            self._step(dt / steps, q, v, (wanted[1] - before[1]) / dt)
        self._wanted = arm.q.copy(), arm.v.copy()
        arm.deviation = np.array([data.qpos[:joints] - arm.q, data.qvel[:joints] - arm.v])
        frame = self.frame(since)
        self.seen[frame] = self._recorded_seen[frame] + self.offset[:, None]

    def _lay_bodies(self, since: float, dt: float) -> None:
        """Lay each capsule as it was recorded, about its middle, and move that on by a step."""
        ends = super().ends_at(since)
        middle, along = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
        if self._since is None:
            self._velocity = (middle - super().ends_at(since - dt).mean(axis=1)) / dt
        else:
            # A body's own muscles speed it up as it was recorded, whatever it touches.
            velocity = (middle - self._middle) / dt
            self._data.qvel[self._joints :] += (velocity - self._velocity).ravel()
            self._velocity = velocity
        self._middle = middle
        length = np.linalg.norm(along, axis=1)
        self._model.geom_size[self._geoms, 1] = np.maximum(0.5 * length, 1e-6)
        for geom, axis in zip(self._geoms, along, strict=True):
            mujoco.mju_quatZ2Vec(self._model.geom_quat[geom], axis)

    def _step(self, dt: float, q: np.ndarray, v: np.ndarray, accel: np.ndarray) -> None:
        """Simulate a step: the arm is to be at q and v at its beginning. Shapes (nv,)."""
        model, data, joints = self._model, self._data, self._joints
        model.opt.timestep = dt
        mujoco.mj_step1(model, data)
        mujoco.mj_fullM(model, data, self._matrix)
        data.qfrc_applied[:] = 0.0
        # The recording is laid out as it is at the end of the step.
        offset = self.offset + dt * self._velocity
        for squeeze in self._find_squeezes():
            push = squeeze.force * squeeze.normal
            carrier = int(self._carriers[squeeze.link])
            mujoco.mj_applyFT(
                model, data, -push, np.zeros(3), squeeze.point, carrier, data.qfrc_applied
            )
            row = joints + 3 * squeeze.body
            data.qfrc_applied[row : row + 3] += push
            self.squeezes.append(squeeze)
        back = RETURN * RETURN * offset + 2.0 * RETURN * self.drift
        data.qfrc_applied[joints:] -= (self.mass[:, None] * back).ravel()
        error, rate = q - data.qpos[:joints], v - data.qvel[:joints]
        wanted = accel + BANDWIDTH * BANDWIDTH * error + 2.0 * BANDWIDTH * rate
        data.qfrc_applied[:joints] += self._matrix[:joints, :joints] @ wanted
        data.qfrc_applied[:joints] += data.qfrc_bias[:joints]
        mujoco.mj_step2(model, data)

    def _find_squeezes(self) -> list[Squeeze]:
        """What presses now; notes how near any link is to any body."""
        model, data = self._model, self._data
        found, segment = [], np.zeros(6)
        self._gap = NEAR
        apart = data.geom_xpos[self._geoms, None] - data.geom_xpos[self._links]
        reach = model.geom_rbound[self._links] + model.geom_size[self._geoms, :2].sum(1)[:, None]
        is_near = (apart**2).sum(axis=2) < (reach + NEAR) ** 2
        for body, link in np.argwhere(is_near).tolist():
            ends = self._links[link], self._geoms[body]
            gap = mujoco.mj_geomDistance(model, data, *ends, NEAR, segment)
            self._gap = min(self._gap, gap)
            if gap < 0.0:
                found.append(self._squeeze(body, link, -gap, segment.copy()))
        return found

    def _squeeze(self, body: int, link: int, depth: float, segment: np.ndarray) -> Squeeze:
        # Where both overlap, the segment leads from the link's surface back to the body's.
        point, normal = segment[:3], (segment[:3] - segment[3:]) / max(depth, 1e-12)
        carrier = int(self._carriers[link])
        mujoco.mj_jac(self._model, self._data, self._jacobian, None, point, carrier)
        surface = self._jacobian @ self._data.qvel
        closing = float((surface - self.velocity[body]) @ normal)
        damper = 2.0 * DAMPING * math.sqrt(self.stiffness[body] * self.mass[body])
        force = max(0.0, float(self.stiffness[body]) * depth + damper * closing)
        return Squeeze(body, link, depth, normal, point, float(np.linalg.norm(surface)), force)


def find_figures() -> np.ndarray:
    """Force in [N], stiffness in [N]/[m] and mass in [kg] of each body. Shape (3, 9)."""
    find = Obstacles(regions=PATTERNS_OF_REGIONS).regions.find
    regions = [
        next(name for name, number in NUMBERS.items() if each >> number & 1) for each in find(NAMES)
    ]
    return np.array([FIGURES.get(region, HEAD) for region in regions]).T.copy()


class Press(NamedTuple):
    """Time in which the arm presses one body, from one moment on at which the arm moves."""

    body: str
    begin: float
    """Since the beginning of the recording, in [s]."""
    duration: float
    """In [s]."""
    speed: float
    """Of the surface that touches first, in [m]/[s]."""
    body_speed: float
    """Of the body by itself: before, and as it was recorded meanwhile, at most, in [m]/[s]."""
    energy: float
    """That its skin stores at most, in [J]."""
    force: float
    """Of its skin at most, in [N]."""
    depth: float
    """How far it is pressed in at most, in [m]."""
    way: float
    """How far it is pushed from where it was recorded at most, in [m]."""
    clamped_force: float
    """Of its skin while links press it from two sides, at most, in [N]."""
    energy_limit: float
    """What may be stored, the body's own speed included, in [J]; 0: it may never be touched."""
    force_limit: float
    """Where it is clamped, in [N]."""
    is_promised: bool
    """Whether the body had kept its bounds until then."""

    @property
    def is_beyond(self) -> bool:
        """Whether a limit was exceeded."""
        kept = 0.0 < self.energy <= self.energy_limit
        return not (kept and self.clamped_force <= self.force_limit)


class PressLog:
    """Follows all presses of one case.

    Args:
        people: Whom the arm presses.
        limits: How fast a surface may be that touches each body, in [m]/[s]; None: nothing may be
            touched. Shape (9,).
    """

    def __init__(self, people: YieldingPeople, limits: np.ndarray | None) -> None:
        self._people = people
        self._limits = limits
        self._open: dict[int, Press] = {}
        self._closed: list[Press] = []
        self._before = np.zeros(len(NAMES))

    @property
    def touches(self) -> tuple[Press, ...]:
        """All of them; those that have not ended last until now."""
        return (*self._closed, *self._open.values())

    def follow(
        self, since: float, dt: float, leaves: Leaves, ends: np.ndarray, broken: np.ndarray
    ) -> None:
        """Take one moment, as `TouchLog.follow`."""
        people = self._people
        for body, name in enumerate(NAMES):
            some = [one for one in people.squeezes if one.body == body]
            if not some:
                if body in self._open:
                    self._closed.append(self._open.pop(body))
                continue
            press = self._open.get(body)
            if press is None:
                if not people.is_arm_moved:
                    # The person touches an arm at rest: nothing the arm did.
                    continue
                press = Press(
                    name, since, -dt, some[0].speed, float(self._before[body]), 0.0, 0.0, 0.0, 0.0,
                    0.0, 0.0, float(people.limit_force[body]), not broken[body],
                )  # fmt: skip
            self._open[body] = self._continue(press, body, dt, some)
        self._before = np.linalg.norm(people.velocity, axis=1)

    def _continue(self, press: Press, body: int, dt: float, some: list[Squeeze]) -> Press:
        people = self._people
        depth, force = max(one.depth for one in some), max(one.force for one in some)
        is_clamped = any(one.normal @ other.normal < 0.0 for one in some for other in some)
        own = max(press.body_speed, float(people.recorded_speed[body]))
        limit = 0.0
        if self._limits is not None and self._limits[body] > 0.0:
            limit = 0.5 * float(people.mass[body]) * (float(self._limits[body]) + own) ** 2
        stored = 0.5 * float(people.stiffness[body]) * depth * depth
        return press._replace(
            duration=press.duration + dt,
            body_speed=own,
            energy=max(press.energy, stored),
            force=max(press.force, force),
            depth=max(press.depth, depth),
            way=max(press.way, float(np.linalg.norm(people.offset[body]))),
            clamped_force=max(press.clamped_force, force if is_clamped else 0.0),
            energy_limit=limit,
        )


class _YieldingStream(Stream):
    """What is sent of bodies that yield, each frame at its own time."""

    def __init__(self, recorded: Stream, people: YieldingPeople) -> None:
        self.__dict__.update(recorded.__dict__)
        self._recorded, self._people = recorded.messages, people
        self.messages = list(recorded.messages)

    def publish(self, table: Obstacles, frame: int, begin: float) -> None:
        """Send what there is of a frame; `begin` is when the recording began, in [s]."""
        calls = []
        offset, drift = self._people.offset, self._people.drift
        for call in self._recorded[frame]:
            rows = [IDS.index(name) for name in call.ids]
            calls.append(
                call._replace(
                    position=call.position + offset[rows, None],
                    velocity=call.velocity + drift[rows, None],
                )
            )
        self.messages[frame] = calls
        super().publish(table, frame, begin)
