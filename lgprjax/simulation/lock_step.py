"""One lock step: the runtime and its simulated devices in simulated seconds.

Control loop, registration, port parsers and recording are those of the vehicle, and so are the processes of the
display page and of the coverage map. The other processes, their ring buffers and threads, and the clock of the computer
are left out. The simulated devices advance by 2 ms, the control loop runs every 20 ms, and a fix is ready in the tick
after its scan. The result does not depend on the speed of the machine.
"""

import json
import math
import shutil
import subprocess
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple, cast

from lgprjax.errors import InputError
from lgprjax.formats import MapFile, read_vehicle
from lgprjax.run_records import Record, RecordKind, Source, pack, unpack
from lgprjax.run_segment import ORIGINS
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.core import ControlCore, load_vehicle
from lgprjax.runtime.control.program import header_record
from lgprjax.runtime.control.record import RecordCore
from lgprjax.runtime.control.setup import TICK_S
from lgprjax.runtime.gnss import GnssParser
from lgprjax.runtime.main import process_command
from lgprjax.runtime.port import Arrival, Port
from lgprjax.runtime.process import RINGS, Heartbeats, processes_of
from lgprjax.runtime.recorder import SegmentWriter, tell_run
from lgprjax.runtime.registration.program import ScanQueue, array_place
from lgprjax.runtime.registration.scans import SCAN_MESSAGES, RadarSelf
from lgprjax.runtime.registration.search import RadarLine, Search
from lgprjax.runtime.ring import Ring
from lgprjax.runtime.service import SUPERVISOR
from lgprjax.runtime.stamps import StampClock
from lgprjax.runtime.supervisor import child_environment, make_rings_folder
from lgprjax.runtime.timeline import Timeline, timeline_of
from lgprjax.simulation.devices.program import open_spec
from lgprjax.wire import Frame, FrameParser, FrameVerdict, Receiver, RefusedBytes, draw_session

_TICK_NS, _STEP_NS, _LATENCY_NS = int(TICK_S * 1e9), 2_000_000, 1_000_000
_FRAMES = {"drive_by_wire": Source.DRIVE_BY_WIRE, "controller": Source.CONTROLLER, "radar": Source.RADAR}
_AFTER_ARRIVAL_S = 2.0
_SECOND_TICKS = 50
_STANDS_MPS = 0.1
_LATEST_DESCRIPTION_S = 30.0
"""Limit in simulated seconds for the radar to describe its scans, calibration and look-up included."""


class Progress(NamedTuple):
    """Progress of a run: simulated seconds, mode, speed, distance to go. NaN without pose or route."""

    time_s: float
    mode: str
    speed_mps: float
    to_go_m: float

    @property
    def line(self) -> str:
        """Progress in words; unknown values are omitted."""
        known = ((self.speed_mps, f"{self.speed_mps:.1f} m/s"), (self.to_go_m, f"{self.to_go_m:.0f} m to go"))
        told = [text for number, text in known if math.isfinite(number)]
        return ", ".join((f"{self.time_s:.0f} s simulated", self.mode, *told))


class _Line:
    """A port in lock step, in place of ``Port``."""

    def __init__(self, name: str, send: Callable[[bytes], None]) -> None:
        self._parser, self._receiver, self._send = FrameParser(), Receiver(name), send
        self._came: list[Arrival[Frame]] = []
        self._refused: list[Arrival[RefusedBytes]] = []

    def feed(self, data: bytes, now_ns: int) -> None:
        """Bytes of the device."""
        for item in self._parser.feed(data):
            if isinstance(item, RefusedBytes):
                self._refused.append(Arrival(now_ns, item))
                continue
            verdict = self._receiver.accept(item, now_ns)
            if verdict is FrameVerdict.ACCEPTED:
                self._came.append(Arrival(now_ns, item))
            else:
                self._refused.append(Arrival(now_ns, RefusedBytes(int(verdict), item.raw[:64])))

    def take(self) -> list[Arrival[Frame]]:
        """Accepted frames since the last call."""
        came, self._came = self._came, []
        return came

    def take_refused(self) -> list[Arrival[RefusedBytes]]:
        """Frames refused since the last call."""
        refused, self._refused = self._refused, []
        return refused

    def write(self, frame: bytes) -> None:
        """Send a frame to the device."""
        self._send(frame)

    def close(self) -> None:
        """Nothing to close."""


_WORKED = (RecordKind.COVER, RecordKind.CORNER, RecordKind.EVENT)


class _Log:
    """The writing end of a ring buffer, directly to the recording."""

    def __init__(self, writer: SegmentWriter, name: str, also: Callable[[Record], None] = lambda _: None) -> None:
        self._writer, self._origin, self._also = writer, ORIGINS.index(name), also
        self._position = 0

    def put(self, data: bytes) -> None:
        """Record a message."""
        self._position += len(data)
        self._writer.append(self._origin, self._position, data)
        self._also(unpack(data))


