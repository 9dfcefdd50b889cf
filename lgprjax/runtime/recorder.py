"""The recorder: everything received, decided and sent is on disk within half a second.

It only reads rings: failures of the recorder or the disk do not affect the processes that drive.
"""

import json
import os
import platform
import queue
import shutil
import signal
import sys
import threading
import time
import uuid
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple, NoReturn

from lgprjax import __version__
from lgprjax.run_segment import (
    ORIGINS,
    OWN,
    SegmentHead,
    pack_head,
    pack_record,
    read_head,
    scan_records,
    segment_path,
    segments_of,
)
from lgprjax.runtime.process import ProcessStage, Started

# Data are synced to disk outside the recorder's loop, which a slow disk must not block.


class DiskSync:
    """A thread that syncs files to disk, in the order of the requests.

    Args:
        longest_s: time limit of one call.
    """

    def __init__(self, longest_s: float = 10.0) -> None:
        self._longest_s = longest_s
        self._jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._error: OSError | None = None
        self._since_s: float | None = None
        # Each is incremented by one thread only.
        self._requested = self._done = 0
        self._thread = threading.Thread(target=self._run, name="disk-sync", daemon=True)
        self._thread.start()

    @property
    def busy(self) -> bool:
        """Whether requested data are not on disk yet."""
        return self._requested > self._done

    def data(self, file: int) -> None:
        """Request syncing of a file's data."""
        self._ask(lambda: os.fdatasync(file))

    def finish(self, file: int) -> None:
        """Request syncing and closing of a file."""
        self._ask(lambda: _finish(file))

    def folder(self, path: Path) -> None:
        """Request syncing of a folder's entries."""
        self._ask(lambda: sync_folder(path))

    def check(self) -> None:
        """Raise failures.

        Raises:
            OSError: a call failed, or takes longer than ``longest_s``.
        """
        since_s = self._since_s
        if self._error is not None:
            raise self._error
        if since_s is not None and time.monotonic() - since_s > self._longest_s:
            raise TimeoutError(f"the disk accepted nothing for {self._longest_s:g} s")

    def drain(self) -> None:
        """Wait until all requests are on disk, at most ``longest_s``.

        Raises:
            OSError: as ``check``.
        """
        self._jobs.put(None)
        self._thread.join(self._longest_s)
        if self._error is None and self._thread.is_alive():
            raise TimeoutError(f"the disk accepted nothing for {self._longest_s:g} s")
        self.check()

    def _ask(self, job: Callable[[], None]) -> None:
        self._requested += 1
        self._jobs.put(job)

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None:
            self._since_s = time.monotonic()
            try:
                job()
            except OSError as error:
                self._error = error
                return
            self._since_s = None
            self._done += 1


def sync_folder(path: Path) -> None:
    """Sync a folder's entries to disk."""
    _finish(os.open(path, os.O_RDONLY | os.O_DIRECTORY))


def _finish(file: int) -> None:
    try:
        os.fsync(file)
    finally:
        os.close(file)


# Resuming a recording: contents of the run's folder when the recorder starts.


class Resume(NamedTuple):
    """Point at which to resume.

    Attributes:
        run: UUID of the run, 16 bytes.
        segment, number: number of the next segment and of the next record.
        last: end and data of each ring's last record on disk, by origin.
        dropped: number of lost messages by ring, as recorded.
    """

    run: bytes
    segment: int
    number: int
    last: dict[int, tuple[int, bytes]]
    dropped: dict[str, int]


def resume(folder: Path) -> Resume:
    """State of the run in a folder; a new run without one.

    Only the last segment with records is read: records of an earlier one were released by their rings long ago.

    Raises:
        OSError: the folder cannot be read.
    """
    files = segments_of(folder)
    heads = {segment: read_head(path)[0] for segment, path in files.items()}
    known = [head.run for head in heads.values() if head is not None]
    run = known[-1] if known else _run_facts(folder) or uuid.uuid4().bytes
    found = Resume(run, max(files, default=-1) + 1, 0, {}, {})
    for segment in reversed(files):
        head = heads[segment]
        last: dict[int, tuple[int, bytes]] = {}
        dropped: dict[str, int] = {}
        number = -1 if head is None or head.run != run else head.number - 1
        seen = False
        for record in scan_records(files[segment], run):
            seen, number = True, max(number, record.number)
            if record.origin == OWN:
                dropped |= json.loads(record.data).get("dropped", {})
            else:
                last[record.origin] = record.position, record.data
        found = found._replace(number=max(found.number, number + 1))
        if seen:
            return found._replace(last=last, dropped=dropped)
    return found


