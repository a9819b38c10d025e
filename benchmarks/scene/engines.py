"""What users pick today, for `bench_schedules.py`: Pinocchio, Coal and MuJoCo in the same scene.

None of them knows how bodies may move on: a distance becomes a time over speed bounds, and a broad
phase is asked whether anything is nearer than link and obstacle can close until the arm stands. All
take the balls to be where they were measured last. Coal's tree is asked by balls around the links
and not by `manager.distance`, whose default callback misses the nearest obstacle now and then.
"""

from __future__ import annotations

import math

import coal
import pinocchio

from armguard.bounds import IsotropicMotion
from armguard.robot import Kinematics
from scene import crowds
from scene.crowds import Answer, UnavailableError

try:
    import mujoco
except ImportError:
    mujoco = None

FAR = 100.0  # [m]: beyond the hall


class PinocchioDistances:
    """`computeDistances` of the arm's meshes, or of their convex hulls, and one ball each."""

    def __init__(self, work: crowds.Work, count: int, hulls: bool) -> None:
        self._work, self._model = work, work.robot.model
        self._data = self._model.createData()
        geometry = pinocchio.GeometryModel()
        for part in work.robot.collision_model.geometryObjects:
            if part.parentJoint == 0:
                continue  # the base, which cannot hit anything
            shape = part.geometry
            if hulls and isinstance(shape, coal.BVHModelBase):
                shape.buildConvexHull(True, "Qt")
                shape = shape.convex
            geometry.addGeometryObject(
                pinocchio.GeometryObject(
                    part.name, part.parentJoint, part.parentFrame, part.placement, shape
                )
            )
        self._parts = geometry.ngeoms
        ball = coal.Sphere(crowds.RADIUS)
        for number in range(count):
            place = pinocchio.SE3.Identity()
            geometry.addGeometryObject(
                pinocchio.GeometryObject(f"ball-{number}", 0, 0, place, ball)
            )
        for part in range(self._parts):
            for number in range(count):
                geometry.addCollisionPair(pinocchio.CollisionPair(part, self._parts + number))
        self._geometry = geometry
        self._balls = [geometry.geometryObjects[self._parts + k].placement for k in range(count)]
        self._results = geometry.createData()

    def update(self, rows: slice, names, stamp: float, position, velocity) -> None:
        """Place the balls, one by one: there is no other way."""
        for ball, place in zip(self._balls[rows], position, strict=True):
            ball.translation = place

    def step(self, stamp: float, q, v, stop_time: float) -> None:
        """All distances."""
        self._nearest = pinocchio.computeDistances(
            self._model, self._data, self._geometry, self._results, q
        )
        self._stop_time = stop_time

    def read(self) -> Answer:
        """The least distance."""
        distance = self._results.distanceResults[self._nearest].min_distance
        pairs = len(self._geometry.collisionPairs)
        return _judge_distance(self._work, distance, pairs, self._stop_time)


class CoalBroadPhase:
    """Coal's dynamic AABB tree of the balls, asked with a ball around each link.

    That ball is the link's own, widened by what link and obstacle can close in the arm's stopping
    time at their speed bounds. Updates keep the tree in order, obstacle by obstacle.
    """

    def __init__(self, work: crowds.Work, count: int) -> None:
        self._kinematics = Kinematics(work.robot)
        spheres = self._kinematics.spheres
        motion = IsotropicMotion(work.robot)
        self._roots = spheres.root
        self._speeds = motion.speed[self._roots] + crowds.SPEED
        self._radii = spheres.radius[self._roots] + motion.position_error[self._roots]
        self._shapes = [coal.Sphere(radius) for radius in self._radii]
        self._links = [coal.CollisionObject(shape) for shape in self._shapes]
        ball = coal.Sphere(crowds.RADIUS)
        self._balls = [coal.CollisionObject(ball) for _ in range(count)]
        self._tree = coal.DynamicAABBTreeCollisionManager()
        self._callback = coal.CollisionCallBackDefault()
        self._is_set_up = False

    def update(self, rows: slice, names, stamp: float, position, velocity) -> None:
        """Move balls and tell the tree; the first time, build it."""
        for ball, place in zip(self._balls[rows], position, strict=True):
            ball.setTranslation(place)
            ball.computeAABB()
            if self._is_set_up:
                self._tree.update(ball)
        if not self._is_set_up:
            for ball in self._balls:
                self._tree.registerObject(ball)
            self._tree.setup()
            self._is_set_up = True

    def step(self, stamp: float, q, v, stop_time: float) -> None:
        """Ask the tree for each link until something is too near."""
        self._kinematics.compute(q, v)
        self._go = True
        radii = self._radii + self._speeds * stop_time
        for i in range(len(self._links) - 1, -1, -1):
            shape, link = self._shapes[i], self._links[i]
            shape.radius = radii[i]
            shape.computeLocalAABB()
            link.setTranslation(self._kinematics.centers[self._roots[i]])
            link.computeAABB()
            self._callback.init()
            self._tree.collide(link, self._callback)
            if self._callback.data.result.isCollision():
                self._go = False
                return

    def read(self) -> Answer:
        """Whether anything is too near."""
        return Answer(math.nan, math.nan, self._go)


