import pytest

from armguard.app.rate_meter import STEP, WINDOW, RateMeter


@pytest.mark.parametrize("rate", [2.0, 30.0, 1000.0])
def test_the_rate_is_that_of_the_messages(rate):
    meter, read = RateMeter(), None
    for frame in range(200):
        now = frame / 30.0
        read = meter.read(now, int(rate * now))
    assert read == pytest.approx(rate, abs=1.0 / WINDOW)


def test_nothing_is_told_before_there_is_something_to_tell_from():
    meter = RateMeter()
    assert meter.read(0.0, 0) is None
    assert meter.read(0.5 * STEP, 10) is None


def test_a_source_that_falls_silent_fades_within_the_window():
    meter = RateMeter()
    for frame in range(60):
        meter.read(frame / 30.0, 10 * frame)
    for frame in range(60, 120):
        read = meter.read(frame / 30.0, 590)
    assert read == 0.0
