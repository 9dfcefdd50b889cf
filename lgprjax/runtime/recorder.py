"""The recorder: everything that arrives, is decided and is sent, on the disk within half a second.

It only reads rings: whatever becomes of it or of the disk, the processes that drive go on.
"""

import os
import signal
import sys
import time
from types import FrameType
from typing import NoReturn

from lgprjax.run_segment import ORIGINS
from lgprjax.runtime.process import Stage, Started
from lgprjax.runtime.recorder_resume import resume, tell_run
from lgprjax.runtime.recorder_segments import SegmentWriter

DISK_REFUSED, DISK_FULL = 1, 3
"""Exit statuses: the disk failed; ``recording.least_free_mb`` is reached and the recording was ended in order."""

_PERIOD_S = 0.02
_SHARE = 1 << 20  # bytes of a ring in one pass: none holds up the others
_PASSES = 8
_DRAIN_S = 3.0
_LOOK_AT_DISK_S = 1.0


class Recorder:
    """The rings of a run and its segments.

    Args:
        started: of the process.

    Raises:
        OSError: the disk refuses, here and in every method.
    """

    def __init__(self, started: Started) -> None:
        self._folder = started.folder
        self._folder.mkdir(parents=True, exist_ok=True)
        self._rings = {origin: started.ring(ORIGINS[origin]) for origin in range(1, len(ORIGINS))}
        before = resume(self._folder)
        tell_run(self._folder, before.run, started.config.file)
        if started.after_death:
            # What the one before wrote, but did not come to let go of, is not recorded twice.
            for origin, position in before.positions.items():
                self._rings[origin].release(position)
        # Places found spoilt by the one before, and losses of rings that are no more.
        self._known = {ORIGINS[o]: max(0, before.dropped.get(ORIGINS[o], 0) - r.lost) for o, r in self._rings.items()}
        self._dropped = self._losses()
        segment_s = started.config.recording.segment_s
        self._writer = SegmentWriter(self._folder, before.run, before.segment, before.number, segment_s)
        self._writer.note({"dropped": self._dropped})

    def write(self) -> bool:
        """Record a share of what waits; whether more waits."""
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
    """Record until SIGTERM, then what still waits; ends in order.

    Raises:
        SystemExit: with ``DISK_REFUSED`` where the disk fails, ``DISK_FULL`` where too little of it is free. One line
            on standard error says so.
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
    started.beat(Stage.STARTING)
    recorder = Recorder(started)
    least_mb = started.config.recording.least_free_mb
    looked_s = -_LOOK_AT_DISK_S
    while not ending:
        started.beat(Stage.READY)
        begun_s = time.monotonic()
        if begun_s - looked_s >= _LOOK_AT_DISK_S:
            looked_s = begun_s
            free_mb = recorder.free_mb()
            if free_mb < least_mb:
                recorder.close(f"{free_mb} MB of the disk are free, fewer than {least_mb}")
                _refuse(DISK_FULL, f"{started.folder}: {free_mb} MB are free, fewer than recording.least_free_mb")
        for _ in range(_PASSES):
            if not recorder.write():
                break
        time.sleep(max(0.0, _PERIOD_S - (time.monotonic() - begun_s)))
    until_s = time.monotonic() + _DRAIN_S
    while True:
        started.beat(Stage.ENDING)
        recorder.write()
        if recorder.empty or time.monotonic() > until_s:
            break
    recorder.close("ended")


def _refuse(status: int, line: str) -> NoReturn:
    print(f"lgprjax recorder: {line}", file=sys.stderr, flush=True)
    raise SystemExit(status)
