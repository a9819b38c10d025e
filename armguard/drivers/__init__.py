"""Drivers: processes that connect a robot to a monitor, each an extra that is loaded on request.

`armguard drive` starts one. It publishes the robot's joint states, obeys the monitor's verdicts,
and stops the robot by the robot's own means if no verdict is valid.
"""

__all__ = ()
