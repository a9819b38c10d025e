"""The paper's quartic, whose first root is a contact time."""

import numpy as np


def smallest_root(x, v, contact_distance, accel):
    """First time on the paper's quartic, by the eigenvalues of its companion matrix, in [s]."""
    roots = np.roots(
        [
            -(accel**2) / 4,
            0.0,
            v @ v - contact_distance * accel,
            2 * (v @ x),
            x @ x - contact_distance**2,
        ]
    )
    return min(root.real for root in roots if abs(root.imag) < 1e-9 and root.real > 0)
