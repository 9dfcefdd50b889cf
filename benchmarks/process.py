"""Each peer in a process of its own, its threads stated: libraries that share one slow each other down."""

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.peers import PEERS, SERIAL_BLAS

_ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class PeerResult:
    """What a peer reached.

    Attributes:
        name, setting: which search, and its size.
        problems: attempted.
        successes: within 0.10 m.
        median_error_m: of the successes.
        single_ms: median latency of one scan at a time, from 369 samples to pose, map prepared.
        batch_ms: a scan, all scans at once.
        evaluations: of the score, a scan.
        preparation_ms: median a map, before the first scan; not in the other times.
        peak_rss_mb: of its process.
        single_threads, batch_threads: allowed where each time was taken.
        missing: why there is no result; else empty.
    """

    name: str
    setting: str
    problems: int
    successes: int
    median_error_m: float
    single_ms: float
    batch_ms: float
    evaluations: int
    preparation_ms: float
    peak_rss_mb: float
    single_threads: int
    batch_threads: int
    missing: str = ""

    @property
    def success_share(self) -> float:
        """Successes a problem; not a number where nothing ran."""
        return self.successes / self.problems if self.problems else float("nan")


def run_peer(
    name: str,
    hard_set: Path,
    *,
    count: int,
    threads: Sequence[int] = (1, 2),
    options: Sequence[str] = (),
    limit_s: float = 900.0,
) -> PeerResult:
    """Run a peer once for each number of threads and keep its best single and its best batch time.

    Args:
        name: one of ``PEERS``.
        hard_set: npz file of ``save_hard_set``.
        count: problems, spread evenly over the set.
        threads: to allow, one process each.
        options: of the peer's own command line.
        limit_s: of each process.

    Returns:
        A result; one that says why in ``missing`` where the peer's package is not installed, or its process failed
        or took too long. Successes are of the first setting that ran; the searches do not depend on threads.
    """
    package = PEERS[name]
    if importlib.util.find_spec(package) is None:
        return _nothing(name, " ".join(options), f"package {package} is not installed")
    results = [_run_once(name, hard_set, count, allowed, options, limit_s) for allowed in threads]
    ran = [result for result in results if not result.missing]
    if not ran:
        return results[0]
    single = min(ran, key=lambda result: result.single_ms)
    batch = min(ran, key=lambda result: result.batch_ms)
    return replace(
        ran[0],
        single_ms=single.single_ms,
        single_threads=single.single_threads,
        batch_ms=batch.batch_ms,
        batch_threads=batch.batch_threads,
        preparation_ms=min(result.preparation_ms for result in ran),
    )


def results_as_json(results: Sequence[PeerResult]) -> str:
    """A JSON list; figures that there are not become null."""
    rows = [{key: None if value != value else value for key, value in asdict(result).items()} for result in results]
    return json.dumps(rows, indent=2, allow_nan=False) + "\n"


def thread_environment(name: str, threads: int) -> dict[str, str]:
    """Variables that hold a peer's BLAS, Numba and XLA to this many threads; it pins itself to as many CPUs."""
    blas = 1 if name in SERIAL_BLAS else threads
    flags = f"--xla_cpu_multi_thread_eigen={'true' if threads > 1 else 'false'}"
    return {
        **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), str(blas)),
        "NUMBA_NUM_THREADS": str(threads),
        # Its default pool (OpenMP) spins while it waits, which costs whole time slices where a core is shared.
        "NUMBA_THREADING_LAYER": "workqueue",
        "XLA_FLAGS": flags,
        "JAX_PLATFORMS": "cpu",
        # Else the last line of a failure tells of hidden frames, not of the failure.
        "JAX_TRACEBACK_FILTERING": "off",
    }


def _run_once(
    name: str, hard_set: Path, count: int, threads: int, options: Sequence[str], limit_s: float
) -> PeerResult:
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "result.json"
        module = f"benchmarks.peers.{name}"
        command = [sys.executable, "-m", module, str(hard_set.resolve()), str(out)]
        command += ["--count", str(count), "--threads", str(threads), *options]
        # A folder of its own: some packages write log files where they are started.
        path = os.pathsep.join(part for part in (str(_ROOT), os.environ.get("PYTHONPATH", "")) if part)
        environment = {**os.environ, **thread_environment(name, threads), "PYTHONPATH": path}
        try:
            done = subprocess.run(
                command, cwd=folder, env=environment, capture_output=True, text=True, timeout=limit_s, check=False
            )
        except subprocess.TimeoutExpired:
            return _nothing(name, " ".join(options), f"not done within {limit_s:.0f} s")
        if done.returncode != 0 or not out.exists():
            last = (done.stderr.strip() or "no message").splitlines()[-1]
            return _nothing(name, " ".join(options), f"its process ended with {done.returncode}: {last}")
        return PeerResult(**json.loads(out.read_text(encoding="utf-8")))


def _nothing(name: str, setting: str, why: str) -> PeerResult:
    nan = float("nan")
    return PeerResult(name, setting, 0, 0, nan, nan, nan, 0, nan, nan, 0, 0, why)


# Measuring programs that are no peers, each in a process of its own like them.

AS_THE_PEER = {"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false", "JAX_CPU_ENABLE_ASYNC_DISPATCH": "false"}
"""How this project's peer runs: each call's work on the thread that calls."""


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
