"""A Panda that moves slowly beside a hand, which may be touched."""

import functools

import numpy as np

from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot.kinematics import Kinematics
from armguard.settings.contact_limits import ContactLimit, ContactLimits
from support.panda_monitor import HOME, PERIOD, STILL, panda

LIMITS = ContactLimits(
    {"hand": ContactLimit(force=80.0, stiffness=1.0, body_mass=1e4, source="test", gap=0.05,
                          thickness=10.0)}
)  # fmt: skip
"""0.8 m/s, and any way where it is clamped."""
RADIUS = 0.05


@functools.cache
def find_front():
    """Centre and radius of the sphere of the last link that stands out farthest along x."""
    kinematics = Kinematics(panda())
    kinematics.compute(HOME, STILL)
    spheres = kinematics.spheres
    is_leaf = spheres.tree.first_child < 0
    leaves = np.flatnonzero(is_leaf & (spheres.link == spheres.link.max()))
    front = leaves[np.argmax(kinematics.centers[leaves, 0] + spheres.radius[leaves])]
    return kinematics.centers[front].copy(), float(spheres.radius[front])


def find_columns():
    """Columns of the Jacobian of the front sphere's centre, and axes of the joints, (3, nv)."""
    kinematics = Kinematics(panda())
    kinematics.compute(HOME, STILL)
    center, _ = find_front()
    jacobian = np.array(kinematics.placement.jacobian)
    return (jacobian[:, :3] + np.cross(jacobian[:, 3:], center)).T, jacobian[:, 3:].T


def go_straight(velocity):
    """Joint velocities that move the last link so, in [m]/[s], without turning it."""
    columns, axes = find_columns()
    wanted = np.concatenate([velocity, np.zeros(3)])
    return np.linalg.lstsq(np.concatenate([columns, axes]), wanted, rcond=None)[0]


class Encounter:
    """The arm at rest or nearly so, and a hand before it.

    Args:
        away: How far the hand is from the arm at first, in [m].
        limits: Of contact; None: none.
        settings: Of the monitor.
    """

    def __init__(self, away=0.03, *, limits=LIMITS, **settings):
        self.obstacles = Obstacles(sources=["default"], accel=np.inf, speed=1.0)
        settings = {"rise_delay": 0.0, "latency": 0.0, "reaction_time": 0.005} | settings
        self.monitor = Monitor(panda(), self.obstacles, contact_limits=limits, **settings)
        self.tick, self.q, self.v = -1, HOME.copy(), STILL.copy()
        self.away = away

    def place(self, away):
        center, radius = find_front()
        return center + np.array([radius + RADIUS + away, 0.0, 0.0])

    def see(self, name="p/hand", *, away=None, region="hand", position=None, **fields):
        """A message about a body part at the time of the next tick."""
        place = self.place(self.away if away is None else away) if position is None else position
        fields = {"radius": RADIUS} | fields
        self.obstacles.update(
            [name], (self.tick + 1) * PERIOD, [place], [[0.0] * 3], region=region, **fields
        )

    def step(self, q=None):
        self.tick += 1
        if q is not None:
            self.q = np.asarray(q, dtype=float)
        return self.monitor.step(self.tick * PERIOD, self.q, self.v)

    def go(self, ticks=3, **fields):
        """Some ticks in each of which the hand is seen; the last verdict."""
        for _ in range(ticks):
            self.see(**fields)
            verdict = self.step()
        return verdict

    @property
    def scheduler(self):
        return self.monitor._scheduler

    def row(self, name="p/hand"):
        return self.obstacles.row(name)
