"""Common parts of all runtime processes: start, heartbeat, cores, notification of systemd."""

import hashlib
import mmap
import os
import struct
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path

from lgprjax.errors import InputError
from lgprjax.files import lock_file
from lgprjax.machine import keep_programs
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.ring import Ring

PROCESSES = ("control", "registration", "recorder", "display", "monitor", "coverage", "output")
"""Names, in the order of their rows in the table of heartbeats. No run has all of them: see ``processes_of``."""

RINGS = {
    "control_log": 8 << 20,  # control to recorder
    "registration_log": 32 << 20,  # registration to recorder
    "supervisor_log": 1 << 20,  # supervisor to recorder
    "fixes": 256 << 10,  # registration to control
    "priors": 256 << 10,  # control to registration
    "state": 1 << 20,  # control to display
    "requests": 64 << 10,  # display to control
    "notes": 256 << 10,  # supervisor to control
    "monitor": 64 << 10,  # monitor to control
    "cover": 1 << 20,  # control to coverage
    "worked": 4 << 20,  # coverage to display
    "poses": 256 << 10,  # control to output
    "view_state": 1 << 20,  # control to output
    "view_scans": 4 << 20,  # registration to output
    "progress": 64 << 10,  # the command that leads a calibration, to control
    "page_scans": 1 << 20,  # registration to display, of a run that only records
}
"""Rings and their sizes in bytes; each carries records (``messages``)."""


def processes_of(config: RuntimeConfig) -> tuple[str, ...]:
    """Processes of a run: neither a field nor a calibration needs a radar, a course needs no worked map; output runs
    only if configured.
    """
    without = {"coverage" if config.coverage is None else "registration"}
    without |= {"registration"} if config.ports.radar is None or config.mode == "calibrate" else set()
    without |= {"output"} if config.output is None else set()
    return tuple(name for name in PROCESSES if name not in without)


class ProcessStage(IntEnum):
    """Stage of a process."""

    STARTING = 0
    WARMING = 1
    READY = 2
    ENDING = 3


_ROW = struct.Struct("<QIIII")  # time of the beat in ns, stage, pid, beats, 0


@dataclass(frozen=True)
class HeartbeatRow:
    """A row of the table of heartbeats; ``mono_ns`` is 0 without one."""

    mono_ns: int
    stage: ProcessStage
    pid: int
    count: int


class Heartbeats:
    """The table of heartbeats: one row per process, which only that process writes."""

    def __init__(self, folder: Path) -> None:
        path = folder / "heartbeats"
        if not path.exists():
            path.write_bytes(bytes(_ROW.size * len(PROCESSES)))
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), 0)

    def beat(self, name: str, stage: ProcessStage, pid: int, count: int) -> None:
        """Write a beat of a process."""
        at = PROCESSES.index(name) * _ROW.size
        self._map[at : at + _ROW.size] = _ROW.pack(time.monotonic_ns(), stage, pid, count & 0xFFFFFFFF, 0)

    def read(self, name: str) -> HeartbeatRow:
        """The last beat of a process."""
        mono_ns, stage, pid, count, _ = _ROW.unpack_from(self._map, PROCESSES.index(name) * _ROW.size)
        return HeartbeatRow(mono_ns, ProcessStage(stage), pid, count)

    def clear(self, name: str) -> None:
        """Clear the row before a process is restarted."""
        at = PROCESSES.index(name) * _ROW.size
        self._map[at : at + _ROW.size] = bytes(_ROW.size)


UNUSABLE_INPUT = 4
"""Exit status of a process whose configuration, or a file of it, cannot be used; the process has printed the reason."""


@dataclass
class Started:
    """Arguments of a process's ``run``.

    Attributes:
        name: name of the process.
        config: configuration of the run.
        rings: folder of the rings and of the heartbeats, in memory.
        folder: folder of the run, for the recording.
        after_death: whether the process replaces a dead one.
    """

    name: str
    config: RuntimeConfig
    rings: Path
    folder: Path
    after_death: bool

    def __post_init__(self) -> None:
        self._beats = Heartbeats(self.rings)
        self._count = 0

    def ring(self, name: str) -> Ring:
        """This process's end of a ring."""
        return Ring.create(self.rings / name, RINGS[name])

    def beat(self, stage: ProcessStage) -> None:
        """Send a heartbeat; call it in the process's own loop, not in another thread, so that hangs are detected."""
        self._count += 1
        self._beats.beat(self.name, stage, os.getpid(), self._count)


