"""A controller for proved motions: sends goals to a shield, and follows its commands.

Run it together with `armguard shield demos/shield.toml` and `03_perception.py`.
"""

import math
import time

import numpy as np

from armguard.streams import JOINTS_ADDRESS, VERDICTS_ADDRESS, Publisher, VerdictReader

NAMES = [f"panda_joint{number}" for number in range(1, 8)]
HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
TURN = np.array([1.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
RISE = np.array([0.0, -0.2, 0.0, 0.1, 0.0, 0.3, 0.0])
WAYPOINTS = [HOME, HOME + 0.5 * TURN + RISE, HOME + TURN]
PERIOD = 0.001  # [s] between two states: less than that of the shield, so that no command is missed
PATIENCE = 1.0  # [s] until a goal that was not taken is sent again


def main(
    duration: float = math.inf, joints: str = JOINTS_ADDRESS, verdicts: str = VERDICTS_ADDRESS
) -> int:
    """Move for `duration` seconds; how many times the arm has come to the end of its path."""
    q, v, followed = HOME, np.zeros(7), None
    goal, asked, ways = -1, -math.inf, 0
    with Publisher(joints) as publisher, VerdictReader(verdicts) as reader:
        start = tick = shown = time.monotonic()
        while tick < start + duration:
            now = time.monotonic()
            if followed is not None:
                q, v, _ = followed.at(now)  # to its end, if nothing else comes
            reader.latest()
            command = reader.command
            if command is not None and command is not followed and command.joins(q, v, now):
                followed = command
            publisher.joints(now, NAMES, q, v)
            is_taken = command is not None and command.goal == goal
            is_done = is_taken and command.progress == 1.0 and not command.moving
            if is_done or (not is_taken and now > asked + PATIENCE):
                ways += is_done
                there = WAYPOINTS[:: -1 if ways % 2 else 1]
                goal = publisher.goal(now + PATIENCE, NAMES, paths=[(there, None)])
                asked = now
            if now >= shown and command is not None:
                why = "" if command.reason is None else command.reason.detail
                print(f"{command.scale:4.0%} of full pace  joint 1 at {q[0]:+.2f} rad  {why}")
                shown += 0.5
            tick += PERIOD
            time.sleep(max(0.0, tick - time.monotonic()))
    return ways


if __name__ == "__main__":
    main()
