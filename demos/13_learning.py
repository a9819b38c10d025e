"""A learner that explores at random beside a person, without and with a shield.

Needs the extra `gym`. The learner has no model of the arm. It learns from its observations how
joints move the gripper (Broyden's rule), and moves the gripper to its target.
"""

import os
from typing import NamedTuple

import gymnasium
import numpy as np

from armguard.gymnasium import ShieldedEnv

GRIPPER, GOAL, JOINTS = slice(14, 17), slice(17, 20), slice(0, 7)  # in what is observed
PACE, NOISE, DAMPING = 2.0, 0.2, 0.02  # [1/s], [rad/s], [m/rad]²


class Outcome(NamedTuple):
    """What a run came to."""

    contacts: int
    placed: int
    reward: float


def run(env: gymnasium.Env, steps: int) -> Outcome:
    """Learn for some steps, the same ones each time."""
    random = np.random.default_rng(0)
    jacobian = random.normal(0.0, 0.1, (3, 7))  # of the gripper, in [m/rad]: a guess
    contacts, placed, total, over = 0, 0, 0.0, True
    for step in range(steps):
        if over:
            seen, _ = env.reset(seed=step)
        way = PACE * (seen[GOAL] - seen[GRIPPER])
        action = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + DAMPING * np.eye(3), way)
        action = np.clip(action + random.normal(0.0, NOISE, 7), -1.0, 1.0).astype(np.float32)
        before = seen
        seen, reward, terminated, truncated, info = env.step(action)
        moved, went = seen[JOINTS] - before[JOINTS], seen[GRIPPER] - before[GRIPPER]
        if moved @ moved > 1e-6:
            jacobian += np.outer(went - jacobian @ moved, moved) / (moved @ moved)
        total, over = total + float(reward), terminated or truncated
        if over or step + 1 == steps:
            contacts, placed = contacts + info["contacts"], placed + info["placed"]
    return Outcome(contacts, placed, total)


def main(steps: int = 10_000, recordings: str | None = None) -> dict[str, Outcome]:
    """Learn without a shield, and with one, beside recorded or generated people."""
    found = {}
    for name, shielded in (("without a shield", False), ("with a shield", True)):
        env = gymnasium.make("armguard/HumanReach-v0", recordings=recordings)
        found[name] = run(ShieldedEnv(env) if shielded else env, steps)
        print(f"{name}: {found[name]}")
    return found


if __name__ == "__main__":
    main(recordings=os.environ.get("ARMGUARD_RECORDINGS"))
