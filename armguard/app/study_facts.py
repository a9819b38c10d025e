"""What a study's page tells of its making: command, machine, versions and seed."""

from __future__ import annotations

import os
import shlex
import sys

from armguard.recording.provenance import describe_provenance
from armguard.robot.robot import Robot

VERSIONS = ("armguard", "numpy", "numba", "llvm", "pinocchio", "python")
"""What a page names the versions of."""


def tell_command() -> str:
    """The command that this process was called by."""
    return shlex.join(["armguard", *sys.argv[1:]])


def describe_machine(provenance: dict[str, str]) -> str:
    """Processor, cores and system of the machine that `describe_provenance` told of."""
    return f"{provenance['processor']}, {os.cpu_count()} cores, {provenance['machine']}"


def list_facts(seed: int) -> dict[str, str]:
    """Machine, versions and seed, by name.

    Args:
        seed: Of all that was drawn at random.
    """
    provenance = describe_provenance(Robot.load("panda"))
    return {
        "machine": describe_machine(provenance),
        "versions": ", ".join(f"{name} {provenance[name]}" for name in VERSIONS),
        "seed": str(seed),
    }
