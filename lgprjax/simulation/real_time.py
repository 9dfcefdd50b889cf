"""Runs in real time: a measurement of whether this machine keeps real time, and the end of a run."""

import multiprocessing
import os
import re
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lgprjax.autopilot import Mode
from lgprjax.run_segment import segments_of
from lgprjax.runtime.timeline import read_timeline

_SECONDS, _PERIOD_S = 1.0, 0.02
_SIZE = 96
_UNITS = (30, 80, 110)
"""Work per period of control loop, registration and simulated devices, each in its own process, in products of two
96 x 96 matrices: the measured load of the quick start at 126 scans per second."""
_LATE_S = 0.06
"""A later start of a period looks like a failed device (its port counts as silent after 0.1 s)."""
_BEHIND = 0.02


class RealTime(NamedTuple):
    """Result of one second of the work on board.

    Attributes:
        largest_late_s: largest delay of the start of a period.
        behind: share of the periods that started after their scheduled end.
    """

    largest_late_s: float
    behind: float

    @property
    def keeps(self) -> bool:
        """Whether simulated devices and runtime can run in real time now."""
        return self.largest_late_s < _LATE_S and self.behind < _BEHIND

    @property
    def line(self) -> str:
        """The result in words."""
        found = f"{100.0 * self.behind:.0f} % of the periods missed, delay up to {self.largest_late_s:.2f} s"
        return f"this machine {'keeps real time' if self.keeps else 'is too busy or too slow'} ({found})"


def measure_real_time(seconds: float = _SECONDS) -> RealTime:
    """Run three processes with the work of a simulated run and measure their delays."""
    context = multiprocessing.get_context("spawn")
    pipes = [context.Pipe() for _ in _UNITS]
    processes = [
        context.Process(target=_work, args=(units, seconds, far), daemon=True)
        for units, (_, far) in zip(_UNITS, pipes, strict=True)
    ]
    for process in processes:
        process.start()
    try:
        for near, _ in pipes:
            near.recv()
        begin_s = time.monotonic() + 0.05
        for near, _ in pipes:
            near.send(begin_s)
        found = [near.recv() for near, _ in pipes]
    finally:
        for process in processes:
            process.join(5.0)
            process.kill()
    late = np.concatenate(found)
    return RealTime(float(late.max()), float(np.mean(late > _PERIOD_S)))


def _work(units: int, seconds: float, pipe: Connection) -> None:
    """One of the three processes: periods of fixed work, with the delay of each."""
    left = np.random.default_rng(0).normal(size=(_SIZE, _SIZE)).astype(np.float32)
    _product(left)
    pipe.send("ready")
    due_s, late = float(pipe.recv()), []
    end_s = due_s + seconds
    while due_s < end_s:
        time.sleep(max(0.0, due_s - time.monotonic()))
        late.append(max(0.0, time.monotonic() - due_s))
        for _ in range(units):
            _product(left)
        due_s += _PERIOD_S
        if time.monotonic() > end_s + seconds:
            # Far too late: stop and record the delay.
            late.append(time.monotonic() - due_s)
            break
    pipe.send(np.array(late))


def _product(left: np.ndarray) -> None:
    # Row by row, so that no library uses several threads.
    for row in left:
        row @ left


# A simulated run in real time ends on arrival, as in lock step, or when arrival has become impossible.

_LOOK_S = 0.5
_AFTER_ARRIVAL_S = 2.0
_STUCK_S = 30.0
"""Limit without READY after all processes are ready, or in ERROR: the system checks give up after 12 s."""
_ENDS = b'"ROUTE_OFF"'  # in the record of an event by which a route or a plan ends
_MODE = re.compile(rb'"mode": "([A-Z_]+)"')
_OVERLAP = 32
"""Bytes that two looks share, so that no mark is cut between them."""


class RunWatch:
    """Monitor of a growing recording for mode and arrival. It reads only new bytes.

    Args:
        folder: folder of the run.

    Attributes:
        mode: last recorded mode; empty before the first.
    """

    def __init__(self, folder: Path) -> None:
        self.mode = ""
        self._folder = folder
        self._read: dict[int, int] = {}
        self._ended = False

    def arrived(self) -> bool:
        """Whether the vehicle has arrived, as far as recorded."""
        before, self._ended = self._ended, self._look()
        # The record with the mark may not be whole before the next look.
        return (before or self._ended) and read_timeline(self._folder).arrived

    def _look(self) -> bool:
        """Whether a route or a plan has ended since the last look."""
        found = False
        for number, path in segments_of(self._folder).items():
            begin = self._read.get(number, 0)
            with path.open("rb") as file:
                file.seek(begin)
                fresh = file.read()
            found |= _ENDS in fresh
            modes = _MODE.findall(fresh)
            self.mode = modes[-1].decode() if modes else self.mode
            self._read[number] = begin + max(len(fresh) - _OVERLAP, 0)
        return found


