"""One run at a time: a vehicle has one master, and a run's folder one writer."""

import fcntl
import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from lgprjax.errors import InputError
from lgprjax.files import is_at
from lgprjax.runtime.config import RuntimeConfig

SHARED_MEMORY = Path("/dev/shm")
"""Every process of the machine finds the same folder here, those of a service with its own ``/tmp`` too."""


def memory_folder() -> Path:
    """A folder in memory where the machine has one, else the one for temporary files."""
    return SHARED_MEMORY if os.access(SHARED_MEMORY, os.W_OK | os.X_OK) else Path(tempfile.gettempdir())


@contextmanager
def only_instance(config: RuntimeConfig, run_folder: Path) -> Iterator[None]:
    """Hold the drive-by-wire device and the run's folder for as long as the body runs.

    The kernel lets go of them when the process ends, however it ends.

    Raises:
        InputError: another process holds one of them; it says which process.
    """
    device = config.ports.drive_by_wire.url
    # Several names lead to one device; an address of the network has one only.
    device_key = device if "://" in device else os.path.realpath(device)
    with ExitStack() as held:
        for key, place, free in (
            (device_key, "ports.drive_by_wire.url", f"{device}, not driven by another run"),
            (os.path.realpath(run_folder), "run folder", f"{run_folder}, not written by another run"),
        ):
            holder = held.enter_context(_lock(key))
            if holder is not None:
                raise InputError(config.file, place, free, f"process {holder} holds it")
        yield


@contextmanager
def _lock(key: str) -> Iterator[str | None]:
    """Hold the lock of a name, or yield who holds it."""
    path = memory_folder() / f"lgprjax-{hashlib.sha256(key.encode()).hexdigest()[:24]}.lock"
    while True:
        descriptor = _open(path)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(descriptor, 20, 0).decode("ascii", "replace").strip() or "unknown"
            os.close(descriptor)
            yield holder
            return
        # Its last holder may have taken the file away between the opening and the locking.
        if is_at(path, descriptor):
            break
        os.close(descriptor)
    try:
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, str(os.getpid()).encode(), 0)
        yield None
    finally:
        with suppress(OSError):
            path.unlink()
        os.close(descriptor)


def _open(path: Path) -> int:
    # Creation apart: in a folder for all, the kernel refuses O_CREAT on a file of another user that is there.
    while True:
        with suppress(FileNotFoundError):
            return os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
        with suppress(FileExistsError):
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
            os.fchmod(descriptor, 0o666)
            return descriptor
