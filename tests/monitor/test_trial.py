"""What was chosen says what it costs, and why it was chosen."""

import pytest

from armguard.monitor import Choice, TrialTick

CHOICE = Choice(
    {"motion": "joint"}, 1, 100, 0.995, 0.001, 30.0, 90, 120.0, True, (), ("a", "b", "c", "d")
)


def test_the_price_is_a_share_of_the_finests():
    assert CHOICE.price == pytest.approx(0.25)
    assert CHOICE._replace(evaluated=0.0, evaluated_finest=0.0).price == 1.0


def test_the_summary_leaves_out_what_else_was_tried():
    assert CHOICE.summary == ("a", "b", "c")


def test_a_tick_of_a_trial_is_judged_at_its_own_time_unless_another_is_given():
    tick = TrialTick(1.0, [0.0], [0.0])
    assert (tick.now, tick.tell) == (None, None)
