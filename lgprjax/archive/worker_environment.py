"""What a worker process is started with: its share of the cores, its GPU, the package it came from."""

import os
import re
from importlib.metadata import entry_points
from pathlib import Path

import lgprjax


def gpus() -> list[str]:
    """Numbers of the GPUs that JAX would use here, as ``CUDA_VISIBLE_DEVICES`` counts them; JAX is not started."""
    wanted = os.environ.get("JAX_PLATFORMS") or "cuda"
    plugins = [plugin.name for plugin in entry_points(group="jax_plugins")]
    if not re.search("cuda|gpu", wanted) or not any("cuda" in name for name in plugins):
        return []
    visible = os.environ.get("CUDA_VISIBLE_DEVICES")
    if visible is not None:
        return [number.strip() for number in visible.split(",") if number.strip()]
    found = [re.fullmatch(r"nvidia(\d+)", path.name) for path in Path("/dev").glob("nvidia*")]
    return sorted((number.group(1) for number in found if number is not None), key=int)


def thread_variables(threads: int) -> dict[str, str]:
    """Variables that hold BLAS and XLA to so many threads; each reads them when it starts.

    Equal threads, equal bits: how many share a sum decides in which order it is added.
    """
    eigen = f"--xla_cpu_multi_thread_eigen={'true' if threads > 1 else 'false'}"
    return {
        **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NPROC"), str(threads)),
        "XLA_FLAGS": f"{os.environ.get('XLA_FLAGS', '')} {eigen}".strip(),
    }


def worker_environment(threads: int, gpu: str | None) -> dict[str, str]:
    """The environment of a worker.

    Args:
        threads: it is held to.
        gpu: it is given, and no other; None for the CPU.
    """
    root = str(Path(lgprjax.__file__).resolve().parents[1])
    path = os.pathsep.join(part for part in (root, os.environ.get("PYTHONPATH", "")) if part)
    environment = {**os.environ, **thread_variables(threads), "PYTHONPATH": path}
    if gpu is not None:
        environment["CUDA_VISIBLE_DEVICES"] = gpu
        # Sums by atomic additions come out differently from run to run.
        environment["XLA_FLAGS"] += " --xla_gpu_deterministic_ops=true"
    return environment
