"""Every robot in `robots/`: limits, proof, samples, levers, and a monitor that runs.

ARMGUARD_SAMPLES sets how many points a robot are drawn from its surface; 1000000 for a long run.
"""

import json
import os
import time

import numpy as np
import pytest

from armguard.app.cli import main
from armguard.bounds import IsotropicMotion
from armguard.cover.containment import is_contained
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot import Kinematics, Robot
from armguard.robot.description import LIMITS, list_robots, robots_directory
from armguard.verdict import Level, ReasonKind
from support.joint_axes import distances_from_axes
from support.surface_samples import is_inside, sample

SAMPLES = int(os.environ.get("ARMGUARD_SAMPLES", "20000"))
DEGREES = {
    "baxter": 14, "kinova": 6, "panda": 7, "tiago": 8, "ur10": 6,
    "ur10e": 6, "ur3e": 6, "ur5": 6, "ur5e": 6, "xarm7": 7,
}  # fmt: skip


@pytest.fixture(scope="module", params=sorted(DEGREES))
def robot(request):
    begin = time.perf_counter()
    robot = Robot.load(request.param)
    print(f"{robot.name}: {time.perf_counter() - begin:.2f} s to load")  # noqa: T201
    return robot


def draw(robot, random):
    return random.uniform(
        np.maximum(robot.lower_position_limit, -np.pi),
        np.minimum(robot.upper_position_limit, np.pi),
    )


def test_all_are_known():
    assert list_robots() == sorted(DEGREES)


def test_limits_are_finite_and_have_sources(robot):
    assert robot.model.nq == robot.model.nv == len(robot.joints) == DEGREES[robot.name]
    for limit in (
        robot.velocity_limit,
        robot.acceleration_limit,
        robot.braking_deceleration,
        robot.position_error,
        robot.velocity_error,
    ):
        assert (np.isfinite(limit) & (limit > 0.0)).all()
    assert (robot.braking_deceleration <= robot.acceleration_limit).all()
    bounded = np.isfinite(robot.lower_position_limit) & np.isfinite(robot.upper_position_limit)
    free = [
        joint for joint, is_bounded in zip(robot.joints, bounded, strict=True) if not is_bounded
    ]
    expected = [f"j2s6s200_joint_{k}" for k in (1, 4, 6)] if robot.name == "kinova" else []
    assert free == expected
    for joint in robot.joints:
        for limit in LIMITS:
            assert robot.source(joint, limit).strip()
    readme = (robots_directory() / robot.name / "README.md").read_text()
    assert all(f"`{link}`" in readme for link in robot.links)


def read_table(text, first):
    """Rows of the Markdown table whose first heading is `first`, as lists of cells."""
    lines = iter(text.splitlines())
    for line in lines:
        if line.startswith(f"| {first} |"):
            next(lines)
            break
    rows = []
    for line in lines:
        if not line.startswith("|"):
            break
        rows.append([cell.strip().strip("`") for cell in line.strip("|").split("|")])
    return rows


def test_the_readme_says_what_the_files_say(robot):
    folder = robots_directory() / robot.name
    readme = (folder / "README.md").read_text()
    *links, total = read_table(readme, "link")
    assert [row[0] for row in links] == list(robot.links)
    for link, count, levels, radius, *_ in links:
        assert int(count) == len(robot.cover.spheres(link)), link
        assert int(levels) == robot.cover.levels(link), link
        assert float(radius) == pytest.approx(1e3 * robot.cover.spheres(link, 0)[0, 3], abs=0.051)
    assert int(total[1]) == sum(int(row[1]) for row in links)
    assert float(total[4]) == max(float(row[4]) for row in links)
    balls = sum(len(robot.cover.tree(link).spheres) for link in robot.links)
    digest = json.loads((folder / "cover.json").read_text())["digest"]
    assert f"All levels together have {balls} balls. Digest `{digest[:16]}…`" in readme
    joints = read_table(readme, "joint")
    assert [row[0] for row in joints] == list(robot.joints)
    for k, (_, position, *limits) in enumerate(joints):
        kinds = robot.velocity_limit, robot.acceleration_limit, robot.braking_deceleration
        expected = [values[k] for values in kinds]
        assert [float(limit) for limit in limits] == pytest.approx(expected, rel=1e-3)
        ends = robot.lower_position_limit[k], robot.upper_position_limit[k]
        if position == "continuous":
            assert not np.isfinite(ends).any()
        else:
            said = [float(end) for end in position.split(" to ")]
            assert said == pytest.approx(ends, rel=1e-3)