class LockStep:
    """A vehicle, its devices and its runtime.

    Args:
        config: configuration of the run, as written to its folder.
        spec: specification of the simulated devices.
        folder: folder of the run.
        shown: ring buffers of a display process.

    Raises:
        InputError: a file of the configuration, or the spec, cannot be used.
    """

    def __init__(self, config: RuntimeConfig, spec: Path, folder: Path, shown: "Page | None") -> None:
        self._config, self._shown = config, shown
        _, make = open_spec(spec)
        # The computer's clock at the beginning, so that dates of the recording are right.
        self._begin_ns = self._now_ns = self._due_ns = time.monotonic_ns()
        self.stage = make(self._begin_ns)
        # Without a map scans are recorded, not searched.
        self._records = not config.map
        self._loaded = load_vehicle(config) if config.commands else None
        session = draw_session()
        self.core: ControlCore | RecordCore = (
            RecordCore(config)
            if self._loaded is None
            else ControlCore(config, self._loaded, session=session, after_death=False)
        )
        run = uuid.uuid4().bytes
        tell_run(folder, run, config.file)
        self._writer = SegmentWriter(folder, run, 0, 0, config.recording.segment_s)
        self._control = _Log(self._writer, "control_log", self._note)
        self._registration = _Log(self._writer, "registration_log", self._note)
        self._supervisor = _Log(self._writer, "supervisor_log", self._note)
        self._told: list[Record] = []
        self._arrived_ns: int | None = None
        self._control.put(pack(header_record(config, self._loaded, session, self._now_ns, after_death=False)))
        self._lines = {
            name: _Line(name, self._sender(name)) for name in _FRAMES if getattr(config.ports, name) is not None
        }
        self._gnss = GnssParser()
        self._came: list[Record] = []
        self._pending: list[tuple[int, Record]] = []
        self._tick = 0
        self._radar: RadarLine | None = None
        self._said = RadarSelf(calibrated=config.radar.calibration is not None)
        self._stamps, self._queue = StampClock(), cast("ScanQueue | None", None)

    def run(
        self,
        for_s: float | None,
        report: Callable[[Progress], None],
        over: "Callable[[LockStep], bool] | None" = None,
    ) -> Timeline:
        """Run until the route or plan is done, or for so many simulated seconds after everything is ready.

        Args:
            for_s: simulated seconds.
            report: function called with the progress.
            over: function that decides every simulated second whether to end.
        """
        with ExitStack() as held:
            try:
                self._start(held)
                end_ns = None if for_s is None else self._now_ns + round(1e9 * for_s)
                reported_s = 0.0
                asked = self._tick
                while (end_ns is None or self._now_ns < end_ns) and not self._finished:
                    self._advance()
                    if over is not None and self._tick >= asked + _SECOND_TICKS:
                        asked = self._tick
                        self._writer.write()
                        if over(self):
                            break
                    if time.monotonic() - reported_s > 0.5:
                        reported_s = time.monotonic()
                        report(self._progress)
                last = self.core.release(self._now_ns)
                if last is not None:
                    self._log(last)
            finally:
                self._writer.close("ended")
        return timeline_of(self._told)

    @property
    def driven(self) -> bool:
        """Whether the simulated driver has ended the manoeuvre, and the vehicle is at standstill."""
        return bool(getattr(self.stage, "finished", False)) and not abs(self._progress.speed_mps) > _STANDS_MPS

    @property
    def engaged(self) -> bool:
        """Whether the computer commands the vehicle."""
        return isinstance(self.core, ControlCore) and bool(self.core.modes.engage)

    def write_truth(self, path: Path) -> None:
        """Write the true poses to a file in the folder of the run."""
        self.stage.truth.write(path, {"simulated_s": (self._now_ns - self._begin_ns) / 1e9})

    @property
    def _progress(self) -> Progress:
        core, passed_s = self.core, (self._now_ns - self._begin_ns) / 1e9
        if isinstance(core, RecordCore):
            state = core.state(1, self._now_ns)
            return Progress(passed_s, str(state["mode"]), float(state["speed_mps"]), math.nan)
        state = core.kind.state(1)
        numbers = [float(state.get(name) or 0.0) for name in ("speed_mps", "to_go_m")]
        return Progress(passed_s, core.modes.mode.name, *numbers)

    @property
    def _finished(self) -> bool:
        return self._arrived_ns is not None and self._now_ns - self._arrived_ns > 1e9 * _AFTER_ARRIVAL_S

    def _start(self, held: ExitStack) -> None:
        """All processes are ready; the registration once the radar has described its scans."""
        for name in processes_of(self._config):
            if name not in ("registration", "output"):
                self._ready(name)
        if "registration" not in processes_of(self._config):
            return
        config = self._config
        port, log, notes = (
            cast("Port[Frame]", self._lines["radar"]),
            cast("Ring", self._registration),
            _Into(self._came),
        )
        self._radar = RadarLine(port, config.radar, log, cast("Ring", notes), self._clock_ns)
        while not self._said.complete or self._radar.preparing:
            if self._now_ns - self._begin_ns > 1e9 * _LATEST_DESCRIPTION_S:
                raise InputError(config.file, "simulation", "a radar that describes its scans", "none")
            self._advance()
        if self._records:
            self._ready("registration")
            return
        source = held.enter_context(MapFile.open(config.path(config.map)))
        vehicle = read_vehicle(config.path(config.vehicle))
        description = self._said.description
        assert description is not None
        search = Search(config, vehicle, source, source, description, self._said.lookup)
        search.ahead.close()
        self._queue = ScanQueue(search, self._stamps, *array_place(vehicle))
        self._ready("registration")

    def _clock_ns(self) -> int:
        return self._now_ns

    def _ready(self, name: str) -> None:
        record = Record(RecordKind.EVENT, Source.SUPERVISOR, 0, self._now_ns, json.dumps({"ready": name}).encode())
        self._supervisor.put(pack(record))
        self._came.append(record)

    def _advance(self) -> None:
        """Two milliseconds of the world; the control loop where it is due."""
        self._now_ns += _STEP_NS
        now_ns, stage = self._now_ns, self.stage
        while stage.next_ns <= now_ns:
            stage.render(stage.tick())
        for line, data in stage.emit(now_ns):
            if line in self._lines:
                self._lines[line].feed(data, now_ns)
            elif line == "gnss" and self._config.ports.gnss is not None:
                found = [each for each in self._gnss.feed(data) if isinstance(each, bytes)]
                self._came += [Record(RecordKind.PORT_IN, Source.GNSS, 0, now_ns, raw) for raw in found]
        if self._radar is not None:
            self._listen(self._radar)
        if now_ns >= self._due_ns:
            self._due_ns += _TICK_NS
            self._control_tick()
            self._search()

    def _listen(self, radar: RadarLine) -> None:
        """The radar's frames and orders, as in the registration process."""
        for arrival in radar.arrivals():
            frame = arrival.item
            record = Record(RecordKind.PORT_IN, Source.RADAR, 0, arrival.mono_ns, frame.raw)
            self._registration.put(pack(record))
            radar.take(frame)
            if frame.name not in SCAN_MESSAGES:
                if not (self._records and self._said.complete):
                    self._said.take(frame)
            elif self._records:
                head = json.dumps({"scans": 1}).encode()
                self._came.append(Record(RecordKind.EVENT, Source.REGISTRATION, 0, arrival.mono_ns, head))
                if self._shown is not None and self._loaded is None:
                    self._shown.scan(record)
            elif self._queue is not None:
                self._queue.take(frame, arrival.mono_ns)
            else:
                self._stamps.feed(frame.stamp_us, arrival.mono_ns)
        radar.order()

    def _control_tick(self) -> None:
        now_ns = self._now_ns
        self._tick += 1
        serial = [name for name in ("drive_by_wire", "controller") if name in self._lines]
        for name in serial:
            frames = self._lines[name].take()
            self._came += [Record(RecordKind.PORT_IN, _FRAMES[name], 0, each.mono_ns, each.item.raw) for each in frames]
        due = [record for time_ns, record in self._pending if time_ns <= now_ns]
        self._pending = [each for each in self._pending if each[0] > now_ns]
        requests = [] if self._shown is None else self._shown.requests()
        came = [record._replace(tick=self._tick) for record in (*self._came, *due, *requests)]
        self._came.clear()
        out = self.core.step(self._tick, now_ns, came)
        self._control.put(pack(Record(RecordKind.TICK, Source.CONTROL, self._tick, now_ns, b"")))
        for record in came:
            self._control.put(pack(record))
        for record in out:
            if record.kind is RecordKind.POSE:
                continue
            if record.kind is RecordKind.STATE:
                if self._shown is not None:
                    self._shown.show(record)
                continue
            self._log(record)
            if record.kind in _WORKED and self._shown is not None:
                self._shown.worked(record)
            if record.kind is RecordKind.PRIOR and self._queue is not None:
                self._queue.priors.take(record.payload)
        for name in serial:
            for refused in self._lines[name].take_refused():
                payload = bytes([int(refused.item.reason)]) + refused.item.data
                self._control.put(pack(Record(RecordKind.REFUSED, _FRAMES[name], self._tick, refused.mono_ns, payload)))
        if self._tick % 50 == 0:
            self._writer.write()
            if self._writer.due:
                self._writer.rotate()

    def _search(self) -> None:
        """Every waiting scan is searched; its fix is there in the next tick."""
        while self._queue is not None and (searched := self._queue.step()) is not None:
            for kind, payload in searched.records:
                record = Record(kind, Source.REGISTRATION, 0, self._due_ns, payload)
                self._registration.put(pack(record))
                if kind is RecordKind.FIX:
                    self._pending.append((self._due_ns, record))

    def _log(self, record: Record) -> None:
        self._control.put(pack(record))
        if record.kind is RecordKind.PORT_OUT:
            line = "drive_by_wire" if record.source is Source.DRIVE_BY_WIRE else "controller"
            self.stage.receive(line, record.payload, self._now_ns + _LATENCY_NS)

    def _sender(self, name: str) -> Callable[[bytes], None]:
        return lambda frame: self.stage.receive(name, frame, self._now_ns + _LATENCY_NS)

    def _note(self, record: Record) -> None:
        """Keep the records of the event list."""
        if record.kind in (RecordKind.EVENT, RecordKind.PLAN, RecordKind.SKID_PLAN, RecordKind.HEADER):
            self._told.append(record)
        ends = record.kind is RecordKind.EVENT and b'"ROUTE_OFF"' in record.payload
        if self._arrived_ns is None and ends and timeline_of(self._told).arrived:
            self._arrived_ns = self._now_ns


