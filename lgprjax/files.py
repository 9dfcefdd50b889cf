"""Common file operations. Nothing heavy is imported: the runtime's supervisor does not compute."""

import hashlib
import os
import sys
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import resources
from pathlib import Path
from typing import Any

from lgprjax.errors import InputError


def load_toml(path: str | Path) -> dict[str, Any]:
    """The table of a TOML file.

    Raises:
        InputError: it cannot be read, or is not TOML.
    """
    try:
        data = Path(path).read_bytes()
        return tomllib.loads(data.decode("utf-8"))
    except OSError as error:
        raise InputError(path, "file", "a readable file", error.strerror or str(error)) from None
    except UnicodeDecodeError as error:
        hdf5 = "HDF5 (the format of drive logs and maps)"
        found = hdf5 if data.startswith(b"\x89HDF") else f"bytes that are not UTF-8, from byte {error.start} on"
        raise InputError(path, "file", "TOML (a text format)", found) from None
    except tomllib.TOMLDecodeError as error:
        # No TOML begins with a brace.
        found = "JSON (the format of fields and coverage plans)" if data.lstrip().startswith(b"{") else str(error)
        raise InputError(path, "file", "TOML", found) from None


def make_folder(folder: Path) -> None:
    """Create a folder for results if it is missing. Raises ``InputError`` if that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, "output", "a folder that can be made", error.strerror or str(error)) from None


def schema_text(name: str) -> str:
    """Text of ``data_schema/NAME.toml``: from the installed package, or from the source tree."""
    packaged = resources.files("lgprjax").joinpath("data_schema", f"{name}.toml")
    if packaged.is_file():
        return packaged.read_text(encoding="utf-8")
    return (Path(__file__).resolve().parents[1] / "data_schema" / f"{name}.toml").read_text(encoding="utf-8")


def is_at(path: Path, descriptor: int) -> bool:
    """Whether an open file is still the one at its path."""
    with suppress(FileNotFoundError):
        return path.stat().st_ino == os.fstat(descriptor).st_ino
    return False


def file_hash(path: str | Path) -> str:
    """SHA-256 of a file, read in blocks."""
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def open_lock(path: Path) -> int:
    """Descriptor of a lock file, created if missing."""
    return os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o666)


@contextmanager
def lock_file(path: Path, opened: Callable[[Path], int] = open_lock) -> Iterator[str | None]:
    """Hold a lock file while the body runs, or yield its holder: "process N", or "another process".

    The system releases it when its process ends. The file is removed afterwards.

    Args:
        path: of the lock file.
        opened: its descriptor, for reading and writing.

    Raises:
        OSError: it cannot be created, or the file system has no locks.
    """
    while True:
        descriptor = opened(path)
        try:
            _lock(descriptor)
        except (BlockingIOError, PermissionError):
            holder = os.read(descriptor, 20).decode("ascii", "replace").strip("\0 ")
            os.close(descriptor)
            yield f"process {holder}" if holder else "another process"
            return
        except OSError:
            os.close(descriptor)
            raise
        # Its last holder may have removed the file between opening and locking.
        if is_at(path, descriptor):
            break
        os.close(descriptor)
    with suppress(OSError):  # a full disk: the holder will not be named, but the lock is held
        os.ftruncate(descriptor, 0)
        os.write(descriptor, str(os.getpid()).encode())
    try:
        yield None
    finally:
        with suppress(OSError):
            path.unlink()
        os.close(descriptor)


def _lock(descriptor: int) -> None:
    if sys.platform == "win32":
        import msvcrt

        # Far beyond its contents: Windows prevents reading of locked bytes.
        os.lseek(descriptor, 1 << 20, os.SEEK_SET)
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        os.lseek(descriptor, 0, os.SEEK_SET)
    else:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def examples_folder(name: str) -> Path:
    """Folder of the example files: ``onboard``, ``sites`` or ``tuning``, of the installed package or the repository."""
    from importlib import resources

    packaged = Path(str(resources.files("lgprjax"))) / "examples" / name
    return packaged if packaged.is_dir() else Path(__file__).resolve().parents[1] / name
