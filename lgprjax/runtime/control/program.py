"""The control process: the loop at 50 Hz between ports and rings, on the computer's monotonic clock."""

import contextlib
import gc
import json
import os
import signal
import time
from collections.abc import Iterator
from typing import Any

from lgprjax import __version__
from lgprjax.coverage.resume import RoutePlace
from lgprjax.files import file_hash
from lgprjax.formats import read_vehicle
from lgprjax.machine import count_compiles
from lgprjax.recordings.vehicles import tool_of
from lgprjax.run_records import Record, RecordKind, Source, pack, unpack
from lgprjax.runtime.choices import Choices
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.core import AnyLoaded, ControlCore, load_vehicle
from lgprjax.runtime.control.record import RecordCore
from lgprjax.runtime.control.setup import TICK_S, Loaded
from lgprjax.runtime.control.skid.setup import SkidLoaded, place_after_death
from lgprjax.runtime.gnss import GnssParser
from lgprjax.runtime.port import Arrival, Port
from lgprjax.runtime.process import ProcessStage, Started
from lgprjax.runtime.ring import Ring
from lgprjax.runtime.service import Notifier
from lgprjax.wire import Frame, draw_session

_TICK_NS = int(TICK_S * 1e9)


class Control:
    """The process's ports, rings and loop."""

    def __init__(self, started: Started) -> None:
        self._started, config = started, started.config
        self._log = started.ring("control_log")
        self._incoming = [started.ring(name) for name in ("fixes", "notes", "monitor", "requests", "progress")]
        self._choices = Choices(started.rings)
        self._state = started.ring("state")
        priors, cover = started.ring("priors"), started.ring("cover")
        self._onward = {RecordKind.PRIOR: priors}
        if config.coverage is not None:
            self._onward |= dict.fromkeys((RecordKind.COVER, RecordKind.CORNER, RecordKind.EVENT), cover)
        self._view: Ring | None = None
        if config.output is not None:
            self._onward[RecordKind.POSE] = started.ring("poses")
            self._view = started.ring("view_state") if config.output.live_port is not None else None
        self._ports = list(_lines(config))
        self._port_of = {port.source: port for port in self._ports}
        self._notifier = Notifier()
        self._ended = False
        signal.signal(signal.SIGTERM, self._end)

    def run(self) -> None:
        """Until SIGTERM."""
        started, config = self._started, self._started.config
        if not config.commands:
            self._record_only()
            return
        anchor = self._choices.anchor if started.after_death else None
        loaded = load_vehicle(config, anchor=anchor)
        place = None
        if started.after_death and isinstance(loaded, SkidLoaded) and loaded.pattern is not None:
            place = place_after_death(started.folder, loaded.pattern)
            loaded = load_vehicle(config, place)
        session = draw_session()
        core = ControlCore(config, loaded, session=session, after_death=started.after_death)
        started.beat(ProcessStage.WARMING)
        core.kind.warm_up()
        self._header(loaded, session, place, anchor)
        # Old fixes are invalid. Reports of the supervisor still hold.
        self._incoming[0].take()
        for port in self._ports:
            port.take()
        gc.collect()
        gc.freeze()
        gc.disable()
        try:
            self._loop(core, collects=config.control.collect_garbage == "between")
        finally:
            last = core.release(time.monotonic_ns())
            self._port_of[last.source].write(last.payload)
            self._log.put(pack(last))
            for port in self._ports:
                port.close()

    def _record_only(self) -> None:
        """Until SIGTERM; nothing is written to any line."""
        anchor = self._choices.anchor if self._started.after_death else None
        core = RecordCore(self._started.config, anchor)
        core.warm_up()
        self._header(None, 0, None, anchor)
        try:
            self._loop(core, collects=False)
        finally:
            for port in self._ports:
                port.close()

    def _loop(self, core: ControlCore | RecordCore, *, collects: bool) -> None:
        due_ns = time.monotonic_ns()
        tick, known, compiles = 0, 0, count_compiles()
        while not self._ended:
            wait_ns = due_ns - time.monotonic_ns()
            if wait_ns > 0:
                time.sleep(wait_ns / 1e9)
            tick += 1
            came = self._came(tick)
            # After its messages: to a loop preempted between the two they would come from the future.
            now_ns = time.monotonic_ns()
            core.unrecorded = self._log.lost
            out = core.step(tick, now_ns, came)
            self._choices.keep(out)
            for record in out:
                if record.kind is RecordKind.PORT_OUT:
                    self._port_of[record.source].write(record.payload)
                elif record.kind in self._onward:
                    self._onward[record.kind].put(pack(record))
            self._started.beat(ProcessStage.READY)
            self._notifier.watchdog()
            self._record(Record(RecordKind.TICK, Source.CONTROL, tick, now_ns, b""), came, out)
            if compiles() != known:
                known = compiles()
                head = json.dumps({"compiled": known}).encode()
                self._log.put(pack(Record(RecordKind.EVENT, Source.CONTROL, tick, time.monotonic_ns(), head)))
            # A missed tick is not repeated.
            due_ns = max(due_ns + _TICK_NS, now_ns + _TICK_NS // 2)
            if collects and due_ns - time.monotonic_ns() > _TICK_NS // 2:
                gc.collect(0)

    def _came(self, tick: int) -> list[Record]:
        """Messages since the last tick, as recorded: line by line, then the rings.

        In the first tick of a relaunched process the operator's choices come before them.
        """
        again = self._choices.again() if tick == 1 and self._started.after_death else []
        came: list[Record] = [record._replace(tick=tick) for record in again]
        for port in self._ports:
            for arrival in port.take():
                came.append(Record(RecordKind.PORT_IN, Source(port.source), tick, arrival.mono_ns, _raw(arrival)))
        for ring in self._incoming:
            for message in ring.take():
                with contextlib.suppress(ValueError):
                    came.append(unpack(message)._replace(tick=tick))
        return came

    def _record(self, begin: Record, came: list[Record], out: list[Record]) -> None:
        self._log.put(pack(begin))
        for record in came:
            self._log.put(pack(record))
        for record in out:
            if record.kind is RecordKind.STATE:
                self._state.put(pack(record))
                if self._view is not None:
                    self._view.put(pack(record))
            elif record.kind is not RecordKind.POSE:
                self._log.put(pack(record))
        for port in self._ports:
            for refused in port.take_refused():
                payload = bytes([int(refused.item.reason)]) + refused.item.data
                self._log.put(
                    pack(Record(RecordKind.REFUSED, Source(port.source), begin.tick, refused.mono_ns, payload))
                )

    def _header(
        self, loaded: AnyLoaded | None, session: int, place: RoutePlace | None, anchor: list[float] | None
    ) -> None:
        started, now_ns, dead = self._started, time.monotonic_ns(), self._started.after_death
        record = header_record(started.config, loaded, session, now_ns, after_death=dead, place=place, anchor=anchor)
        self._log.put(pack(record))

    def _end(self, *_: object) -> None:
        self._ended = True


def header_record(
    config: RuntimeConfig,
    loaded: AnyLoaded | None,
    session: int,
    now_ns: int,
    *,
    after_death: bool,
    place: RoutePlace | None = None,
    anchor: list[float] | None = None,
) -> Record:
    """Data for a replay in addition to the ticks; ``loaded`` is ``None`` for a run that only records.

    Without a plan it has what a record of the worked ground needs: the tool, and the frame's anchor after a relaunch.
    """
    hashes = {} if loaded is None else loaded.hashes
    plan = None if config.coverage is None else config.coverage.plan
    header: dict[str, object] = {
        "version": __version__,
        "config": str(config.file),
        "mode": config.mode if config.commands else "record",
        "hashes": hashes,
        "plan_sha256": hashes.get(plan) if plan else None,
        "session": session,
        "after_death": after_death,
        "pid": os.getpid(),
    }
    if isinstance(loaded, Loaded):
        frame = loaded.frame
        header["frame"] = [frame.latitude_deg, frame.longitude_deg, frame.height_m]
    machine = getattr(loaded, "machine", "")
    if machine:
        header["machine"] = machine
    if config.coverage is not None and not plan:
        path = config.path(config.vehicle)
        vehicle = read_vehicle(path)
        header["vehicle"] = {"name": vehicle.name, "sha256": file_hash(path)}
        header["tool"] = tool_of(vehicle, path)._asdict()
    if anchor is not None:
        header["anchor"] = anchor
    if place is not None:
        header["place"] = [place.line, place.along_m]
    return Record(RecordKind.HEADER, Source.CONTROL, 0, now_ns, json.dumps(header).encode())


def _lines(config: RuntimeConfig) -> Iterator[Port[Any]]:
    """The lines of the control process, as far as the run has them."""
    ports = config.ports
    for source, name, table in (
        (Source.DRIVE_BY_WIRE, "drive_by_wire", ports.drive_by_wire),
        (Source.CONTROLLER, "controller", ports.controller),
    ):
        if table is not None:
            yield Port.frames(source, table.url, table.baud, name)
    if ports.gnss is not None:
        yield Port(Source.GNSS, ports.gnss.url, ports.gnss.baud, GnssParser())


def _raw(arrival: Arrival[Any]) -> bytes:
    return arrival.item.raw if isinstance(arrival.item, Frame) else bytes(arrival.item)


def run(started: Started) -> None:
    """The process."""
    Control(started).run()
