import math

from armguard.tally import Tally
from armguard.verdict import Level, Verdict


def verdict(level, contact_time=1.0, **changes):
    fields = {
        "stamp": 0.0,
        "sequence": 1,
        "level": level,
        "contact_time": contact_time,
        "stop_time": 0.2,
        "speed_scale": 0.0,
        "link": "hand",
        "obstacle": "ball",
        "complete": True,
        "evaluated": 1,
        "reasons": (),
        "valid_until": 0.0,
    }
    return Verdict(**(fields | changes))


def count(*verdicts):
    tally = Tally()
    for one in verdicts:
        tally.count(one)
    return tally


def test_every_tick_is_counted_once():
    levels = [Level.STOP, Level.SLOW, Level.STOP, Level.CLEAR, Level.CLEAR]
    tally = count(*map(verdict, levels))
    assert tally.levels == {Level.STOP: 2, Level.SLOW: 1, Level.AWARE: 0, Level.CLEAR: 2}
    assert sum(tally.levels.values()) == len(levels)


def test_a_stop_is_a_fall_to_it_and_a_beginning_with_it():
    stop, clear = verdict(Level.STOP), verdict(Level.CLEAR)
    assert count(clear, clear).stops == 0
    assert count(stop, stop).stops == 1
    assert count(stop, clear, stop, stop, clear, stop).stops == 3


def test_ticks_without_any_joint_state_count_only_as_waiting():
    waiting = verdict(Level.STOP, 0.0, sequence=0, link=None, complete=False)
    tally = count(waiting, waiting, verdict(Level.CLEAR))
    assert tally.waiting == 2
    assert tally.stops == tally.incomplete == tally.levels[Level.STOP] == 0
    assert tally.min_contact_time == 1.0


def test_the_soonest_contact_is_of_a_pair():
    assert count().min_contact_time == math.inf
    unknown = verdict(Level.STOP, 0.0, link=None, complete=False)
    tally = count(verdict(Level.CLEAR, math.inf, link=None), unknown, verdict(Level.SLOW, 0.25))
    assert tally.min_contact_time == 0.25
    assert tally.incomplete == 1
