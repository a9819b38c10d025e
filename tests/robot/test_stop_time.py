import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armguard.robot.stop_time import ALL_COVERED, compute_stop_time
from support.urdf_arms import hold


def plain_stop_time(v, errors, limits, accels, brakes, age, horizon, reaction):
    worst = 0.0
    for speed, error, limit, accel, brake in zip(v, errors, limits, accels, brakes, strict=True):
        free = age + horizon + reaction
        fastest = min(limit, abs(speed) + error + accel * free)
        worst = max(worst, fastest / brake)
    return horizon + reaction + worst


joints = st.integers(1, 7).flatmap(
    lambda n: st.tuples(
        *(
            st.lists(st.floats(low, high), min_size=n, max_size=n)
            for low, high in ((-2.0, 2.0), (0.0, 0.1), (2.0, 3.0), (1.0, 20.0), (0.5, 5.0))
        )
    )
)


@given(joints, st.floats(0.0, 0.1), st.floats(1e-4, 0.1), st.floats(0.0, 0.1))
def test_stop_time_is_the_formula(arm, age, horizon, reaction):
    arrays = [np.array(part) for part in arm]
    found = compute_stop_time(*arrays[:4], hold(arrays[4]), age, horizon, reaction, arrays[3])[0]
    assert found == pytest.approx(plain_stop_time(*arm, age, horizon, reaction), rel=1e-12)


@given(joints, st.floats(0.01, 1.0), st.floats(-0.1, 0.1))
def test_with_operating_limits_joints_speed_up_gently_and_were_faster_before(arm, share, age):
    v, errors, limits, accels, brakes = (np.array(part) for part in arm)
    horizon, reaction = 0.003, 0.02
    speeding = share * accels
    times = age, horizon, reaction
    held = hold(brakes)
    stop_time = compute_stop_time(v, errors, limits, accels, held, *times, speeding)[0]
    assert stop_time <= compute_stop_time(v, errors, limits, accels, held, *times, accels)[0]
    for begin in np.linspace(0.0, horizon + reaction, 5):
        # Before the stamp it can have been faster by what it can slow down.
        rate = speeding if age + begin > 0.0 else accels
        speed = np.minimum(limits, np.abs(v) + errors + rate * abs(age + begin))
        assert (begin + speed / brakes <= stop_time * (1.0 + 1e-12)).all()


@given(joints, st.floats(-0.1, 0.1))
def test_a_joint_is_uncovered_where_it_may_be_too_fast_when_its_brakes_bite(arm, age):
    v, errors, limits, accels, _ = (np.array(part) for part in arm)
    speed = np.minimum(limits, np.abs(v) + errors + accels * max(age + 0.02, -age, 0.02))
    for share, uncovered in ((1.001, ALL_COVERED), (0.999, len(v) - 1)):
        stated = 2.0 * speed
        stated[-1] = share * speed[-1]
        brakes = hold(accels)._replace(speed=stated[:, None])
        times = age, 0.005, 0.015
        found = compute_stop_time(v, errors, limits, accels, brakes, *times, accels)[1]
        assert found == uncovered
