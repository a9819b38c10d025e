"""What a row of a table allows its body, and a table that keeps what it was told."""

import numpy as np


class Told:
    """What a table was told last; stands in for one."""

    heard_sources = ()

    def __init__(self):
        self.problems = []

    def update(self, ids, stamp, *fields, source, snapshot, region):
        assert region == "", "an arm is no part of a person"
        self.ids, self.fields = list(ids), [np.array(field) for field in fields]

    def leave_broken(self, source, joint, problem, stamp):
        self.problems.append(f"{joint} {problem}")


def go_on(closing, accel, speed, time):
    """How far a row's body gets along directions: the law that every contact time rests on."""
    closing = np.minimum(closing, speed)
    with np.errstate(divide="ignore", invalid="ignore"):
        ramp = np.where(np.isinf(accel), 0.0, (speed - closing) / accel)
        short = closing * time + 0.5 * np.where(np.isinf(accel), 0.0, accel) * time**2
    return np.where(time < ramp, short, 0.5 * (closing + speed) * ramp + speed * (time - ramp))
