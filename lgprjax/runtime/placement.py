"""Where and how a process of the runtime runs: cores, priority, threads."""

import os
import sys

from lgprjax.errors import InputError
from lgprjax.runtime.config import RuntimeConfig


def check_cores(config: RuntimeConfig) -> None:
    """Whether this machine has the cores that the configuration names.

    Raises:
        InputError: it has not.
    """
    for place, core in (
        ("control.core", config.control.core),
        ("supervision.registration_core", config.supervision.registration_core),
    ):
        if core is not None and core not in _cores():
            expected = "one of " + ", ".join(str(known) for known in sorted(_cores()))
            raise InputError(config.file, place, expected, str(core))


def hold_to_cores(name: str, config: RuntimeConfig) -> None:
    """Pin control and registration, or coverage, to their cores; the others keep off a core that is control's own."""
    check_cores(config)
    beside = config.supervision.registration_core
    own = {"control": config.control.core, "registration": beside, "coverage": beside}.get(name)
    allowed = {own} if own is not None else _cores() - {config.control.core}
    if sys.platform == "linux" and allowed:
        os.sched_setaffinity(0, allowed)


def run_in_real_time(name: str, priority: int, *, threads_too: bool) -> None:
    """First in, first out above everything ordinary; says so in a line where the machine does not permit it.

    Args:
        name: of the process.
        priority: 1 to 99.
        threads_too: threads and processes that are started later inherit it.
    """
    if sys.platform != "linux":
        return
    policy = os.SCHED_FIFO if threads_too else os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    try:
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except OSError as error:
        print(f"{name}: real-time priority {priority} is not permitted: {error.strerror}", file=sys.stderr, flush=True)


def run_in_ordinary_time() -> None:
    """Back from real-time priority."""
    if sys.platform == "linux":
        # Taking the flag back needs a right that the priority itself does not.
        flag = os.sched_getscheduler(0) & os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, os.SCHED_OTHER | flag, os.sched_param(0))


def set_environment(config: RuntimeConfig) -> None:
    """One thread a process for the compiled functions, and their cache; before JAX or NumPy is imported.

    What the environment already says stays.
    """
    settings = {
        "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
        "JAX_CPU_ENABLE_ASYNC_DISPATCH": "false",
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    if config.cache is not None:
        settings["JAX_COMPILATION_CACHE_DIR"] = str(config.path(config.cache))
        # The default leaves out what compiles within a second; many of those make a slow start.
        settings["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
        settings["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"
    for name, value in settings.items():
        os.environ.setdefault(name, value)


def _cores() -> set[int]:
    return os.sched_getaffinity(0) if sys.platform == "linux" else set(range(os.cpu_count() or 1))
