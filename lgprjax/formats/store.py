"""Self-describing HDF5 files: opened with one clear error, validated against their schema, written with units."""

import errno
import os
import re
import reprlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from lgprjax.errors import InputError
from lgprjax.formats.schema import Entry, Finding, Schema, Tally, check_scalar, check_version, expected_scalar

CHUNK_BYTES = 1 << 20
# Cache of a few chunks, so that ranges of scans that end inside a chunk do not decompress it twice.
CACHE_BYTES = 8 << 20
_BLOCK_BYTES = 8 << 20
# Errors that h5py raises for damage in a file's structure.
DAMAGE = (OSError, RuntimeError, KeyError, TypeError, ValueError, MemoryError, OverflowError)


def open_store(path: str | Path) -> h5py.File:
    """Open an HDF5 file for reading. Raises ``InputError`` if it is missing, empty, truncated or of another format."""
    file = Path(path)
    try:
        with file.open("rb") as stream:
            if not stream.read(1):
                raise InputError(file, "file", "an HDF5 file", "an empty file")
        return h5py.File(file, "r", rdcc_nbytes=CACHE_BYTES, locking="best-effort")
    except OSError as error:
        if error.errno is not None and error.strerror:
            raise InputError(file, "file", "a readable file", error.strerror) from None
        if not h5py.is_hdf5(file):
            raise InputError(file, "file", "an HDF5 file", _named_otherwise(file)) from None
        raise InputError(file, "file", "a complete HDF5 file", "a truncated or damaged file") from None


def _named_otherwise(file: Path) -> str:
    """Kind of a file that is not HDF5, by its name, with a hint to the expected file."""
    if file.name.endswith(".cover.geojson"):
        return "a coverage plan (lgprjax cover record makes X.worked.h5 from it and from recorded runs)"
    if file.name.endswith(".fixes.csv"):
        return "a table of fixes (X.fixes.h5 has them as HDF5)"
    if file.suffix == ".toml":
        return "a TOML text file"
    return "another format (lgprjax import converts recordings)"


@contextmanager
def reading(path: str | Path, place: str) -> Iterator[None]:
    """Turn the library's error about damaged contents into one line."""
    try:
        yield
    except InputError:
        raise
    except DAMAGE as error:
        raise InputError(path, place, "readable data", "damaged data (a part of the file is lost)") from error


def attribute_of(item: Any, name: str) -> object:
    """Attribute as plain Python value: text, number, or ``None`` if missing."""
    value = item.attrs.get(name)
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(())[()]
    return value.item() if isinstance(value, np.generic) else value


def write_attribute(item: Any, name: str, value: str | float) -> None:
    """Write an attribute; texts have a fixed length, as HDF5 may crash on damaged texts of variable length."""
    if isinstance(value, str):
        text = value.encode()
        item.attrs.create(name, text, dtype=h5py.string_dtype("utf-8", max(1, len(text))))
    else:
        item.attrs[name] = value


def write_root(store: h5py.File, schema: Schema) -> None:
    """Write the root attributes of every file: schema and version."""
    write_attribute(store, "schema", schema.name)
    write_attribute(store, "schema_version", schema.version)


def write_array(store: h5py.File, schema: Schema, path: str, values: np.ndarray) -> h5py.Dataset:
    """Write a small array with unit and description from its schema."""
    entry = schema.dataset(path)
    # Fixed-length text: readable everywhere and compressible, unlike HDF5's own strings.
    kind = f"S{max(map(len, entry.choices))}" if entry.choices else entry.dtype[0]
    try:
        data = np.asarray(values).astype(kind)
    except (TypeError, ValueError):  # such as None, or rows of different lengths
        raise InputError("call", path, "an array of numbers", reprlib.repr(values)) from None
    compression = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if data.nbytes > 4096 else {}
    return _describe(store.create_dataset(path, data=data, **compression), entry)


