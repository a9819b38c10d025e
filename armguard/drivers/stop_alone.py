"""Stops an arm without the process that drives it, and without the client library."""

from __future__ import annotations

from armguard.drivers.options import DriveOptions
from armguard.drivers.ur_lines import is_in_local_control, stop_by_script


def stop_alone(options: DriveOptions) -> str:
    """Stop an arm whose driver has ended or hangs, if possible; returns what stops it, in words."""
    if options.driver == "ros2":
        if options.follows:
            return "the arm rests at the end of the motion that was sent last"
        return "the driver sends no speed, so the robot must stop by itself"
    if options.driver == "franka":
        return "without positions the robot stops by itself"
    if stop_by_script(options.host, options.deceleration):
        if is_in_local_control(options.host):
            return "the robot is in local control and ignores orders: stop it by hand"
        return "the arm was ordered to stop"
    return "no order reaches the arm: check that it is at rest"
