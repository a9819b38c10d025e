"""What a driver's process is started with; it stands as JSON on its command line."""

from __future__ import annotations

from pathlib import Path

import msgspec

from armguard.streams.keys import Keys

WRONG_ARM, LOST = 2, 3
"""Exit codes: another try is of no use; the robot was lost, and was stopped if it could be."""


class DriveOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that a driver's process has to know."""

    driver: str
    """Whose robot: "ur" or "franka"."""
    host: str
    """Name or address of the robot's controller."""
    model: str
    """Which robot it is to be, such as "UR5e" or "FR3"."""
    rate: float
    """Joint states a second, in [Hz]."""
    names: tuple[str, ...]
    """Of the joints, in the robot's own order."""
    timeout: float
    """Silence of the robot after which its program is paused, in [s]."""
    speed: float
    """Fraction of its speed that a program gets where nothing is near, above 0 and up to 1."""
    stop_within: float
    """How long the arm may move on after an order to pause, in [s]. Then it is stopped."""
    deceleration: float
    """Of that stop, in [rad/s²]."""
    payload: float
    """What the monitor takes the arm to carry at most, in [kg]."""
    joints: str
    """Address to publish joint states to."""
    verdicts: str
    """Address of verdicts."""
    waypoints: tuple[tuple[float, ...], ...] = ()
    """Positions of the joints between which the driver moves a robot without a program, in
    [rad]."""
    velocities: tuple[float, ...] = ()
    """What the monitor takes the joints to keep to, in [rad/s], in the robot's own order."""
    accelerations: tuple[float, ...] = ()
    """With which they may speed up, in [rad/s²], in the same order."""
    contact_force: float | None = None
    """The least force that a contact limit of the cell permits, in [N]; None: none states one."""
    is_first: bool = True
    """Whether somebody has just started the driver; otherwise this takes the place of a connection
    that was lost."""
    arm: str = ""
    """Which of several arms it is; empty where there is one."""
    follows: bool = False
    """Whether the commands of a shield move the arm; otherwise its own program does."""
    measure: int = 0
    """How often to stop the arm on purpose, to measure it; 0: never."""
    key_files: tuple[str, str] | None = None
    """Where the monitor asks for keys: the secret file of a client that may send joint states and
    read verdicts, and the monitor's public file."""
    parent: int = 0
    """The process that started this one; this one ends with it."""
    link: int = -1
    """Descriptor of the pipe to that process."""

    @property
    def longest_silence(self) -> float:
        """Silence of the robot, or of this process, after which the arm is stopped, in [s]."""
        return 3.0 * self.timeout

    def load_keys(self) -> Keys | None:
        """The keys of the client; None where there are none."""
        return None if self.key_files is None else Keys.load(*map(Path, self.key_files))
