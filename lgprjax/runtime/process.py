"""A process of the runtime: what it is started with, and its heartbeat."""

import mmap
import os
import struct
import time
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path

from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.ring import Ring

PROCESSES = ("control", "registration", "recorder", "display", "monitor", "coverage")
"""Names, in the order of their rows in the table of heartbeats. No run has all of them: see ``processes_of``."""

RINGS = {
    "control_log": 8 << 20,  # control to recorder
    "registration_log": 32 << 20,  # registration to recorder
    "supervisor_log": 1 << 20,  # supervisor to recorder
    "fixes": 256 << 10,  # registration to control
    "priors": 256 << 10,  # control to registration
    "state": 1 << 20,  # control to display
    "requests": 64 << 10,  # display to control
    "notes": 256 << 10,  # supervisor to control
    "monitor": 64 << 10,  # monitor to control
    "cover": 1 << 20,  # control to coverage
    "worked": 4 << 20,  # coverage to display
}
"""Rings and their sizes in bytes; each carries ``records``."""


def processes_of(config: RuntimeConfig) -> tuple[str, ...]:
    """Those of a run: a field is worked without radar, a course is driven without a map of cells."""
    without = "coverage" if config.coverage is None else "registration"
    return tuple(name for name in PROCESSES if name != without)


class Stage(IntEnum):
    """How far a process has come."""

    STARTING = 0
    WARMING = 1
    READY = 2
    ENDING = 3


_ROW = struct.Struct("<QIIII")  # time of the beat in ns, stage, pid, beats, 0


@dataclass(frozen=True)
class Beat:
    """A row of the table of heartbeats; ``mono_ns`` is 0 where there was none."""

    mono_ns: int
    stage: Stage
    pid: int
    count: int


class Heartbeats:
    """The table of heartbeats: one row a process, which only that process writes."""

    def __init__(self, folder: Path) -> None:
        path = folder / "heartbeats"
        if not path.exists():
            path.write_bytes(bytes(_ROW.size * len(PROCESSES)))
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), 0)

    def beat(self, name: str, stage: Stage, pid: int, count: int) -> None:
        """Say that a process lives."""
        at = PROCESSES.index(name) * _ROW.size
        self._map[at : at + _ROW.size] = _ROW.pack(time.monotonic_ns(), stage, pid, count & 0xFFFFFFFF, 0)

    def read(self, name: str) -> Beat:
        """The last beat of a process."""
        mono_ns, stage, pid, count, _ = _ROW.unpack_from(self._map, PROCESSES.index(name) * _ROW.size)
        return Beat(mono_ns, Stage(stage), pid, count)

    def clear(self, name: str) -> None:
        """Before a process is started anew."""
        at = PROCESSES.index(name) * _ROW.size
        self._map[at : at + _ROW.size] = bytes(_ROW.size)


@dataclass
class Started:
    """What a process's ``run`` is given.

    Attributes:
        name: of the process.
        config: of the run.
        rings: folder of the rings and of the heartbeats, in memory.
        folder: of the run, where the recording goes.
        after_death: it replaces one that died.
    """

    name: str
    config: RuntimeConfig
    rings: Path
    folder: Path
    after_death: bool

    def __post_init__(self) -> None:
        self._beats = Heartbeats(self.rings)
        self._count = 0

    def ring(self, name: str) -> Ring:
        """This process's end of a ring."""
        return Ring.create(self.rings / name, RINGS[name])

    def beat(self, stage: Stage) -> None:
        """From the process's own loop, not from a thread beside it: a loop that hangs must be seen."""
        self._count += 1
        self._beats.beat(self.name, stage, os.getpid(), self._count)
