"""A `TickState` on its own, as a scheduler sets it for a tick."""

import numpy as np


def begin_tick(state, now, arm_age, refinement_threshold):
    """Start a tick, before the arm is prepared or pairs are evaluated; all in [s]."""
    state.now, state.arm_age = now, arm_age
    state.refinement_threshold = refinement_threshold
    state.sphere_time.fill(np.inf)
    state.view_table()
