"""Two arms as they truly are, by Pinocchio and Coal alone: how far apart, and how one attacks.

Independent of what it is to judge: links are the hulls of their surfaces, joints move in closed
form within what their limits allow, and nothing of armguard's bounds or covers is used.
"""

import coal
import numpy as np
import pinocchio

ROOM = 0.02  # that joints keep to their stops, in [rad] or [m]


class TrueArm:
    """An arm of which everything is known.

    Args:
        robot: The arm.
        base: Placement of its base in the world.
        q: Where it begins, at rest.
        velocity: What it keeps to, (nv,).
        acceleration: With which it speeds up, (nv,); it brakes as hard as the robot can.
    """

    def __init__(self, robot, base, q, velocity, acceleration):
        self.robot, self.base = robot, base
        self.q, self.v = np.array(q, dtype=float), np.zeros(len(q))
        self.velocity, self.acceleration = velocity, acceleration
        self.data = robot.model.createData()
        self.joints = [robot.joint_index(link) for link in robot.links]
        self.hulls = [_make_hull(robot.hull(link)) for link in robot.links]

    def place(self, q=None):
        """Placements of all links in the world."""
        q = self.q if q is None else q
        pinocchio.computeJointJacobians(self.robot.model, self.data, q)
        return [self.base * self.data.oMi[joint] for joint in self.joints]

    def points_at(self, q, joint, points):
        """Points of a joint's frame in the world. Shape (n, 3)."""
        pinocchio.forwardKinematics(self.robot.model, self.data, q)
        placement = self.base * self.data.oMi[joint]
        return points @ placement.rotation.T + placement.translation

    def towards(self, link, point, direction):
        """Joint velocities that move a point in the world along a direction as fast as may be."""
        joint = self.joints[link]
        moved = pinocchio.getJointJacobian(
            self.robot.model, self.data, joint, pinocchio.ReferenceFrame.WORLD
        )
        local, along = self.base.actInv(point), self.base.rotation.T @ direction
        rates = along @ (moved[:3] + np.cross(moved[3:], local, axis=0))
        return np.sign(rates) * self.velocity

    def push(self, wanted, dt):
        """Go on for `dt` towards the wanted joint velocities, as hard as the joints may."""
        robot = self.robot
        stopping = 0.5 * self.v**2 / robot.acceleration_limit + np.abs(self.v) * dt + ROOM
        wanted = np.where(
            self.q + stopping > robot.upper_position_limit, np.minimum(wanted, 0), wanted
        )
        wanted = np.where(
            self.q - stopping < robot.lower_position_limit, np.maximum(wanted, 0), wanted
        )
        self._change(wanted, robot.acceleration_limit, dt)

    def brake(self, dt):
        """Slow down for `dt` as gently as the brakes may."""
        self._change(np.zeros(len(self.v)), self.robot.braking_deceleration, dt)

    def _change(self, wanted, braking, dt):
        v, most = self.v, np.minimum(np.abs(wanted), self.velocity) * np.sign(wanted)
        slower = (most * v < 0.0) | (np.abs(most) < np.abs(v))
        # It turns round at rest: no further than that in one step.
        target = np.where(slower & (most * v <= 0.0), 0.0, most)
        step = np.where(slower, braking, self.acceleration) * dt
        after = v + np.clip(target - v, -step, step)
        self.q, self.v = self.q + 0.5 * dt * (v + after), after


def measure(first, second):
    """Least distance between two arms, the links, and the closest points, in the world."""
    best = (np.inf, 0, 0, np.zeros(3), np.zeros(3))
    places, others = first.place(), second.place()
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    for i, (hull, place) in enumerate(zip(first.hulls, places, strict=True)):
        for k, (other, its) in enumerate(zip(second.hulls, others, strict=True)):
            result.clear()
            distance = coal.distance(
                hull, _transform(place), other, _transform(its), request, result
            )
            if distance < best[0]:
                best = (distance, i, k, result.getNearestPoint1(), result.getNearestPoint2())
    return best


def _transform(placement):
    return coal.Transform3s(placement.rotation, placement.translation)


def _make_hull(points):
    vertices = coal.StdVec_Vec3s()
    for point in points:
        vertices.append(point)
    return coal.Convex.convexHull(vertices, True, "Qt")
