"""Measuring programs that are no peers, each in a process of its own like them."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lgprjax.bench.process import thread_environment

AS_THE_PEER = {"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false", "JAX_CPU_ENABLE_ASYNC_DISPATCH": "false"}
"""How this project's peer runs: each call's work on the thread that calls."""

_ROOT = Path(__file__).resolve().parents[2]


class ProgramError(Exception):
    """A measuring program did not end well; one line says why."""


def run_program(
    module: str,
    arguments: Sequence[str],
    *,
    threads: int,
    limit_s: float = 900.0,
    environment: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Run ``python -m MODULE OUT ARGUMENTS...`` and read the JSON object that it writes to OUT.

    Args:
        module: of this package.
        arguments: after the output's path.
        threads: it is held to, see ``thread_environment``.
        limit_s: it may take.
        environment: variables of its own, above those of the threads.

    Raises:
        ProgramError: it failed or took too long.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "result.json"
        path = os.pathsep.join(part for part in (str(_ROOT), os.environ.get("PYTHONPATH", "")) if part)
        variables = {**os.environ, **thread_environment("this_project", threads), "PYTHONPATH": path}
        variables.update(environment or {})
        command = [sys.executable, "-m", module, str(out), *arguments]
        try:
            done = subprocess.run(
                command, cwd=folder, env=variables, capture_output=True, text=True, timeout=limit_s, check=False
            )
        except subprocess.TimeoutExpired:
            raise ProgramError(f"{module}: not done within {limit_s:.0f} s") from None
        if done.returncode != 0 or not out.exists():
            last = (done.stderr.strip() or "no message").splitlines()[-1]
            raise ProgramError(f"{module}: its process ended with {done.returncode}: {last}")
        found = json.loads(out.read_text(encoding="utf-8"))
        assert isinstance(found, dict)
        return found


def hold_to(threads: int) -> None:
    """Pin this process to as many of the CPUs that it may use."""
    if sys.platform == "linux":
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[-threads:])
