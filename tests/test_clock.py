from armguard.clock import MonotonicClock
from support.manual_clock import ManualClock


def test_the_monotonic_clock_starts_near_zero_and_sleeps_to_deadlines():
    clock = MonotonicClock()
    assert 0.0 <= clock.now() < 60.0
    deadline = clock.now() + 0.01
    clock.sleep_until(deadline)
    woken = clock.now()
    assert woken >= deadline
    clock.sleep_until(0.0)
    assert clock.now() >= woken


def test_the_manual_clock_moves_only_when_told_and_never_back():
    clock = ManualClock(2.0)
    assert clock.now() == clock.now() == 2.0
    clock.sleep_until(3.5)
    clock.sleep_until(1.0)
    assert clock.now() == 3.5
