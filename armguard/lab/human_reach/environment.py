"""HumanReach: a Panda carries parts from place to place, past a person who comes and reaches in."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Literal

import coal
import gymnasium
import numpy as np
import pinocchio
from gymnasium.spaces import Box
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError
from armguard.lab.human_reach.workplace import FLOOR, STEP, Person, Workplace
from armguard.lab.simulation.bodies import POINTS, publish_person
from armguard.lab.simulation.bounded_person import BoundedPerson
from armguard.lab.simulation.mujoco_person import LEGS
from armguard.lab.simulation.person import ProceduralPerson
from armguard.lab.simulation.recordings import place_recording
from armguard.obstacles.obstacles import Obstacles
from armguard.robot.robot import Robot

Array = NDArray[np.float64]
Observation = NDArray[np.float32]

PERIOD_STEPS = 20
EPISODE = 10.0
"""In [s]; a generated person comes and goes in it."""

FASTEST = 1.0
"""Of the joints that can be asked for, in [rad]/[s]."""

HOME = (-0.45, -0.4, 0.0, -2.2, 0.0, 1.8, 0.785)
PLACES = np.array([[0.45, -0.22, 0.3], [-0.32, -0.38, 0.3]])
"""Where parts are fetched, and where they are to be brought, in [m]."""

NEAR = 0.05
"""From how far the gripper takes a part up, and puts it down, in [m]."""

GRIP = pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, 0.21]))
"""The middle of a part between the fingers, in the frame of the last joint."""

PART, PART_RADIUS = "part", 0.03
"""A ball, in [m]."""

REACHED = ((-0.4, -0.5, 0.2), (0.4, -0.35, 0.5))
"""Where a generated person reaches: two corners of a box, in [m]."""

WIDEST = 10.0
"""Nothing that is observed is beyond this."""


class HumanReach(gymnasium.Env[Observation, NDArray[np.float32]]):
    """A pick-and-place task beside a person, on MuJoCo.

    The action is the velocity of each joint for the next 0.02 s, in [rad]/[s]. The gripper takes a
    part up once it is within 5 cm of it, and puts it down where it is to be brought. Then the next
    part lies there. Rewards are 10 for each metre that the gripper gets nearer to where it is to go
    next, 5 for each part that is taken up or put down, and -5 for each contact.

    The observation has 75 numbers: positions and velocities of the joints (14), the gripper, where
    it is to go next (3 each), whether it holds a part (1), and positions and velocities of the nine
    tracked points of the person (54), in [rad], [m] and [s].

    `info` has `contacts` (with the moving arm, in this episode), `contacts_at_rest` and `placed`
    (parts).

    Args:
        recordings: A folder of recorded people, of which each episode has one that is drawn at
            random; None: each has a generated one.

    Attributes:
        robot: The arm, with a part between its fingers.
        period: Of the steps, in [s].
        action_kind: What an action is.

    Raises:
        ArmguardError: The folder has no recordings, or one of them is malformed.
    """

    metadata = {"render_modes": [], "render_fps": 50}  # noqa: RUF012 (as Gymnasium has it)
    period = PERIOD_STEPS * STEP
    action_kind: Literal["velocity"] = "velocity"

    def __init__(self, recordings: str | os.PathLike[str] | None = None) -> None:
        self._recorded = None if recordings is None else _read_people(Path(recordings))
        self.robot = Robot.load("panda")
        self.robot.attach(PART, "panda_hand", coal.Sphere(PART_RADIUS), GRIP)
        self._workplace = Workplace(self.robot, PART)
        self._mirror = self.robot.model.createData()
        joints = len(self.robot.joints)
        self.action_space = Box(-FASTEST, FASTEST, (joints,), np.float32)
        count = 2 * joints + 7 + 6 * len(POINTS)
        self.observation_space = Box(-WIDEST, WIDEST, (count,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; see `gymnasium.Env.reset`."""
        super().reset(seed=seed)
        person, begin = self._draw_person()
        self._workplace.reset(np.array(HOME), person, begin)
        self._placed = 0
        self._away = self._measure()
        return self._observe(), self._describe()

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Move for one period; see `gymnasium.Env.step`.

        Raises:
            ArmguardError: The action is not finite.
        """
        workplace, before = self._workplace, self._workplace.contacts
        wanted = np.clip(np.asarray(action, np.float64), -FASTEST, FASTEST)
        if not np.isfinite(wanted).all():
            raise ArmguardError("action", f"is {action!r}", expected="finite velocities")
        workplace.move(wanted, PERIOD_STEPS)
        away = self._measure()
        reward = 10.0 * (self._away - away) - 5.0 * (workplace.contacts - before)
        if away <= NEAR:
            reward += 5.0
            self._placed += workplace.holds_part
            workplace.holds_part = not workplace.holds_part
            away = self._measure()
        self._away = away
        return self._observe(), reward, False, False, self._describe()

    def read_joints(self) -> tuple[Array, Array]:
        """Positions and velocities, in [rad] and [rad]/[s]. Shapes (7,)."""
        return self._workplace.read_joints()

    def publish(self, obstacles: Obstacles, stamp: float) -> None:
        """Hand the person of now over to a table, legs included, with a stamp in [s]."""
        position, velocity = self._workplace.sample_person()
        exact = np.zeros(len(POINTS))
        publish_person(obstacles, "person", stamp, position, velocity, exact, person="person")
        hip, pace = (track[POINTS.index("hip")] for track in (position, velocity))
        foot = [hip[0], hip[1], FLOOR + LEGS.radius]
        paces = [pace, [pace[0], pace[1], 0.0]]
        obstacles.update(
            ["person/legs"], stamp, [[hip, foot]], [paces], radius=LEGS.radius, source="person"
        )

    def _draw_person(self) -> tuple[Person, float]:
        """Who is there in an episode, and from when of theirs on, in [s]."""
        random = self.np_random
        if self._recorded is None:
            target = random.uniform(*REACHED)
            return ProceduralPerson(int(random.integers(2**31)), EPISODE, target=target), 0.0
        person = self._recorded[random.integers(len(self._recorded))]
        return person, random.uniform(0.0, max(0.0, person.duration - EPISODE))

    def find_gripper(self, q: Array) -> Array:
        """Where the middle of the gripper is at joint positions, in [rad]; in [m]. Shape (3,)."""
        pinocchio.forwardKinematics(self.robot.model, self._mirror, q)
        grip: Array = self._mirror.oMi[self.robot.joint_index(PART)].act(GRIP.translation)
        return grip

    def _measure(self) -> float:
        """How far the gripper is from where it is to go next, in [m]."""
        goal = PLACES[int(self._workplace.holds_part)]
        return float(np.linalg.norm(goal - self.find_gripper(self.read_joints()[0])))

    def _observe(self) -> Observation:
        holds = self._workplace.holds_part
        q, v = self.read_joints()
        seen = np.concatenate(
            [
                q,
                v,
                self.find_gripper(q),
                PLACES[int(holds)],
                [float(holds)],
                *(track.ravel() for track in self._workplace.sample_person()),
            ]
        )
        return np.clip(seen, -WIDEST, WIDEST).astype(np.float32)

    def _describe(self) -> dict[str, Any]:
        workplace = self._workplace
        return {
            "contacts": workplace.contacts,
            "contacts_at_rest": workplace.contacts_at_rest,
            "placed": self._placed,
        }


def _read_people(folder: Path) -> list[BoundedPerson]:
    paths = sorted(folder.glob("*.csv"))
    if not paths:
        raise ArmguardError(f"recordings {str(folder)!r}", "has no CSV files")
    return [BoundedPerson(place_recording(path)) for path in paths]
