"""What keys cost: how long a message is under way with CURVE, beside the same without.

    python benchmarks/bench_keys.py [--messages 2000] [--obstacles 0 100 1000]

One publisher sends messages over loopback TCP to one input, which is asked for them without pause,
as at the moment of a tick. Each is timed from the call that sends it until its bytes are there; 0
obstacles is a joint state. With and without keys take turns, message by message, so that whatever
else the machine does meets both.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import zmq

from armguard.streams import Authenticator, Client, KeyPair, Keys, Publisher, SocketInput
from scene.machine import describe_machine

ADDRESS = "tcp://127.0.0.1:*"
NAMES = [f"joint{i}" for i in range(7)]


def make_pair() -> KeyPair:
    """Keys of one of the two sides."""
    return KeyPair(*(key.decode() for key in zmq.curve_keypair()))


class Way:
    """A publisher and the input that it sends to.

    Args:
        authenticator: Of the input; None: without keys.
        keys: Of the publisher.
    """

    def __init__(self, authenticator: Authenticator | None, keys: Keys | None) -> None:
        self._input = SocketInput(ADDRESS, authenticator)
        self._publisher = Publisher(self._input.address, "camera", keys)
        while not self._publisher.wait(0.001):
            self._input.receive()

    def time(self, count: int) -> float:
        """Seconds that one message of `count` obstacles is under way; 0: a joint state."""
        ids, points = [f"obstacle {i}" for i in range(count)], np.ones((count, 3))
        begin = time.perf_counter()
        if count:
            self._publisher.update(ids, begin, points, points, radius=0.1)
        else:
            self._publisher.joints(begin, NAMES, np.zeros(7), np.zeros(7))
        while self._input.receive() is None:
            pass
        return time.perf_counter() - begin

    def close(self) -> None:
        """Close both ends."""
        self._publisher.close()
        self._input.close()


def measure(messages: int, counts: list[int]) -> None:
    """Print a row for each size of message."""
    server, client = make_pair(), make_pair()
    authenticator = Authenticator(
        server, {"camera": Client(client.public, frozenset(["obstacles", "joints"]))}
    )
    ways = [Way(None, None), Way(authenticator, Keys(client, server.public))]
    print("| obstacles | plain p50 / p99 | with keys p50 / p99 | ratio of p50 |")
    print("|---|---|---|---|")
    for count in counts:
        times = np.array([[way.time(count) for way in ways] for _ in range(messages)])[10:]
        (p50, p50_keys), (p99, p99_keys) = np.percentile(1e6 * times, [50, 99], axis=0)
        print(
            f"| {count or 'joint state'} | {p50:.0f} / {p99:.0f} µs "
            f"| {p50_keys:.0f} / {p99_keys:.0f} µs | {p50_keys / p50:.2f} |"
        )
    for way in ways:
        way.close()
    authenticator.close()


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--messages", type=int, default=2000)
    parser.add_argument("--obstacles", type=int, nargs="+", default=[0, 100, 1000])
    options = parser.parse_args()
    print(describe_machine())
    measure(options.messages, options.obstacles)


if __name__ == "__main__":
    main()
