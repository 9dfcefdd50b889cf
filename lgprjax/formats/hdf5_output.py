"""HDF5 files written under a temporary name, safe against a disk that fills up while they are written.

HDF5 cannot close a file whose writes fail: handles stay open, the library prints pages of errors and crashes the
process when it ends. So it never sees a failure: it writes through :class:`GuardedFile`, which remembers the first
failure, pretends success from then on, and tells at the next check.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py

from lgprjax.formats.atomic import atomic_output
from lgprjax.formats.schema import Schema
from lgprjax.formats.store import CACHE_BYTES, write_root

# After a failure HDF5 may read back what it believes to be written: this much of it is kept.
_OVERLAY_BYTES = 64 << 20
# The format of HDF5 1.10 has checksums on all of a file's structure; older ones read damage as if it were data.
_FORMAT = ("v110", "v110")


class GuardedFile:
    """Binary file for h5py's ``fileobj`` driver whose writes never fail; ``error`` holds the first failure.

    h5py passes buffers of a type of its own, which only ``memoryview`` understands: hence ``Any``.
    """

    def __init__(self, path: Path) -> None:
        # Unbuffered: a buffer would report a full disk later and elsewhere.
        self._file = path.open("w+b", buffering=0)
        self._position = 0
        self._overlay: list[tuple[int, bytes]] = []
        self._overlay_bytes = 0
        self.error: BaseException | None = None

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move; as in ``io``."""
        base = {os.SEEK_SET: 0, os.SEEK_CUR: self._position, os.SEEK_END: self._size()}[whence]
        self._position = base + offset
        return self._position

    def tell(self) -> int:
        """Position; as in ``io``."""
        return self._position

    def read(self, size: int) -> bytes:
        """As in ``io``; HDF5 itself calls ``readinto``."""
        buffer = bytearray(size)
        self.readinto(memoryview(buffer))
        return bytes(buffer)

    def readinto(self, buffer: Any) -> int:
        """Fill the buffer; bytes beyond the end read as zeros."""
        target = memoryview(buffer).cast("B")
        start, stop = self._position, self._position + len(target)
        data = os.pread(self._file.fileno(), len(target), start)
        target[: len(data)] = data
        target[len(data) :] = bytes(len(target) - len(data))
        for offset, kept in self._overlay:
            low, high = max(start, offset), min(stop, offset + len(kept))
            if low < high:
                target[low - start : high - start] = kept[low - offset : high - offset]
        self._position = stop
        return len(target)

    def write(self, buffer: Any) -> int:
        """Write all of the buffer, or remember why that failed."""
        data = memoryview(buffer).cast("B")
        if self.error is None:
            try:
                written = 0
                while written < len(data):
                    written += os.pwrite(self._file.fileno(), data[written:], self._position + written)
            except BaseException as error:  # also Ctrl-C: HDF5 must finish its bookkeeping first
                self.error = error
        if self.error is not None and self._overlay_bytes + len(data) <= _OVERLAY_BYTES:
            self._overlay.append((self._position, bytes(data)))
            self._overlay_bytes += len(data)
        self._position += len(data)
        return len(data)

    def truncate(self, size: int) -> int:
        """Set the size, unless the file is already lost."""
        if self.error is None:
            try:
                self._file.truncate(size)
            except BaseException as error:
                self.error = error
        return size

    def flush(self) -> None:
        """Nothing is held back: the file is unbuffered."""

    def close(self) -> None:
        """Close the file underneath; HDF5 must have closed its own before."""
        self._file.close()

    def check(self) -> None:
        """Raise the failure that a write met, if any."""
        if self.error is not None:
            raise self.error

    def _size(self) -> int:
        size = os.fstat(self._file.fileno()).st_size
        return max([size, *(offset + len(kept) for offset, kept in self._overlay)])


@contextmanager
def create_store(path: str | Path, schema: Schema, force: bool = False) -> Iterator[tuple[h5py.File, GuardedFile]]:
    """Create a file of a schema; it appears under its name when the block ends well, else nothing is left behind.

    Yields:
        The HDF5 file, schema and version written, and the guarded file: call its ``check`` now and then when much
        is written, so that a full disk ends the work early. It is checked at the end in any case.

    Raises:
        InputError: the output exists or cannot be written (see :func:`lgprjax.formats.atomic.atomic_output`).
    """
    with atomic_output(path, force) as temporary:
        guarded = GuardedFile(temporary)
        try:
            with h5py.File(guarded, "w", libver=_FORMAT, rdcc_nbytes=CACHE_BYTES, rdcc_w0=1.0) as store:
                write_root(store, schema)
                yield store, guarded
        finally:
            guarded.close()
            # A failed write is the cause of whatever error HDF5 ran into afterwards.
            guarded.check()
