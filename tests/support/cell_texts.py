"""Cell files that several tests start from."""

ROBOT = '[robot]\nname = "panda"\n'
FRAMES = (
    ROBOT
    + """
[robot.base]
xyz = [1.0, 0.0, 0.0]
quaternion = [0.0, 0.0, 0.7071067811865476, 0.7071067811865476]
[frames.lens]
parent = "camera"
xyz = [0.0, 0.0, 0.5]
calibration_error = 0.002
[frames.camera]
parent = "base"
xyz = [2.0, 0.0, 0.0]
quaternion = [1.0, 0.0, 0.0, 0.0]
calibration_error = 0.01
"""
)
