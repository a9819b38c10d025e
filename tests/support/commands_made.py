"""A command of a shield, as it goes over the wire."""

import numpy as np

from armguard.messages.command import CommandMessage, pack
from armguard.messages.reasons import ReasonMessage

TIMES = np.array([0.0, 0.004, 0.01, 0.05])
Q, V, A = np.random.default_rng(5).normal(size=(3, 4, 2))
COMMAND = CommandMessage(
    sequence=7,
    stamp=1.0,
    take_up_by=1.002,
    valid_until=1.05,
    names=["shoulder", "elbow"],
    times=pack(TIMES),
    q=pack(Q),
    v=pack(V),
    a=pack(A),
    moving=True,
    scale=0.5,
    progress=0.25,
    executed=3,
    stop=None,
    reason=ReasonMessage("contact", "hand and person", "in 0.2 s"),
    contact_speed=None,
    goal=2**63 - 1,
    refused=None,
    problem="",
)
