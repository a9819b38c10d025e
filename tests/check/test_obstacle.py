import numpy as np
import pytest

from armguard_check.intervals import BITS, ProofError, read, read_vector
from armguard_check.obstacle import Body

SCALE = 1 << BITS
STATE = {
    "stamp": 1.0,
    "points": [1.0, 0.0, 0.0, 1.2, 0.1, 0.0],
    "velocities": [-0.5, 0.2, 0.0, -0.4, 0.0, 0.1],
    "radius": 0.1,
    "position_error": 0.01,
    "velocity_error": 0.05,
    "accel": 2.0,
    "speed": 1.0,
}


@pytest.mark.parametrize("accel", [0.5, 2.0, 50.0])
@pytest.mark.parametrize("now", [0.8, 1.0, 1.3])
def test_no_motion_within_bounds_leaves_less_room(accel, now):
    random = np.random.default_rng(5)
    body = Body(STATE | {"accel": accel}, read(now))
    assert body.size.high / SCALE == pytest.approx(0.11)
    for _ in range(20):
        normal = random.normal(size=3)
        normal /= np.linalg.norm(normal)
        end = float(random.uniform(0.05, 0.8))
        room = body.room(read_vector(normal.tolist()), read_vector([0.0] * 3), read(0.0), read(end))
        for k in (0, 3):
            place, rate = (np.array(STATE[key][k : k + 3]) for key in ("points", "velocities"))
            # From the stamp on, or back to it, as hard towards the place as it can.
            for t in np.linspace(0.0, end, 7):
                s = now - STATE["stamp"] + t
                steps, sign = np.linspace(0.0, abs(s), 400), np.sign(s) or 1.0
                v = sign * rate - 0.05 * normal
                where = place.copy()
                for dt in np.diff(steps):
                    faster = v - accel * dt * normal
                    faster *= min(1.0, 1.0 / np.linalg.norm(faster))
                    where, v = where + 0.5 * (v + faster) * dt, faster
                assert room.low / SCALE <= normal @ where + 1e-3 * abs(s)


def test_without_a_bound_on_acceleration_it_is_fast_at_once():
    body = Body(STATE | {"accel": "Infinity"}, read(1.0))
    room = body.room(read_vector([1.0, 0.0, 0.0]), read_vector([0.0] * 3), read(0.0), read(0.5))
    assert room.low / SCALE == pytest.approx(0.5)
    fixed = Body(STATE | {"accel": 0.0, "velocity_error": 0.0}, read(1.0))
    room = fixed.room(read_vector([1.0, 0.0, 0.0]), read_vector([0.0] * 3), read(0.0), read(0.5))
    assert room.low / SCALE == pytest.approx(0.75)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"radius": -0.01, "position_error": 0.1}, "radius is -0.01"),
        ({"position_error": -0.01}, "position_error is -0.01"),
        ({"accel": -1.0}, "accel is -1.0"),
        ({"speed": "-Infinity"}, "speed is '-Infinity'"),
        ({"velocity_error": float("nan")}, "velocity_error is nan"),
        ({"points": [], "velocities": []}, "no points"),
        ({"points": [1.0, 2.0], "velocities": [1.0, 2.0]}, "points is not a list of 3"),
    ],
)
def test_states_that_are_none_are_refused(change, why):
    with pytest.raises(ProofError, match=why):
        Body(STATE | change, read(1.0))


def test_each_point_has_a_velocity():
    with pytest.raises(ValueError, match="shorter"):
        Body(STATE | {"velocities": [0.0, 0.0, 0.0]}, read(1.0))
