"""An arm in MuJoCo that meets a body part: a mass on a spring, the skin, that the surface presses.

MuJoCo computes how the arm moves. The skin is computed here, against the true triangles of the
links, so that the energy in the tissue is known: 0.5 k c² for a compression c, and the work done on
it where the skin damps as well. There is no friction, and no gravity.

The controller's motion is exact until something is touched. From then on a loop of the stated
stiffness holds the arm to that motion, with as much torque as it takes, and knows of no contact; an
arm of infinite stiffness cannot be held up at all.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from armguard.bridges.mujoco import add_arm
from armguard.jit.kernels import kernel
from armguard.robot import Robot

STEP = 1e-4  # [s], while something is pressed
SWING = 5e-4  # [s], of an arm that was touched, and is not any more
TOUCH = 2e-6  # [m], the gap from which on the skin is computed
NEARBY = 5e-4  # [m]
GROUP = 16  # triangles that are skipped together
RIGID = math.inf  # stiffness of an arm that nothing holds up, in [N/m]


class Surface(NamedTuple):
    """The triangles of all links, as a tree of balls, depth first; only the smallest have any.

    What is within some distance of a triangle is inside as well, so that a point is a sphere.
    """

    corners: np.ndarray
    """In the frame of the link's joint, in [m]. Shape (n, 3, 3)."""
    swell: np.ndarray
    """How far from its triangle the surface is, in [m]. Shape (n,)."""
    first: np.ndarray
    """Where the triangles of each ball begin, and the end. Shape (balls + 1,)."""
    ball: np.ndarray
    """Centre and radius. Shape (balls, 4)."""
    beyond: np.ndarray
    """The next ball that is not inside it. Shape (balls,)."""
    joint: np.ndarray
    """Which joint moves it. Shape (balls,)."""
    link: np.ndarray
    """Number of its link. Shape (balls,)."""


class Skin(NamedTuple):
    """The body part that is touched: a ball of a mass, in a skin that gives way."""

    mass: float
    """[kg]"""
    stiffness: float
    """[N/m]"""
    damping: float
    """[N s/m]"""
    radius: float
    """[m]"""


class Touch(NamedTuple):
    """One contact, from the first touch until the skin is free again."""

    energy: float
    """The greatest work that was done on the skin up to any moment, in [J]."""
    force: float
    """Its greatest force, in [N]."""
    part_speed: float
    """Of the body part before, in [m/s]."""
    surface_speed: float
    """Of the fastest point of the touched link, as it was and as the controller wanted it, in
    [m/s]."""
    link: int
    """Number of the link that touched first."""
    joint_error: float
    """How far the contact moved a joint out of its way at most, in [rad] or [m]."""
    is_clamped: bool
    """Whether it was pressed from two sides: between two links, or against anything else."""


def make_surface(robot: Robot) -> Surface:
    """The true surface of an arm: the triangles of its links."""
    parts = [robot.triangles(link) for link in robot.links]
    return _build_surface(robot, parts, [np.zeros(len(part)) for part in parts])


def make_cover_surface(robot: Robot) -> Surface:
    """The surface of an arm that is made of the smallest spheres of its cover."""
    spheres = [find_leaves(robot, link) for link in robot.links]
    points = [np.repeat(some[:, None, :3], 3, axis=1) for some in spheres]
    return _build_surface(robot, points, [some[:, 3] for some in spheres])


def find_leaves(robot: Robot, link: str) -> np.ndarray:
    """Centres and radii of the smallest spheres of a link's cover, in [m]. Shape (n, 4)."""
    tree = robot.cover.tree(link)
    return tree.spheres[np.asarray(tree.child_count) == 0]


