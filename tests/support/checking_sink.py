"""A sink that keeps what was published and tests each row against the one before, in plain NumPy.

The reference for what a table of obstacles has to find: it shares no code with armguard.
"""

import numpy as np

ACCEL, SPEED = 10.0, 2.0
SLACK = 1e-12


class GrowthSink:
    """Takes rows; counts those that the growth of the last accepted one does not allow."""

    def __init__(self):
        self.calls = []
        self.last = {}
        self.refused = []
        self.taken = 0

    def update(
        self,
        ids,
        stamp,
        position,
        velocity=None,
        radius=None,
        accel=None,
        speed=None,
        position_error=0.0,
        velocity_error=0.0,
        source="default",
    ):
        position = np.asarray(position, dtype=float)
        self.calls.append((list(ids), stamp, position, velocity, source))
        radius, position_error, velocity_error = (
            np.broadcast_to(value, len(ids)) for value in (radius, position_error, velocity_error)
        )
        accel = ACCEL if accel is None else accel
        speed = SPEED if speed is None else speed
        for row, name in enumerate(ids):
            points, velocities = (
                np.asarray(array)[row].reshape(-1, 3) for array in (position, velocity)
            )
            assert np.isfinite(points).all()
            assert np.isfinite(velocities).all()
            assert radius[row] > 0.0
            new = (stamp, points, velocities, position_error[row], velocity_error[row])
            if self._allows(self.last.get(name), new, accel, speed):
                self.last[name] = new
                self.taken += 1
            else:
                self.refused.append((name, stamp))

    @staticmethod
    def _allows(old, new, accel, speed):
        stamp1, x1, v1, dp1, dv1 = new
        if not (np.linalg.norm(v1, axis=1) <= speed + dv1 + SLACK).all():
            return False
        if old is None:
            return True
        stamp0, x0, v0, dp0, dv0 = old
        h = stamp1 - stamp0
        room = accel * h * h / 2 + dv0 * h + dp0 + dp1 + SLACK
        return bool(
            (np.linalg.norm(x1 - x0 - v0 * h, axis=1) <= room).all()
            and (np.linalg.norm(x1 - x0, axis=1) <= speed * h + dp0 + dp1 + SLACK).all()
            and (np.linalg.norm(v1 - v0, axis=1) <= accel * h + dv0 + dv1 + SLACK).all()
        )
