"""A simulated UR5e controller that runs a program, for `armguard drive demos/ur5e.toml`."""

import math
import time

from armguard.lab.simulation.ur_controller import UrController


def main(duration: float = math.inf, host: str = "127.0.0.1") -> int:
    """Serve for `duration` seconds; how often its program was started or let go on."""
    with UrController(host) as controller:
        print(f"a simulated UR5e at {host}; its program swings three joints", flush=True)
        end, shown = time.monotonic() + duration, 0
        while time.monotonic() < end:
            time.sleep(0.05)
            for order in controller.received[shown:]:
                print(f"{order.order} {order.value:.2g}" if order.value else order.order)
                shown += 1
        return controller.started


if __name__ == "__main__":
    main()