class StuckWatch:
    """Detection of runs that cannot arrive: not READY for a while, or in ERROR without override.

    Args:
        leaves_error: whether the script presses the override button, which leaves ERROR.
    """

    def __init__(self, *, leaves_error: bool) -> None:
        self._stuck = ("", Mode.BOOT.name, Mode.CHECKS.name, Mode.ERROR.name)
        self._leaves_error = leaves_error
        self._was_ready = False
        self._since_s: float | None = None

    def look(self, mode: str, now_s: float) -> str:
        """Reason to end the run; empty if it may continue.

        Args:
            mode: mode of the vehicle, after all processes are ready.
            now_s: present time.
        """
        self._was_ready |= mode not in self._stuck
        if self._since_s is None or mode not in self._stuck or (self._was_ready and self._leaves_error):
            self._since_s = now_s
        if now_s - self._since_s <= _STUCK_S:
            return ""
        if self._was_ready:
            return f"{mode} for {_STUCK_S:.0f} s"
        return f"not READY within {_STUCK_S:.0f} s of the start, but {mode or Mode.BOOT.name}"


@contextmanager
def ended_when_over(folder: Path, say: Callable[[str], None], *, leaves_error: bool) -> Iterator[threading.Event]:
    """End this process, as Ctrl-C does, soon after arrival, or when arrival has become impossible.

    Args:
        folder: folder of the run.
        say: takes the reason of an early end.
        leaves_error: see ``StuckWatch``.

    Yields:
        Event to set when all processes are ready.
    """
    over, ready = threading.Event(), threading.Event()

    def watch() -> None:
        found, stuck = RunWatch(folder), StuckWatch(leaves_error=leaves_error)
        while not over.wait(_LOOK_S):
            if found.arrived():
                over.wait(_AFTER_ARRIVAL_S)
            elif ready.is_set() and (why := stuck.look(found.mode, time.monotonic())):
                say(f"ended early: {why}")
            else:
                continue
            if not over.is_set():
                os.kill(os.getpid(), signal.SIGTERM)
            return

    thread = threading.Thread(target=watch, name="watch", daemon=True)
    thread.start()
    try:
        yield ready
    finally:
        over.set()
        thread.join()


# The search of registration itself.

SCANS_HZ = 126.0
"""Scans per second of an array on board."""


def measure_search(seconds: float = 3.0) -> float:
    """Scans per second of the onboard registration, on a simulated course of 60 m."""
    from lgprjax.formats import MapFile, read_vehicle
    from lgprjax.mapping import build_map
    from lgprjax.runtime.config import PortsTable, PortTable, RuntimeConfig
    from lgprjax.runtime.registration.scans import RadarDescription
    from lgprjax.runtime.registration.search import Search
    from lgprjax.simulation.devices.world import CourseWorld
    from lgprjax.simulation.loop import OffRoad, make_course

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        spec = OffRoad(2, 60.0, 1)
        build_map([make_course(spec, folder).baseline], folder / "course.map.h5")
        vehicle = folder / "v.vehicle.toml"
        vehicle.write_text(_VEHICLE, encoding="utf-8")
        port = PortTable(url="/dev/null")
        ports = PortsTable(drive_by_wire=port, controller=port, gnss=port, radar=port)
        config = RuntimeConfig(
            file=folder / "c.toml", name="doctor", vehicle=vehicle.name, map="course.map.h5", routes=["-"], ports=ports
        )
        with MapFile.open(folder / "course.map.h5") as source, MapFile.open(folder / "course.map.h5") as beside:
            radar = CourseWorld(spec, source.description.frame, weather="clear", drive_seed=1).radar
            described = RadarDescription(
                source.description.channels,
                radar.samples,
                radar.sample_step_ns,
                radar.time_zero_ns,
                128.0,
                1 / SCANS_HZ,
            )
            search = Search(config, read_vehicle(vehicle), source, beside, described)
            try:
                search.warm_up()
                return search.scans_per_second(seconds)
            finally:
                search.ahead.close()


_VEHICLE = """schema = "lgprjax.vehicle"
schema_version = "1.0"
name = "doctor"
steering_kind = "counter_steer"
[array]
x_m = 3.0
height_m = 0.3
"""
