"""What dense samples of a simulated motion show, in plain NumPy."""

import numpy as np

LARGEST_JERK = 180.0  # [m/s³]


def sample_densely(source, times):
    return (np.array(part) for part in zip(*(source.sample(time) for time in times), strict=True))


def check_motion(source, duration, speed, accel, dt=2e-3):
    """Speeds and accelerations within bounds, velocities the derivative of positions."""
    times = np.arange(0.0, duration, dt)
    x, v = sample_densely(source, times)
    a = np.diff(v, axis=0) / dt
    assert np.linalg.norm(v, axis=2).max() <= speed
    assert np.linalg.norm(a, axis=2).max() <= accel
    # Simpson's rule, off by some dt³ where the jerk jumps: a forgotten factor would show.
    travel = (v[:-2] + 4 * v[1:-1] + v[2:]) * (dt / 3)
    assert np.abs(x[2:] - x[:-2] - travel).max() < 2.0 * dt**3
    # Twice continuously differentiable: accelerations do not jump.
    assert np.linalg.norm(np.diff(a, axis=0), axis=2).max() < LARGEST_JERK * dt
    return x, v
