"""The supervisor: starts the runtime's processes, finds the dead and the hung, starts them again, ends them in order.

It decides nothing about driving. It tells the control process what became of the others, and the mode machine there
knows what that means; a control process that died comes up again with ``--after-death``, never engaged.
"""

import json
import os
import select
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import NamedTuple, TextIO

from lgprjax.errors import InputError
from lgprjax.runtime.children import Child, Limits, Told, What, child_environment, end_children
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.instance import memory_folder, only_instance
from lgprjax.runtime.main import process_command
from lgprjax.runtime.notify import Notifier, watchdog_s
from lgprjax.runtime.parent import SUPERVISOR
from lgprjax.runtime.placement import check_cores, run_in_ordinary_time, run_in_real_time
from lgprjax.runtime.process import RINGS, Heartbeats, processes_of
from lgprjax.runtime.records import Kind, Record, Source, pack
from lgprjax.runtime.ring import Ring

CommandMaker = Callable[[str, RuntimeConfig, Path, Path, bool], Sequence[str]]
"""Name, configuration, rings, run folder, after a death -> command line."""

_PERIOD_S = 0.01
_END_S = 5.0  # for each of the three steps of the end
_ENDED_BY = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


class Ready(NamedTuple):
    """The vehicle may be driven.

    Attributes:
        after_s: seconds from the start.
        missing: processes that are not there and need not be.
    """

    after_s: float
    missing: tuple[str, ...]

    @property
    def line(self) -> str:
        """For a person."""
        without = f" without {', '.join(self.missing)}" if self.missing else ""
        return f"ready after {self.after_s:.1f} s{without}"


def say_ready(ready: Ready) -> None:
    """One line on standard output."""
    _say(ready.line, sys.stdout)


def make_rings_folder() -> Path:
    """A new folder in memory for a run's rings; what runs that were killed have left there is taken away."""
    base = memory_folder()
    for old in base.glob("lgprjax-rings-*-*"):
        if not Path(f"/proc/{old.name.split('-')[2]}").exists():
            shutil.rmtree(old, ignore_errors=True)
    return Path(tempfile.mkdtemp(prefix=f"lgprjax-rings-{os.getpid()}-", dir=base))


def supervise(
    config: RuntimeConfig,
    run_folder: Path,
    rings: Path,
    *,
    ready: Callable[[Ready], None] = say_ready,
    command: CommandMaker = process_command,
) -> int:
    """Run the processes of a vehicle until SIGTERM, SIGINT or SIGHUP; from the main thread.

    Args:
        config: of the run; the processes read it anew from its file.
        run_folder: of the run.
        rings: folder of the rings, in memory, see ``make_rings_folder``; it is taken away at the end; where the run
            is refused, only if it is empty.
        ready: called once, when all that must be there is ready.
        command: how a process is started.

    Returns:
        The exit status, 0.

    Raises:
        InputError: another run holds the device or the folder, a core is not there, or memory does not hold the rings.
    """
    try:
        check_cores(config)
        with only_instance(config, run_folder), _end_signals() as asked, _priority(config):
            try:
                _make_rings(rings)
                _Supervisor(config, run_folder, rings, command).run(asked, ready)
            finally:
                shutil.rmtree(rings, ignore_errors=True)
    finally:
        # Rings of another run are not empty.
        with suppress(OSError):
            rings.rmdir()
    return 0


