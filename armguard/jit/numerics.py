"""What tests of measured states have in common: codes, their meaning, and rounding.

Rounding goes towards acceptance and is bounded: durations are widened by `SLACK` (eight ulp of 1)
times the stamps, lengths and speeds by `SLACK` times the magnitudes that enter the test.
"""

from __future__ import annotations

import numpy as np

SLACK = 8.0 * float(np.finfo(np.float64).eps)

ALLOWED = 0
POSITION_BY_ACCEL = 1
POSITION_BY_SPEED = 2
VELOCITY_BY_ACCEL = 3
VELOCITY_BY_SPEED = 4
SHAPE = 5
NOT_FINITE = 6
TIME_BACKWARDS = 7

MEANING = {
    POSITION_BY_ACCEL: "moved farther than its acceleration allows",
    POSITION_BY_SPEED: "moved farther than its speed allows",
    VELOCITY_BY_ACCEL: "changed its velocity by more than its acceleration allows",
    VELOCITY_BY_SPEED: "is faster than its speed bound",
    SHAPE: "changed its shape",
    NOT_FINITE: "is not finite",
    TIME_BACKWARDS: "has an older stamp than the state before",
}
"""What each code says of a body or a joint, to follow its name."""
