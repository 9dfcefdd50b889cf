"""The segments of a run as they are written: appended to only, in whole chunks."""

import json
import os
import time
from pathlib import Path

from lgprjax.run_segment import OWN, SegmentHead, pack_head, pack_record, segment_path
from lgprjax.runtime.recorder_sync import DiskSync

_SYNC_EVERY_S = 0.2


class SegmentWriter:
    """Writes a run from a segment and a number on.

    Args:
        folder: of the run.
        run: its UUID.
        segment: the first to write; its file must not exist.
        number: of the next record.
        segment_s: how long a segment is written to.

    Raises:
        OSError: the disk refuses, here and in every method.
    """

    def __init__(self, folder: Path, run: bytes, segment: int, number: int, segment_s: float) -> None:
        self.number = number
        self._folder, self._run, self._segment, self._segment_s = folder, run, segment, segment_s
        self._chunk: list[bytes] = []
        self._sync = DiskSync()
        self._synced_s = self._begun_s = time.monotonic()
        self._file = self._open()

    def append(self, origin: int, position: int, data: bytes) -> None:
        """Number a record and put it to the next chunk."""
        self._chunk.append(pack_record(self._run, self.number, origin, position, data))
        self.number += 1

    def note(self, what: dict[str, object]) -> None:
        """A record of the recorder's own."""
        self.append(OWN, 0, json.dumps(what).encode())

    def write(self) -> None:
        """Write the chunk, and ask for it on the disk when it is time to."""
        self._sync.check()
        if self._chunk:
            _write_whole(self._file, b"".join(self._chunk))
            self._chunk.clear()
        now_s = time.monotonic()
        if now_s - self._synced_s >= _SYNC_EVERY_S and not self._sync.busy:
            self._sync.data(self._file)
            self._synced_s = now_s

    @property
    def due(self) -> bool:
        """Whether the next segment should be begun."""
        return time.monotonic() - self._begun_s >= self._segment_s

    def rotate(self) -> None:
        """Begin the next segment."""
        self.write()
        self._sync.finish(self._file)
        self._segment += 1
        self._file = self._open()
        self._begun_s = time.monotonic()

    def close(self, reason: str) -> None:
        """End the run in order; everything is on the disk after it."""
        self.note({"end": reason})
        self.write()
        self._sync.finish(self._file)
        self._sync.drain()

    def _open(self) -> int:
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC
        file = os.open(segment_path(self._folder, self._segment), flags, 0o644)
        head = SegmentHead(self._run, self._segment, time.time_ns(), time.monotonic_ns(), self.number)
        _write_whole(file, pack_head(head))
        self._sync.folder(self._folder)
        return file


def _write_whole(file: int, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[os.write(file, view) :]
