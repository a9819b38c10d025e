"""What kernels are told of bodies: fields in the order in which they are unpacked."""

import inspect

import numba
import numpy as np

from armguard.contact import earliest_contact_pair
from armguard.contact.advancement import trace_contact_time
from armguard.contact.bodies import Ball, Bounds, Hull
from support.contact_cases import ordinary_case


def test_bodies_say_what_the_face_says_by_keywords():
    rng = np.random.default_rng(3)
    for _ in range(200):
        case = ordinary_case(rng) | {"clock_error1": 0.0, "clock_error2": 0.0}
        one, other = (
            {
                "accel": float(case[f"a{n}"]),
                "speed": float(case[f"s{n}"]),
                "velocity_error": float(case[f"velocity_error{n}"]),
                "age": float(case[f"age{n}"]),
            }
            for n in (1, 2)
        )
        place, motion = (dict(zip(names, case[key], strict=True)) for names, key in (
            (("x", "y", "z"), "p1"), (("vx", "vy", "vz"), "v1")
        ))  # fmt: skip
        ball = Ball(**place, **motion, bounds=Bounds(**one))
        corners = np.atleast_2d(case["p2"])
        velocities = np.ascontiguousarray(np.broadcast_to(case["v2"], corners.shape))
        hull = Hull(points=corners, velocities=velocities, size=1, bounds=Bounds(**other))
        found = trace_contact_time(ball, hull, case["contact_distance"], 8, None)
        assert found == earliest_contact_pair(**case)


def test_numbers_of_a_body_are_handed_over_as_floats():
    bounds = Bounds(1.0, 2.0, 0.0, 0.0)
    assert str(numba.typeof(bounds)).startswith("Bounds(float64 x 4")
    assert list(inspect.signature(Ball).parameters)[-1] == "bounds"
