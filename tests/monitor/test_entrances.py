"""What may come out of an entrance: nothing touches the arm before the verdicts say so."""

import numpy as np
import pinocchio
import pytest

from armguard.exceptions import ArmguardError
from armguard.monitor.entrances import GOLDEN, distance_to_hull
from armguard.obstacles import Obstacles
from armguard.verdict import Level, ReasonKind
from support.nearest_points import closest_in_hull
from support.panda_monitor import HOME, SCHEDULES, STILL, make_monitor, panda

DOOR = np.array([[1.6, -0.4, 0.0], [1.6, 0.4, 0.0], [1.6, -0.4, 2.0], [1.6, 0.4, 2.0]])


def leaves(q):
    """Centres and radii of the arm's finest spheres, placed by Pinocchio alone. Shape (n, 4)."""
    robot = panda()
    data = robot.model.createData()
    pinocchio.forwardKinematics(robot.model, data, q)
    placed = []
    for link in robot.links:
        tree = robot.cover.tree(link)
        pose = data.oMi[robot.joint_index(link)]
        spheres = tree.spheres[tree.child_count == 0]
        placed.append(
            np.column_stack([spheres[:, :3] @ pose.rotation.T + pose.translation, spheres[:, 3]])
        )
    return np.concatenate(placed)


@pytest.mark.parametrize("schedule", SCHEDULES[:3])
def test_an_entrance_counts_as_a_body_of_any_velocity_that_is_seen_there_at_every_tick(schedule):
    """One that stands is seen at every tick, of unknown velocity and stamped with the tick."""
    entrances, bodies = Obstacles(sources=[], speed=1.7), Obstacles(speed=1.7)
    entrances.add_entrance("door", DOOR, 0.3, 0.1)
    radius = float(entrances.table.radius[0])
    (_, monitor), (_, other) = (
        make_monitor(schedule, obstacles=one) for one in (entrances, bodies)
    )
    fresh = np.nan
    for tick in range(40):
        now = 0.001 * tick
        bodies.update(["door"], now, DOOR[None], radius=radius)
        bodies.table.position_error[0] = 0.0
        verdict, expected = monitor.step(now, HOME, STILL), other.step(now, HOME, STILL)
        assert verdict.obstacle == "door"
        # The arm rests: an older certificate is shorter by its age, and made anew in time.
        fresh = verdict.contact_time if tick == 0 else fresh
        assert 0.7 * fresh < verdict.contact_time <= fresh + 1e-9
        if tick == 0 or schedule != "deadline":
            assert verdict.contact_time == pytest.approx(expected.contact_time, abs=1e-8)


def swing(time):
    return HOME + 0.2 * (1.0 - np.cos(3.0 * time)), STILL + 0.6 * np.sin(3.0 * time)


def gaps_to_door(balls):
    """Distance of each ball's surface from the rectangle that the door is, in [m]."""
    nearest = np.clip(balls[:, :3], DOOR.min(axis=0), DOOR.max(axis=0))
    return np.linalg.norm(balls[:, :3] - nearest, axis=1) - balls[:, 3]


@pytest.mark.hazard("H-02")
def test_nothing_that_comes_out_touches_before_the_verdict_says():
    """All bodies that can have come out, at any moment, by any way that their speed allows.

    Those that have not been found at a tick left the region `delay` before it at the earliest: at a
    time T the nearest of them is nearer than the region by pace (T - tick + delay), for it is
    convex. The arm swings, and so meets them as soon as its surface is no farther than that.
    """
    delay, pace, radius, period = 0.15, 2.0, 0.25, 0.002
    obstacles = Obstacles(sources=[], speed=pace)
    obstacles.add_entrance("door", DOOR, radius, delay)
    _, monitor = make_monitor(obstacles=obstacles, rate=1.0 / period)
    times = period * np.arange(1000)
    room = np.array([gaps_to_door(leaves(swing(time)[0])).min() - radius for time in times])
    met = 0
    for tick, time in enumerate(times[:400]):
        verdict = monitor.step(time, *swing(time))
        assert verdict.obstacle == "door"
        reached = room[tick:] <= pace * (times[tick:] - time + delay)
        if reached.any():
            met += 1
            first = times[tick + int(np.argmax(reached))]
            assert time + verdict.contact_time <= first
    assert met > 300


