"""What machine a benchmark runs on, and with what."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from pathlib import Path


def describe_machine(*, load: bool = True) -> str:
    """Processor, load unless that is left out, and the versions that matter."""
    model = platform.processor() or platform.machine()
    path = Path("/proc/cpuinfo")
    if path.exists():
        lines = path.read_text(encoding="utf-8").splitlines()
        model = next((x.partition(":")[2].strip() for x in lines if "model name" in x), model)
    versions = [f"Python {platform.python_version()}"]
    for package in ("armguard", "numpy", "numba", "pin", "coal", "mujoco"):
        try:
            versions.append(f"{package} {importlib.metadata.version(package)}")
        except importlib.metadata.PackageNotFoundError:
            versions.append(f"no {package}")
    busy = f", load {_load()}" if load else ""
    return f"{model}, {os.cpu_count()} cores{busy}; " + ", ".join(versions)


def _load() -> str:
    return " ".join(f"{load:.2f}" for load in os.getloadavg())
