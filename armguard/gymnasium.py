"""Gymnasium: a wrapper with which a shield moves the arm of an environment, and environments.

Whatever a policy requests, the arm of a `ShieldedEnv` follows only motions that are proved until
rest. `import armguard.gymnasium` registers `armguard/HumanReach-v0`.

Needs the package gymnasium (the extra `gym`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal, Protocol, cast

import numpy as np

from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
from armguard.monitor.monitor import Monitor
from armguard.obstacles.obstacles import Obstacles
from armguard.robot.operating_limits import OperatingLimits
from armguard.robot.robot import Robot
from armguard.shield import Command, Shield

try:
    import gymnasium
except ModuleNotFoundError:
    raise ArmguardError(
        "armguard.gymnasium",
        "needs the package gymnasium, which is not installed",
        remedy="pip install 'armguard[gym]'",
    ) from None

__all__ = ["JointScene", "ShieldedEnv"]

ACTION_KINDS = ("velocity", "position", "chunk")

JERK = 500.0
"""Default jerk of each joint, in [rad]/[s³] or [m]/[s³]."""

VELOCITY_SHARE, ACCELERATION_SHARE = 0.4, 0.25
"""Default operating limits, as fractions of the robot's limits."""

LOOK_AHEAD = 0.03
"""In [s], at least."""

TRACKING_ERROR, VELOCITY_TRACKING_ERROR = 0.001, 0.01
"""Of the controller, in [rad] and [rad]/[s], or [m] and [m]/[s], where nothing else is given."""


class JointScene(Protocol):
    """The facts about an environment that a shield needs."""

    @property
    def robot(self) -> Robot:
        """The arm, with all bodies that it holds."""

    @property
    def period(self) -> float:
        """Period of the environment's steps, in [s]."""

    @property
    def action_kind(self) -> Literal["velocity", "position", "chunk"]:
        """Kind of the actions.

        Velocities of the joints during the step, in [rad]/[s] or [m]/[s], shape (nv,); positions at
        its end, in [rad] or [m], shape (nv,); or positions at equal parts of it, shape (points,
        nv). In between, the arm moves at constant velocity.
        """

    def read_joints(self) -> tuple[FloatArray, FloatArray]:
        """Joint positions and velocities now, in the order of `robot.joints`. Shape (nv,) each."""

    def publish(self, obstacles: Obstacles, stamp: float) -> None:
        """Update a table with all obstacles in their present state, with a stamp in [s]."""


