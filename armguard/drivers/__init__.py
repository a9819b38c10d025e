"""Drivers: processes that join a robot to a monitor, each an extra, loaded where one is asked for.

`armguard drive` starts one. It publishes the robot's joint states, obeys the monitor's verdicts,
and stops the robot by the robot's own means where no verdict is valid.
"""

__all__ = ()