def test_published_operating_limits_are_within_the_hardwares_and_in_the_readme(robot):
    published = robot.published_operating_limits
    for limit, hardware in (
        (published.velocity, robot.velocity_limit),
        (published.acceleration, robot.acceleration_limit),
    ):
        assert ((limit > 0.0) & (limit <= hardware)).all()
    assert published.acceleration.max() <= 10.0, "nothing derived from efforts"
    assert ("CHOSEN" in published.source) == (robot.name == "tiago")
    assert "commit " in published.source or "issue 380" in published.source
    readme = (robots_directory() / robot.name / "README.md").read_text()
    rows = read_table(readme, "operating limits of")
    assert [row[0] for row in rows] == list(robot.joints)
    for k, values in enumerate(zip(published.velocity, published.acceleration, strict=True)):
        assert [float(cell) for cell in rows[k][1:]] == pytest.approx(values, rel=1e-3)


def test_the_page_on_covers_says_what_the_files_say(robot):
    page = (robots_directory().parent / "docs" / "covers.md").read_text()
    row = {line[0].split("`")[0]: line for line in read_table(page, "robot")}[robot.name]
    leaves = sum(len(robot.cover.spheres(link)) for link in robot.links)
    assert [int(cell) for cell in row[1:3]] == [len(robot.links), leaves]
    readme = (robots_directory() / robot.name / "README.md").read_text()
    assert row[4] == read_table(readme, "link")[-1][4]


def test_the_list_of_robots_says_what_the_files_say(robot, capsys):
    assert main(["robots"]) == 0
    line = next(one for one in capsys.readouterr().out.splitlines() if robot.name in one.split())
    leaves = sum(len(robot.cover.spheres(link)) for link in robot.links)
    numbers = [len(robot.joints), len(robot.links), leaves]
    assert [int(word) for word in line.split()[1:4]] == numbers


def test_covers_are_proved(robot):
    assert robot.cover.links == robot.links
    for link in robot.links:
        assert is_contained(robot.triangles(link), robot.cover.tree(link)), link


def test_no_sample_is_outside_at_any_level(robot):
    for link in robot.links:
        points = sample(robot.triangles(link), -(-SAMPLES // len(robot.links)))
        for level in range(robot.cover.levels(link)):
            assert is_inside(points, robot.cover.spheres(link, level)).all()


def test_descent_loses_no_geometry_wherever_it_stops(robot):
    random = np.random.default_rng(0)
    for link in robot.links:
        points = sample(robot.triangles(link), 200)
        tree = robot.cover.tree(link)
        for _ in range(5):
            front, stopped = [0], []
            while front:
                node = front.pop()
                if tree.child_count[node] and random.random() < 0.7:
                    front.extend(tree.first_child[node] + np.arange(tree.child_count[node]))
                else:
                    stopped.append(node)
            assert is_inside(points, tree.spheres[stopped]).all()


def test_levers_are_finite_and_never_below_sampled_ones(robot):
    random = np.random.default_rng(1)
    kinematics, lever = Kinematics(robot), IsotropicMotion(robot).lever
    assert np.isfinite(lever).all()
    spheres, zeros = kinematics.spheres, np.zeros(len(robot.joints))
    for _ in range(150):
        kinematics.compute(draw(robot, random), zeros)
        for joint in np.unique(spheres.joint).tolist():
            here = spheres.joint == joint
            seen = distances_from_axes(
                kinematics.model, kinematics.data, joint, kinematics.centers[here]
            )
            assert (seen <= lever[here]).all()


def test_a_monitor_sees_a_ball_come_and_says_stop(robot):
    obstacles = Obstacles(accel=10.0, speed=3.0)
    monitor = Monitor(robot, obstacles)
    q = 0.5 * (
        np.maximum(robot.lower_position_limit, -1.0) + np.minimum(robot.upper_position_limit, 1.0)
    )
    q = np.clip(q, robot.lower_position_limit + 0.05, robot.upper_position_limit - 0.05)
    v = np.zeros(len(q))
    kinematics = Kinematics(robot)
    kinematics.compute(q, v)
    target = kinematics.centers[-1]
    levels = []
    for tick in range(151):
        stamp = 0.02 * tick
        position = target + np.array([9.0 - 3.0 * stamp, 0.0, 0.0])
        obstacles.update(["ball"], stamp, [position], [[-3.0, 0.0, 0.0]], radius=0.1)
        verdict = monitor.step(stamp, q, v)
        kinds = {reason.kind for reason in verdict.reasons}
        assert not kinds & {ReasonKind.INTERNAL_ERROR, ReasonKind.BOUND_BROKEN}, verdict.reasons
        levels.append(verdict.level)
    assert levels == sorted(levels, reverse=True)
    assert levels[-1] is Level.STOP
    assert verdict.contact_time == 0.0


def park(robot):
    """A pose in the middle of the joints' ranges, at rest."""
    q = 0.5 * (
        np.maximum(robot.lower_position_limit, -1.0) + np.minimum(robot.upper_position_limit, 1.0)
    )
    q = np.clip(q, robot.lower_position_limit + 0.05, robot.upper_position_limit - 0.05)
    return q, np.zeros(len(q))


def watch(robot):
    """A monitor on an arm whose controller keeps to what is published, and its obstacles."""
    obstacles = Obstacles(accel=10.0, speed=2.0, sources=["camera"])
    return Monitor(robot, obstacles, operating="published"), obstacles


@pytest.mark.parametrize("angle", [0.0, 0.5 * np.pi])
@pytest.mark.parametrize("distance", [2.0, 3.0])
def test_a_person_who_stands_still_stops_no_parked_arm(robot, distance, angle):
    """Held by a capsule from the knees to the head, whose bounds are 10 m/s² and 2 m/s."""
    monitor, obstacles = watch(robot)
    place = distance * np.array([np.cos(angle), np.sin(angle), 0.0])
    person = place + np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 1.6]])
    q, v = park(robot)
    for tick in range(3):
        stamp = 0.001 * tick
        obstacles.update(
            ["person"], stamp, [person], np.zeros((1, 2, 3)), radius=0.2, source="camera",
            snapshot=True,
        )  # fmt: skip
        verdict = monitor.step(stamp, q, v)
    assert verdict.level >= (Level.AWARE if distance == 3.0 else Level.SLOW), verdict


