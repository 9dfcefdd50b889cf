"""Files as every room meets them. Nothing heavy is imported: the supervisor of the runtime does not compute."""

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
        InputError: it cannot be read, or is no TOML.
    """
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(path, "file", "a readable file", error.strerror or str(error)) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(path, "file", "TOML", str(error)) from None


def schema_text(name: str) -> str:
    """Text of ``data_schema/NAME.toml``: from the installed package, or from the source tree beside it."""
    packaged = resources.files("lgprjax").joinpath("data_schema", f"{name}.toml")
    if packaged.is_file():
        return packaged.read_text(encoding="utf-8")
    return (Path(__file__).resolve().parents[1] / "data_schema" / f"{name}.toml").read_text(encoding="utf-8")


def is_at(path: Path, descriptor: int) -> bool:
    """Whether the file that was opened is still the one of that name."""
    with suppress(FileNotFoundError):
        return path.stat().st_ino == os.fstat(descriptor).st_ino
    return False


def file_hash(path: str | Path) -> str:
    """SHA-256 of a file, read in blocks."""
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def open_lock(path: Path) -> int:
    """Descriptor of a lock file, made where there is none."""
    return os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o666)


@contextmanager
def lock_file(path: Path, opened: Callable[[Path], int] = open_lock) -> Iterator[str | None]:
    """Hold a lock file for as long as the body runs, or yield who holds it: "process N", or "another process".

    The system lets go of it when its process ends, however it ends. The file is removed afterwards.

    Args:
        path: of the lock file.
        opened: its descriptor, for reading and writing.

    Raises:
        OSError: it cannot be made, or the file system knows no locks.
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
        # Its last holder may have taken the file away between the opening and the locking.
        if is_at(path, descriptor):
            break
        os.close(descriptor)
    with suppress(OSError):  # a full disk: who holds it will not be told, but it is held
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

        # Far behind what is written into it: Windows lets nobody read what is locked.
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
