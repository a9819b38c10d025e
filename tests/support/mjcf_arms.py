"""A small arm in MuJoCo's format, written as the models of MuJoCo Menagerie are."""

from pathlib import Path

import numpy as np

from support.urdf_arms import write_stl

COMPILER = '<compiler angle="degree" meshdir="assets" eulerseq="zYx"/>'

ARM = """<mujoco model="small_arm">
  {compiler}
  <default>
    <joint damping="1"/>
    <default class="arm">
      <joint axis="0 1 0" range="-170 170"/>
      <general biastype="affine" ctrlrange="-3 3" forcerange="-60 60"/>
      <default class="visual"><geom type="mesh" contype="0" conaffinity="0" group="2"/></default>
      <default class="collision">
        <geom type="capsule" group="3"/>
        <default class="box_class"><geom type="box"/></default>
      </default>
      <default class="finger"><joint type="slide" axis="0 0 1" range="0 0.04"/></default>
      <mesh scale="0.001 0.002 0.001"/>
    </default>
  </default>
  <asset>
    <mesh class="arm" file="fin.stl"/>
    <mesh name="wedge" vertex="0 0 0  0.1 0 0  0 0.1 0  0 0 0.1"/>
  </asset>
  <worldbody>
    <light pos="0 0 3"/>
    <body name="base" childclass="arm" pos="0.1 0 0.2" euler="20 -30 40">
      <inertial pos="0 0 0" mass="2" diaginertia="0.01 0.01 0.01"/>
      <geom class="collision" size="0.06 0.05" pos="0 0 0.05"/>
      <body name="shoulder" pos="0 0 0.15" axisangle="1 1 0 25">
        <inertial pos="0 0 0.1" quat="1 1 0 0" mass="3" diaginertia="0.02 0.02 0.01"/>
        <joint name="pan" axis="0 0 2"/>
        <joint name="lift" pos="0 0.02 0.01" range="-100 90"/>
        <geom class="visual" mesh="fin"/>
        <geom class="collision" size="0.05" fromto="0 0 0 0.05 0.1 0.3"/>
        <geom class="collision" type="mesh" mesh="fin" pos="0.02 0 0" zaxis="0 1 1"/>
        <body name="wrist" pos="0 0 0.3" xyaxes="1 0 1 0 1 0">
          <inertial pos="0 0 0.1" mass="1" fullinertia="0.01 0.01 0.01 0 0 0.001"/>
          <joint name="roll" type="hinge" axis="1 0 1" limited="false" range="0 1"/>
          <geom class="box_class" size="0.02 0.03" fromto="0.1 0 0 -0.1 0.1 0.2"/>
          <geom class="collision" type="cylinder" size="0.04 0.1" quat="1 1 1 0"/>
          <geom class="collision" type="sphere" size="0.05" pos="0 0 0.2"/>
          <geom class="collision" type="mesh" mesh="wedge" pos="0 0 0.1" euler="10 20 30"/>
          {inside}
          <body name="left" pos="0 0.03 0.2">
            <inertial pos="0 0 0" mass="0.1" diaginertia="0.001 0.001 0.001"/>
            <joint name="left_finger" class="finger"/>
            <geom class="box_class" size="0.01 0.01 0.04"/>
          </body>
          <body name="right" pos="0 -0.03 0.2" quat="0 0 0 1">
            <inertial pos="0 0 0" mass="0.1" diaginertia="0.001 0.001 0.001"/>
            <joint name="right_finger" class="finger"/>
            <geom class="box_class" size="0.01 0.01 0.04"/>
          </body>
        </body>
      </body>
    </body>
    {beside}
  </worldbody>
  <equality><joint joint1="right_finger" joint2="left_finger" polycoef="0 1 0 0 0"/></equality>
  <actuator>
    <general class="arm" name="lift" joint="lift" gear="2"/>
    <position name="pan" joint="pan" forcerange="-5 4" kp="100"/>
  </actuator>
  {extra}
</mujoco>
"""

JOINTS = ("pan", "lift", "roll")
LOCKED = {"left_finger": {"travel": [0.0, 0.04]}, "right_finger": {"travel": [0.0, 0.04]}}


def write_mjcf(
    folder: Path,
    *,
    compiler: str = COMPILER,
    inside: str = "",
    beside: str = "",
    extra: str = "",
) -> Path:
    """The arm in a folder, with more inside its wrist, beside it in the world, and at the end."""
    (folder / "assets").mkdir(exist_ok=True)
    write_stl(folder / "assets" / "fin.stl", 1000.0 * np.array(
        [[[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[0, 0, 0], [0, 0.1, 0], [0, 0, 0.2]],
         [[0, 0, 0], [0, 0, 0.2], [0.1, 0, 0]], [[0.1, 0, 0], [0, 0, 0.2], [0, 0.1, 0]]]
    ))  # fmt: skip
    path = folder / "arm.xml"
    path.write_text(ARM.format(compiler=compiler, inside=inside, beside=beside, extra=extra))
    return path
