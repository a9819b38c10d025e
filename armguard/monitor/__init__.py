"""`Monitor`: computes a verdict in every tick from joint states and obstacles.

Contains its judge, the stop decision, committed pieces, and the queries between ticks.
"""

from typing import TYPE_CHECKING

from armguard.lazy import lazy_names
from armguard.monitor.monitor import Monitor
from armguard.monitor.reports import PairReport, Snapshot
from armguard.monitor.trial import Choice, TrialTick
from armguard.verdict import PlanVerdict

if TYPE_CHECKING:
    from armguard.monitor.explain import Explanation, Gain
    from armguard.monitor.headroom import Attention, Headroom
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "Attention": "armguard.monitor.headroom",
            "Explanation": "armguard.monitor.explain",
            "Gain": "armguard.monitor.explain",
            "Headroom": "armguard.monitor.headroom",
        },
    )

__all__ = [
    "Attention",
    "Choice",
    "Explanation",
    "Gain",
    "Headroom",
    "Monitor",
    "PairReport",
    "PlanVerdict",
    "Snapshot",
    "TrialTick",
]