class _Into:
    """A ring buffer that the next tick of the control loop reads."""

    def __init__(self, came: list[Record]) -> None:
        self._came = came

    def put(self, data: bytes) -> None:
        """Hand a message over."""
        self._came.append(unpack(data))


class Page:
    """Ring buffers of the display process and of the coverage process of a run in lock step."""

    def __init__(self, rings: Path) -> None:
        self._state, self._requests, self._cover, self._scans = (
            Ring.create(rings / name, RINGS[name]) for name in ("state", "requests", "cover", "page_scans")
        )

    def show(self, state: Record) -> None:
        """Send a state to the page, which computes ages by the computer's clock."""
        self._state.put(pack(state._replace(mono_ns=time.monotonic_ns())))

    def scan(self, record: Record) -> None:
        """A scan, to the page's radargram."""
        self._scans.put(pack(record))

    def worked(self, record: Record) -> None:
        """A moment of work, a corner or an event, to the coverage process."""
        self._cover.put(pack(record))

    def requests(self) -> list[Record]:
        """Requests of the page."""
        found = []
        for message in self._requests.take():
            with suppress(ValueError):
                found.append(unpack(message))
        return found


@contextmanager
def page_beside(config: RuntimeConfig, rings: Path, folder: Path) -> Iterator[Page]:
    """Run display and coverage processes during the block; a process that ends is not restarted."""
    Heartbeats(rings)
    for name, size in RINGS.items():
        Ring.create(rings / name, size)
    shown = Page(rings)
    processes = [
        subprocess.Popen(
            process_command(name, config, rings, folder, False),
            env=child_environment(name, SUPERVISOR),
            stdin=subprocess.DEVNULL,
        )
        for name in ("display", "coverage")
        if name in processes_of(config)
    ]
    try:
        yield shown
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            with suppress(subprocess.TimeoutExpired):
                process.wait(5.0)
            process.kill()
            process.wait()


def drive_in_lock_step(
    config: RuntimeConfig,
    spec: dict[str, Any],
    folder: Path,
    for_s: float | None,
    report: Callable[[Progress], None],
    over: Callable[[LockStep], bool] | None = None,
) -> None:
    """Run in simulated time, with the processes of the display page and of the coverage map.

    Recording and true poses are in the folder also after an interruption.

    Args:
        config: of the run, as written to its folder.
        spec: of the simulated devices.
        folder: of the run.
        for_s: simulated seconds after everything is ready.
        report: function called with the progress.
        over: function that decides every second of simulated time whether to end the run.

    Raises:
        InputError: a file of the configuration, or the spec, cannot be used.
    """
    written = folder / "devices.json"
    written.write_text(json.dumps(spec | {"ports": "", "truth": ""}, indent=1), encoding="utf-8")
    rings = make_rings_folder()
    with ExitStack() as held:
        held.callback(shutil.rmtree, rings, ignore_errors=True)
        run = LockStep(config, written, folder, held.enter_context(page_beside(config, rings, folder)))
        try:
            run.run(for_s, report, over)
        finally:
            run.write_truth(folder / "truth.npz")
