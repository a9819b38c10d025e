"""Commissioning: what a recording of a few stops says of an arm, its controller and its sources.

No data sheet says how long a controller takes to obey, or how far a joint still goes. Each STOP in
a recording is a measurement of both. What a recording cannot say is named, and not made up.
"""

from armguard.lab.commission.findings import Findings, commission
from armguard.lab.commission.lines import write_cell_lines, write_robot_lines
from armguard.lab.commission.observations import Observations, observe

__all__ = [
    "Findings",
    "Observations",
    "commission",
    "observe",
    "write_cell_lines",
    "write_robot_lines",
]
