"""Provenance of verdicts apart from their inputs: versions, sources, processor, compiler.

With the same provenance, the same inputs give bit-identical verdicts. Otherwise the last digits of
numbers can differ. If two recordings of verdicts differ, compare their provenance first.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import platform
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import pinocchio
from numba import config as numba_config

from armguard.robot.portable import describe_robot
from armguard.robot.robot import Robot

config: Any = numba_config

PACKAGE = Path(__file__).resolve().parents[1]

NAMES = {
    "armguard": "another version of armguard",
    "sources": "other sources of armguard",
    "robot": "another robot description",
    "cover": "another cover",
    "processor": "another processor",
    "processor_features": "another processor",
    "machine": "another machine",
    "numba": "another compiler (numba)",
    "llvmlite": "another compiler (llvmlite)",
    "numpy": "another version of NumPy",
    "pinocchio": "another version of Pinocchio",
    "coal": "another version of Coal",
    "python": "another version of Python",
}
"""Description of a difference in each."""

_DISTRIBUTIONS = ("armguard", "numba", "llvmlite", "numpy", "coal")


def describe_provenance(robot: Robot) -> dict[str, str]:
    """The provenance of this process's verdicts about this robot, by the names of `NAMES`."""
    return {**describe_software(), **digest_robot(robot)}


def describe_software() -> dict[str, str]:
    """The part of the provenance that does not depend on the robot, by the names of `NAMES`."""
    model, flags = _describe_processor()
    return {
        **{name: importlib.metadata.version(name) for name in _DISTRIBUTIONS},
        "sources": digest_package(PACKAGE),
        "processor": config.CPU_NAME or model,
        "processor_features": config.CPU_FEATURES or _digest(flags.encode()),
        "machine": f"{platform.system()} {platform.machine()}",
        "pinocchio": pinocchio.__version__,
        "python": platform.python_version(),
    }


def _describe_processor() -> tuple[str, str]:
    """Model of this machine's processor, and its features as far as the system lists them."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    found = {name.strip(): value.strip() for name, _, value in (x.partition(":") for x in lines)}
    model = found.get("model name") or platform.processor() or "unknown"
    return model, found.get("flags") or found.get("Features") or ""


def digest_robot(robot: Robot) -> dict[str, str]:
    """Digests of a robot: of everything except its cover, and of its cover."""
    data = describe_robot(robot)
    covers = {link["name"]: link.pop("cover") for link in data["links"]}
    return {
        "robot": _digest(msgspec.json.encode(data, order="deterministic")),
        "cover": _digest(msgspec.json.encode(covers, order="deterministic")),
    }


def list_differences(recorded: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """The differences in words, with both values; each kind of cause once."""
    told: dict[str, str] = {}
    for name, words in NAMES.items():
        before, now = recorded.get(name, "unknown"), here.get(name, "unknown")
        if before != now:
            told.setdefault(words, f"{words}: {before} recorded, {now} here")
    return list(told.values())


def digest_package(package: Path) -> str:
    """A digest of all modules of a package."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(path.relative_to(package).as_posix().encode() + b"\0")
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:16]


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]
