"""Points against exact geometry, and what counts as flying against its definition."""

import numpy as np
import pytest

from armguard.bridges.depth import Background, PinholeCamera, find_flying, stereo_error
from armguard.exceptions import ArmguardError

CAMERA = PinholeCamera((135.0, 140.0), (127.5, 71.5), farthest=5.0)
SHAPE = 144, 256
RANDOM = np.random.default_rng(1)


def look(surface, camera=CAMERA):
    """Depth at which the ray of each pixel meets a surface, NaN where it does not, in [m]."""
    u, v = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    rays = np.stack(
        [
            (u - camera.center[0]) / camera.focal_length[0],
            (v - camera.center[1]) / camera.focal_length[1],
            np.ones(SHAPE),
        ],
        axis=-1,
    )
    return surface(rays)


def test_a_plane_and_a_ball_are_where_they_are():
    normal = np.array([0.1, -0.4, 1.0])
    points = CAMERA.place(look(lambda rays: 2.0 / (rays @ normal)))
    assert points.shape == (SHAPE[0] * SHAPE[1], 3)
    np.testing.assert_allclose(points @ normal, 2.0, rtol=1e-12)
    middle, radius = np.array([0.2, -0.1, 1.5]), 0.4

    def ball(rays):
        square, along = (rays**2).sum(axis=-1), rays @ middle
        with np.errstate(invalid="ignore"):
            root = np.sqrt(along**2 - square * (middle @ middle - radius**2))
        return (along - root) / square

    points = CAMERA.place(look(ball))
    seen = np.isfinite(points).all(axis=1)
    assert 1000 < seen.sum() < len(points)
    away = np.linalg.norm(points[seen] - middle, axis=1)
    np.testing.assert_allclose(away, radius, rtol=1e-9)
    assert np.isnan(points[~seen]).all()


def test_a_pixel_is_where_row_and_column_say():
    depth = np.full((3, 5), np.nan)
    depth[2, 4] = 2.0
    points = PinholeCamera((100.0, 50.0), (2.0, 1.0)).place(depth)
    assert points[2 * 5 + 4].tolist() == [2.0 * 2 / 100, 2.0 * 1 / 50, 2.0]
    assert np.isnan(np.delete(points, 14, axis=0)).all()


@pytest.mark.parametrize("kind", [np.uint16, np.int32, np.float32, np.float64])
def test_units_become_metres(kind):
    assert CAMERA.read(np.array([[1500]], kind)).tolist() == [[1.5]]


def test_what_is_no_depth_is_none():
    image = [[np.nan, np.inf, -np.inf, 0.0, -1500.0, 99.0, 5001.0, 1e300, 100.0, 5000.0]]
    depth = CAMERA.read(image)
    assert np.isnan(depth[0, :8]).all()
    assert depth[0, 8:].tolist() == [0.1, 5.0]
    assert np.isnan(CAMERA.read(np.array([[0, 65535]], np.uint16))).all()
    before = np.array([[0.0, 1500.0]])
    CAMERA.read(before)
    assert before.tolist() == [[0.0, 1500.0]], "what is given is not written to"
    assert CAMERA.read(np.zeros((0, 0))).shape == (0, 0)


@pytest.mark.parametrize(
    "image", [1.0, [1.0, 2.0], np.zeros((2, 2, 3)), [["a"]], np.zeros((2, 2), bool), None]
)
def test_what_is_no_image_is_refused(image):
    with pytest.raises(ArmguardError, match=r"^image"):
        CAMERA.read(image)


@pytest.mark.parametrize(
    ("changes", "offender"),
    [
        ({"focal_length": (0.0, 100.0)}, "focal_length"),
        ({"focal_length": (100.0, np.nan)}, "focal_length"),
        ({"focal_length": (100.0,)}, "focal_length"),
        ({"center": (np.inf, 0.0)}, "center"),
        ({"scale": 0.0}, "scale"),
        ({"scale": np.nan}, "scale"),
        ({"nearest": 0.0}, "nearest"),
        ({"farthest": np.inf}, "nearest, farthest"),
        ({"nearest": 3.0, "farthest": 2.0}, "nearest"),
    ],
)
def test_a_camera_that_cannot_be_is_refused(changes, offender):
    with pytest.raises(ArmguardError, match=f"^{offender}"):
        PinholeCamera(**({"focal_length": (1.0, 1.0), "center": (0.0, 0.0)} | changes))