def _build_surface(robot: Robot, parts: list[np.ndarray], swells: list[np.ndarray]) -> Surface:
    """Of the triangles of each link, shapes (n, 3, 3), and how far from each its surface is."""
    corners: list[np.ndarray] = []
    swelled: list[np.ndarray] = []
    first, balls, beyond, joints, links = [0], [], [], [], []

    def add(triangles: np.ndarray, swell: np.ndarray, number: int) -> None:
        points, index = triangles.reshape(-1, 3), len(balls)
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        apart = np.linalg.norm(triangles - middle, axis=2).max(axis=1)
        balls.append([*middle, (apart + swell).max()])
        joints.append(robot.joint_index(robot.links[number]) - 1)
        links.append(number)
        beyond.append(0)
        is_leaf = len(triangles) <= GROUP
        first.append(first[-1] + is_leaf * len(triangles))
        if is_leaf:
            corners.append(triangles)
            swelled.append(swell)
        else:
            middles = triangles.mean(axis=1)
            order = np.argsort(middles[:, np.argmax(np.ptp(middles, axis=0))], kind="stable")
            half = len(order) // 2
            add(triangles[order[:half]], swell[order[:half]], number)
            add(triangles[order[half:]], swell[order[half:]], number)
        beyond[index] = len(balls)

    for number, (triangles, swell) in enumerate(zip(parts, swells, strict=True)):
        add(triangles, swell, number)
    columns = map(np.array, (first, balls, beyond, joints, links))
    return Surface(np.concatenate(corners), np.concatenate(swelled), *columns)


@kernel
def _nearest_on_triangle(t, p):
    """The point of a triangle nearest to p (Ericson, Real-Time Collision Detection, 5.1.5)."""
    abx, aby, abz = t[1, 0] - t[0, 0], t[1, 1] - t[0, 1], t[1, 2] - t[0, 2]
    acx, acy, acz = t[2, 0] - t[0, 0], t[2, 1] - t[0, 1], t[2, 2] - t[0, 2]
    apx, apy, apz = p[0] - t[0, 0], p[1] - t[0, 1], p[2] - t[0, 2]
    d1, d2 = abx * apx + aby * apy + abz * apz, acx * apx + acy * apy + acz * apz
    if d1 <= 0.0 and d2 <= 0.0:
        return t[0, 0], t[0, 1], t[0, 2]
    bpx, bpy, bpz = p[0] - t[1, 0], p[1] - t[1, 1], p[2] - t[1, 2]
    d3, d4 = abx * bpx + aby * bpy + abz * bpz, acx * bpx + acy * bpy + acz * bpz
    if d3 >= 0.0 and d4 <= d3:
        return t[1, 0], t[1, 1], t[1, 2]
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        s = d1 / (d1 - d3)
        return t[0, 0] + s * abx, t[0, 1] + s * aby, t[0, 2] + s * abz
    cpx, cpy, cpz = p[0] - t[2, 0], p[1] - t[2, 1], p[2] - t[2, 2]
    d5, d6 = abx * cpx + aby * cpy + abz * cpz, acx * cpx + acy * cpy + acz * cpz
    if d6 >= 0.0 and d5 <= d6:
        return t[2, 0], t[2, 1], t[2, 2]
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        s = d2 / (d2 - d6)
        return t[0, 0] + s * acx, t[0, 1] + s * acy, t[0, 2] + s * acz
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        s = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return (
            t[1, 0] + s * (t[2, 0] - t[1, 0]),
            t[1, 1] + s * (t[2, 1] - t[1, 1]),
            t[1, 2] + s * (t[2, 2] - t[1, 2]),
        )
    share = 1.0 / (va + vb + vc)
    v, w = vb * share, vc * share
    return t[0, 0] + abx * v + acx * w, t[0, 1] + aby * v + acy * w, t[0, 2] + abz * v + acz * w