def test_a_ball_that_is_thrown_stops_the_arm_in_time(robot):
    """From 3 m, at 8 m/s: the STOP comes while the arm still rests before the ball is there."""
    monitor, obstacles = watch(robot)
    q, v = park(robot)
    kinematics = Kinematics(robot)
    kinematics.compute(q, v)
    finest = kinematics.spheres.child_count == 0
    centers, radii = kinematics.centers[finest], kinematics.spheres.radius[finest]
    target = centers[-1]
    side = np.array([target[0], target[1], 0.0])
    side /= np.linalg.norm(side)
    start = target + side * (3.0 - np.linalg.norm(target[:2]))
    rests_at = None
    for tick in range(1000):
        stamp = 0.001 * tick
        position = start - 8.0 * stamp * side
        gaps = np.linalg.norm(centers - position, axis=1) - radii
        if gaps.min() <= 0.05:
            break
        obstacles.update(
            ["ball"], stamp, [position], [-8.0 * side], radius=0.05, accel=10.0, speed=9.0,
            source="camera", snapshot=True,
        )  # fmt: skip
        verdict = monitor.step(stamp, q, v)
        if verdict.level is Level.STOP and rests_at is None:
            rests_at = stamp + verdict.stop_time
    assert rests_at is not None
    assert rests_at <= stamp


def test_brakes_are_stated_for_every_joint_and_say_so_in_the_readme(robot):
    readme = (robots_directory() / robot.name / "README.md").read_text()
    rows = read_table(readme, "load up to [kg]")
    stated = {one.source for row in robot.brakes.entries.values() for one in row}
    assert len(rows) == len(stated)
    assert max(float(row[0]) for row in rows) == robot.brakes.most_payload
    for row in rows:
        assert any(row[-1].split("`")[-1].strip() in source for source in stated), row
    # Whatever is neither published nor computed by a command is marked.
    for source in stated:
        assert "CHOSEN" in source or "computed by benchmarks/" in source or "manual" in source
    assert robot.brakes.check_payload(None) == robot.brakes.most_payload
    top = robot.velocity_limit + robot.velocity_error
    covered = robot.brakes.make_curves().speed[:, -1]
    if robot.name == "panda":
        np.testing.assert_allclose(covered, 0.6 * robot.velocity_limit)
    else:
        assert (covered >= top).all()
