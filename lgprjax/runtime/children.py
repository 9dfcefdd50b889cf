"""One process under supervision: started, listened to, found dead or hung, started again."""

import os
import signal
import subprocess
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from enum import Enum
from typing import NamedTuple

from lgprjax.runtime.process import Beat, Heartbeats, Stage

STORAGE_FULL = 3
"""Exit status of a recorder that stopped in good order for want of space: starting it again would change nothing."""

_QUICK_S = 2.0  # a process that dies sooner after its start is kept waiting
_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.1, 2.0
_DEATHS, _DEATHS_WITHIN_S = 10, 300.0
_ENDING_S = 5.0  # a last write to a slow card
_LOOK_S = 0.05  # time between two looks that counts at most: a machine that stood still hung nobody


class What(Enum):
    """What became of a process."""

    READY = "ready"
    DIED = "died"
    LEFT = "left"


class Told(NamedTuple):
    """What became of a process, told once.

    Attributes:
        what: ready after a start or a relaunch, died, or left dead.
        name: of the process.
        why: how it died or why it is left, for a person; empty for ready.
    """

    what: What
    name: str
    why: str = ""


class Limits(NamedTuple):
    """How long a process may be silent, and come up, seconds; ``patient``: it is never left dead."""

    silent_s: float
    start_s: float
    patient: bool


class Child:
    """A process and the supervisor's knowledge of it. Times are of the monotonic clock, in seconds.

    Args:
        name: of the process.
        command: its command line; the argument tells whether it replaces one that died.
        environment: it is started with.
        beats: where it says that it lives.
        limits: it is held to.
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
        self._command = command
        self._environment = environment
        self._beats = beats
        self._limits = limits
        self._process: subprocess.Popen[bytes] | None = None
        self._told_dead = False
        self._deaths: deque[float] = deque(maxlen=_DEATHS)
        self._due_s = 0.0
        self._wait_s = 0.0
        self._started_s = 0.0
        self._silent_s = 0.0
        self._count = 0

    @property
    def running(self) -> bool:
        """Whether there is a process, alive or not yet gone."""
        return self._process is not None and self._process.poll() is None

    def look(self, now_s: float, passed_s: float) -> list[Told]:
        """What is new; starts it where that is due, kills it where it hangs.

        Args:
            now_s: time of this look.
            passed_s: since the look before.
        """
        if self._process is None:
            return self._launch(now_s) if not self.left and now_s >= self._due_s else []
        status = self._process.poll()
        if status is None:
            return [] if self._told_dead else self._listen(self._process, now_s, min(passed_s, _LOOK_S))
        self._process = None
        if self._told_dead:
            return []
        if status == STORAGE_FULL and not self._limits.patient:
            self.left, self.ready = True, False
            return [Told(What.LEFT, self.name, f"exit {status}")]
        return self._died(now_s, f"signal {-status}" if status < 0 else f"exit {status}")

    def end(self) -> None:
        """Ask it to end; one that is stopped is let go on to hear it."""
        if self._process is not None and self._process.poll() is None:
            self._process.terminate()
            self._process.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        """End it now."""
        if self._process is not None:
            self._process.kill()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(timeout=1.0)

    def _launch(self, now_s: float) -> list[Told]:
        self._beats.clear(self.name)
        self._told_dead = self.ready = False
        self._silent_s, self._count, self._started_s = 0.0, 0, now_s
        try:
            # A group of its own: what a terminal sends reaches the supervisor alone, which ends them in order.
            self._process = subprocess.Popen(
                self._command(self.died_before), env=self._environment, stdin=subprocess.DEVNULL, process_group=0
            )
        except OSError as error:
            return self._died(now_s, f"not started: {error.strerror}")
        return []

    def _listen(self, process: "subprocess.Popen[bytes]", now_s: float, passed_s: float) -> list[Told]:
        told: list[Told] = []
        beat = self._read()
        if beat is None or beat.pid != process.pid or beat.count == self._count:
            self._silent_s += passed_s
        else:
            self._count = beat.count
            self._silent_s = min(max(now_s - beat.mono_ns / 1e9, 0.0), passed_s)
            if beat.stage == Stage.READY and not self.ready:
                self.ready = True
                told.append(Told(What.READY, self.name))
        if not self.ready:
            if now_s - self._started_s > self._limits.start_s:
                told += self._hung(process, now_s, f"not ready after {now_s - self._started_s:.1f} s")
        elif self._silent_s > (_ENDING_S if beat is not None and beat.stage == Stage.ENDING else self._limits.silent_s):
            told += self._hung(process, now_s, f"hung {self._silent_s:.2f} s")
        return told

    def _hung(self, process: "subprocess.Popen[bytes]", now_s: float, why: str) -> list[Told]:
        process.kill()
        return self._died(now_s, why)

    def _died(self, now_s: float, why: str) -> list[Told]:
        self.ready, self._told_dead, self.died_before = False, True, True
        quick = now_s - self._started_s < _QUICK_S
        self._wait_s = min(max(2.0 * self._wait_s, _FIRST_WAIT_S), _LONGEST_WAIT_S) if quick else 0.0
        self._due_s = now_s + self._wait_s
        self._deaths.append(now_s)
        told = [Told(What.DIED, self.name, why)]
        if not self._limits.patient and len(self._deaths) == _DEATHS and now_s - self._deaths[0] < _DEATHS_WITHIN_S:
            self.left = True
            told.append(Told(What.LEFT, self.name, f"{_DEATHS} deaths in {_DEATHS_WITHIN_S:.0f} s"))
        return told

    def _read(self) -> Beat | None:
        # A process gone wild may have written anything.
        with suppress(ValueError):
            return self._beats.read(self.name)
        return None


def end_children(children: Sequence[Child], limit_s: float) -> None:
    """Ask processes to end and wait for it; what has not ended within ``limit_s`` seconds is killed."""
    for child in children:
        child.end()
    until_s = time.monotonic() + limit_s
    while any(child.running for child in children) and time.monotonic() < until_s:
        time.sleep(0.01)
    for child in children:
        if child.running:
            child.kill()


def child_environment(name: str, supervisor_variable: str) -> dict[str, str]:
    """The environment of a process: only the control loop may speak to the service manager's watchdog."""
    environment = {**os.environ, supervisor_variable: str(os.getpid())}
    if name != "control":
        environment.pop("NOTIFY_SOCKET", None)
    return environment
