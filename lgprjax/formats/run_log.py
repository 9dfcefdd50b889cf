"""Reading a recorded run: every intact record, at any damage of its files."""

import json
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from uuid import UUID

import numpy as np
from jaxtyping import Complex

from lgprjax.errors import InputError
from lgprjax.run_records import Record, numpy_type, unpack
from lgprjax.run_segment import (
    HEADS_SIZE,
    OWN,
    SUFFIX,
    SegmentHead,
    SegmentRecord,
    read_head,
    scan_records,
    segments_of,
)
from lgprjax.wire import CRC, HEAD_FIELDS, MESSAGES, SYNC, Frame, decode

RUN_FILE = "run.json"
"""Next to the segments: UUID, versions, and the computer's clocks at each start of the recorder."""


class DamagedBytes(NamedTuple):
    """Bytes of a segment that are not an intact record: from ``start`` to before ``stop``."""

    file: str
    start: int
    stop: int


class MissingNumbers(NamedTuple):
    """Arrival numbers from ``first`` to ``last`` without an intact record."""

    first: int
    last: int


class RunSummary(NamedTuple):
    """Summary of a run's files.

    Attributes:
        run: UUID; ``None`` if no file has it, in which case foreign records cannot be recognised.
        segments: number of files.
        records: intact records, without the recorder's own.
        first, last: arrival numbers of the first and the last intact record.
        cut: incomplete records at the end of segments, in bytes: where the recording was interrupted.
        damaged: other bytes that are no record.
        missing: numbers that are lost.
        dropped: messages that did not fit into their rings, by ring.
        end: why the recording ended; ``None`` if it was interrupted.
    """

    run: UUID | None
    segments: int
    records: int
    first: int | None
    last: int | None
    cut: tuple[DamagedBytes, ...]
    damaged: tuple[DamagedBytes, ...]
    missing: tuple[MissingNumbers, ...]
    dropped: dict[str, int]
    end: str | None

    @property
    def complete(self) -> bool:
        """Whether nothing that arrived is lost: it ended properly, and no number or message is missing."""
        return self.end is not None and not self.missing and not any(self.dropped.values())


class RunReading:
    """The records of a run. Each pass over it reads the files again.

    Attributes:
        folder: folder of the run.
        heads: heads of the segments with an intact head, in order.
    """

    def __init__(self, folder: Path, files: dict[int, Path]) -> None:
        self.folder = folder
        self._files = files
        self._broken: dict[int, list[int]] = {}
        heads = []
        for segment, path in files.items():
            head, self._broken[segment] = read_head(path)
            if head is not None:
                heads.append(head)
        most = Counter(head.run for head in heads).most_common(1)
        self._run = most[0][0] if most else _run_of(folder / RUN_FILE)
        self.heads: tuple[SegmentHead, ...] = tuple(head for head in heads if head.run == self._run)
        self._summary: RunSummary | None = None

    def __iter__(self) -> Iterator[tuple[int, bytes]]:
        """Arrival number and bytes of every intact record, numbers rising."""
        tally = _Tally()
        for segment, path in self._files.items():
            tally.open(path, self._broken[segment])
            if self._run is not None:
                for record in scan_records(path, self._run):
                    if tally.add(record) and record.origin != OWN:
                        yield record.number, record.data
            tally.close(path)
        self._summary = tally.summary(self._run, len(self._files))

    @property
    def clock(self) -> tuple[int, int] | None:
        """UTC and monotonic clock of one moment at the run's beginning, ns; ``None`` if no file has it."""
        if self.heads:
            return self.heads[0].utc_ns, self.heads[0].mono_ns
        with suppress(OSError, ValueError, KeyError, TypeError, IndexError):
            first = json.loads((self.folder / RUN_FILE).read_text(encoding="utf-8"))["clocks"][0]
            return int(first["utc_ns"]), int(first["mono_ns"])
        return None

    @property
    def summary(self) -> RunSummary:
        """Summary of the last complete pass; a pass is made if there was none."""
        if self._summary is None:
            for _ in self:
                pass
        assert self._summary is not None
        return self._summary


def read_run(folder: str | Path) -> RunReading:
    """The records of a run, in the order of their arrival.

    Damage does not stop the reading: intact records after it are found again, and the summary lists the losses.

    Args:
        folder: folder of the run.

    Raises:
        InputError: there is no folder, or it holds no segment of a run.
    """
    path = Path(folder)
    if not path.is_dir():
        raise InputError(path, "folder", "the folder of a recorded run", _instead_of_folder(path))
    files = segments_of(path)
    if not files:
        raise InputError(path, "folder", f"segments of a recorded run, 0000{SUFFIX} and on", _instead_of_run(path))
    return RunReading(path, files)


