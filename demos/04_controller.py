"""A controller with a speed slider: follows the speed scale, and stops on STOP and on silence.

Run it together with `armguard run demos/cell.toml` and `03_perception.py`.
"""

import math
import time

import numpy as np

from armguard.streams import JOINTS_ADDRESS, VERDICTS_ADDRESS, Publisher, VerdictReader

NAMES = [f"panda_joint{number}" for number in range(1, 8)]
PERIOD = 0.002  # [s] between two states
VELOCITY, ACCELERATION = 2.175, 3.75  # what joint 1 keeps to, [rad/s], [rad/s²]


def main(
    duration: float = math.inf,
    slider: float = 0.15,
    joints: str = JOINTS_ADDRESS,
    verdicts: str = VERDICTS_ADDRESS,
) -> float:
    """Swing joint 1 for `duration` seconds at up to `slider` of its top speed; the way in [rad]."""
    q, v = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]), np.zeros(7)
    speed, direction, way = 0.0, 1.0, 0.0
    with Publisher(joints) as publisher, VerdictReader(verdicts) as reader:
        start = tick = shown = time.monotonic()
        while tick < start + duration:
            verdict = reader.latest()
            allowed = min(slider, reader.speed_scale())  # 0 on STOP, and beyond valid_until
            wanted = VELOCITY * allowed * direction * (abs(q[0]) < 0.5 or q[0] * direction < 0.0)
            speed += float(np.clip(wanted - speed, -PERIOD * ACCELERATION, PERIOD * ACCELERATION))
            direction = -direction if speed == 0.0 and abs(q[0]) >= 0.5 else direction
            q[0], v[0], way = q[0] + PERIOD * speed, speed, way + PERIOD * abs(speed)
            publisher.joints(tick, NAMES, q, v)
            if tick >= shown:
                level = "silence" if verdict is None or reader.silent() else verdict.level.name
                print(f"{level:8} allowed {allowed:4.0%}  joint 1 at {q[0]:+.2f} rad", flush=True)
                shown += 0.5
            tick += PERIOD
            time.sleep(max(0.0, tick - time.monotonic()))
    return way


if __name__ == "__main__":
    main()
