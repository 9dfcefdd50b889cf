"""Output files that are there whole or not at all: a temporary name beside the target, then a rename."""

import errno
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from lgprjax.errors import InputError

# What a file system answers to a writer. Other errors inside the block are someone else's and pass through.
_WRITE_ERRORS = frozenset(
    getattr(errno, name)
    for name in (
        *("ENOSPC", "EFBIG", "EDQUOT", "EIO", "EACCES", "EPERM"),
        *("EROFS", "ENOENT", "ENOTDIR", "EISDIR", "ENAMETOOLONG", "EMFILE"),
    )
    if hasattr(errno, name)
)


@contextmanager
def atomic_output(path: str | Path, force: bool = False) -> Iterator[Path]:
    """Yield a temporary path in the target's folder; rename it onto ``path`` when the block ends well.

    Args:
        path: the target.
        force: replace a target that exists.

    Raises:
        InputError: the target exists (without ``force``) or is a folder, its folder is missing, or the file
            system refuses (no space left, file too large, no permission). Nothing is left behind.
    """
    target = Path(path)
    if target.is_dir():
        raise InputError(target, "output", "a file name", "a folder")
    if target.exists() and not force:
        raise InputError(target, "output", "a new file, or --force", "the file exists")
    if not target.parent.is_dir():
        raise InputError(target, "output", "a folder that exists", f"no folder {target.parent}")
    temporary = target.parent / f".{target.name}.partial-{os.getpid()}"
    try:
        yield temporary
        # A full disk may show only now, and a rename must not outrun the data in a power cut.
        with temporary.open("rb") as written:
            os.fsync(written.fileno())
        temporary.replace(target)
    except (OSError, RuntimeError) as error:
        reason = _write_refusal(error, (temporary, target))
        if reason is None:
            raise
        raise InputError(target, "output", "a file that can be written", reason) from None
    finally:
        _discard(temporary)


def _discard(temporary: Path) -> None:
    with suppress(OSError):
        # HDF5 may still hold a file that it failed to close: emptied first, it gives its space back at once.
        os.truncate(temporary, 0)
    with suppress(OSError):
        temporary.unlink()


def _write_refusal(error: OSError | RuntimeError, ours: tuple[Path, Path]) -> str | None:
    """Why the file system refused our file, in its own words; ``None`` when the error is not about that."""
    number = error.errno if isinstance(error, OSError) else None
    if number is None:
        # h5py tells the number only inside its text, and raises RuntimeError when closing fails.
        inside = re.search(r"errno = (\d+)", str(error))
        number = int(inside.group(1)) if inside else None
    named = getattr(error, "filename", None)
    if number is None or number not in _WRITE_ERRORS or (named is not None and Path(os.fsdecode(named)) not in ours):
        return None
    return os.strerror(number)
