"""Data that the parts of a driver's process share."""

from __future__ import annotations

from typing import NamedTuple

from armguard.drivers.latencies import Latencies
from armguard.drivers.link import Link
from armguard.drivers.measurement import Measurement
from armguard.drivers.options import DriveOptions


class Session(NamedTuple):
    """One connection to a robot."""

    options: DriveOptions
    """Options of the process."""
    latencies: Latencies
    """Counts actions."""
    link: Link
    """Takes lines for people."""
    measurement: Measurement | None = None
    """Stops the arm on purpose, and ends the session when it is done; None: no measurement."""