class MujocoDistances:
    """`mj_geomDistance` of each link's hull and each ball."""

    def __init__(self, work: crowds.Work, count: int) -> None:
        self._work = work
        self._model = make_mujoco_model(work.robot, count)
        self._data = mujoco.MjData(self._model)
        self._links = [self._model.geom(link).id for link in work.robot.links]
        last = max(self._links)
        self._balls = range(last + 1, last + 1 + count)

    def update(self, rows: slice, names, stamp: float, position, velocity) -> None:
        """Place the balls."""
        self._data.mocap_pos[rows] = position

    def step(self, stamp: float, q, v, stop_time: float) -> None:
        """All distances, each no further than the least so far."""
        model, data = self._model, self._data
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        least, measure = FAR, mujoco.mj_geomDistance
        for ball in self._balls:
            for link in self._links:
                least = min(least, measure(model, data, link, ball, least, None))
        self._least, self._stop_time = least, stop_time

    def read(self) -> Answer:
        """The least distance."""
        pairs = len(self._links) * len(self._balls)
        return _judge_distance(self._work, self._least, pairs, self._stop_time)


class MujocoContacts(MujocoDistances):
    """MuJoCo's collision detection, with the same distances as margins as Coal's broad phase."""

    def __init__(self, work: crowds.Work, count: int) -> None:
        super().__init__(work, count)
        self._speeds = IsotropicMotion(work.robot).surface_speed + crowds.SPEED

    def step(self, stamp: float, q, v, stop_time: float) -> None:
        """Everything within the links' margins."""
        model, data = self._model, self._data
        data.qpos[:] = q
        model.geom_margin[self._links] = self._speeds * stop_time
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)

    def read(self) -> Answer:
        """Whether there is anything."""
        return Answer(math.nan, math.nan, self._data.ncon == 0)


def make_mujoco_model(robot, count: int):
    """The arm as MuJoCo sees it, its links as convex hulls, and balls that are placed by hand."""
    if mujoco is None:
        raise UnavailableError("the package mujoco is not installed: pip install 'armguard[bench]'")
    model, spec = robot.model, mujoco.MjSpec()
    spec.memory = 2**26 + 2**17 * count  # [bytes]: more than its broad phase takes
    bodies = {0: spec.worldbody}
    for joint in range(1, model.njoints):
        place = model.jointPlacements[joint]
        x, y, z, w = pinocchio.Quaternion(place.rotation).coeffs()
        body = bodies[model.parents[joint]].add_body(pos=place.translation, quat=[w, x, y, z])
        if model.joints[joint].shortname() != "JointModelRZ":
            raise UnavailableError(f"{model.names[joint]} does not turn about its z axis")
        body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 0.0, 1.0])
        body.explicitinertial, body.mass, body.inertia = True, 1.0, [1.0, 1.0, 1.0]
        bodies[joint] = body
    for link in robot.links:
        spec.add_mesh(name=link, uservert=robot.hull(link).ravel())
        bodies[robot.joint_index(link)].add_geom(
            name=link, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=link, contype=1, conaffinity=0
        )
    size = [crowds.RADIUS, 0.0, 0.0]
    for _ in range(count):
        spec.worldbody.add_body(mocap=True).add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE, size=size, contype=0, conaffinity=1
        )
    return spec.compile()


def _judge_distance(work: crowds.Work, distance: float, pairs: int, stop_time: float) -> Answer:
    time = max(distance, 0.0) / (work.top_speed + crowds.SPEED)
    return Answer(time, pairs, time > stop_time)
