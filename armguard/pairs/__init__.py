"""Pairs of link and obstacle on the numbers of one tick: contact times and distances."""

from armguard.pairs.separation import compute_separation
from armguard.pairs.separation_margin import SeparationRule

__all__ = [
    "SeparationRule",
    "compute_separation",
]
