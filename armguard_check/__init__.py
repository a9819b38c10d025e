"""Checks proofs that armguard made, with no code of armguard: standard library only.

`python -m armguard_check` reads proofs as JSON lines. docs/proofs.md describes the claims of a
proof and what the checker trusts.
"""

from armguard_check.intervals import ProofError
from armguard_check.proof import Proved, verify

__all__ = ["ProofError", "Proved", "verify"]
