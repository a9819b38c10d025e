"""Sends joint states at 500 Hz and obeys verdicts, without armguard's library.

For a monitor that was started with `armguard run … --json-verdicts`.
"""

import json
import sys
import time

import zmq

NAMES = [f"panda_joint{number}" for number in range(1, 8)]


def main(joints: str = "tcp://127.0.0.1:5702", verdicts: str = "tcp://127.0.0.1:5703") -> None:
    """Swing the first joint as fast as verdicts allow, until the process is ended."""
    publisher, reader = (zmq.Context.instance().socket(kind) for kind in (zmq.PUB, zmq.SUB))
    publisher.set(zmq.IMMEDIATE, 1)  # keep nothing for a monitor that is not there
    publisher.connect(joints)
    reader.connect(verdicts)
    reader.subscribe(b"")
    q = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]  # [rad]
    speed, direction, sequence, scale, valid_until = 0.0, 1.0, 0, 0.0, 0.0
    tick = time.monotonic()
    while True:
        while reader.poll(0):
            told = json.loads(reader.recv())
            if told["type"] == "verdict":  # answers to plans come here as well
                scale = 0.0 if told["level"] == "STOP" else told["speed_scale"] or 0.0
                valid_until = told["valid_until"] or 0.0  # null is no number: over
        allowed = scale if time.monotonic() <= valid_until else 0.0  # silence means brake
        direction = -direction if abs(q[0]) > 0.5 and q[0] * direction > 0.0 else direction
        wanted = direction * min(0.3, 2.0 * allowed)  # [rad/s]
        speed += max(-0.0075, min(0.0075, wanted - speed))  # 3.75 rad/s² at 500 Hz, as it brakes
        q[0] += 0.002 * speed
        sequence += 1
        state = {"names": NAMES, "q": q, "v": [speed] + [0.0] * 6, "stamp": tick, "seq": sequence}
        publisher.send(json.dumps({"type": "joints", **state}).encode())
        tick += 0.002
        time.sleep(max(0.0, tick - time.monotonic()))


if __name__ == "__main__":
    main(*sys.argv[1:])
