import math

import pytest

from armguard.lab.paper.measure import Row
from armguard.lab.paper.report import (
    fit_exponents,
    summarise,
)


def make_row(pairs, schedule="full-DAA", **changes):
    usual = Row(
        0.05, round(math.sqrt(2 * pairs)), pairs, 100, 2.0, schedule, float(pairs),
        pairs * math.log2(pairs), 3.0 * pairs, 0.0, 1.0, 1.0, 1.0, 0, math.nan, math.nan, 0, 0,
    )  # fmt: skip
    return usual._replace(**changes)


def make_rows():
    rows = [make_row(pairs) for pairs in (28, 128, 8192)]
    return rows + [
        make_row(pairs, "daa, powers", evaluations=buckets, comparisons=0.5 * buckets**2)
        for pairs, buckets in ((28, 5), (128, 8), (8192, 14))
    ]


def test_growth_is_fitted_from_a_hundred_pairs_on():
    fitted = fit_exponents(make_rows())
    assert fitted["full-DAA"]["evaluations"] == fitted["full-DAA"]["tick"] == 1.0
    assert 1.0 < fitted["full-DAA"]["comparisons"] < 1.2
    assert fitted["daa, powers"]["evaluations"] == pytest.approx(
        math.log(14 / 8) / math.log(64), abs=1e-3
    )
    assert fit_exponents([make_row(28), make_row(8192)]) == {}


def test_the_summary_tells_growth_agreement_and_the_unwatched():
    text = "\n".join(summarise(make_rows(), False))
    assert "evaluations grow as pairs^1.00" in text
    assert "balls^2.0" in text
    assert "1.33 to 1.84 times L log2 L" in text
    assert "Unwatched pairs: 0, in 0 alarms." in text
    assert "report it" in summarise([make_row(28, unwatched=2)], False)[-1]
    assert "Interrupted" in summarise(make_rows(), True)[0]
