import math

from armguard.lab.extremes.line import Line


def test_what_is_not_measured_is_no_number():
    line = Line("group", "case", "refused", note="why")
    assert all(map(math.isnan, (line.tight, line.worst, line.price)))
