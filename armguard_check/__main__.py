"""Checks proofs from lines of JSON on standard input, and prints the results as JSON.

Run as `python -m armguard_check < proofs.jsonl`; exit code 0 if there are proofs and all hold, else
1.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from typing import Any

from armguard_check.intervals import ProofError, require
from armguard_check.proof import verify

COUNTS = "proofs", "verified", "contact_free", "rests_in_time", "rests_only"


def check(lines: Iterable[bytes]) -> dict[str, Any]:
    """Check all proofs; returns the results."""
    found: dict[str, Any] = dict.fromkeys(COUNTS, 0)
    found |= {"arms": {}, "covers": {}, "first_refused": None}
    for line in lines:
        found["proofs"] += 1
        proof: Any = None
        try:
            proof = json.loads(line.decode(), object_pairs_hook=read_object)
            proved = verify(proof)
        except (ProofError, ValueError, RecursionError) as error:
            why = "it is not UTF-8" if isinstance(error, UnicodeDecodeError) else str(error)
            place = {key: name(proof, key) for key in ("sequence", "now", "link", "obstacle")}
            refused = {"proof": found["proofs"], **place, "why": why}
            found["first_refused"] = found["first_refused"] or refused
            continue
        found["verified"] += 1
        found["contact_free"] += proved.contact_time > 0
        found["rests_in_time"] += proved.in_time
        found["rests_only"] += proved.rests and not proved.in_time
        for trusted, digest in (("arms", proved.arm), ("covers", proved.cover)):
            found[trusted][digest] = found[trusted].get(digest, 0) + 1
    return found


def read_object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object without repeated keys, for which readers could find different values."""
    read = dict(pairs)
    require(len(read) == len(pairs), "a key is repeated")
    return read


def name(proof: Any, key: str) -> str | float | None:
    """Identifying fields of a proof, if they are plain values."""
    value = proof.get(key) if isinstance(proof, dict) else None
    return value if isinstance(value, str | int | float) else None


def main() -> int:
    """Check standard input; the exit code."""
    found = check(sys.stdin.buffer)
    sys.stdout.write(json.dumps(found, indent=1) + "\n")
    return 0 if 0 < found["proofs"] == found["verified"] else 1


if __name__ == "__main__":
    sys.exit(main())