def test_the_promise_of_each_tick_is_tight_for_the_fastest_way_out():
    """A body that runs straight at an arm at rest meets it no sooner, and hardly later."""
    obstacles = Obstacles(sources=[], speed=2.0)
    obstacles.add_entrance("door", DOOR, 0.25, 0.1)
    _, monitor = make_monitor("full", obstacles=obstacles, motion="isotropic")
    told = monitor.step(0.0, HOME, STILL).contact_time
    latest = (gaps_to_door(leaves(HOME)).min() - 0.25 - 0.1 * 2.0) / 2.0
    assert 0.1 * latest < told <= latest


def test_an_entrance_that_the_arm_is_in_is_a_stop_that_names_it():
    obstacles = Obstacles(sources=[])
    obstacles.add_entrance("hatch", leaves(HOME)[-1, :3], 0.1, 0.1)
    _, monitor = make_monitor(obstacles=obstacles)
    verdict = monitor.step(0.0, HOME, STILL)
    assert verdict.level is Level.STOP
    assert verdict.contact_time == 0.0
    assert verdict.obstacle == "hatch"
    (reason,) = (one for one in verdict.reasons if one.kind is ReasonKind.CONTACT)
    assert "hatch" in reason.subject
    assert "may come out of it unseen" in reason.detail
    explanation = monitor.explain()
    assert explanation.obstacle == "hatch"
    assert explanation.obstacle_age == 0.0


@pytest.mark.parametrize("points", [[[0.0, 0.0, 0.3]], "box"])
def test_an_entrance_around_a_link_is_refused_by_name(points):
    corners = np.array(np.meshgrid([-2, 2], [-2, 2], [-1, 2])).reshape(3, 8).T.astype(float)
    place, radius = (corners, 0.0) if points == "box" else (points, 1.0)
    obstacles = Obstacles(sources=[])
    obstacles.add_entrance("room", place, radius, 0.0)
    with pytest.raises(ArmguardError, match=r"'room': is around panda_link\d"):
        make_monitor(obstacles=obstacles)
    # What is not watched against it may be in it.
    obstacles.add_static("post", [9.0, 0.0, 0.0], 0.1)
    ignore = [(link, "room") for link in panda().links]
    make_monitor(obstacles=obstacles, ignore=ignore)


def test_an_entrance_that_a_link_can_leave_by_a_little_is_none_around_it():
    """The link's reach is a ball: a region that is smaller by little does not hold all of it."""
    _, monitor = make_monitor(obstacles=Obstacles(sources=[]))
    *place, reach = monitor._scheduler.arm.motion.reach.link_balls[0].tolist()
    around = reach * 3.0**0.5 / GOLDEN**2 * (1.0 + GOLDEN**2) ** 0.5
    for share, is_around in ((1.001, True), (0.97, False)):
        obstacles = Obstacles(sources=[])
        obstacles.add_entrance("room", [place], share * around, 0.0)
        ignore = [(link, "room") for link in panda().links[1:]]
        if is_around:
            with pytest.raises(ArmguardError, match=f"'room': is around {panda().links[0]}"):
                make_monitor(obstacles=obstacles, ignore=ignore)
        else:
            make_monitor(obstacles=obstacles, ignore=ignore)


def test_distances_to_hulls_are_never_too_short():
    random = np.random.default_rng(3)
    for count in (1, 2, 3, 5, 8):
        for _ in range(40):
            points = random.normal(size=(count, 3))
            place = 2.0 * random.normal(size=3)
            expected = np.linalg.norm(closest_in_hull(points - place))
            found = distance_to_hull(place, points)
            assert expected - 1e-7 <= found <= expected + 1e-3
