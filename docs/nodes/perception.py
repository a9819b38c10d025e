"""Sends a ball that wanders about in front of the arm, at 100 Hz, without armguard's library."""

import json
import math
import sys
import time

import zmq


def main(address: str = "tcp://127.0.0.1:5701", source: str = "camera") -> None:
    """Publish until the process is ended."""
    publisher = zmq.Context.instance().socket(zmq.PUB)
    publisher.set(zmq.IMMEDIATE, 1)  # keep nothing for a monitor that is not there
    publisher.connect(address)
    sequence, tick = 0, time.monotonic()
    while True:
        sequence += 1
        phase = 0.4 * tick
        message = {
            "type": "obstacles",
            "source": source,
            "seq": sequence,
            "stamp": tick,  # when it was measured, [s] of CLOCK_MONOTONIC
            "snapshot": True,  # all that there is
            "ids": ["ball"],
            "position": [[3.0 + 0.5 * math.cos(phase), 0.3, 0.5]],  # [m]
            "velocity": [[-0.2 * math.sin(phase), 0.0, 0.0]],  # [m/s]
            "radius": 0.1,  # [m]
        }
        publisher.send(json.dumps(message).encode())
        tick += 0.01
        time.sleep(max(0.0, tick - time.monotonic()))


if __name__ == "__main__":
    main(*sys.argv[1:])
