"""What holds of every command, whatever happens to a shield.

ARMGUARD_STEPS sets how many steps are tried; a million take some hours.
"""

import os
from collections import Counter

from support.random_shield import RandomShield

STEPS = int(os.environ.get("ARMGUARD_STEPS", "3000"))
IN_A_WORLD = 200
FIRST = 20
"""Seed from which a few worlds have all that must happen in them."""


def test_whatever_happens_every_command_is_proved_keeps_its_limits_and_goes_on_without_a_jump():
    total, closest = Counter(), 0.0
    for seed in range(FIRST, FIRST + STEPS // IN_A_WORLD):
        world = RandomShield(seed)
        try:
            world.run(IN_A_WORLD)
        except AssertionError as error:
            raise AssertionError(f"world {seed} at {world.now:.3f} s: {error}") from error
        total += world.counts
        closest = max(closest, world.closest)
    assert total["moving"] > 0.2 * total["steps"]
    for event in (
        *("new", "resumed", "rested", "resets", "latched", "told to brake", "looked at again"),
        "at no time",
    ):
        assert total[event] > 0, event
    # Balls can do nearly all that is allowed for.
    assert closest > 0.5
