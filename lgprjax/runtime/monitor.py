"""The monitor: memory, storage, load, temperatures and steps of the clock, reported to the control process."""

import json
import os
import shutil
import signal
import time
from pathlib import Path
from typing import NamedTuple

from lgprjax.run_records import Record, RecordKind, Source, pack
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.process import PROCESSES, Heartbeats, ProcessStage, Started

_PERIOD_S = 1.0
_BEAT_S = 0.1
_LEAST_MEMORY_MB = 300.0
_STEP_S = 0.05
"""The clock is slewed by less than this in a period; a larger change is a step."""
_BELIEVED_C = (-40.0, 150.0)  # missing sensors show values outside


class Condition(NamedTuple):
    """State of the computer; ``None`` where unknown. MB are 10^6 bytes.

    Attributes:
        free_mb: room for the recording.
        memory_mb: available memory.
        rss_mb: memory of each process.
        load: processes running or waiting, mean over a minute.
        hottest_c: the hottest sensor, degrees Celsius.
        clock_step_s: step of the wall clock since the last check, seconds.
    """

    free_mb: float | None
    memory_mb: float | None
    rss_mb: dict[str, float]
    load: float
    hottest_c: float | None
    clock_step_s: float


def run(started: Started) -> None:
    """The monitor process; until SIGTERM."""
    ended: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: ended.append(number))
    beats = Heartbeats(started.rings)
    ring = started.ring("monitor")
    ahead_s, due_s = _clock_ahead_s(), time.monotonic()
    while not ended:
        started.beat(ProcessStage.READY)
        if time.monotonic() >= due_s:
            due_s += _PERIOD_S
            before_s, ahead_s = ahead_s, _clock_ahead_s()
            pids = {name: beats.read(name).pid for name in PROCESSES} | {"supervisor": os.getppid()}
            condition = look_at_computer(started.folder, pids, ahead_s - before_s)
            content = condition._asdict() | {"warnings": warnings_of(condition, started.config)}
            record = Record(RecordKind.MONITOR, Source.MONITOR, 0, time.monotonic_ns(), json.dumps(content).encode())
            ring.put(pack(record))
        time.sleep(_BEAT_S)
    started.beat(ProcessStage.ENDING)


def look_at_computer(folder: Path, pids: dict[str, int], clock_step_s: float, root: Path = Path("/")) -> Condition:
    """Present state of the computer.

    Args:
        folder: folder of the recording.
        pids: process IDs by name; 0 if not running.
        clock_step_s: clock step measured by the caller.
        root: parent folder of ``proc`` and ``sys``.
    """
    rss_mb = {name: memory for name, pid in pids.items() if (memory := _rss_mb(root, pid)) is not None}
    step_s = round(clock_step_s, 3) if abs(clock_step_s) >= _STEP_S else 0.0
    load = round(os.getloadavg()[0], 2)
    return Condition(_free_mb(folder), _memory_mb(root), rss_mb, load, _hottest_c(root), step_s)


def warnings_of(condition: Condition, config: RuntimeConfig) -> list[str]:
    """Warnings in words; empty if all is well."""
    warnings: list[str] = []
    least_mb, hottest_c = config.recording.least_free_mb, config.supervision.hottest_c
    if condition.free_mb is None:
        warnings.append("the recording folder is not accessible")
    elif condition.free_mb < least_mb:
        warnings.append(f"storage: {condition.free_mb:.0f} MB free, {least_mb} required")
    if condition.memory_mb is not None and condition.memory_mb < _LEAST_MEMORY_MB:
        warnings.append(f"memory: {condition.memory_mb:.0f} MB left")
    if condition.hottest_c is not None and condition.hottest_c > hottest_c:
        warnings.append(f"too hot: {condition.hottest_c:.0f} °C, {hottest_c:.0f} allowed")
    if condition.clock_step_s:
        warnings.append(f"the clock was set by {condition.clock_step_s:+.3f} s")
    return warnings


def _clock_ahead_s() -> float:
    """Wall clock minus the monotonic one, by the quickest of three readings."""
    readings = [(time.monotonic_ns(), time.time_ns(), time.monotonic_ns()) for _ in range(3)]
    before, day, after = min(readings, key=lambda reading: reading[2] - reading[0])
    return (day - (before + after) // 2) / 1e9


def _free_mb(folder: Path) -> float | None:
    try:
        return round(shutil.disk_usage(folder).free / 1e6, 1)
    except OSError:
        return None


def _memory_mb(root: Path) -> float | None:
    for line in (_text(root / "proc/meminfo") or "").splitlines():
        if line.startswith("MemAvailable:"):
            return round(int(line.split()[1]) * 1024 / 1e6, 1)
    return None


def _rss_mb(root: Path, pid: int) -> float | None:
    found = _text(root / f"proc/{pid}/statm") if pid else None
    return round(int(found.split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6, 1) if found else None


def _hottest_c(root: Path) -> float | None:
    files = [*root.glob("sys/class/thermal/thermal_zone*/temp"), *root.glob("sys/class/hwmon/hwmon*/temp*_input")]
    found = [number for file in files if (number := _thousandths(file)) is not None]
    return max((value for value in found if _BELIEVED_C[0] < value < _BELIEVED_C[1]), default=None)


def _thousandths(file: Path) -> float | None:
    try:
        return int(_text(file) or "") / 1000.0
    except ValueError:
        return None


def _text(file: Path) -> str | None:
    # Sensors and processes may disappear at any time, and a sensor may answer with an error.
    try:
        return file.read_text(encoding="ascii", errors="replace")
    except OSError:
        return None
