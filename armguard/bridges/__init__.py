"""Where armguard meets others: MuJoCo (`armguard.bridges.mujoco`), and messages of ROS 2.

Its modules are imported by their names, since each needs a package of its own.
"""

__all__: list[str] = []
