"""`Monitor`: from joint states and obstacles to a verdict in every tick.

Its judge, the decision to stop, committed pieces, and what can be asked of it between ticks.
"""

from armguard.monitor.explain import Explanation, Gain
from armguard.monitor.headroom import Attention, Headroom
from armguard.monitor.monitor import Monitor
from armguard.monitor.reports import PairReport, Snapshot
from armguard.monitor.trial import Choice, TrialTick
from armguard.verdict import PlanVerdict

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
