"""`armguard check`: checks the proofs of a recording in a process that runs none of this code."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from armguard.app.processes import COMPLAINT
from armguard.app.terminal import print_json
from armguard.exceptions import ArmguardError
from armguard.messages.proof import Proof
from armguard.recording.agreement import Agreement
from armguard.recording.reading import Recording

if TYPE_CHECKING:
    from armguard.app import cli


PLACE = "sequence", "now", "link", "obstacle"
"""Fields that identify a proof."""


def check(wishes: cli.Check) -> int:
    """Check all proofs of a recording; return the exit code.

    Args:
        wishes: Options of the command line.

    Raises:
        ArmguardError: The file is no recording, or is damaged, or the checker has ended early.
    """
    recording = Recording(wishes.file)
    found = _check_proofs(recording)
    if wishes.json:
        print_json(lambda: found | {"cut_off": recording.is_cut_off})
    else:
        lines = _describe(found)
        if recording.is_cut_off:
            lines.insert(1, "the recording has no end: its writer was killed")
        sys.stdout.write("".join(f"{line}\n" for line in lines))
    return 0 if 0 < found["proofs"] == found["verified"] == found["agreeing"] else COMPLAINT


def _check_proofs(recording: Recording) -> dict[str, Any]:
    """Results of `python -m armguard_check`, which reads the recorded proofs unchanged.

    Also checks whether they agree with what was recorded beside them.
    """
    agreement = Agreement(recording)
    first: dict[str, Any] | None = None
    # The one beside this package; -P: nothing that lies in the working directory.
    beside = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    checker = subprocess.Popen(
        [sys.executable, "-P", "-m", "armguard_check"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=beside,
    )
    with checker, _ending(checker):
        assert checker.stdin is not None, "it is a pipe"
        assert checker.stdout is not None, "it is a pipe"
        try:
            for _, event, data in recording.events():
                problem = agreement.take(event)
                if isinstance(event, Proof):
                    checker.stdin.write(data + b"\n")
                    if problem and first is None:
                        place = {key: getattr(event, key) for key in PLACE}
                        first = {**place, "why": problem}
            checker.stdin.close()
        except BrokenPipeError:
            pass  # what it has to say of that stands on standard error
        said = checker.stdout.read()
    try:
        found: dict[str, Any] = json.loads(said)
    except ValueError:
        raise ArmguardError(
            "armguard_check", f"has ended with {checker.returncode}", expected="its report"
        ) from None
    return found | {"agreeing": agreement.agreeing, "first_disagreeing": first}


@contextlib.contextmanager
def _ending(process: subprocess.Popen[bytes]) -> Iterator[None]:
    """Ends a process at an error, so that it does not report on half of its input."""
    try:
        yield
    except BaseException:
        process.kill()
        raise


def _describe(found: dict[str, Any]) -> list[str]:
    """Results, for people."""
    lines = [
        f"{found['proofs']} proofs, {found['verified']} verified",
        f"{found['agreeing']} agree with the recorded verdicts, obstacles, settings and arm",
        f"{found['contact_free']} prove that no contact is possible before a time",
        f"{found['rests_in_time']} prove that the arm is at rest or slow enough before contact "
        f"after a STOP",
        f"{found['rests_only']} prove only that the arm comes to rest after a STOP",
        *(f"trusted: arm {digest}, {count} proofs" for digest, count in found["arms"].items()),
    ]
    for kind, words in (("refused", "does not hold"), ("disagreeing", "does not agree")):
        first = found[f"first_{kind}"]
        if first is not None:
            place = f"tick {first['sequence']} at {first['now']} s"
            pair = f"{first['link']} and {first['obstacle']}"
            lines.append(f"first proof that {words}: {place}, {pair}: {first['why']}")
    return lines
