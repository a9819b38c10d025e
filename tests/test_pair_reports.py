import math

from armguard.pair_reports import BUCKETS, bucket_of


def test_buckets():
    assert [bucket_of(time, 0.001) for time in (0.0, 0.001, 0.0019, 0.0021, 0.0041)] == [
        0, 0, 0, 1, 2,
    ]  # fmt: skip
    for time in (65.537, 1e9, 1e308, math.inf, math.nextafter(65.536, 0.0)):
        assert bucket_of(time, 0.001) == BUCKETS - 1
    assert bucket_of(math.nan, 0.001) == 0
    assert bucket_of(1e308, 5e-324) == BUCKETS - 1