def tell_run(folder: Path, run: bytes, config: Path) -> None:
    """Write the files that readers need next to the segments: the configuration as read, and ``run.json``.

    ``run.json`` gets the two clocks of the computer at each start of the recorder.

    Raises:
        OSError: the disk refuses.
    """
    copy, run_json = folder / "config.toml", folder / "run.json"
    if not copy.exists():
        fresh = copy.with_suffix(".new")
        shutil.copyfile(config, fresh)
        _settle(fresh, copy)
    table: dict[str, Any] = {"uuid": str(uuid.UUID(bytes=run)), "lgprjax": __version__, "clocks": []}
    table |= {"python": platform.python_version(), "machine": platform.platform(), "config": str(config)}
    with suppress(OSError, ValueError, KeyError, TypeError):
        table["clocks"] = list(json.loads(run_json.read_text(encoding="utf-8"))["clocks"])
    table["clocks"].append({"utc_ns": time.time_ns(), "mono_ns": time.monotonic_ns()})
    fresh = run_json.with_suffix(".new")
    fresh.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    _settle(fresh, run_json)


def _run_facts(folder: Path) -> bytes | None:
    with suppress(OSError, ValueError, KeyError, TypeError):
        return uuid.UUID(json.loads((folder / "run.json").read_text(encoding="utf-8"))["uuid"]).bytes
    return None


def _settle(fresh: Path, target: Path) -> None:
    with fresh.open("rb") as file:
        os.fsync(file.fileno())
    fresh.rename(target)
    sync_folder(target.parent)


# Writing the segments of a run: append only, in complete chunks.

_SYNC_EVERY_S = 0.2


class SegmentWriter:
    """Writes a run, starting at a segment and a record number.

    Args:
        folder: folder of the run.
        run: UUID of the run.
        segment: number of the first segment to write; its file must not exist.
        number: number of the next record.
        segment_s: duration of a segment.

    Raises:
        OSError: a disk error, here and in every method.
    """

    def __init__(self, folder: Path, run: bytes, segment: int, number: int, segment_s: float) -> None:
        self.number = number
        self._folder, self._run, self._segment, self._segment_s = folder, run, segment, segment_s
        self._chunk: list[bytes] = []
        self._sync = DiskSync()
        self._synced_s = self._begun_s = time.monotonic()
        self._file = self._open()

    def append(self, origin: int, position: int, data: bytes) -> None:
        """Number a record and add it to the next chunk."""
        self._chunk.append(pack_record(self._run, self.number, origin, position, data))
        self.number += 1

    def note(self, what: dict[str, object]) -> None:
        """Add the recorder's own record."""
        self.append(OWN, 0, json.dumps(what).encode())

    def write(self) -> None:
        """Write the chunk, and request a sync when due."""
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
        """End the run properly; everything is on disk afterwards."""
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


DISK_REFUSED, DISK_FULL = 1, 3
"""Exit statuses: the disk failed; ``recording.least_free_mb`` is reached and the recording was ended in order."""

_PERIOD_S = 0.02
_SHARE = 1 << 20  # bytes of a ring in one pass, so that none delays the others
_PASSES = 8
_DRAIN_S = 3.0
_LOOK_AT_DISK_S = 1.0