def create_array(
    store: h5py.File,
    schema: Schema,
    path: str,
    row_shape: tuple[int, ...],
    dtype: str | np.dtype[Any] | None = None,
    *,
    rows: int | None = None,
    checksum: bool = False,
) -> h5py.Dataset:
    """Create an empty array that grows along its first axis, in chunks of whole rows.

    Args:
        store: open file.
        schema: schema with the array.
        path: path of the array.
        row_shape: shape of a row.
        dtype: stored type, if not the schema's first.
        rows: number of rows per chunk; by default about 1 MiB.
        checksum: whether every chunk has a checksum (Fletcher's), so that a damaged one cannot be read as data.
    """
    entry = schema.dataset(path)
    kind = np.dtype(entry.dtype[0] if dtype is None else dtype)
    row_bytes = max(1, kind.itemsize * int(np.prod(row_shape)))
    # A short row (a time, a flag) would make chunks of 100,000 rows: too much to rewrite for each append.
    usual = min(max(1, CHUNK_BYTES // row_bytes), 16384)
    dataset = store.create_dataset(
        path,
        shape=(0, *row_shape),
        maxshape=(None, *row_shape),
        chunks=(rows or usual, *row_shape),
        dtype=kind,
        compression="gzip",
        compression_opts=1,
        shuffle=True,
        fletcher32=checksum,
    )
    return _describe(dataset, entry)


def _describe(dataset: h5py.Dataset, entry: Entry) -> h5py.Dataset:
    write_attribute(dataset, "unit", entry.unit)
    write_attribute(dataset, "description", entry.description)
    return dataset


def validate_store(
    store: h5py.File, path: str | Path, schema: Schema, *, bulk: bool = False, complete: bool = True
) -> Iterator[Finding]:
    """Findings of an open file, lazily, in the schema's order.

    Args:
        store: open file.
        path: name of the file in the findings.
        schema: schema of the file.
        bulk: whether to read also the bulk datasets, block by block.
        complete: whether the file is complete; if not, the minimum sizes are not checked.
    """
    file = str(path)
    try:
        yield from _findings(store, file, schema, bulk, complete)
    except DAMAGE:
        yield Finding(file, "file", "a complete HDF5 file", "a damaged file structure")


def _findings(store: h5py.File, file: str, schema: Schema, bulk: bool, complete: bool) -> Iterator[Finding]:
    refusal = check_version(schema, attribute_of(store, "schema"), attribute_of(store, "schema_version"))
    if refusal is not None:
        yield Finding(file, *refusal)
        return
    absent: list[str] = []
    for group in schema.groups:
        if not isinstance(_get(store, group.path), h5py.Group):
            absent.append(group.path + "/")
            needed = group.required or (group.needs is not None and group.needs in store)
            if needed or group.path in store:
                yield Finding(file, group.path, "a group", "another object" if group.path in store else "none")
    for paths in schema.one_of:
        present = [p for p in paths if p in store]
        if len(present) != 1 and not paths[0].startswith(tuple(absent)):
            yield Finding(file, " or ".join(paths), "exactly one of them", "both" if present else "neither")
    for entry in schema.attributes:
        holder, _, name = entry.path.partition("@")
        if holder in store:
            yield from _check_attribute(store[holder], name, file, entry)
    sizes: dict[str, tuple[int, str]] = {}
    for entry in schema.datasets:
        if entry.path.startswith(tuple(absent)):
            continue
        if entry.path in store:
            yield from _check_dataset(store, file, entry, sizes, bulk)
        elif entry.required or (entry.needs is not None and entry.needs in store):
            yield Finding(file, entry.path, "a dataset", "none")
    if complete:
        for axis, (size, place) in sizes.items():
            if size < schema.minimum.get(axis, 1):
                expected = f"at least {schema.minimum.get(axis, 1)} along the axis {axis}"
                yield Finding(file, place, expected, str(size))


def _get(store: h5py.File, path: str) -> object:
    """Object at a path; ``None`` if missing or if its link is broken."""
    return store.get(path) if path in store else None


def _check_attribute(holder: Any, name: str, file: str, entry: Entry) -> Iterator[Finding]:
    value = attribute_of(holder, name)
    if value is None:
        if entry.required:
            yield Finding(file, entry.path, expected_scalar(entry), "none")
        return
    problem = check_scalar(entry, value)
    if problem is not None:
        yield Finding(file, entry.path, expected_scalar(entry), problem)


def _check_dataset(
    store: h5py.File, file: str, entry: Entry, sizes: dict[str, tuple[int, str]], bulk: bool
) -> Iterator[Finding]:
    dataset = _get(store, entry.path)
    if not isinstance(dataset, h5py.Dataset):
        yield Finding(file, entry.path, "a dataset", "another object")
        return
    if dataset.dtype.name not in entry.dtype and not (entry.choices and dataset.dtype.kind == "S"):
        yield Finding(file, entry.path, " or ".join(entry.dtype), f"type {dataset.dtype.name}")
        return
    shape = dataset.shape
    names = ", ".join(str(axis) for axis in entry.dims)
    if shape is None or len(shape) != len(entry.dims):
        yield Finding(file, entry.path, f"axes [{names}]", f"shape {shape}")
        return
    for axis, size in zip(entry.dims, shape, strict=True):
        due, origin = (axis, "") if isinstance(axis, int) else sizes.setdefault(axis, (size, entry.path))
        if size != due:
            reason = f" as in {origin}" if origin else ""
            yield Finding(file, entry.path, f"axes [{names}] with {axis} = {due}{reason}", f"shape {shape}")
    unit = attribute_of(dataset, "unit")
    if unit != entry.unit:
        yield Finding(file, f"{entry.path}@unit", repr(entry.unit), "none" if unit is None else repr(unit))
    if bulk or not entry.bulk:
        yield from _check_values(dataset, file, entry)


def _check_values(dataset: h5py.Dataset, file: str, entry: Entry) -> Iterator[Finding]:
    tally = Tally(entry)
    row_bytes = max(1, dataset.dtype.itemsize * int(np.prod(dataset.shape[1:])))
    rows = max(1, _BLOCK_BYTES // row_bytes)
    try:
        for start in range(0, dataset.shape[0], rows):
            tally.add(dataset[start : start + rows])
    except DAMAGE:
        lost = f"damaged data (a part of the file is lost), first in {_first_lost(dataset, start, rows)}"
        yield Finding(file, entry.path, "readable data", lost)
        return
    yield from tally.findings(file, entry.path)


def _first_lost(dataset: h5py.Dataset, start: int, rows: int) -> str:
    """The first unreadable rows from ``start`` on: a chunk, if there are chunks."""
    stop = min(start + rows, dataset.shape[0])
    step = dataset.chunks[0] if dataset.chunks else rows
    for low in range(start - start % step, stop, step):
        try:
            dataset[low : low + step]
        except DAMAGE:
            return f"rows {low} to {min(low + step, dataset.shape[0]) - 1}"
    return f"rows {start} to {stop - 1}"


# Output files that are complete or absent: a temporary name next to the target, then a rename.

# Errors of the file system when writing. Other errors inside the block pass through.
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
    """Yield a temporary path in the target's folder; rename it to ``path`` when the block succeeds.

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
        raise InputError(target, "output", "a new file, or --force", "an existing file")
    if not target.parent.is_dir():
        raise InputError(target, "output", "a folder that exists", f"no folder {target.parent}")
    temporary = target.parent / f".{target.name}.partial-{os.getpid()}"
    try:
        yield temporary
        # A full disk may show only now, and a rename must not precede the data in a power cut.
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
        # HDF5 may still hold a file that it failed to close: truncated first, it frees its space at once.
        os.truncate(temporary, 0)
    with suppress(OSError):
        temporary.unlink()


def _write_refusal(error: OSError | RuntimeError, ours: tuple[Path, Path]) -> str | None:
    """The file system's reason for refusing a file; ``None`` for other errors."""
    number = error.errno if isinstance(error, OSError) else None
    if number is None:
        # h5py gives the number only in its text, and raises RuntimeError when closing fails.
        inside = re.search(r"errno = (\d+)", str(error))
        number = int(inside.group(1)) if inside else None
    named = getattr(error, "filename", None)
    if number is None or number not in _WRITE_ERRORS or (named is not None and Path(os.fsdecode(named)) not in ours):
        return None
    return os.strerror(number)


# HDF5 files written under a temporary name, safe against a disk that fills up while they are written.
#
# HDF5 cannot close a file whose writes fail: handles stay open, the library prints pages of errors and crashes the
# process at exit. Therefore it never sees a failure: it writes through :class:`GuardedFile`, which remembers the first
# failure, pretends success from then on, and raises at the next check.

# After a failure HDF5 may read back data that it believes written: this much of it is kept.
_OVERLAY_BYTES = 64 << 20
# The format of HDF5 1.10 has checksums on all of a file's structure; older ones read damage as data.
_FORMAT = ("v110", "v110")


class GuardedFile:
    """Binary file for h5py's ``fileobj`` driver whose writes never fail; ``error`` holds the first failure.

    h5py passes a private buffer type, which only ``memoryview`` understands: hence ``Any``.
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
        """Read bytes as in ``io``; HDF5 itself calls ``readinto``."""
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
        """Write all of the buffer, or remember the failure."""
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
        """No operation: the file is unbuffered."""

    def close(self) -> None:
        """Close the file underneath; HDF5 must have closed its own before."""
        self._file.close()

    def check(self) -> None:
        """Raise the first failure of a write, if any."""
        if self.error is not None:
            raise self.error

    def _size(self) -> int:
        size = os.fstat(self._file.fileno()).st_size
        return max([size, *(offset + len(kept) for offset, kept in self._overlay)])


@contextmanager
def create_store(path: str | Path, schema: Schema, force: bool = False) -> Iterator[tuple[h5py.File, GuardedFile]]:
    """Create a file of a schema; it appears under its name when the block succeeds, else nothing is left behind.

    Yields:
        The HDF5 file, schema and version written, and the guarded file: call its ``check`` now and then when much
        is written, so that a full disk ends the work early. It is checked at the end in any case.

    Raises:
        InputError: the output exists or cannot be written (see :func:`lgprjax.formats.store.atomic_output`).
    """
    with atomic_output(path, force) as temporary:
        guarded = GuardedFile(temporary)
        try:
            with h5py.File(guarded, "w", libver=_FORMAT, rdcc_nbytes=CACHE_BYTES, rdcc_w0=1.0) as store:
                write_root(store, schema)
                yield store, guarded
        finally:
            guarded.close()
            # A failed write is the cause of any later error of HDF5.
            guarded.check()


# Times: ISO 8601 texts of files, and whole nanoseconds of Unix time.

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def utc_ns(text: str) -> int:
    """Nanoseconds of Unix time of a time text; without a zone it is UTC. Raises ``ValueError`` if invalid."""
    moment = datetime.fromisoformat(text)
    moment = moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)
    return (moment - _EPOCH) // timedelta(microseconds=1) * 1000


def utc_text(ns: int) -> str:
    """The time as text for files, to the microsecond. Raises ``OverflowError`` beyond the calendar."""
    return (_EPOCH + timedelta(microseconds=ns // 1000)).isoformat().replace("+00:00", "Z")
