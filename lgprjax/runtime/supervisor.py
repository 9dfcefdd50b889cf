"""The supervisor: starts the processes of the runtime, replaces dead and hung ones, ends them in order.

It makes no driving decisions. It reports the state of the others to the control process, whose mode machine reacts.
Control and recorder, if they died, are restarted with ``--after-death``: control is never engaged then, and the
recorder writes nothing twice.
"""

import json
import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from enum import Enum
from functools import partial
from pathlib import Path
from typing import NamedTuple, TextIO

from lgprjax.errors import InputError
from lgprjax.run_records import Record, RecordKind, Source, pack
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.main import process_command
from lgprjax.runtime.process import (
    RINGS,
    UNUSABLE_INPUT,
    HeartbeatRow,
    Heartbeats,
    ProcessStage,
    check_cores,
    memory_folder,
    only_instance,
    processes_of,
    run_in_ordinary_time,
    run_in_real_time,
)
from lgprjax.runtime.ring import Ring
from lgprjax.runtime.service import SUPERVISOR, Notifier, watchdog_s

# One supervised process: started, monitored, found dead or hung, restarted.

STORAGE_FULL = 3
"""Exit status of a recorder that stopped for lack of space: a restart would change nothing."""

_QUICK_S = 2.0  # a process that dies sooner after its start is restarted later
_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.1, 2.0
_DEATHS, _DEATHS_WITHIN_S = 10, 300.0
_ENDING_S = 5.0  # a last write to a slow card
_LOOK_S = 0.05  # largest counted time between two checks: a suspended machine is no hang


class What(Enum):
    """State change of a process."""

    READY = "ready"
    DIED = "died"
    LEFT = "left"


class ProcessReports(NamedTuple):
    """State change of a process, reported once.

    Attributes:
        what: ready after a start or a relaunch, died, or left dead.
        name: name of the process.
        why: description of its death, or why it is not restarted; empty for ready.
    """

    what: What
    name: str
    why: str = ""


class Limits(NamedTuple):
    """Time limits of a process for silence and for starting, seconds; ``patient``: it is always restarted."""

    silent_s: float
    start_s: float
    patient: bool


class Child:
    """A supervised process. Times are of the monotonic clock, in seconds.

    Args:
        name: name of the process.
        command: function that returns its command line; the argument says whether it replaces a dead process.
        environment: environment of the process.
        beats: heartbeats of the process.
        limits: time limits.

    Attributes:
        ready, left, died_before: whether it is ready, is left dead, and died at least once.
        input_refused: whether its last end was a refusal of its input.
    """

    def __init__(
        self,
        name: str,
        command: Callable[[bool], Sequence[str]],
        environment: Mapping[str, str],
        beats: Heartbeats,
        limits: Limits,
    ) -> None:
        self.name = name
        self.ready = False
        self.left = False
        self.died_before = False
        self.input_refused = False
        self._command = command
        self._environment = environment
        self._beats = beats
        self._limits = limits
        self._process: subprocess.Popen[bytes] | None = None
        self._reported_dead = False
        self._deaths: deque[float] = deque(maxlen=_DEATHS)
        self._due_s = 0.0
        self._wait_s = 0.0
        self._started_s = 0.0
        self._silent_s = 0.0
        self._count = 0

    @property
    def running(self) -> bool:
        """Whether there is a process, alive or still ending."""
        return self._process is not None and self._process.poll() is None

    @property
    def state(self) -> What | None:
        """Last state change; ``None`` before the first."""
        if self.ready:
            return What.READY
        return What.LEFT if self.left else What.DIED if self.died_before else None

    def look(self, now_s: float, passed_s: float) -> list[ProcessReports]:
        """New state changes; starts the process when due, kills it if it hangs.

        Args:
            now_s: present time.
            passed_s: time since the previous call.
        """
        if self._process is None:
            return self._launch(now_s) if not self.left and now_s >= self._due_s else []
        status = self._process.poll()
        if status is None:
            return [] if self._reported_dead else self._listen(self._process, now_s, min(passed_s, _LOOK_S))
        self._process = None
        self.input_refused = status == UNUSABLE_INPUT
        if self._reported_dead:
            return []
        if status == STORAGE_FULL and not self._limits.patient:
            self.left, self.ready = True, False
            return [ProcessReports(What.LEFT, self.name, f"exit {status}")]
        return self._died(now_s, f"signal {-status}" if status < 0 else f"exit {status}")

    def end(self) -> None:
        """Signal the process to end; a stopped one is continued to receive the signal."""
        if self._process is not None and self._process.poll() is None:
            self._process.terminate()
            self._process.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        """End it now."""
        if self._process is not None:
            self._process.kill()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(timeout=1.0)

    def _launch(self, now_s: float) -> list[ProcessReports]:
        self._beats.clear(self.name)
        self._reported_dead = self.ready = False
        self._silent_s, self._count, self._started_s = 0.0, 0, now_s
        try:
            # A separate group: signals of a terminal reach the supervisor alone, which ends the processes in order.
            self._process = subprocess.Popen(
                self._command(self.died_before), env=self._environment, stdin=subprocess.DEVNULL, process_group=0
            )
        except OSError as error:
            return self._died(now_s, f"not started: {error.strerror}")
        return []

    def _listen(self, process: "subprocess.Popen[bytes]", now_s: float, passed_s: float) -> list[ProcessReports]:
        reports: list[ProcessReports] = []
        beat = self._read()
        if beat is None or beat.pid != process.pid or beat.count == self._count:
            self._silent_s += passed_s
        else:
            self._count = beat.count
            self._silent_s = min(max(now_s - beat.mono_ns / 1e9, 0.0), passed_s)
            if beat.stage == ProcessStage.READY and not self.ready:
                self.ready = True
                reports.append(ProcessReports(What.READY, self.name))
        if not self.ready:
            if now_s - self._started_s > self._limits.start_s:
                reports += self._hung(process, now_s, f"not ready after {now_s - self._started_s:.1f} s")
        elif self._silent_s > (
            _ENDING_S if beat is not None and beat.stage == ProcessStage.ENDING else self._limits.silent_s
        ):
            reports += self._hung(process, now_s, f"hung {self._silent_s:.2f} s")
        return reports

    def _hung(self, process: "subprocess.Popen[bytes]", now_s: float, why: str) -> list[ProcessReports]:
        process.kill()
        return self._died(now_s, why)

    def _died(self, now_s: float, why: str) -> list[ProcessReports]:
        self.ready, self._reported_dead, self.died_before = False, True, True
        quick = now_s - self._started_s < _QUICK_S
        self._wait_s = min(max(2.0 * self._wait_s, _FIRST_WAIT_S), _LONGEST_WAIT_S) if quick else 0.0
        self._due_s = now_s + self._wait_s
        self._deaths.append(now_s)
        reports = [ProcessReports(What.DIED, self.name, why)]
        if not self._limits.patient and len(self._deaths) == _DEATHS and now_s - self._deaths[0] < _DEATHS_WITHIN_S:
            self.left = True
            reports.append(ProcessReports(What.LEFT, self.name, f"{_DEATHS} deaths in {_DEATHS_WITHIN_S:.0f} s"))
        return reports

    def _read(self) -> HeartbeatRow | None:
        # A faulty process may have written anything.
        with suppress(ValueError):
            return self._beats.read(self.name)
        return None


