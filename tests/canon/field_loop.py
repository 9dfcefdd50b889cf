"""The control loop against the simulated devices of a field in lock step: every byte of the lines, no real time.

Ports, supervisor and recorder are left out; parsers, receivers and the control loop are the vehicle's own.
"""

import copy
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from lgprjax.autopilot import Mode
from lgprjax.run_records import COVER, SKID_PLAN, Record, RecordKind, Source
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.core import ControlCore
from lgprjax.runtime.control.skid.setup import SkidLoaded
from lgprjax.runtime.control.skid.vehicle import SkidSteerVehicle
from lgprjax.runtime.gnss import GnssParser
from lgprjax.simulation.devices.faults import FAULT_LASTS_S, Schedule, read_items
from lgprjax.simulation.devices.field_stage import FIELD_FAULTS, FIELD_SCRIPT, FieldSpec, FieldStage
from lgprjax.wire import FrameParser, FrameVerdict, Receiver, RefusedBytes

BEGIN_NS = 7_000_000_000_000
TICK_NS = 20_000_000
_STEP_NS = 5_000_000
_LINES = {"drive_by_wire": Source.DRIVE_BY_WIRE, "controller": Source.CONTROLLER, "gnss": Source.GNSS}
_RATE_MPS2 = 0.8
"""Of the made-up flail's tracks."""


def spec_of(
    loaded: SkidLoaded,
    start: tuple[float, float, float],
    script: list[dict[str, Any]],
    faults: list[dict[str, Any]],
    seed: int = 2,
) -> FieldSpec:
    """Devices that stand at a pose of the plan's frame."""
    frame = loaded.frame
    anchor = (48.0, 11.0, 500.0) if frame is None else (frame.latitude_deg, frame.longitude_deg, frame.height_m)
    return FieldSpec(
        anchor=anchor,
        start=start,
        track_m=float(loaded.setup.vehicle.track_m),
        gnss_x_m=float(loaded.setup.model.gnss_x_m),
        gnss_y_m=float(loaded.setup.model.gnss_y_m),
        seed=seed,
        ports="",
        truth="",
        script=script,
        faults=faults,
    )


