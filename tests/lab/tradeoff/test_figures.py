import math

import pytest

from armguard.lab.tradeoff.figures import (
    compute_figures,
    count_missed,
    find_front,
    find_lateness,
    match_ticks,
)
from armguard.lab.tradeoff.truth import Contact
from support.tradeoff_cases import make_track

LEVELS = [3, 3, 0, 0, 1, 3, 0, 0]


def figures(track, finest=None, contacts=()):
    finest = make_track(LEVELS) if finest is None else finest
    return compute_figures(track, finest, [1e-5, 3e-5], contacts, 0.02)


def test_a_setting_that_says_what_the_finest_says():
    found = figures(make_track(LEVELS))
    assert found.stop == 0.5
    assert found.slow == 0.125
    assert found.same_level == found.tight_finest == found.tight_finest_p5 == 1.0
    assert (found.late_p50, found.late_max, found.missed) == (0.0, 0.0, 0.0)
    assert found.tick_p50 == found.tick_max == pytest.approx(100.0)
    assert found.intake_p50 == pytest.approx(20.0)
    # 8 ticks of 0.1 ms and 40 µs of messages in 80 ms.
    assert found.core == pytest.approx((8e-4 + 4e-5) / 0.08)
    assert found.evaluated == 10.0


def test_ticks_of_another_rate_are_compared_where_they_meet():
    slow = make_track(LEVELS[1::2], rate=50.0, contact_time=0.5)
    own, other = match_ticks(slow.time, make_track(LEVELS).time)
    assert own.tolist() == [0, 1, 2, 3]
    assert other.tolist() == [1, 3, 5, 7]
    found = figures(slow)
    assert found.same_level == 1.0
    assert found.tight_finest == 0.5


def test_lateness_is_from_the_finest_stop_until_this_one():
    finest = make_track(LEVELS)
    assert find_lateness(make_track(LEVELS), finest) == [0.0, 0.0]
    assert find_lateness(make_track([0] * 8), finest) == [0.0, 0.0]
    # The second begins at 70 ms, this says it at 80 ms.
    assert find_lateness(make_track([3, 0, 0, 0, 0, 3, 1, 0]), finest) == pytest.approx([0.0, 0.01])
    # What never says it is as late as the STOP was long.
    assert find_lateness(make_track([3] * 8), finest) == pytest.approx([0.02, 0.01])
    assert find_lateness(make_track(LEVELS), make_track([0, 0, 3])) == []


def test_contacts_that_come_sooner_than_was_said_are_missed():
    contact = Contact(0.06, 0.0, "ball", False)
    assert count_missed(make_track([0] * 8, contact_time=0.001), [contact], 0.02) == 0
    assert count_missed(make_track([0] * 8, contact_time=0.2), [contact], 0.02) == 1
    assert count_missed(make_track([0] * 8, contact_time=0.2), [], 0.02) == 0


def test_contacts_without_a_stop_in_time_are_missed():
    contact = Contact(0.06, 0.0, "ball", False)
    for levels, missed in (([3, 3, 3, 0, 0, 0, 0, 0], 0), ([3, 3, 3, 3, 0, 0, 0, 0], 1)):
        track = make_track(levels, contact_time=0.0)
        assert count_missed(track, [contact], 0.02) == missed


def test_nothing_was_promised_of_what_broke_its_bounds_or_was_not_seen():
    track = make_track([3] * 8, contact_time=9.0)
    assert count_missed(track, [Contact(0.06, 0.0, "ball", True)], 0.02) == 0
    assert count_missed(track, [Contact(0.06, 0.06, "ball", False)], 0.02) == 0
    assert count_missed(track, [Contact(0.06, 0.03, "ball", False)], 0.02) == 1


def test_a_front_has_what_nothing_beats():
    prices, caution = [3.0, 1.0, 2.0, 2.0, 4.0], [0.1, 0.5, 0.3, 0.2, 0.1]
    assert find_front(prices, caution) == [1, 3, 0]
    assert find_front([], []) == []


def test_nothing_measured_is_nothing_said():
    assert math.isnan(figures(make_track([])).core)