def end_children(children: Sequence[Child], limit_s: float) -> None:
    """Signal processes to end and wait; those still running after ``limit_s`` seconds are killed."""
    for child in children:
        child.end()
    until_s = time.monotonic() + limit_s
    while any(child.running for child in children) and time.monotonic() < until_s:
        time.sleep(0.01)
    for child in children:
        if child.running:
            child.kill()


def child_environment(name: str, supervisor_variable: str) -> dict[str, str]:
    """The environment of a process: only the control loop may feed the service manager's watchdog."""
    environment = {**os.environ, supervisor_variable: str(os.getpid())}
    if name != "control":
        environment.pop("NOTIFY_SOCKET", None)
    return environment


CommandMaker = Callable[[str, RuntimeConfig, Path, Path, bool], Sequence[str]]
"""Name, configuration, rings, run folder, after a death -> command line."""

_PERIOD_S = 0.01
_END_S = 5.0  # for each of the three steps of the end
_TOLD_OF_DEATH = ("control", "recorder")
"""Processes that start differently after a death."""
_ENDED_BY = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


class Ready(NamedTuple):
    """The vehicle may be driven.

    Attributes:
        after_s: seconds from the start.
        missing: optional processes that are not running.
    """

    after_s: float
    missing: tuple[str, ...]

    @property
    def line(self) -> str:
        """Text for the operator."""
        without = f" without {', '.join(self.missing)}" if self.missing else ""
        return f"ready after {self.after_s:.1f} s{without}"


def say_ready(ready: Ready) -> None:
    """One line on standard output."""
    _say(ready.line, sys.stdout)


