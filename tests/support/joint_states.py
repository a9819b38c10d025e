"""Joint states put to the test as the monitor does, with the reasons it gives."""

import numpy as np

from armguard.monitor.joint_reasons import describe_refusal, read_joint_vectors
from armguard.verdict import Reason

TIMEOUT = 0.05


def changed(vector, joint, value):
    vector = vector.copy()
    vector[joint] = value
    return vector


def receive(states, stamp, q, v, now):
    """Why a state is refused, as the monitor goes about it; None if it is believed."""
    if not states.is_plain(q, v):
        read = read_joint_vectors(q, v, len(states.q))
        if isinstance(read, Reason):
            return read
        q, v = read
    found, joint, *stop_times = states.accept(stamp, q, v, now)
    assert np.isfinite(stop_times).all() == (found >= 0)
    return describe_refusal(states, found, joint, stamp, q, v) if found < 0 else None


def kind_of(reason):
    return None if reason is None else reason.kind
