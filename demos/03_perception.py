"""A perception node: reports a ball that moves towards the arm and away again, at 100 Hz.

Run it together with `armguard run demos/cell.toml` and `04_controller.py`.
"""

import math
import time

from armguard.streams import OBSTACLES_ADDRESS, Publisher


def main(duration: float = math.inf, address: str = OBSTACLES_ADDRESS) -> None:
    """Publish for `duration` seconds."""
    with Publisher(address, source="camera") as publisher:
        start = tick = time.monotonic()
        while tick < start + duration:
            phase = 0.4 * (tick - start)  # the whole way there and back takes 15.7 s
            position = [[3.0 + 2.0 * math.cos(phase), 0.3, 0.5]]
            velocity = [[-0.8 * math.sin(phase), 0.0, 0.0]]
            publisher.update(["ball"], tick, position, velocity, radius=0.1, snapshot=True)
            if phase % 0.4 < 0.004:
                print(f"ball {position[0][0]:.2f} m from the robot's axis", flush=True)
            tick += 0.01  # the next deadline: sleeping for a while instead would drift
            time.sleep(max(0.0, tick - time.monotonic()))


if __name__ == "__main__":
    main()
