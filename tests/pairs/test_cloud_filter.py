import numpy as np
import pinocchio
import pytest

from armguard.exceptions import ArmguardError
from armguard.obstacles import Frame
from armguard.pairs import CloudFilter
from support.panda_monitor import HOME, panda


def place_surface(q, base=None):
    """Points of the arm's true surface in the world, in [m]. Shape (n, 3)."""
    robot = panda()
    data = robot.model.createData()
    pinocchio.forwardKinematics(robot.model, data, q)
    base = pinocchio.SE3.Identity() if base is None else base
    placed = []
    for link in robot.links:
        points = robot.triangles(link).reshape(-1, 3)[::20]
        pose = base * data.oMi[robot.joint_index(link)]
        placed.append(points @ pose.rotation.T + pose.translation)
    return np.concatenate(placed)


def measure_cover(q, points):
    """Distance of each point from the arm's finest spheres, in [m]. Shape (n,)."""
    robot = panda()
    data = robot.model.createData()
    pinocchio.forwardKinematics(robot.model, data, q)
    least = np.full(len(points), np.inf)
    for link in robot.links:
        tree = robot.cover.tree(link)
        pose = data.oMi[robot.joint_index(link)]
        for sphere in tree.spheres[tree.child_count == 0]:
            center = pose.act(sphere[:3])
            least = np.minimum(least, np.linalg.norm(points - center, axis=1) - sphere[3])
    return least


def test_what_a_camera_sees_of_the_arm_is_no_obstacle():
    """The surface is where the joints truly are, within their errors, and measured within 20 mm."""
    random = np.random.default_rng(2)
    robot = panda()
    base = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.0, 0.0, 1.0), np.array([0.4, -0.2, 0.7]))
    chosen = CloudFilter(robot, base)
    for _ in range(5):
        low, high = robot.lower_position_limit, robot.upper_position_limit
        q = random.uniform(low, high)
        true = q + robot.position_error * random.uniform(-1.0, 1.0, 7)
        points = place_surface(true, base)
        shift = random.normal(size=points.shape)
        points = points + 0.02 * shift / np.linalg.norm(shift, axis=1)[:, None]
        assert not chosen.find_others(points, q).any()


def test_nothing_is_left_out_beyond_the_blind_shell():
    random = np.random.default_rng(3)
    chosen = CloudFilter(panda())
    assert 0.02 < chosen.blind_shell < 0.03
    points = random.uniform([-0.5, -0.6, -0.1], [0.8, 0.6, 1.2], (20000, 3))
    points[::100] = np.nan
    others = chosen.find_others(points, HOME)
    away = measure_cover(HOME, points)
    assert others[~(away <= chosen.blind_shell)].all()
    assert not others[away <= 0.02].any()
    assert 100 < (~others).sum() < 10000


def test_joint_states_of_another_time_widen_the_shell():
    chosen = CloudFilter(panda(), time_error=0.01)
    assert chosen.blind_shell > CloudFilter(panda()).blind_shell + 0.01
    moved = HOME + 0.01 * panda().velocity_limit
    assert not chosen.find_others(place_surface(moved), HOME).any()


def test_points_in_a_frame():
    lens = Frame([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.5, 0.0, 1.0])
    points = np.random.default_rng(4).uniform(-1.0, 1.0, (5000, 3))
    moved = points @ lens.rotation.T + lens.translation
    chosen = CloudFilter(panda())
    there = chosen.find_others(points, HOME, lens)
    assert (there == chosen.find_others(moved, HOME)).all()
    assert (~there).any()


def test_a_trail_takes_what_is_close_behind_the_shell_on_a_ray_and_nothing_else():
    """Rays are walked back in steps of a millimetre, which errs by half of that."""
    random = np.random.default_rng(5)
    trail, camera = 0.15, np.array([1.4, 0.3, 1.8])
    plain, chosen = CloudFilter(panda()), CloudFilter(panda(), trail=trail)
    lens = Frame([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.5, 0.0, 1.0])
    points = random.uniform([-0.5, -0.6, -0.1], [0.8, 0.6, 1.2], (4000, 3))
    ray = camera - points
    away = np.linalg.norm(ray, axis=1, keepdims=True)
    steps = np.arange(0.0, trail + 5e-4, 1e-3)
    least = np.array(
        [plain.find_others(points + min(step, trail) * ray / away, HOME) for step in steps]
    ).all(axis=0)
    others = chosen.find_others(points, HOME, origin=camera)
    assert not (others & ~least).any()  # nothing that touches on the way is left
    grown = CloudFilter(panda(), shell=0.021, trail=trail).find_others(points, HOME, origin=camera)
    assert (least >= grown).all()
    assert (plain.find_others(points, HOME) & ~others).sum() > 50
    inverse = (points - lens.translation) @ lens.rotation
    seen_from = (camera - lens.translation) @ lens.rotation
    assert (chosen.find_others(inverse, HOME, lens, seen_from) == others).mean() > 0.999
    # A point before the arm, and one in the camera, have no trail that reaches it.
    near = camera + 0.3 * (np.array([0.0, 0.0, 0.3]) - camera)
    assert chosen.find_others([near, camera], HOME, origin=camera).all()


@pytest.mark.parametrize("origin", [None, [0.0, 0.0], [0.0, np.nan, 0.0]])
def test_a_trail_needs_to_know_where_rays_begin(origin):
    with pytest.raises(ArmguardError, match="origin"):
        CloudFilter(panda(), trail=0.1).find_others(np.zeros((1, 3)), HOME, origin=origin)


@pytest.mark.parametrize(
    ("points", "q", "offender"),
    [
        ([[1.0, 2.0]], HOME, "points"),
        ([1.0, 2.0, 3.0], HOME, "points"),
        ([[1.0, 2.0, 3.0]], HOME[:6], "q"),
        ([[1.0, 2.0, 3.0]], np.full(7, np.nan), "q"),
    ],
)
def test_what_makes_no_sense_is_refused_by_name(points, q, offender):
    with pytest.raises(ArmguardError, match=f"^{offender}"):
        CloudFilter(panda()).find_others(points, q)


@pytest.mark.parametrize("name", ["shell", "time_error", "trail"])
@pytest.mark.parametrize("value", [-0.1, np.nan, np.inf])
def test_a_shell_is_a_length(name, value):
    with pytest.raises(ArmguardError, match=f"^{name}"):
        CloudFilter(panda(), **{name: value})