@kernel
def find_nearest(surface, places, turns, p, within, point):
    """Fill the surface's point nearest to p; its distance, at most `within`, and its group or -1.

    The distance is below 0 inside a surface that is some way from its triangles.
    `places` and `turns` are those of the joints' frames. Shapes (nv, 3) and (nv, 9).
    """
    best, found = within, -1
    here, local, nearest = -1, np.empty(3), np.empty(3)
    group = -1
    while group + 1 < surface.joint.shape[0]:
        group += 1
        joint = surface.joint[group]
        if joint != here:
            here, r = joint, turns[joint]
            x, y, z = p[0] - places[here, 0], p[1] - places[here, 1], p[2] - places[here, 2]
            for i in range(3):
                local[i] = r[i] * x + r[3 + i] * y + r[6 + i] * z
        ball = surface.ball[group]
        x, y, z = local[0] - ball[0], local[1] - ball[1], local[2] - ball[2]
        far = best + ball[3]
        if far <= 0.0 or x * x + y * y + z * z >= far * far:
            group = surface.beyond[group] - 1
            continue
        if surface.first[group + 1] == surface.first[group]:
            continue  # what follows is inside this ball, in smaller ones
        for number in range(surface.first[group], surface.first[group + 1]):
            a, b, c = _nearest_on_triangle(surface.corners[number], local)
            x, y, z = local[0] - a, local[1] - b, local[2] - c
            length, swell = math.sqrt(x * x + y * y + z * z), surface.swell[number]
            if length - swell < best:
                best, found = length - swell, group
                share = swell / max(length, 1e-12)
                nearest[0], nearest[1], nearest[2] = a + share * x, b + share * y, c + share * z
    if found >= 0:
        k = surface.joint[found]
        for i in range(3):
            r = turns[k]
            point[i] = places[k, i] + (
                r[3 * i] * nearest[0] + r[3 * i + 1] * nearest[1] + r[3 * i + 2] * nearest[2]
            )
    return best, found


@kernel
def advance_joints(q, v, accel, target, up, rate, hold, brakes, dt):
    """One step of what the controller wants, in place: towards velocities, or to rest.

    A joint that brakes goes on for the rest of `hold`, and slows down by `rate` then.
    """
    for j in range(q.shape[0]):
        left, before = dt, v[j]
        if brakes:
            on = min(hold[j], left)
            q[j] += v[j] * on
            hold[j] -= on
            left -= on
            ramp = min(left, abs(v[j]) / rate[j])
            slower = math.copysign(max(abs(v[j]) - rate[j] * ramp, 0.0), v[j])
        else:
            ramp = min(left, abs(target[j] - v[j]) / up[j])
            change = math.copysign(up[j] * ramp, target[j] - v[j])
            slower = v[j] + change
        q[j] += 0.5 * (v[j] + slower) * ramp
        v[j] = 0.0 if brakes and left > ramp else slower
        q[j] += v[j] * (left - ramp)
        accel[j] = (v[j] - before) / dt


class Push(NamedTuple):
    """A force on the arm."""

    force: np.ndarray
    """[N]. Shape (3,)."""
    point: np.ndarray
    """Where it acts, in [m]. Shape (3,)."""
    joint: int
    """Which moves what is pushed."""


