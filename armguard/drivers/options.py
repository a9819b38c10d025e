"""Options of a driver's process, as JSON on its command line."""

from __future__ import annotations

from pathlib import Path

import msgspec

from armguard.bridges.ros2 import FrameErrors
from armguard.streams.keys import Keys

WRONG_ARM, LOST, ENDED = 2, 3, 4
"""Exit codes: another try is useless; the robot was lost, and was stopped if possible; a signal, or
the end of its parent, ended the process, with the arm at rest."""

END_TIMEOUT = 2.0
"""How long a process may take to end after a signal, besides the time for the arm to rest, in
[s]."""

LONGEST_HANG = 2.0
"""Silence after which the process of a robot that stops by itself is ended, in [s]."""


class ObstacleTopic(msgspec.Struct, frozen=True, kw_only=True):
    """A topic of a ROS 2 graph that reports obstacles."""

    topic: str
    kind: str
    """Type of its messages."""
    radius: float | None
    """Radius of bodies without sizes, in [m]."""
    snapshot: bool
    """Whether each message shows all bodies that its source sees."""


class Ros2Options(msgspec.Struct, frozen=True, kw_only=True):
    """Further options of the driver of a ROS 2 graph."""

    domain: int
    joint_states: str
    """Topic of the joint states."""
    speed_override: str
    """Topic to send the speed to."""
    acknowledge: str
    """Topic by which the arm may move again after a restart; empty: a restart does not hold it."""
    trajectory: str
    """Topic to send trajectories to; empty: there is none."""
    obstacles: dict[str, ObstacleTopic]
    """By source."""
    obstacle_address: str
    """Address to publish obstacles to."""
    frames: tuple[str, ...]
    """Frames that the monitor knows."""
    frame_errors: dict[str, FrameErrors]
    """Of others, by name or pattern."""
    acceleration_limit: tuple[float, ...]
    """Of the joints, in [rad/s²]."""
    position_error: tuple[float, ...]
    """In [rad]."""
    velocity_error: tuple[float, ...]
    """In [rad/s]."""
    is_continuous: tuple[bool, ...]
    """Whether a joint turns without end."""


class FrankaOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Further options of the driver of a Franka."""

    waypoints: tuple[tuple[float, ...], ...]
    """Positions of the joints between which the driver moves it, in [rad]; empty behind a
    shield."""
    velocities: tuple[float, ...]
    """Velocity limits that the monitor assumes, in [rad/s]."""
    accelerations: tuple[float, ...]
    """Acceleration limits of the joints, in [rad/s²]."""
    contact_force: float | None
    """The least force that a contact limit of the cell permits, in [N]; None: none states one."""


class DriveOptions(msgspec.Struct, frozen=True, kw_only=True):
    """All options of a driver's process."""

    driver: str
    """Which robot's: "ur", "franka" or "ros2"."""
    host: str
    """Name or address of the robot's controller, or which domain it is in."""
    model: str
    """Model of the robot, such as "UR5e" or "FR3"."""
    rate: float
    """Joint states a second, in [Hz]; 0: as many as come."""
    names: tuple[str, ...]
    """Of the joints, in the robot's own order."""
    timeout: float
    """Silence of the robot after which its program is paused, in [s]."""
    speed: float
    """Fraction of its speed that a program gets if no obstacle is near, above 0 and up to 1."""
    stop_within: float
    """How long the arm may still move after an order to pause, in [s]. Then the driver stops it."""
    deceleration: float
    """Deceleration of that stop, in [rad/s²]."""
    validity: float
    """How long a verdict of the cell's monitor is valid [s]."""
    payload: float
    """Greatest payload that the monitor assumes, in [kg]."""
    joints: tuple[str, ...]
    """Addresses to publish joint states to: each of a monitor."""
    verdicts: str
    """Address of verdicts."""
    arm: str = ""
    """Which of several arms it is; empty where there is one."""
    follows: bool = False
    """Whether commands of a shield move the arm; otherwise its own program does."""
    measure: int = 0
    """How often to stop the arm on purpose, to measure it; 0: never."""
    key_files: tuple[str, str] | None = None
    """Where the monitor asks for keys: the secret file of a client that may send joint states and
    read verdicts, and the monitor's public file."""
    ros2: Ros2Options | None = None
    """Of the driver "ros2" alone."""
    franka: FrankaOptions | None = None
    """Of the driver "franka" alone."""
    is_first: bool = True
    """Whether a person has just started the driver; otherwise this process replaces a lost process
    or connection."""
    parent: int = 0
    """The process that started this one; this one ends with it."""
    link: int = -1
    """Descriptor of the pipe to that process."""

    @property
    def longest_silence(self) -> float:
        """Silence of the robot, or of this process, after which the arm is stopped, in [s].

        In a ROS 2 graph the robot stops by itself if this process is silent, so the silence may be
        longer before another process starts.
        """
        return 3.0 * self.timeout if self.ros2 is None else LONGEST_HANG

    @property
    def longest_end(self) -> float:
        """How long this process may take to bring the arm to rest and to end, in [s]."""
        return END_TIMEOUT + self.stop_within

    def load_keys(self) -> Keys | None:
        """The keys of the client; None where there are none."""
        return None if self.key_files is None else Keys.load(*map(Path, self.key_files))