def test_no_point_of_a_surface_is_farther_from_all_points_than_the_position_error():
    """A surface across the axis, whose depths are all off by the error."""
    error = 0.05
    true = CAMERA.place(np.full(SHAPE, 2.0)).reshape(*SHAPE, 3)
    seen = CAMERA.place(np.full(SHAPE, 2.0 + error)).reshape(*SHAPE, 3)
    middle = 0.5 * (true[:-1, :-1] + true[1:, 1:])
    away = np.linalg.norm(middle - seen[:-1, :-1], axis=-1).max()
    bound = CAMERA.position_error(2.0, error, SHAPE)
    assert away <= bound <= away + 0.02
    assert np.linalg.norm(true - seen, axis=-1).max() == pytest.approx(
        bound - CAMERA.position_error(2.0, 0.0, SHAPE), rel=1e-12
    )


def test_a_stereo_error_holds_what_the_disparity_may_be_off_by():
    focal_length, baseline, subpixel = 447.0, 0.095, 0.08
    for depth in (0.5, 1.0, 3.0, 10.0):
        disparity = focal_length * baseline / depth
        error = float(stereo_error(depth, focal_length, baseline, subpixel))
        assert focal_length * baseline / (disparity - 4.0 * subpixel) == pytest.approx(
            depth + error
        )
        assert focal_length * baseline / (disparity + 4.0 * subpixel) > depth - error
    assert stereo_error([133.0, 1e300], focal_length, baseline).tolist() == [np.inf, np.inf]
    assert np.isnan(stereo_error([np.nan], focal_length, baseline)).all()


