"""How far each motion model lets a point of the arm get, how far it can be driven, and the price.

    python benchmarks/bench_motions.py panda xarm7 ur5 tiago --states 300

For random states at up to 30 % of the joint speeds, a random point of the last link and a random
direction: the mean bound of each model at 50, 100 and 200 ms, beside the furthest that joint
motions within all limits got (bang-bang ones with one switch, improved joint by joint); how often
one got further than a model allows, which has to be never; and ratios, as medians over the states:
that of the joint bound to the isotropic one cannot be less than that of what was reached. "best" is
the least of reach, isotropic and joint.
Then what a tick pays for each model, and what one evaluation of sphere and obstacle costs, in this
process and on this machine: compare them with each other.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import pinocchio

from armguard.bounds import (
    BrakingMotion,
    IsotropicMotion,
    JointMotion,
    ReachMotion,
    table_contact_time,
)
from armguard.bounds.table_time import ArmSphere
from armguard.contact.advancement import row_contact_time
from armguard.contact.bodies import Ball, Bounds, Hull
from armguard.jit import kernel
from armguard.robot import Kinematics, Robot
from scene.configurations import draw_configuration

TIMES = (0.05, 0.1, 0.2)
STEP = 1e-3
WATCHED = 25  # steps between the places of a motion that are kept
MOTIONS, ROUNDS = 64, 4
REACTION, HORIZON = 0.02, 0.003
REPEATS = 2000


def integrate(robot, q, v, first, switch, second):
    """Positions of joints every 25 ms while each goes from one extreme of acceleration to another.

    A joint that reaches its top speed keeps it; one that comes to a limit stays there.

    Args:
        robot: Whose limits apply.
        q: Where it starts, in [rad] or [m]. Shape (nv,).
        v: Joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
        first: Share of the acceleration limit at first, in [-1, 1]. Shape (n, nv).
        switch: When it changes, in [s]. Shape (n, nv).
        second: Share from then on. Shape (n, nv).

    Returns:
        Shape (looks, n, nv).
    """
    place, pace = np.tile(q, (len(first), 1)), np.tile(v, (len(first), 1))
    looks = []
    for step in range(1, round(TIMES[-1] / STEP) + 1):
        share = np.where((step - 1) * STEP < switch, first, second)
        after = pace + STEP * share * robot.acceleration_limit
        after = np.clip(after, -robot.velocity_limit, robot.velocity_limit)
        place = place + 0.5 * STEP * (pace + after)
        held = np.clip(place, robot.lower_position_limit, robot.upper_position_limit)
        pace = np.where(held == place, after, 0.0)
        place = held
        if step % WATCHED == 0:
            looks.append(place)
    return np.array(looks)


def measure(robot, data, joint, point, direction, looks):
    """Furthest way of a point up to each look, from its place at the start. Shape (looks, n)."""
    ways = np.empty(looks.shape[:2])
    for index in np.ndindex(*ways.shape):
        pinocchio.forwardKinematics(robot.model, data, looks[index])
        ways[index] = direction @ data.oMi[joint].act(point)
    return np.maximum.accumulate(ways, axis=0)


def drive(robot, data, q, v, link, point, direction, random):
    """Furthest that joint motions got at the `TIMES`, in [m]. Shape (3,)."""
    joint = robot.joint_index(link)
    jacobian = pinocchio.computeJointJacobians(robot.model, data, q)
    start = data.oMi[joint].act(point)
    slope = direction @ (jacobian[:3] + np.cross(jacobian[3:].T, start).T)
    count = len(q)
    shape = (MOTIONS, count)
    first = random.choice([-1.0, 1.0], shape)
    second = random.choice([-1.0, 1.0], shape)
    switch = random.uniform(0.0, TIMES[-1], shape) * random.choice([0.0, 1.0], (MOTIONS, 1))
    first[: MOTIONS // 2] = second[: MOTIONS // 2] = np.where(slope >= 0.0, 1.0, -1.0)
    picked = [round(t / STEP) // WATCHED - 1 for t in TIMES]
    furthest = np.zeros(len(TIMES))
    for number in range(ROUNDS):
        looks = integrate(robot, q, v, first, switch, second)
        ways = measure(robot, data, joint, point, direction, looks) - direction @ start
        furthest = np.maximum(furthest, ways[picked].max(axis=1))
        # The best for one of the times, with one joint of each motion drawn anew.
        best = int(ways[picked[number % len(picked)]].argmax())
        rows, joints = np.arange(MOTIONS), random.integers(0, count, MOTIONS)
        for array in (first, switch, second):
            array[:] = array[best]
        first[rows, joints] = random.choice([-1.0, 0.0, 1.0], MOTIONS)
        second[rows, joints] = random.choice([-1.0, 0.0, 1.0], MOTIONS)
        switch[rows, joints] = random.uniform(0.0, TIMES[-1], MOTIONS)
    return furthest


def compare_bounds(robot, states, share, random):
    """Bounds of every model and the furthest motions, in [m]. Each of shape (states, 3)."""
    models = {
        "reach": ReachMotion(robot),
        "isotropic": IsotropicMotion(robot),
        "joint": JointMotion(robot),
        "braking": BrakingMotion(robot, REACTION),
    }
    data = robot.model.createData()
    link = robot.links[-1]
    spheres = robot.cover.tree(link).spheres
    found = {name: np.empty((states, len(TIMES))) for name in (*models, "best", "driven")}
    for state in range(states):
        q = draw_configuration(robot, random)
        v = random.uniform(-share, share, len(q)) * robot.velocity_limit
        point = spheres[random.integers(len(spheres)), :3]
        direction = random.normal(size=3)
        direction /= np.linalg.norm(direction)
        for name, model in models.items():
            found[name][state] = [model.advance(q, v, link, point, direction, t) for t in TIMES]
        found["driven"][state] = drive(robot, data, q, v, link, point, direction, random)
    found["best"] = np.minimum.reduce([found[name] for name in ("reach", "isotropic", "joint")])
    return found


@kernel
def run_free(centers, velocities, accel, speed, error, still, bodies, count):
    """Contact times of spheres as free bodies, or standing still, with as many obstacles."""
    total = 0.0
    pace = np.zeros_like(bodies)
    for k in range(count):
        i, row = k % centers.shape[0], k % bodies.shape[0]
        u = np.zeros(3) if still else velocities[i]
        bounds = Bounds(
            0.0 if still else accel[i], 0.0 if still else speed[i], 0.0 if still else error[i], 0.0
        )
        sphere = Ball(centers[i, 0], centers[i, 1], centers[i, 2], u[0], u[1], u[2], bounds)
        bounds = Bounds(10.0, 2.0, 0.1, 0.0)
        total += row_contact_time(sphere, bodies, pace, row, 1, bounds, 0.2, 8, None)
    return total


@kernel
def run_table(centers, jacobian, lever, slope_error, table, bodies, count):
    """The same with a table of joint displacements."""
    total = 0.0
    pace = np.zeros((1, 3))
    for k in range(count):
        i, row = k % centers.shape[0], k % bodies.shape[0]
        sphere = ArmSphere(
            centers[i, 0], centers[i, 1], centers[i, 2], jacobian, lever[i], slope_error[i]
        )
        hull = Hull(bodies[row], pace, 1, Bounds(10.0, 2.0, 0.1, 0.0))
        total += table_contact_time(sphere, table, hull, 0.2, 0.0)
    return total


def price(call, count=1):
    """Median seconds of one of so many calls."""
    call()
    durations = []
    for _ in range(max(5, REPEATS // count)):
        begin = time.perf_counter()
        call()
        durations.append((time.perf_counter() - begin) / count)
    return float(np.median(durations))


def price_models(robot, random):
    """What a tick pays for each model, and one evaluation, in [µs], by name."""
    kinematics = Kinematics(robot)
    isotropic, joint = IsotropicMotion(robot), JointMotion(robot)
    braking = BrakingMotion(robot, REACTION)
    q = draw_configuration(robot, random)
    v = random.uniform(-0.3, 0.3, len(q)) * robot.velocity_limit
    kinematics.compute(q, v)
    isotropic.update(v)
    jacobian = pinocchio.computeJointJacobians(kinematics.model, kinematics.data, q).copy()
    bodies = random.normal(size=(100, 1, 3))
    bodies *= random.uniform(1.5, 3.0, (100, 1, 1)) / np.linalg.norm(bodies, axis=2, keepdims=True)
    centers = np.array(kinematics.centers)
    free = (centers, np.array(kinematics.velocities), isotropic.accel, isotropic.speed)
    free = (*free, isotropic.velocity_error)
    count = 1000

    def by_table(motion, table):
        arguments = (centers, jacobian, motion.lever, motion.slope_error, table, bodies, count)
        return 1e6 * price(lambda: run_table(*arguments), count)

    return {
        "kinematics": (1e6 * price(lambda: kinematics.compute(q, v)), 0.0),
        "reach": (0.0, 1e6 * price(lambda: run_free(*free, True, bodies, count), count)),
        "isotropic": (
            1e6 * price(lambda: isotropic.update(v)),
            1e6 * price(lambda: run_free(*free, False, bodies, count), count),
        ),
        "joint": (
            1e6 * price(lambda: joint.tabulate(q, v, 0.0)),
            by_table(joint, joint.tabulate(q, v, 0.0)),
        ),
        "braking": (
            1e6 * price(lambda: braking.tabulate(q, v, 0.0, HORIZON)),
            by_table(braking, braking.tabulate(q, v, 0.0, HORIZON)),
        ),
    }


def report(name, states, share):
    """Print the tables of one robot; the median ratio of joint to isotropic bound at 50 ms."""
    robot, random = Robot.load(name), np.random.default_rng(0)
    found = compare_bounds(robot, states, share, random)
    driven = found["driven"]
    print(f"\n{name}, {robot.links[-1]}: {states} states at up to {share:.0%} of the joint speeds")
    header = "".join(f"{1e3 * t:>9.0f} ms" for t in TIMES)
    print(f"{'mean bound [m]':16}{header}{'driven further':>16}{'tick [µs]':>12}{'pair [µs]':>12}")
    prices = price_models(robot, random)
    for model in ("reach", "isotropic", "joint", "best", "braking"):
        # Free motions are nothing that a braking arm does.
        further = "" if model == "braking" else int((driven > found[model] + 1e-9).sum())
        figures = "".join(f"{value:12.3f}" for value in found[model].mean(axis=0))
        tick, pair = prices.get(model, (None, None))
        costs = "" if tick is None else f"{tick:12.2f}{pair:12.3f}"
        print(f"{model:16}{figures}{further:>16}{costs}")
    print(f"{'driven':16}" + "".join(f"{value:12.3f}" for value in driven.mean(axis=0)))
    median = {}
    for above, below in (("joint", "isotropic"), ("driven", "isotropic"), ("driven", "joint")):
        median[above, below] = np.median(found[above] / found[below], axis=0)
        figures = "".join(f"{value:12.3f}" for value in median[above, below])
        print(f"{f'{above}/{below}':16}{figures}   (median)")
    print(f"kinematics {prices['kinematics'][0]:.2f} µs a tick, {len(robot.links)} links")
    return float(median["joint", "isotropic"][0])


def main(arguments: list[str] | None = None) -> dict[str, float]:
    """Print the tables; the ratio at 50 ms by robot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robots", nargs="*", default=["panda", "xarm7", "ur5", "tiago"])
    parser.add_argument("--states", type=int, default=200)
    parser.add_argument("--share", type=float, default=0.3, help="of the joint speeds, at most")
    options = parser.parse_args(arguments)
    return {name: report(name, options.states, options.share) for name in options.robots}


if __name__ == "__main__":
    main()
