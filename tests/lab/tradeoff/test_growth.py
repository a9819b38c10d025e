import pytest

from armguard.lab.tradeoff import growth
from armguard.lab.tradeoff.growth import Grown, fit_exponents, list_sizes, measure_size
from support.tradeoff_cases import make_site


def test_exponents_are_those_of_the_large():
    def grown(name, exponent):
        return [
            Grown(name, pairs, max(50.0, 1e-2 * pairs**exponent), 1.0, 0.0)
            for pairs in (10, 100, 10_000, 100_000, 1_000_000)
        ]

    found = fit_exponents([*grown("full", 1.0), *grown("daa", 0.95), Grown("one", 900, 1, 1, 0)])
    assert found == {"full": pytest.approx(1.0), "daa": pytest.approx(0.95)}


def test_each_schedule_is_run_at_each_size(monkeypatch):
    monkeypatch.setattr(growth, "COUNTS", (1, 4))
    monkeypatch.setattr(growth, "SECONDS", 0.02)
    found = [measure_size(make_site(), 0, count, one) for count, one in list_sizes()]
    assert [(one.schedule, one.pairs) for one in found] == [
        (name, 10 * count)
        for count in (1, 4)
        for name in ("deadline", "full", "daa, powers", "daa, fibonacci")
    ]
    assert all(one.tick > 0.0 for one in found)