def _instead_of_folder(path: Path) -> str:
    if not path.exists():
        return "no folder"
    if path.suffix == SUFFIX:
        return f"a segment of a run: give its folder, {path.parent}"
    if path.suffix == ".toml":
        return "a TOML file: the runs are in the folder recording.folder of the configuration"
    if path.name.endswith(".drive.h5"):
        return "a drive log (lgprjax recover makes it from a run)"
    return "a file"


def _instead_of_run(path: Path) -> str:
    """Description of a folder without segments, often the parent folder of runs, for an error."""
    runs = sorted(each for each in path.iterdir() if each.is_dir() and segments_of(each))
    return f"a folder of runs: give one of them, such as {runs[-1]}" if runs else "none"


class _Tally:
    """Findings of a pass over a run."""

    def __init__(self) -> None:
        self._records = 0
        self._first: int | None = None
        self._last: int | None = None
        self._cut: list[DamagedBytes] = []
        self._damaged: list[DamagedBytes] = []
        self._missing: list[MissingNumbers] = []
        self._dropped: dict[str, int] = {}
        self._end: str | None = None
        self._file = ""
        self._stop = 0

    def open(self, path: Path, broken: list[int]) -> None:
        """Begin a segment."""
        self._file, self._stop = path.name, 0
        if path.stat().st_size >= HEADS_SIZE:
            self._stop = HEADS_SIZE
            self._damaged += [DamagedBytes(self._file, at, at + HEADS_SIZE // 2) for at in broken]

    def add(self, record: SegmentRecord) -> bool:
        """Whether a record belongs to the run: a number that does not rise does not."""
        due = 0 if self._last is None else self._last + 1
        if record.number < due:
            return False
        if record.number > due:
            self._missing.append(MissingNumbers(due, record.number - 1))
        if record.start > self._stop:
            self._damaged.append(DamagedBytes(self._file, self._stop, record.start))
        self._first = record.number if self._first is None else self._first
        self._last, self._stop = record.number, record.stop
        self._records += record.origin != OWN
        # Records after an end are from a restart, which has its own end.
        self._end = None
        if record.origin == OWN:
            note = json.loads(record.data)
            self._dropped |= note.get("dropped", {})
            self._end = note.get("end")
        return True

    def close(self, path: Path) -> None:
        """End a segment."""
        size = path.stat().st_size
        if size > self._stop:
            self._cut.append(DamagedBytes(self._file, self._stop, size))

    def summary(self, run: bytes | None, segments: int) -> RunSummary:
        """Summary of all segments."""
        return RunSummary(
            run=None if run is None else UUID(bytes=run),
            segments=segments,
            records=self._records,
            first=self._first,
            last=self._last,
            cut=tuple(self._cut),
            damaged=tuple(self._damaged),
            missing=tuple(self._missing),
            dropped=self._dropped,
            end=self._end,
        )


def _run_of(path: Path) -> bytes | None:
    with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
        return UUID(json.loads(path.read_text(encoding="utf-8"))["uuid"]).bytes
    return None


# Frames of the lines in a recorded run, as rows of NumPy: their layout is that of ``lgprjax.wire``.


def read_run_record(data: bytes) -> Record | None:
    """A record's parts; ``None`` for one that this version does not know."""
    with suppress(ValueError):
        return unpack(data)
    return None


@cache
def frame_type(name: str) -> np.dtype[Any]:
    """A frame of a message from its sync to its last field of fixed size. ``KeyError`` for a message not known."""
    fields = (*HEAD_FIELDS, *MESSAGES[name].numbers)
    return np.dtype([("sync", "u1", len(SYNC)), *((field.name, numpy_type(field.kind)) for field in fields)])


def frame_name(frame: bytes) -> str | None:
    """Message type of a complete frame; ``None`` if it is not a frame, or its CRC is wrong."""
    with suppress(ValueError):
        return decode(frame).name
    return None


def frame_data(frame: bytes, name: str) -> bytes:
    """Data after the fields of fixed size: a scan's samples."""
    return frame[frame_type(name).itemsize : -CRC.size]


def complex_rows(frame: Frame) -> Complex[np.ndarray, "row frequency"]:
    """Sweeps of a radar_sweep or radar_lookup: all channels, then the calibration channel, in units of its scale.

    Raises:
        ValueError: the numbers have a size other than 4 or 8 bytes.
    """
    rows, steps, width = (int(frame.number(name)) for name in ("rows", "steps", "width"))
    if width not in _LAYOUTS:
        raise ValueError(f"{frame.name}: numbers of 4 or 8 bytes were expected, found {width}")
    data = frame.fields["data"]
    assert isinstance(data, bytes)
    parts = np.frombuffer(data, _LAYOUTS[width]).reshape(rows, steps, 2).astype(np.float32)
    scaled = parts * np.float32(frame.number("scale"))
    return np.asarray(scaled[..., 0] + 1j * scaled[..., 1], np.complex64)


_LAYOUTS = {4: "<i2", 8: "<f4"}
"""Parts of complex numbers by their width in bytes."""