class Recorder:
    """The rings of a run and its segments.

    Args:
        started: arguments of the process.

    Raises:
        OSError: a disk error, here and in every method.
    """

    def __init__(self, started: Started) -> None:
        self._folder = started.folder
        self._folder.mkdir(parents=True, exist_ok=True)
        self._rings = {origin: started.ring(ORIGINS[origin]) for origin in range(1, len(ORIGINS))}
        before = resume(self._folder)
        tell_run(self._folder, before.run, started.config.file)
        if started.after_death:
            # Records written but not released by the previous recorder are not recorded twice.
            for origin, last in before.last.items():
                # If that recorder died before its first write, the last records on disk are of earlier rings, where the
                # same byte count means another record: only the record's data identifies it as this ring's.
                if last in self._rings[origin].peek().messages:
                    self._rings[origin].release(last[0])
        # Damage found by the previous recorder, and losses of rings that no longer exist.
        self._known = {ORIGINS[o]: max(0, before.dropped.get(ORIGINS[o], 0) - r.lost) for o, r in self._rings.items()}
        self._dropped = self._losses()
        segment_s = started.config.recording.segment_s
        self._writer = SegmentWriter(self._folder, before.run, before.segment, before.number, segment_s)
        self._writer.note({"dropped": self._dropped})

    def write(self) -> bool:
        """Record a part of the waiting messages; returns whether more wait."""
        released, more = [], False
        for origin, ring in self._rings.items():
            waiting = ring.peek(_SHARE)
            for position, message in waiting.messages:
                self._writer.append(origin, position, message)
            released.append((ring, waiting.end))
            more |= sum(len(message) for _, message in waiting.messages) >= _SHARE
        dropped = self._losses()
        if dropped != self._dropped:
            self._writer.note({"dropped": dropped})
            self._dropped = dropped
        self._writer.write()
        for ring, end in released:
            ring.release(end)
        if self._writer.due:
            self._writer.rotate()
            self._writer.note({"dropped": self._dropped})
        return more

    def free_mb(self) -> int:
        """Free space on the recording's disk, megabytes."""
        disk = os.statvfs(self._folder)
        return disk.f_bavail * disk.f_frsize // 1_000_000

    def close(self, reason: str) -> None:
        """End the recording in order."""
        self._writer.close(reason)

    @property
    def empty(self) -> bool:
        """Whether nothing waits in any ring."""
        return not any(ring.waiting for ring in self._rings.values())

    def _losses(self) -> dict[str, int]:
        counts = {ORIGINS[origin]: ring.lost + ring.damaged for origin, ring in self._rings.items()}
        return {name: count + self._known[name] for name, count in counts.items()}


def run(started: Started) -> None:
    """Record until SIGTERM, then the waiting messages; ends properly.

    Raises:
        SystemExit: with ``DISK_REFUSED`` if the disk fails, ``DISK_FULL`` if too little is free. One line on standard
            error says so.
    """
    ending: list[int] = []

    def end(signum: int, _frame: FrameType | None) -> None:
        ending.append(signum)

    signal.signal(signal.SIGTERM, end)
    # Ctrl-C at a terminal reaches every process: the supervisor's SIGTERM comes after the others have ended.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        _record(started, ending)
    except OSError as error:
        _refuse(DISK_REFUSED, f"{started.folder}: {error.strerror or error}")


def _record(started: Started, ending: list[int]) -> None:
    started.beat(ProcessStage.STARTING)
    recorder = Recorder(started)
    least_mb = started.config.recording.least_free_mb
    looked_s = -_LOOK_AT_DISK_S
    while not ending:
        started.beat(ProcessStage.READY)
        begun_s = time.monotonic()
        if begun_s - looked_s >= _LOOK_AT_DISK_S:
            looked_s = begun_s
            free_mb = recorder.free_mb()
            if free_mb < least_mb:
                recorder.close(f"{free_mb} MB of disk are free, fewer than {least_mb}")
                _refuse(DISK_FULL, f"{started.folder}: {free_mb} MB are free, fewer than recording.least_free_mb")
        for _ in range(_PASSES):
            if not recorder.write():
                break
        time.sleep(max(0.0, _PERIOD_S - (time.monotonic() - begun_s)))
    until_s = time.monotonic() + _DRAIN_S
    while True:
        started.beat(ProcessStage.ENDING)
        recorder.write()
        if recorder.empty or time.monotonic() > until_s:
            break
    recorder.close("ended")


def _refuse(status: int, line: str) -> NoReturn:
    print(f"lgprjax recorder: {line}", file=sys.stderr, flush=True)
    raise SystemExit(status)