# Messages to the service manager: systemd's notify protocol, datagrams of ``NAME=VALUE`` lines to a socket.


# Cores, priority and threads of a runtime process.


def check_cores(config: RuntimeConfig) -> None:
    """Check that this machine has the configured cores.

    Raises:
        InputError: a core is missing.
    """
    for place, core in (
        ("control.core", config.control.core),
        ("supervision.registration_core", config.supervision.registration_core),
    ):
        if core is not None and core not in _cores():
            expected = "one of " + ", ".join(str(known) for known in sorted(_cores()))
            raise InputError(config.file, place, expected, str(core))


def hold_to_cores(name: str, config: RuntimeConfig) -> None:
    """Pin control and registration, or coverage, to their cores; the others avoid a core reserved for control."""
    check_cores(config)
    beside = config.supervision.registration_core
    own = {"control": config.control.core, "registration": beside, "coverage": beside}.get(name)
    allowed = {own} if own is not None else _cores() - {config.control.core}
    if sys.platform == "linux" and allowed:
        os.sched_setaffinity(0, allowed)


def run_in_real_time(name: str, priority: int, *, threads_too: bool) -> None:
    """Use real-time (FIFO) priority; prints a line if the machine does not permit it.

    Args:
        name: name of the process.
        priority: priority, 1 to 99.
        threads_too: whether threads and processes started later inherit it.
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

    Existing variables of the environment are kept.
    """
    use_cache(config)
    for name, value in {
        "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
        "JAX_CPU_ENABLE_ASYNC_DISPATCH": "false",
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }.items():
        os.environ.setdefault(name, value)


def use_cache(config: RuntimeConfig) -> None:
    """Keep compiled functions in the configuration's folder, in this process and those that it starts; before JAX is
    imported. Existing variables of the environment are kept.
    """
    if config.cache is None:
        return
    keep_programs(config.path(config.cache))


def _cores() -> set[int]:
    return os.sched_getaffinity(0) if sys.platform == "linux" else set(range(os.cpu_count() or 1))


# One run at a time: a vehicle has one master, and a run's folder one writer.

SHARED_MEMORY = Path("/dev/shm")
"""All processes of the machine find the same folder here, including services with a private ``/tmp``."""


def memory_folder() -> Path:
    """A folder in memory where the machine has one, else the one for temporary files."""
    return SHARED_MEMORY if os.access(SHARED_MEMORY, os.W_OK | os.X_OK) else Path(tempfile.gettempdir())


@contextmanager
def only_instance(config: RuntimeConfig, run_folder: Path) -> Iterator[None]:
    """Lock the drive-by-wire device and the run's folder while the body runs.

    The kernel releases them when the process ends.

    Raises:
        InputError: another process holds one of them; the message names it.
    """
    # The line whose device only one run may have: that of the commands, or of a run that only records, its first.
    name = next(name for name in ("drive_by_wire", "gnss", "radar") if getattr(config.ports, name) is not None)
    device, line = config.port(name).url, f"ports.{name}.url"
    # A device may have several names; a network address has only one.
    device_key = device if "://" in device else os.path.realpath(device)
    with ExitStack() as held:
        for key, place, free in (
            (device_key, line, f"{device}, not in use by another run"),
            (os.path.realpath(run_folder), "run folder", f"{run_folder}, not in use by another run"),
        ):
            name = f"lgprjax-{hashlib.sha256(key.encode()).hexdigest()[:24]}.lock"
            holder = held.enter_context(lock_file(memory_folder() / name, _open))
            if holder is not None:
                raise InputError(config.file, place, free, f"in use by {holder}")
        yield


def _open(path: Path) -> int:
    # Creation apart: in a folder for all, the kernel refuses O_CREAT on a file of another user that is there.
    while True:
        with suppress(FileNotFoundError):
            return os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
        with suppress(FileExistsError):
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
            os.fchmod(descriptor, 0o666)
            return descriptor
