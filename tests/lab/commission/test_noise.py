import numpy as np
import pytest

from armguard.lab.commission.noise import estimate_noise, fit_slopes, fit_windows


@pytest.mark.parametrize("deviation", [0.0, 1e-4, 0.3])
def test_noise_is_found_on_a_smooth_course_with_kinks(deviation):
    times = np.arange(0.0, 10.0, 0.001)
    course = np.abs(np.sin(times)) + times**2
    noisy = course + np.random.default_rng(1).normal(0.0, deviation, len(times))
    assert estimate_noise(noisy) == pytest.approx(deviation, rel=0.1, abs=1e-6)


def test_parabolas_are_fitted_exactly_at_any_spacing():
    times = np.cumsum(np.random.default_rng(2).uniform(0.5, 1.5, 200))
    values, slopes, residuals = fit_windows(times, 3.0 - 2.0 * times + 0.25 * times**2, 4)
    middle = times[4:-4]
    np.testing.assert_allclose(values, 3.0 - 2.0 * middle + 0.25 * middle**2, rtol=1e-9)
    np.testing.assert_allclose(slopes, 0.5 * middle - 2.0, atol=1e-8)
    assert residuals.max() < 1e-7


def test_slopes_are_those_of_numpy():
    random = np.random.default_rng(3)
    times, values = np.cumsum(random.uniform(0.5, 1.5, 50)), random.normal(size=50)
    expected = [np.polyfit(times[k : k + 7], values[k : k + 7], 1)[0] for k in range(44)]
    np.testing.assert_allclose(fit_slopes(times, values, 7), expected, atol=1e-12)
