"""Checks proofs that come as lines of JSON on standard input, and prints what it found, as JSON.

Run as `python -m armguard_check < proofs.jsonl`; exit code 0 if there are some and all of them
hold, else 1.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from typing import Any

from armguard_check.intervals import ProofError
from armguard_check.proof import verify


def check(lines: Iterable[str | bytes]) -> dict[str, Any]:
    """Check all proofs; what there is to say of them."""
    proofs = verified = contact_free = in_time = rests_only = 0
    first: dict[str, Any] | None = None
    arms: dict[str, int] = {}
    for line in lines:
        proofs += 1
        proof: Any = None
        try:
            proof = json.loads(line)
            proved = verify(proof)
        except (ProofError, ValueError, RecursionError) as error:
            known = proof if isinstance(proof, dict) else {}
            place = {key: known.get(key) for key in ("sequence", "now", "link", "obstacle")}
            first = first or {"proof": proofs, **place, "why": str(error)}
        else:
            verified += 1
            contact_free += proved.contact_time > 0
            in_time += proved.in_time
            rests_only += proved.rests and not proved.in_time
            arms[proved.arm] = arms.get(proved.arm, 0) + 1
    found = {"proofs": proofs, "verified": verified, "contact_free": contact_free}
    found |= {"rests_in_time": in_time, "rests_only": rests_only}
    return found | {"arms": arms, "first_refused": first}


def main() -> int:
    """Check standard input; the exit code."""
    found = check(sys.stdin)
    sys.stdout.write(json.dumps(found, indent=1) + "\n")
    return 0 if 0 < found["proofs"] == found["verified"] else 1


if __name__ == "__main__":
    sys.exit(main())