class _Supervisor:
    def __init__(self, config: RuntimeConfig, run_folder: Path, rings: Path, command: CommandMaker) -> None:
        self._needed = {"control", "registration"} | ({"recorder", "coverage"} if config.recording.mandatory else set())
        self._notifier = Notifier()
        self._watchdog_s = watchdog_s()
        self._start_s = config.supervision.start_s
        self._rings = [Ring.create(rings / name, RINGS[name]) for name in ("notes", "supervisor_log")]
        beats = Heartbeats(rings)
        self._children = {
            name: Child(
                name,
                partial(_command, command, name, config, rings, run_folder),
                child_environment(name, SUPERVISOR),
                beats,
                _limits(name, config),
            )
            for name in processes_of(config)
        }

    def run(self, asked: list[int], ready: Callable[[Ready], None]) -> None:
        began_s = before_s = time.monotonic()
        is_ready = False
        try:
            while not asked:
                now_s = time.monotonic()
                for child in self._children.values():
                    for told in child.look(now_s, now_s - before_s):
                        self._tell(told)
                before_s = now_s
                if not is_ready and self._all_up():
                    is_ready = True
                    now_ready = Ready(now_s - began_s, self._missing())
                    self._notifier.ready(now_ready.line)
                    ready(now_ready)
                time.sleep(max(0.0, now_s + _PERIOD_S - time.monotonic()))
        finally:
            self._end()

    def _tell(self, told: Told) -> None:
        content = {told.what.value: told.name} | ({"why": told.why} if told.why else {})
        payload = json.dumps(content).encode()
        record = pack(Record(Kind.EVENT, Source.SUPERVISOR, 0, time.monotonic_ns(), payload))
        for ring in self._rings:
            ring.put(record)
        if told.name == "control" and self._watchdog_s is not None:
            # Until a new control process feeds it, the watchdog would end the whole service.
            self._notifier.watchdog_within(self._watchdog_s if told.what is What.READY else self._start_s)
        if told.what is not What.READY:
            _say(f"{told.name} {told.what.value}: {told.why}", sys.stderr)
        missing = self._missing()
        self._notifier.status(f"without {', '.join(missing)}" if missing else "all processes ready")

    def _missing(self) -> tuple[str, ...]:
        return tuple(name for name, child in self._children.items() if not child.ready)

    def _all_up(self) -> bool:
        # What need not be there is waited for until it has failed once.
        return all(
            child.ready or (name not in self._needed and (child.died_before or child.left))
            for name, child in self._children.items()
        )

    def _end(self) -> None:
        """Control first: it lets the actuators go. The recorder last: it writes what the others still said."""
        self._notifier.stopping()
        last = self._children["recorder"]
        others = [child for name, child in self._children.items() if name not in ("control", "recorder")]
        for step in ([self._children["control"]], others, [last]):
            end_children(step, _END_S)
        self._notifier.close()


def _command(
    command: CommandMaker, name: str, config: RuntimeConfig, rings: Path, run_folder: Path, died: bool
) -> Sequence[str]:
    return command(name, config, rings, run_folder, died and name == "control")


def _limits(name: str, config: RuntimeConfig) -> Limits:
    limits = config.supervision
    is_control = name == "control"
    silent_s = limits.control_s if is_control else limits.others_s
    # Found within the limit, not at the first look after it.
    return Limits(silent_s - _PERIOD_S, limits.start_s, patient=is_control)


def _make_rings(rings: Path) -> None:
    """Make the rings and the heartbeats with their memory reserved: a page that cannot be had kills its writer."""
    rings.mkdir(parents=True, exist_ok=True)
    Heartbeats(rings)
    for name, size in RINGS.items():
        try:
            path = Ring.create(rings / name, size).path
            with path.open("r+b") as file:
                os.posix_fallocate(file.fileno(), 0, path.stat().st_size)
        except OSError as error:
            expected = f"{sum(RINGS.values()) >> 20} MiB of free memory"
            raise InputError(rings, name, expected, error.strerror or str(error)) from None


@contextmanager
def _end_signals() -> Iterator[list[int]]:
    """The signals that ask for an orderly end, as they come in."""
    asked: list[int] = []
    before = {number: signal.signal(number, lambda number, _: asked.append(number)) for number in _ENDED_BY}
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _priority(config: RuntimeConfig) -> Iterator[None]:
    """Above the control loop, if that has real-time priority: a watchman that it can starve sees nothing."""
    if config.control.realtime_priority is None:
        yield
        return
    run_in_real_time("supervisor", min(config.control.realtime_priority + 1, 99), threads_too=False)
    try:
        yield
    finally:
        run_in_ordinary_time()


def _say(line: str, stream: TextIO) -> None:
    # A reader that is gone must not end the supervision, and one that does not read must not hold it up: what is
    # writable takes a line.
    with suppress(OSError, ValueError):
        if select.select([], [stream], [], 0.0)[1]:
            print(line, file=stream, flush=True)
