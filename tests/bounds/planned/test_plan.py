import numpy as np
import pytest

from armguard.bounds import Plan, Refusal
from armguard.bounds.limits import read_limits
from armguard.bounds.planned.plan import MOST_SAMPLES, read_plan
from armguard.jit import pack
from armguard.robot.portable import LIMITS
from support.panda_monitor import panda

GOOD = Plan(1.0, [0.0, 0.1, 0.2], np.zeros((3, 2)), np.zeros((3, 2)), [1e-3, 1e-3])
PLAIN = Plan(1.0, *(np.array(array) for array in GOOD[1:5]), np.full(2, 0.1))
"""A plan whose arrays are of float64 already."""


class Broken:
    def __array__(self, dtype=None, copy=None):
        raise MemoryError("no room")


@pytest.mark.parametrize("kind", [np.float64, np.float32])
@pytest.mark.parametrize("order", ["C", "F"])
def test_what_is_well_formed_is_copied(kind, order):
    q = np.zeros((3, 2), kind, order)
    read = read_plan(GOOD._replace(q=q, times=(0, 1, 2)), 2)
    assert isinstance(read, Plan)
    q[:] = 5.0
    assert np.array_equal(read.q, np.zeros((3, 2)))
    assert read.velocity_tracking_error is None
    for array in read[1:5]:
        assert array.dtype == np.float64
        assert array.flags.c_contiguous
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


@pytest.mark.parametrize("plan", [None, 3.0, "plan", tuple(GOOD), {"stamp": 0.0}, Plan])
def test_what_is_no_plan_is_refused(plan):
    refusal = read_plan(plan, 2)
    assert isinstance(refusal, Refusal)
    assert refusal.subject == "plan"


MASKED = np.ma.masked_array(np.zeros((3, 2)), mask=[[0, 0], [0, 1], [0, 0]])


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("stamp", None, "numbers"),
        ("stamp", "1.0", "numbers"),
        ("stamp", True, "numbers"),
        ("stamp", np.nan, "finite"),
        ("stamp", np.inf, "finite"),
        ("stamp", [1.0], "shape"),
        ("times", [], "numbers|samples"),
        ("times", [0.0], "samples"),
        ("times", np.arange(MOST_SAMPLES + 1.0), "samples"),
        ("times", [0.1, 0.2, 0.3], "begins at"),
        ("times", [0.0, 0.2, 0.2], "rising"),
        ("times", [0.0, 0.2, 0.1], "rising"),
        ("times", [0.0, 0.2, 1e308], "expected 1e+06 s at most"),
        ("times", [0.0, np.nan, 0.2], "finite"),
        ("times", [[0.0, 0.1, 0.2]], "shape"),
        ("times", ["0", "0.1", "0.2"], "numbers"),
        ("times", Broken(), "numbers"),
        ("times", [0.0, 10**400, 1.0], "numbers"),
        ("q", np.zeros((2, 2)), "shape"),
        ("q", np.zeros((3, 3)), "shape"),
        ("q", np.zeros(3), "shape"),
        ("q", [[0.0, 0.0], [0.0], [0.0, 0.0]], "numbers"),
        ("q", np.full((3, 2), np.nan), "finite"),
        ("q", np.zeros((3, 2), complex), "numbers"),
        ("q", MASKED, "finite"),
        ("q", None, "numbers"),
        ("v", np.full((3, 2), -np.inf), "finite"),
        ("v", np.zeros((2, 3)), "shape"),
        ("v", np.full((3, 2), np.longdouble("1e4000")), "finite"),
        ("tracking_error", None, "numbers"),
        ("tracking_error", 1e-3, "shape"),
        ("tracking_error", [1e-3, 0.0], "above 0"),
        ("tracking_error", [1e-3, -1e-3], "above 0"),
        ("tracking_error", [1e-3, np.nan], "finite"),
        ("tracking_error", [1e-3, np.inf], "finite"),
        ("velocity_tracking_error", [1e-3, 0.0], "above 0"),
        ("velocity_tracking_error", [1e-3], "shape"),
        ("velocity_tracking_error", [1e-3, np.nan], "finite"),
    ],
)
def test_what_is_malformed_is_refused_by_name(field, value, words):
    for good in (GOOD, PLAIN):
        refusal = read_plan(good._replace(**{field: value}), 2)
        assert isinstance(refusal, Refusal)
        assert refusal.subject == field
        assert any(word in refusal.detail for word in words.split("|"))
        assert str(refusal) == f"{field}: {refusal.detail}"


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 0.0, -1e-3, 1e7])
@pytest.mark.parametrize("field", PLAIN._fields[1:])
def test_every_number_of_plain_arrays_is_looked_at(field, value):
    array = getattr(PLAIN, field)
    for place in np.ndindex(array.shape):
        bad = array.copy()
        bad[place] = value
        read = read_plan(PLAIN._replace(**{field: bad}), 2)
        fits = {"times": place == (0,) and value == 0.0}.get(field, value > 0.0)
        if field in ("q", "v"):
            fits = bool(np.isfinite(value))
        assert isinstance(read, Plan if fits and np.isfinite(value) else Refusal), (place, read)


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_what_has_no_room_is_refused_before_it_is_copied(kind):
    count = 10**14
    q = np.broadcast_to(kind(0.0), (count, 2))
    read = read_plan(PLAIN._replace(times=np.broadcast_to(kind(0.0), count), q=q, v=q), 2)
    assert read == Refusal("times", f"has {count} samples, expected 2 to {MOST_SAMPLES}")


def test_limits_of_less_precision_need_no_kernels_of_their_own(monkeypatch):
    expected = pack(read_limits(panda())).kind
    for name in LIMITS:  # other tests share the robot
        monkeypatch.setattr(panda(), name, np.float32(getattr(panda(), name)))
    limits = read_limits(panda())
    assert pack(limits).kind is expected
    assert np.array_equal(limits.velocity, panda().velocity_limit)
