from armguard.drivers.arm import ArmState, Program
from armguard.drivers.latencies import Latencies
from armguard.verdict import Level
from support.verdict_samples import verdict

STATE = ArmState(1.0, [0.0] * 6, [0.0] * 6, Program.RUNNING, "", 0.37)


def test_a_line_a_second_says_what_the_second_was_like():
    latencies = Latencies(0.0)
    for number in range(500):
        stamp = 0.002 * number
        latencies.add_state(stamp, stamp + (0.02 if number == 7 else 0.001))
        assert not latencies.make_line(stamp, STATE, None)
    latencies.counts.verdicts = 480
    latencies.add_stop(0.003, was_silent=False)
    latencies.add_stop(0.004, was_silent=True)
    line = latencies.make_line(1.0, STATE, verdict(Level.SLOW))
    for words in (
        "500 states; age p50 1.0, p99 1.0, max 20.0 ms",
        "480 verdicts",
        "2 stops",
        "max 4.0 ms",
        "1 without a valid verdict",
        "SLOW",
        "speed 37%",
        "program running",
    ):
        assert words in line
    assert not latencies.make_line(1.5, STATE, None)
    assert latencies.make_line(2.0, None, None).startswith("0 states; 0 verdicts; 2 stops")


def test_stops_that_were_not_timed_have_no_percentiles():
    latencies = Latencies(0.0)
    latencies.counts.stops = 3  # as behind a shield
    assert "3 stops; no verdict yet" in latencies.make_line(1.0, None, None)
    assert latencies.counts.obeyed_p99 is None


def test_counts_have_the_longest_gap_and_the_slowest_stop():
    latencies = Latencies(0.0)
    for stamp in (0.0, 0.002, 0.05, 0.052):
        latencies.add_state(stamp, stamp)
    for duration in (0.001, 0.009, 0.002):
        latencies.add_stop(duration, was_silent=False)
    counts = latencies.counts
    assert abs(counts.longest_gap - 0.048) < 1e-12
    assert counts.obeyed_max == 0.009
    assert 0.002 < counts.obeyed_p99 <= 0.009