def make_rings_folder() -> Path:
    """A new folder in memory for a run's rings; remains of killed runs are removed."""
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
        config: configuration of the run; the processes read it again from its file.
        run_folder: folder of the run.
        rings: folder of the rings, in memory, see ``make_rings_folder``; removed at the end; if the run is refused,
            only if it is empty.
        ready: function called once, when all required processes are ready.
        command: function that returns a process's command line.

    Returns:
        The exit status: 0; 1 if the control process cannot use its input and never was ready.

    Raises:
        InputError: another run holds the device or the folder, a core is missing, or there is not enough memory for the
            rings.
    """
    try:
        check_cores(config)
        with only_instance(config, run_folder), _end_signals() as end_requested, _priority(config):
            try:
                _make_rings(rings)
                return _Supervisor(config, run_folder, rings, command).run(end_requested, ready)
            finally:
                shutil.rmtree(rings, ignore_errors=True)
    finally:
        # Rings of another run are not empty.
        with suppress(OSError):
            rings.rmdir()


class _Supervisor:
    def __init__(self, config: RuntimeConfig, run_folder: Path, rings: Path, command: CommandMaker) -> None:
        self._needed = {"control", "registration"}
        if config.recording.mandatory or config.mode != "drive":
            self._needed |= {"recorder", "coverage"}
        self._notifier = Notifier()
        self._watchdog_s = watchdog_s()
        self._start_s = config.supervision.start_s
        self._notes, self._log = (Ring.create(rings / name, RINGS[name]) for name in ("notes", "supervisor_log"))
        self._untold: set[str] = set()
        """Processes whose last change was reported only to a dead control process."""
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

    def run(self, end_requested: list[int], ready: Callable[[Ready], None]) -> int:
        began_s = before_s = time.monotonic()
        is_ready = control_was_up = False
        control = self._children["control"]
        try:
            while not end_requested:
                now_s = time.monotonic()
                for child in self._children.values():
                    for reports in child.look(now_s, now_s - before_s):
                        self._tell(reports)
                before_s = now_s
                control_was_up |= control.ready
                if control.input_refused and not control_was_up:
                    # Nothing has been driven yet: its own line is worth more than starting it again for ever.
                    return 1
                if not is_ready and self._all_up():
                    is_ready = True
                    now_ready = Ready(now_s - began_s, self._missing())
                    self._notifier.ready(now_ready.line)
                    ready(now_ready)
                time.sleep(max(0.0, now_s + _PERIOD_S - time.monotonic()))
        finally:
            self._end()
        return 0

    def _tell(self, reports: ProcessReports) -> None:
        record = _note(reports)
        self._notes.put(record)
        self._log.put(record)
        if reports.name == "control":
            self._tell_anew(reports.what)
        else:
            self._untold.discard(reports.name)
        if reports.name == "control" and self._watchdog_s is not None:
            # Until a new control process feeds the watchdog, it would end the whole service.
            self._notifier.watchdog_within(self._watchdog_s if reports.what is What.READY else self._start_s)
        if reports.what is not What.READY:
            _say(f"{reports.name} {reports.what.value}: {reports.why}", sys.stderr)
        missing = self._missing()
        self._notifier.status(f"without {', '.join(missing)}" if missing else "all processes ready")

    def _tell_anew(self, control: What) -> None:
        """Resend the processes' states to a new control process, because the old one lost them."""
        if control is not What.READY:
            self._untold = {name for name in self._children if name != "control"}
            return
        for name in sorted(self._untold):
            what = self._children[name].state
            if what is not None:
                self._notes.put(_note(ProcessReports(what, name)))
        self._untold.clear()

    def _missing(self) -> tuple[str, ...]:
        return tuple(name for name, child in self._children.items() if not child.ready)

    def _all_up(self) -> bool:
        # Optional processes are waited for until they have failed once.
        return all(
            child.ready or (name not in self._needed and (child.died_before or child.left))
            for name, child in self._children.items()
        )

    def _end(self) -> None:
        """Control first: it releases the actuators. The recorder last: it writes the last messages of the others."""
        self._notifier.stopping()
        last = self._children["recorder"]
        others = [child for name, child in self._children.items() if name not in ("control", "recorder")]
        for step in ([self._children["control"]], others, [last]):
            end_children(step, _END_S)
        self._notifier.close()


def _note(reports: ProcessReports) -> bytes:
    content = {reports.what.value: reports.name} | ({"why": reports.why} if reports.why else {})
    payload = json.dumps(content).encode()
    return pack(Record(RecordKind.EVENT, Source.SUPERVISOR, 0, time.monotonic_ns(), payload))


def _command(
    command: CommandMaker, name: str, config: RuntimeConfig, rings: Path, run_folder: Path, died: bool
) -> Sequence[str]:
    return command(name, config, rings, run_folder, died and name in _TOLD_OF_DEATH)


def _limits(name: str, config: RuntimeConfig) -> Limits:
    limits = config.supervision
    is_control = name == "control"
    silent_s = limits.control_s if is_control else limits.others_s
    # Found within the limit, not at the first check after it.
    return Limits(silent_s - _PERIOD_S, limits.start_s, patient=is_control)


def _make_rings(rings: Path) -> None:
    """Create the rings and the heartbeats with their memory reserved: a page that cannot be had kills its writer."""
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
    """The signals that request an orderly end, as they arrive."""
    end_requested: list[int] = []
    before = {number: signal.signal(number, lambda number, _: end_requested.append(number)) for number in _ENDED_BY}
    try:
        yield end_requested
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
    # A closed reader must not end the supervision, and a stalled one must not block it: lines are written only to
    # writable streams.
    with suppress(OSError, ValueError):
        if select.select([], [stream], [], 0.0)[1]:
            print(line, file=stream, flush=True)
