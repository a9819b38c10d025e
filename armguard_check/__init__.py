"""Checks proofs that armguard made, and shares nothing with it: standard library alone.

`python -m armguard_check` reads proofs as JSON lines. docs/proofs.md says what a proof claims, and
what is taken on trust.
"""

from armguard_check.intervals import ProofError
from armguard_check.proof import Proved, verify

__all__ = ["ProofError", "Proved", "verify"]
