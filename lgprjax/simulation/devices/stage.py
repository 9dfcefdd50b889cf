"""Common part of stages: devices in their world, with script, faults and lines; bytes and time in, frames out."""

import json
import os
import threading
from abc import ABC, abstractmethod
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from lgprjax.errors import InputError
from lgprjax.simulation.devices.boxes import (
    OVERRIDE_FIRST,
    OVERRIDE_SECOND,
    ControllerBox,
    DeviceSender,
    HostedBox,
    buttons_of,
)
from lgprjax.simulation.devices.faults import (
    FAULT_LASTS_S,
    READY_MODE,
    Moment,
    RunningFaults,
    Schedule,
    ScriptItem,
    check_choice,
    read_items,
)
from lgprjax.simulation.devices.sensors import WEEK_S, GnssClock, Lines
from lgprjax.simulation.devices.vehicle import TruthRows

# Specification of a run of the devices: SPEC.json.


class StageSpec(BaseModel):
    """Specification common to all runs of the devices. Paths are relative to the program's working folder.

    Attributes:
        ports: path of the file of the devices' addresses.
        truth: path of the file of the truth, written at the end.
        script: actions of the driver.
        faults: faults of the devices.
        rate: seconds of the world per second of the computer.
        parent: ID of the process with which the devices end. The starting process writes its own, because loading takes
            seconds, and a parent that ends meanwhile can no longer be found when the file is read.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    ports: str
    truth: str
    script: list[dict[str, Any]] = []
    faults: list[dict[str, Any]] = []
    rate: float = Field(default=1.0, gt=0.0, le=10.0)
    parent: int = Field(default_factory=os.getppid, gt=0)


_Spec = TypeVar("_Spec", bound=StageSpec)


def read_spec(path: Path, kind: type[_Spec]) -> _Spec:
    """Read a specification.

    Raises:
        InputError: the file is missing or not JSON, or a key is unknown, missing or has a wrong value.
    """
    try:
        return kind.model_validate(json.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise InputError(path, "file", "a readable file", error.strerror or str(error)) from None
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise InputError(path, place, first["msg"], repr(first["input"])[:60]) from None
    except ValueError as error:
        raise InputError(path, "file", "JSON", str(error)) from None


# Periodic events.

_LATEST_NS = 100_000_000
"""Older pending messages are dropped, as a device has no queue."""


class Ticker:
    """Periodic moments.

    Args:
        first_ns, period_ns: first moment, and period.
    """

    def __init__(self, first_ns: int, period_ns: int) -> None:
        self._next_ns, self._period_ns = first_ns, period_ns

    def due(self, now_ns: int) -> list[int]:
        """Moments passed since the last call."""
        times = []
        while self._next_ns <= now_ns:
            if now_ns - self._next_ns <= _LATEST_NS:
                times.append(self._next_ns)
            self._next_ns += self._period_ns
        return times


_BUTTONS_NS = 20_000_000


class StageKind(NamedTuple):
    """Lines of a kind of vehicle, and its script actions and faults with their required keys.

    Attributes:
        lines: lines to the host.
        script: required keys of each script action.
        script_lasts_s: default duration of each action.
        buttons: buttons of the controller that a script may press.
        faults: required keys of each fault.
    """

    lines: tuple[str, ...]
    script: dict[str, tuple[str, ...]]
    script_lasts_s: dict[str, float]
    buttons: tuple[str, ...]
    faults: dict[str, tuple[str, ...]]


_Box = TypeVar("_Box", bound=HostedBox)
_Tick = TypeVar("_Tick")


class Stage(ABC, Generic[_Box, _Tick]):
    """The devices and their world. Times are arguments in nanoseconds of the world's clock.

    ``tick`` and ``render`` belong to one thread, ``receive`` and ``emit`` may belong to another.

    Args:
        kind: lines, script actions and faults of the kind of vehicle.
        spec: specification of the run.
        file: file of the specification, for messages.
        begin_ns: start time of the world.
        tick_ns: tick of the world.
        box: class of the drive-by-wire box, constructed with its sender.
        seed: seed of sessions, clocks and damage.

        Attributes:
        truth: true motion.
        faults: running faults.
        drive_box, controller: devices that every vehicle has.
        latest_s: largest lateness of each kind of message.

    Raises:
        InputError: the spec's script or faults cannot be used.
    """

    truth: TruthRows

    def __init__(
        self, kind: StageKind, spec: StageSpec, file: Path, begin_ns: int, *, tick_ns: float, box: type[_Box], seed: int
    ) -> None:
        script = read_items(file, "script", spec.script, key="do", known=kind.script, lasts_s=kind.script_lasts_s)
        wrong = read_items(file, "faults", spec.faults, key="kind", known=kind.faults, lasts_s=FAULT_LASTS_S)
        check_choice(file, "script", script, "button", kind.buttons)
        check_choice(file, "faults", wrong, "line", kind.lines)
        self.begin_ns, self.faults, self.latest_s = begin_ns, RunningFaults(), {"status": 0.0}
        self._script, self._wrong = Schedule(script), Schedule(wrong)
        self._rng = np.random.default_rng([seed, 53])
        self._senders = {line: self._sender() for line in kind.lines}
        self.drive_box = box(self._senders["drive_by_wire"])
        self.controller = ControllerBox(self._senders["controller"])
        self._lines = Lines(self.faults, seed)
        self._clock_s = (2400.0 + float(self._rng.uniform(0.1, 0.8))) * WEEK_S - 1e-9 * begin_ns
        if (rolls_over_s := _week_rollover_s(wrong, file)) is not None:
            self._clock_s = 2401.0 * WEEK_S - rolls_over_s - 1e-9 * begin_ns
        self._clock = GnssClock(self._clock_s)
        self._tick_ns, self._ticks = tick_ns, 0
        self._ready_ns: int | None = None
        self._buttons = Ticker(begin_ns, _BUTTONS_NS)
        self._lock = threading.Lock()

    @property
    def next_ns(self) -> int:
        """Start time of the next tick."""
        return self.begin_ns + round(self._ticks * self._tick_ns)

    @abstractmethod
    def tick(self) -> _Tick:
        """Move the vehicle by a tick, with the host's messages up to its start."""

    def render(self, tick: _Tick) -> None:
        """Record the scans of a tick, where a radar scans."""

    def skip(self, tick: _Tick) -> int:
        """Leave out a tick's scans, and return their number."""
        del tick
        return 0

    def renew(self) -> None:
        """Another host has connected to the radar."""

    def warm(self) -> None:
        """Compile everything that a run needs by first ticks."""

    def receive(self, line: str, data: bytes, now_ns: int) -> None:
        """The host's bytes on a line."""
        with self._lock:
            self._deliver(line, self._lines.into(line, data), now_ns)

    def emit(self, now_ns: int) -> list[tuple[str, bytes]]:
        """Messages of the devices up to now: (line, complete messages)."""
        with self._lock:
            for line, sender in self._senders.items():
                sender.stuck = self._lines.repeats(line)
            told = self._due(now_ns)
            told += [
                ("controller", self.controller.status(due_ns, self._pressed())) for due_ns in self._buttons.due(now_ns)
            ]
            sent = ((line, self._lines.out(line, data)) for line, data in told)
            return [(line, data) for line, data in sent if data]

    @abstractmethod
    def _due(self, now_ns: int) -> list[tuple[str, bytes]]:
        """Messages due from the devices other than the controller."""

    @property
    def _host_ready(self) -> bool:
        """Whether the host is ready, so that times of the script begin to count."""
        return bool(self.drive_box.mode == READY_MODE)

    @property
    @abstractmethod
    def _buttons_held(self) -> Iterable[str]:
        """Buttons that the operator presses."""

    def _deliver(self, line: str, data: bytes, now_ns: int) -> None:
        """Bytes of a line to their device."""
        if line == "drive_by_wire":
            self.drive_box.receive(data, now_ns)
        elif line == "controller":
            self.controller.receive(data, now_ns)

    def _begin_tick(self, way_m: float, arrivals: int = 0) -> list[ScriptItem]:
        """The next tick begins: its faults run, and items of the script that do are returned."""
        begin_ns, box = self.next_ns, self.drive_box
        if self._ready_ns is None and self._host_ready:
            self._ready_ns = begin_ns
        since = None if self._ready_ns is None else 1e-9 * (begin_ns - self._ready_ns)
        moment = Moment(1e-9 * begin_ns, since, way_m, box.mode, 1e-9 * (begin_ns - box.mode_since_ns), arrivals)
        self.faults.run(self._wrong.step(moment))
        box.bus_off = self.faults.has("bus_off")
        self._clock.offset_s = self._clock_s + self.faults.number("time_step", "s", 0.0)
        self._ticks += 1
        return self._script.step(moment)

    def _sender(self) -> DeviceSender:
        return DeviceSender(int(self._rng.integers(1, 1 << 32)), int(self._rng.integers(1, 1 << 40)))

    def _note(self, what: str, late_ns: int) -> None:
        self.latest_s[what] = max(self.latest_s[what], 1e-9 * late_ns)

    def _pressed(self) -> int:
        pressed = set(self._buttons_held)
        pressed |= {"override"} if self.faults.has("override_stuck") else set()
        pressed |= {"estop"} if self.faults.has("estop_held") else set()
        bits = buttons_of(pressed)
        return bits & ~(OVERRIDE_FIRST | OVERRIDE_SECOND) if self.faults.has("override_wire_cut") else bits


def _week_rollover_s(wrong: list[ScriptItem], file: Path) -> float | None:
    """Time of the GNSS week rollover, s after the start of the world; ``None`` without one."""
    rolls = [item for item in wrong if item.name == "week_rollover"]
    if rolls and rolls[0].at_s is None:
        raise InputError(file, "faults", "week_rollover with at_s", "week_rollover without at_s")
    return rolls[0].at_s if rolls else None
