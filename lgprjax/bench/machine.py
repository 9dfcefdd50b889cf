"""What a measurement ran on: one line, so that no figure stands without it."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from lgprjax.machine import usable_cores

_PACKAGES = ("numpy", "jax", "numba", "evosax", "pyswarms")


def machine_line() -> str:
    """CPU, cores that may be used, load, versions of everything that computes."""
    cores = usable_cores()
    load = f", load {os.getloadavg()[0]:.2f} at the start" if hasattr(os, "getloadavg") else ""
    found = [f"Python {platform.python_version()}", *(f"{name} {_version(name)}" for name in _PACKAGES)]
    return f"{_cpu()}, {cores} cores{load}; {', '.join(found)}"


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "missing"