class Arm:
    """An arm in MuJoCo, its loop, and its surface.

    Attributes:
        q: Joint positions that the controller wants now, in [rad] or [m]. Shape (nv,).
        v: Its velocities. Shape (nv,).
        accel: Its accelerations in the step before. Shape (nv,).
        is_free: Whether nothing has touched the arm yet, so that it is exactly there.
    """

    def __init__(self, robot: Robot, surface: Surface) -> None:
        spec = mujoco.MjSpec()
        spec.option.gravity = [0.0, 0.0, 0.0]
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        add_arm(spec, robot)
        for name in robot.joints:
            motor = spec.add_actuator(name=name, target=name)
            motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
            motor.gaintype = mujoco.mjtGain.mjGAIN_FIXED
            motor.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        self.robot, self.model = robot, spec.compile()
        self.data = mujoco.MjData(self.model)
        self.surface = surface
        self.hulls = [robot.hull(link) for link in robot.links]
        self.joint_of = [robot.joint_index(link) - 1 for link in robot.links]
        nv = len(robot.joints)
        self.q, self.v, self.accel = np.zeros(nv), np.zeros(nv), np.zeros(nv)
        self._gain, self._damping = np.zeros(nv), np.zeros(nv)
        self._jacobian, self._spin = np.zeros((3, nv)), np.zeros((3, nv))
        self._matrix, self._torque = np.zeros((nv, nv)), np.zeros(nv)
        self.is_free, self.stiffness = True, RIGID

    def start(self, q: np.ndarray, v: np.ndarray, stiffness: float) -> None:
        """Begin anew, with a loop of a stiffness in [N/m] at the place that is touched first."""
        self.q[:], self.v[:], self.accel[:] = q, v, 0.0
        self.is_free, self.stiffness = True, stiffness
        self.place()

    def place(self) -> None:
        """Put the arm where the controller wants it."""
        self.data.qpos[:], self.data.qvel[:] = self.q, self.v
        mujoco.mj_kinematics(self.model, self.data)

    @property
    def places(self) -> np.ndarray:
        return self.data.xpos[1:]

    @property
    def turns(self) -> np.ndarray:
        return self.data.xmat[1:]

    def find_nearest(self, p: np.ndarray, within: float, point: np.ndarray) -> tuple[float, int]:
        return find_nearest(self.surface, self.places, self.turns, p, within, point)

    def column(self, p: np.ndarray, joint: int) -> np.ndarray:
        """The Jacobian of a point that a joint's frame carries. Shape (3, nv)."""
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_jac(self.model, self.data, self._jacobian, None, p, joint + 1)
        return self._jacobian

    def fastest(self, link: int) -> float:
        """Speed of a link's fastest point, as it is or as the controller wants it, in [m/s]."""
        joint = self.joint_of[link]
        points = self.hulls[link] @ self.turns[joint].reshape(3, 3).T
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_jac(
            self.model, self.data, self._jacobian, self._spin, self.places[joint], joint + 1
        )
        fastest = 0.0
        for v in (self.v, self.data.qvel)[: 1 if self.is_free else 2]:
            speeds = self._jacobian @ v + np.cross(self._spin @ v, points)
            fastest = max(fastest, float((speeds**2).sum(axis=1).max()))
        return math.sqrt(fastest)

    def hold_by_loop(self, p: np.ndarray, direction: np.ndarray, joint: int) -> None:
        """Give the loop its gains, so that it is as stiff as stated at a point."""
        self.is_free = False
        mujoco.mj_forward(self.model, self.data)
        mujoco.mj_fullM(self.model, self.data, self._matrix)
        inertia = np.diag(self._matrix)
        slope = direction @ self.column(p, joint)
        # Gains in proportion to inertias: the same bandwidth for all joints.
        rate2 = self.stiffness * float(slope @ (slope / inertia))
        self._gain[:] = max(rate2, 100.0) * inertia
        self._damping[:] = 2.0 * math.sqrt(max(rate2, 100.0)) * inertia
        self.model.actuator_gainprm[:, 0] = self._gain
        self.model.actuator_biasprm[:, 1] = -self._gain
        self.model.actuator_biasprm[:, 2] = -self._damping

    def step(self, dt: float, pushes: Sequence[Push]) -> None:
        """Simulate a step of an arm that is pushed, after the wanted motion was advanced."""
        if self.is_free or self.stiffness == RIGID:
            self.place()
            return
        model, data = self.model, self.data
        model.opt.timestep = dt
        data.ctrl[:] = self.q
        mujoco.mj_step1(model, data)
        mujoco.mj_mulM(model, data, self._torque, self.accel)
        data.qfrc_applied[:] = self._torque + data.qfrc_bias + self._damping * self.v
        for force, point, joint in pushes:
            mujoco.mj_applyFT(model, data, force, np.zeros(3), point, joint + 1, data.qfrc_applied)
        mujoco.mj_step2(model, data)
        mujoco.mj_kinematics(model, data)

    @property
    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Where the arm is, and how fast, whatever the controller wants. Shape (nv,) each."""
        return (self.q, self.v) if self.is_free else (self.data.qpos, self.data.qvel)

    @property
    def joint_error(self) -> float:
        return 0.0 if self.is_free else float(np.abs(self.data.qpos - self.q).max())


class Contact:
    """A body part before, while and after an arm touches it.

    Attributes:
        center: Of the part, in [m]. Shape (3,).
        velocity: In [m/s]. Shape (3,).
        gap: Between its skin and the arm, in [m]; negative while it is pressed.
        touches: The contacts that are over.
    """

    def __init__(self, arm: Arm, skin: Skin, center, velocity) -> None:
        self.arm, self.skin = arm, skin
        self.center, self.velocity = np.array(center, float), np.array(velocity, float)
        self.touches: list[Touch] = []
        self._point, self._force = np.zeros(3), np.zeros(3)
        self._group, self._count, self._link = -1, 0, -1
        self._first = np.zeros(3)
        self._size = self._compression = self._work = 0.0
        self._open: Touch | None = None
        self.gap = 0.0
        self.look(0.0)

    @property
    def is_pressed(self) -> bool:
        return self._open is not None

    def look(self, dt: float) -> None:
        """Measure the gap, and the skin's force from it."""
        skin, arm = self.skin, self.arm
        # A little farther than it was is enough to find it again, and quicker.
        near = self.gap + skin.radius + NEARBY
        away, self._group = arm.find_nearest(self.center, near, self._point)
        if self._group < 0:
            away, self._group = arm.find_nearest(self.center, math.inf, self._point)
        self.gap = away - skin.radius
        compression = max(-self.gap, 0.0)
        size = 0.0
        if compression > 0.0:
            # The part and the surface move alike in a step, so that the gap tells how fast.
            rate = (compression - self._compression) / dt if dt > 0.0 else 0.0
            size = max(skin.stiffness * compression + skin.damping * rate, 0.0)
            self._work += 0.5 * (self._size + size) * (compression - self._compression)
            normal = (self.center - self._point) / max(away, 1e-12)
            self._force[:] = size * normal
            self._note(size, normal)
        else:
            self._force[:] = 0.0
            if self._open is not None:
                self.touches.append(self._open)
            self._open, self._work = None, 0.0
        self._size, self._compression = size, compression

    def _note(self, size: float, normal: np.ndarray) -> None:
        arm, link = self.arm, int(self.arm.surface.link[self._group])
        touch = self._open
        if touch is None:
            speed = float(np.linalg.norm(self.velocity))
            touch = Touch(0.0, 0.0, speed, 0.0, link, 0.0, False)
            self._count, self._first = 0, normal
            if arm.is_free and arm.stiffness < RIGID:
                arm.hold_by_loop(self._point, normal, int(arm.surface.joint[self._group]))
        # Speeds change little within half a millisecond.
        self._count += 1
        is_due = self._count % 5 == 1 or link != self._link
        speed, self._link = arm.fastest(link) if is_due else 0.0, link
        stored = 0.5 * self.skin.stiffness * max(-self.gap, 0.0) ** 2
        self._open = touch._replace(
            energy=max(touch.energy, stored, self._work),
            force=max(touch.force, size),
            surface_speed=max(touch.surface_speed, speed),
            joint_error=max(touch.joint_error, arm.joint_error),
            is_clamped=touch.is_clamped or (link != touch.link and normal @ self._first < 0.0),
        )

    def choose_step(self, most: float) -> float:
        """How long the next step may be, in [s], so that the first touch is met."""
        if self.is_pressed or self.gap <= TOUCH:
            return min(STEP, most)
        arm = self.arm
        closing = float(np.linalg.norm(self.velocity)) + self._arm_speed() + 1e-9
        safe = max(0.9 * self.gap / closing, 1e-6)
        return min(safe, most if arm.is_free or arm.stiffness == RIGID else min(SWING, most))

    def _arm_speed(self) -> float:
        """More than any point of the arm's speed, but for an arm that swings, in [m/s]."""
        return float(np.abs(self.arm.v).sum()) * REACH

    def advance(self, dt: float) -> None:
        """Let the part move for a step, and the arm that it presses against."""
        skin, arm = self.skin, self.arm
        self.velocity += 0.5 * dt / skin.mass * self._force
        self.center += dt * self.velocity
        pushes = []
        if self._size > 0.0:
            pushes.append(Push(-self._force, self._point, int(arm.surface.joint[self._group])))
        arm.step(dt, pushes)
        self.look(dt)
        self.velocity += 0.5 * dt / skin.mass * self._force

    def finish(self) -> list[Touch]:
        """All contacts, the one that lasts still among them."""
        return self.touches + ([] if self._open is None else [self._open])


REACH = 1.5  # [m], more than any point of these arms is away from any axis