class FieldLoop:
    """A vehicle, its devices and its control loop.

    Args:
        config, loaded: of the run.
        start: pose at which it stands.
        script, faults: see ``simulation.devices``.

    Attributes:
        rows: SKID_PLAN of every tick; times_ns: of them; covers: COVER, with their times.
        events: of the control loop: time and JSON; corners: JSON.
        stage: the devices; ticks: what the control loop was given and sent, tick by tick.
    """

    def __init__(
        self,
        config: RuntimeConfig,
        loaded: SkidLoaded,
        start: tuple[float, float, float],
        script: list[dict[str, Any]],
        faults: list[dict[str, Any]],
        *,
        seed: int = 2,
    ) -> None:
        self.stage = FieldStage(spec_of(loaded, start, script, faults, seed), Path("spec.json"), BEGIN_NS)
        self.core = ControlCore(config, loaded, session=77, after_death=False)
        self._parsers = {line: FrameParser() for line in ("drive_by_wire", "controller")}
        self._receivers = {line: Receiver(line) for line in ("drive_by_wire", "controller")}
        self._gnss = GnssParser()
        self._came: list[Record] = []
        self._now_ns, self._due_ns, self.tick = BEGIN_NS, BEGIN_NS, 0
        self.rows: list[np.void] = []
        self.times_ns: list[int] = []
        self.covers: list[tuple[int, np.void]] = []
        self.events: list[tuple[float, str]] = []
        self.corners: list[dict[str, Any]] = []
        self.state: dict[str, Any] = {}
        self.ticks: list[tuple[int, list[Record], list[bytes]]] = []
        self.held_up: list[tuple[float, float]] = []
        for name in ("recorder", "coverage"):
            self.tell({"ready": name})

    def tell(self, note: dict[str, Any]) -> None:
        """What the supervisor says of a process, now."""
        self._came.append(Record(RecordKind.EVENT, Source.SUPERVISOR, 0, self._now_ns, json.dumps(note).encode()))

    @property
    def kind(self) -> SkidSteerVehicle:
        """The vehicle in the control loop."""
        kind = self.core.kind
        assert isinstance(kind, SkidSteerVehicle)
        return kind

    @property
    def time_s(self) -> float:
        """Since the beginning."""
        return (self._now_ns - BEGIN_NS) / 1e9

    @property
    def mode(self) -> Mode:
        """As driven."""
        return self.core.modes.mode

    def run(self, seconds: float, until: Callable[["FieldLoop"], bool] = lambda _: False) -> bool:
        """Let time pass; whether ``until`` came true before its end."""
        end_ns = self._now_ns + round(seconds * 1e9)
        while self._now_ns < end_ns:
            self._now_ns += _STEP_NS
            self._step()
            if until(self):
                return True
        return False

    def _step(self) -> None:
        now_ns, stage = self._now_ns, self.stage
        while stage.next_ns <= now_ns:
            stage.tick()
        for line, data in stage.emit(now_ns):
            if line == "gnss":
                found: list[Any] = [each for each in self._gnss.feed(data) if isinstance(each, bytes)]
            else:
                frames = [each for each in self._parsers[line].feed(data) if not isinstance(each, RefusedBytes)]
                receiver = self._receivers[line]
                found = [frame.raw for frame in frames if receiver.accept(frame, now_ns) is FrameVerdict.ACCEPTED]
            self._came += [Record(RecordKind.PORT_IN, _LINES[line], 0, now_ns, raw) for raw in found]
        if now_ns < self._due_ns or any(begin <= self.time_s < end for begin, end in self.held_up):
            return
        self._due_ns = max(self._due_ns + TICK_NS, now_ns + TICK_NS // 2)
        self.tick += 1
        came, self._came = self._came, []
        sent: list[bytes] = []
        for record in self.core.step(self.tick, now_ns, came):
            if record.kind is RecordKind.PORT_OUT:
                line = "drive_by_wire" if record.source is Source.DRIVE_BY_WIRE else "controller"
                stage.receive(line, record.payload, now_ns + 1_000_000)
                sent.append(record.payload)
            elif record.kind is RecordKind.SKID_PLAN:
                self.rows.append(np.frombuffer(record.payload, SKID_PLAN)[0])
                self.times_ns.append(now_ns)
            elif record.kind is RecordKind.COVER:
                self.covers.append((now_ns, np.frombuffer(record.payload, COVER)[0]))
            elif record.kind is RecordKind.CORNER:
                self.corners.append(json.loads(record.payload))
            elif record.kind is RecordKind.EVENT:
                self.events.append((self.time_s, record.payload.decode()))
            elif record.kind is RecordKind.STATE:
                self.state = json.loads(record.payload)
        self.ticks.append((now_ns, came, sent))

    def copy(self, *shared: Any) -> "FieldLoop":
        """The same drive, to go on by itself; ``shared`` is not copied with it."""
        memo: dict[int, Any] = {id(each): each for each in shared}
        # A lock is of no use to a copy in one thread, and cannot be copied.
        lock = self.stage._lock
        memo[id(lock)] = lock
        return copy.deepcopy(self, memo)

    def inject(self, *faults: dict[str, Any]) -> None:
        """Faults that begin now."""
        items = [fault if "at_s" in fault else {"at_way_m": 0.0, **fault} for fault in faults]
        self.stage._wrong = Schedule(
            read_items(Path("faults"), "", items, key="kind", known=FIELD_FAULTS, lasts_s=FAULT_LASTS_S)
        )

    def act(self, *script: dict[str, Any]) -> None:
        """What the operator does from now on."""
        items = [{"at_way_m": 0.0, **line} for line in script]
        self.stage._script = Schedule(
            read_items(
                Path("script"), "", items, key="do", known=FIELD_SCRIPT, lasts_s={"press": 0.3, "brake_tap": 0.3}
            )
        )

    def when(self, first: int, holds: Callable[[np.void], bool]) -> float:
        """Seconds from tick ``first`` to the first one with something; infinite where there is none."""
        for number, row in enumerate(self.rows[first:]):
            if holds(row):
                return (self.times_ns[first + number] - self.times_ns[first - 1]) / 1e9
        return math.inf

    def within_limits(self, first: int) -> None:
        """No command beyond the limiter while something is engaged; the tool never without its engagement."""
        rows, times = self.rows[first - 1 :], self.times_ns[first - 1 :]
        for before, row, began, now in zip(rows, rows[1:], times, times[1:], strict=False):
            assert np.isfinite(row["command"]).all()
            assert not (int(row["tool"]) and not int(row["engage"]) & 1)
            if int(before["engage"]) & 1 and int(row["engage"]) & 1:
                change = np.abs(np.asarray(row["command"], float) - np.asarray(before["command"], float)).max()
                assert change <= _RATE_MPS2 * (now - began) / 1e9 + 1e-5