class ShieldedEnv(
    gymnasium.Wrapper[Any, Any, Any, Any],
    gymnasium.utils.RecordConstructorArgs,
):
    """An environment whose arm a shield moves.

    The action is the requested motion, of the same kind and shape as without the shield. The
    environment gets the motion that the shield has proved: the request, as far as it can be proved.
    `info["armguard"]` describes each step: `level` (its name), `scale` (the pace as a fraction of
    the requested one), `reason` (why it is slower, else None), `contact_time` (in [s]) and
    `contact_speed` (in [m]/[s]; None without contact limits).

    Each episode has its own monitor, table of obstacles and shield, so that no state is carried to
    the next episode, and the same seed gives the same steps.

    Args:
        env: The environment.
        scene: Makes the scene from the environment; None: the innermost environment is a scene
            itself.
        obstacles: Keywords of `armguard.Obstacles`, above all the bounds of obstacles.
        monitor: Keywords of `armguard.Monitor`. By default the operating limits are 0.4 of the
            velocity limits and 0.25 of the acceleration limits, and the latency is 0, since the
            simulation waits. The rate is that of the steps, and the motion is planned.
        shield: Keywords of `armguard.Shield`. By default the jerk is 500, and the tracking errors
            are those of an arm that moves at constant velocity within a step. The rate is that of
            the points.

    Attributes:
        command: Command of the shield in the last step; None before the first step.

    Raises:
        ArmguardError: The scene's actions do not match the action space, or a keyword is out of
            range.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        scene: Callable[[gymnasium.Env[Any, Any]], JointScene] | None = None,
        *,
        obstacles: Mapping[str, Any] | None = None,
        monitor: Mapping[str, Any] | None = None,
        shield: Mapping[str, Any] | None = None,
    ) -> None:
        gymnasium.utils.RecordConstructorArgs.__init__(
            self, scene=scene, obstacles=obstacles, monitor=monitor, shield=shield
        )
        super().__init__(env)
        self._scene = cast(JointScene, env.unwrapped) if scene is None else scene(env)
        robot, joints = self._scene.robot, len(self._scene.robot.joints)
        shape = env.action_space.shape
        if self._scene.action_kind not in ACTION_KINDS:
            raise ArmguardError(
                "action_kind",
                f"is {self._scene.action_kind!r}",
                expected=f"one of {', '.join(ACTION_KINDS)}",
            )
        is_chunk = self._scene.action_kind == "chunk"
        if shape is None or len(shape) != 1 + is_chunk or shape[-1] != joints:
            wanted = f"(points, {joints})" if is_chunk else f"({joints},)"
            raise ArmguardError("action space", f"has the shape {shape}", expected=wanted)
        self._points = shape[0] if is_chunk else 1
        self._apart = self._scene.period / self._points
        operating = OperatingLimits.fraction(
            robot, velocity=VELOCITY_SHARE, acceleration=ACCELERATION_SHARE
        )
        # An arm that goes on evenly is off a motion that brakes at b by at most b dt² / 8, and its
        # velocity by b dt / 2.
        uneven = robot.acceleration_limit * self._apart
        self._obstacle_options = dict(obstacles or {})
        self._monitor_options = {"operating": operating, "latency": 0.0, **(monitor or {})}
        self._shield_options = {
            "jerk": JERK,
            "look_ahead": max(LOOK_AHEAD, self._scene.period),
            "tracking_error": TRACKING_ERROR + uneven * self._apart / 8.0,
            "velocity_tracking_error": VELOCITY_TRACKING_ERROR + uneven / 2.0,
            **(shield or {}),
        }
        self.command: Command | None = None
        self._steps = 0
        self._obstacles, self._shield = self._make_shield()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode with an arm at rest."""
        answer = super().reset(seed=seed, options=options)
        self.command, self._steps = None, 0
        self._obstacles, self._shield = self._make_shield()
        return answer

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Execute the requested action as far as it is proved."""
        scene, now = self._scene, self._steps * self._scene.period
        scene.publish(self._obstacles, now)
        q, v = scene.read_joints()
        if scene.action_kind == "velocity":
            command = self._shield.step(now, q, v, velocity=action)
        else:
            chunk = action if scene.action_kind == "chunk" else [action]
            command = self._shield.step(now, q, v, chunk=chunk)
        self.command = command
        proved = self._follow(command, now, q)
        observation, reward, terminated, truncated, info = self.env.step(proved)
        self._steps += 1
        info = {**info, "armguard": _describe(command)}
        return observation, reward, terminated, truncated, info

    def _make_shield(self) -> tuple[Obstacles, Shield]:
        """Make a new monitor, table and shield, without any earlier state."""
        obstacles, scene = Obstacles(**self._obstacle_options), self._scene
        rate = 1.0 / scene.period
        monitor = Monitor(
            scene.robot, obstacles, rate=rate, motion="planned", **self._monitor_options
        )
        shield = Shield(
            monitor,
            rate=1.0 / self._apart,
            chunk_period=self._apart,
            **self._shield_options,
        )
        return obstacles, shield

    def _follow(self, command: Command, now: float, q: FloatArray) -> Any:
        """The action that moves the arm along a command for one step."""
        times = now + self._apart * np.arange(1, self._points + 1)
        places = np.tile(q, (self._points, 1))
        if len(command.times):
            places = np.array([command.at(time)[0] for time in times])
        action = places if self._scene.action_kind == "chunk" else places[0]
        if self._scene.action_kind == "velocity":
            # From where it is, so that what it was off by is made good.
            action = (action - q) / self._scene.period
        return action.astype(self.env.action_space.dtype)


def _describe(command: Command) -> dict[str, Any]:
    verdict = command.verdict
    return {
        "level": verdict.level.name,
        "scale": command.scale,
        "reason": None if command.reason is None else str(command.reason),
        "contact_time": verdict.contact_time,
        "contact_speed": command.contact_speed,
    }


gymnasium.register(
    "armguard/HumanReach-v0",
    entry_point="armguard.lab.human_reach.environment:HumanReach",
    max_episode_steps=500,
)
