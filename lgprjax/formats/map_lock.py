"""One writer of a map at a time, and nothing left beside it by writers that were killed."""

import fcntl
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from lgprjax.errors import InputError
from lgprjax.files import is_at


@contextmanager
def locked_map(path: str | Path) -> Iterator[None]:
    """Hold a map against other writers for as long as the body runs; readers are held up by nobody.

    The lock is a file beside the map, ``.NAME.lock``, which the kernel lets go of when its process ends, however it
    ends. What writers that were killed have left beside the map is removed.

    Args:
        path: the map, which need not exist yet.

    Raises:
        InputError: another process writes the map (it says which one), or no file can be made in the map's folder.
    """
    target = Path(path)
    if not target.parent.is_dir():
        raise InputError(target, "output", "a folder that exists", f"no folder {target.parent}")
    lock = target.with_name(f".{target.name}.lock")
    descriptor = _hold(lock, target)
    try:
        _clear_remains(target)
        yield
    finally:
        with suppress(OSError):
            lock.unlink()
        os.close(descriptor)


def scratch_folder(path: str | Path) -> Path:
    """Where this process keeps a map's unfinished parts: beside it, so that a rename is all that is left to do.

    What is in it when the process is killed is removed with the next lock on the map.
    """
    target = Path(path)
    return target.with_name(f".{target.name}.partial-{os.getpid()}-parts")


def _hold(lock: Path, target: Path) -> int:
    while True:
        try:
            descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise InputError(target, "output", "a file that can be written", os.strerror(error.errno or 0)) from None
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(descriptor, 20, 0).decode("ascii", "replace").strip()
            os.close(descriptor)
            found = f"process {holder} at work on it" if holder else "another process at work on it"
            raise InputError(target, "output", "a map that no other process is writing", found) from None
        except OSError as error:
            os.close(descriptor)
            raise InputError(target, "output", "a file system with locks", os.strerror(error.errno or 0)) from None
        # Its last holder may have taken the file away between the opening and the locking.
        if is_at(lock, descriptor):
            break
        os.close(descriptor)
    with suppress(OSError):  # a full disk: who holds it will not be told, but it is held
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, str(os.getpid()).encode(), 0)
    return descriptor


def _clear_remains(target: Path) -> None:
    """Remove unfinished outputs of processes that are no more."""
    remains = re.compile(rf"\.{re.escape(target.name)}\.partial-(\d{{1,9}})(?:-parts)?")
    for entry in target.parent.iterdir():
        left = remains.fullmatch(entry.name)
        if left is None or _alive(int(left.group(1))):
            continue
        if entry.is_dir():
            shutil.rmtree(entry, ignore_errors=True)
        else:
            with suppress(OSError):
                entry.unlink()


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
