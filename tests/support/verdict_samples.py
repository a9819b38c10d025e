"""Verdicts as tests need them."""

from armguard.verdict import Verdict


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
        "run": "first",
    }
    return Verdict(**(fields | changes))