@pytest.mark.parametrize("name", ["focal_length", "baseline", "subpixel"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_a_stereo_camera_that_cannot_be_is_refused(name, value):
    numbers = {"focal_length": 447.0, "baseline": 0.095, "subpixel": 0.08} | {name: value}
    with pytest.raises(ArmguardError, match=rf"^{name}"):
        stereo_error(1.0, **numbers)


def find_flying_slowly(depth, step, reach):
    """Pixel by pixel, as the definition has it."""
    flying = np.zeros(depth.shape, bool)
    for i, j in np.ndindex(*depth.shape):

        def look_around(distance, i=i, j=j):
            places = np.ndindex(*depth.shape)
            return [
                depth[k, m]
                for k, m in places
                if 0 < max(abs(k - i), abs(m - j)) <= distance and np.isfinite(depth[k, m])
            ]

        is_behind = any(one < depth[i, j] - step for one in look_around(reach))
        is_level = any(abs(one - depth[i, j]) <= step for one in look_around(1))
        flying[i, j] = np.isfinite(depth[i, j]) and (is_behind or not is_level)
    return flying


@pytest.mark.parametrize("seed", range(20))
def test_flying_pixels_are_those_of_the_definition(seed):
    random = np.random.default_rng(seed)
    shape, reach = random.integers(1, 10, 2), int(random.integers(1, 4))
    depth = random.uniform(1.0, 1.6, shape)
    depth[random.random(shape) < 0.2] = np.nan
    assert (find_flying(depth, 0.1, reach) == find_flying_slowly(depth, 0.1, reach)).all()


@pytest.mark.parametrize("seed", range(20))
def test_a_surface_keeps_what_is_not_beside_a_nearer_one(seed):
    """Surfaces are painted over each other, noisy and slanted, and pixels are missing."""
    random = np.random.default_rng(seed)
    step, shape = 0.12, (60, 80)
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    true, surface = np.full(shape, 3.0), np.zeros(shape, int)
    for number in range(1, 8):
        top, left = random.integers(0, shape[0] - 2), random.integers(0, shape[1] - 2)
        down, across = random.integers(1, 30, 2)
        slope = random.uniform(-0.015, 0.015, 2)
        depth = random.uniform(1.0, 2.8) + slope[0] * (rows - top) + slope[1] * (columns - left)
        inside = (rows >= top) & (rows < top + down) & (columns >= left) & (columns < left + across)
        inside &= depth < true
        true[inside], surface[inside] = depth[inside], number
    seen = true + random.uniform(-0.02, 0.02, shape)
    seen[random.random(shape) < 0.02] = np.nan
    flying = find_flying(seen, step)
    for i in range(shape[0]):
        for j in range(shape[1]):
            around = np.s_[max(0, i - 1) : i + 2, max(0, j - 1) : j + 2]
            wide = np.s_[max(0, i - 2) : i + 3, max(0, j - 2) : j + 3]
            same = (surface[around] == surface[i, j]) & np.isfinite(seen[around])
            has_nearer = (surface[wide] != surface[i, j]) & (true[wide] < true[i, j])
            has_nearer = has_nearer.any()
            if np.isfinite(seen[i, j]) and same.sum() >= 2 and not has_nearer:
                assert not flying[i, j]


def test_what_flies_at_an_edge_is_found_and_so_is_the_rim_behind_it():
    depth = np.full((40, 40), 3.0)
    depth[:, :20] = 1.5
    depth[:, 20] = np.linspace(1.7, 2.95, 40)  # between both, one pixel wide
    for reach, lost in ((1, 21), (2, 22)):
        flying = find_flying(depth, 0.12, reach)
        assert flying[:, 20:lost].all()
        assert not flying[:, :20].any()
    depth[:, 20], depth[:, 21] = np.nan, 2.5  # behind a hole
    assert find_flying(depth, 0.12)[:, 21].all()


@pytest.mark.parametrize("step", [0.0, -1.0, np.nan, np.inf])
def test_a_step_is_a_length(step):
    with pytest.raises(ArmguardError, match=r"^step"):
        find_flying(np.ones((2, 2)), step)


@pytest.mark.parametrize("reach", [0, -1, 1.5, np.nan])
def test_a_reach_is_a_number_of_pixels(reach):
    with pytest.raises(ArmguardError, match=r"^reach"):
        find_flying(np.ones((2, 2)), 0.1, reach)


def test_only_what_is_before_the_background_counts():
    background, shape = Background(), (20, 30)
    wall = np.full(shape, 3.0)
    wall[:, :10] = 2.0
    for _ in range(30):
        seen = wall + RANDOM.uniform(-0.03, 0.03, shape)
        seen[RANDOM.random(shape) < 0.1] = np.nan
        seen[12:16, 20:24] = np.nan  # never seen
        background.learn(seen)
    quiet = background.find_nearer(wall + RANDOM.uniform(-0.03, 0.03, shape), 0.03)
    quiet[13:15, 21:23] = False
    assert not quiet.any()
    # The middle of what was never seen has no background: whatever is there counts.
    assert background.find_nearer(np.full(shape, 9.0), 0.03)[13:15, 21:23].all()
    hand = wall.copy()
    hand[5, 25] = 2.9
    assert np.argwhere(background.find_nearer(hand, 0.03))[0].tolist() == [5, 25]
    assert not background.find_nearer(np.full(shape, np.nan), 0.0).any()
    # Beside the nearer wall, the farther one has the depth of the nearer.
    assert not background.find_nearer(np.full(shape, 2.0), 0.03)[:, 10].any()
    assert background.find_nearer(np.full(shape, 2.0), 0.03)[0, 11:].all()


def test_a_background_knows_its_shape():
    background = Background()
    with pytest.raises(ArmguardError, match=r"^depth"):
        background.find_nearer(np.ones((2, 3)), 0.0)
    background.learn(np.ones((2, 3)))
    for call in (background.learn, lambda depth: background.find_nearer(depth, 0.0)):
        with pytest.raises(ArmguardError, match=r"shape \(3, 2\)"):
            call(np.ones((3, 2)))
