import numba

from armguard.contact.bodies import Ball, Bounds


def test_numbers_of_a_body_are_handed_over_as_floats():
    bounds = Bounds(1.0, 2.0, 0.0, 0.0)
    assert str(numba.typeof(bounds)).startswith("Bounds(float64 x 4")
    assert numba.typeof(Ball(*[0.0] * 6, bounds)).types[:6] == (numba.float64,) * 6
