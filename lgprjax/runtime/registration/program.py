"""The registration process: takes the radar's scans, searches each from the control loop's prior, and sends its fix."""

import gc
import json
import signal
import time
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Shaped

from lgprjax.formats import MapFile, VehicleFile, read_vehicle
from lgprjax.machine import count_compiles
from lgprjax.registration import TRACK_SCANS, Code, DriveFixes, Track
from lgprjax.run_records import FIX, SEARCHED, Record, RecordKind, Source, pack, unpack
from lgprjax.runtime.port import Arrival, Port
from lgprjax.runtime.process import ProcessStage, Started
from lgprjax.runtime.registration.scans import SCAN_MESSAGES, RadarSelf
from lgprjax.runtime.registration.search import (
    AHEAD_M,
    PriorTrack,
    RadarLine,
    Search,
)
from lgprjax.runtime.stamps import StampClock
from lgprjax.wire import Frame

_IDLE_S = 0.002
_WISH_S = 0.2
_TELL_S = 0.1
_STANDING_MPS = 0.05
_STANDING_NS = 100_000_000
_WAITING = 256  # scans: two seconds
_REPEATED, _MOST_REPEATS = 4.0, 10  # factor on the covariance of a repeated match, and its largest power


class _Scan(NamedTuple):
    time_ns: int
    frame: Frame


class Searched(NamedTuple):
    """Scans that were searched: rows of ``FIX``, and of ``SEARCHED``, from which their fixes can be found again."""

    fixes: Shaped[np.ndarray, " scan"]
    given: Shaped[np.ndarray, " scan"]

    @property
    def records(self) -> Iterator[tuple[RecordKind, bytes]]:
        """Kind and payload of each, what was given before what was found."""
        for fix, given in zip(self.fixes, self.given, strict=True):
            yield RecordKind.SEARCHED, given.tobytes()
            yield RecordKind.FIX, fix.tobytes()


class ScanQueue:
    """Scans on their way to their fixes: waiting for a prior, then searched. Without clock, ports or rings.

    Args:
        search: prepared search.
        clock: clock of the radar's stamps so far.
        array_x_m, height_m: centre of the array ahead of the rear axle, and above the ground.
    """

    def __init__(self, search: Search, clock: StampClock, array_x_m: float, height_m: float) -> None:
        self.priors = PriorTrack(array_x_m, height_m)
        self._search, self._clock = search, clock
        self._waiting: deque[_Scan] = deque()
        self._searched_ns = self._told_ns = 0
        self._begins = True
        self._repeats = 0

    def take(self, frame: Frame, arrival_ns: int) -> None:
        """Take an arrived radar_scan or radar_sweep."""
        scan_ns = self._clock.feed(frame.stamp_us, arrival_ns)
        if scan_ns is not None:
            self._waiting.append(_Scan(scan_ns, frame))
            if len(self._waiting) > _WAITING:
                self._waiting.popleft()

    def step(self) -> Searched | None:
        """Search at most ``TRACK_SCANS`` waiting scans that have a prior; ``None`` without any."""
        priors = self.priors
        if priors.take_end() and not self._begins:
            self._search.begin_anew()
            self._begins = True
        while self._waiting and priors.covers(self._waiting[0].time_ns) is False:
            self._waiting.popleft()
        ready: list[_Scan] = []
        while self._waiting and len(ready) < TRACK_SCANS and priors.covers(self._waiting[0].time_ns):
            scan = self._waiting.popleft()
            # At standstill ten scans per second are enough.
            if abs(priors.speed_mps) > _STANDING_MPS or scan.time_ns - self._searched_ns >= _STANDING_NS:
                ready.append(scan)
                self._searched_ns = scan.time_ns
        if not ready:
            return None
        times = np.array([scan.time_ns for scan in ready], np.int64)
        track = priors.track(times)
        found, valid = self._search.feed([scan.frame for scan in ready], track)
        return Searched(self._rows(ready, found), self._given(ready, track, valid))

    def _given(
        self, scans: list[_Scan], track: Track, valid: Bool[np.ndarray, "scan channel"]
    ) -> Shaped[np.ndarray, " scan"]:
        rows = np.zeros(len(scans), SEARCHED)
        rows["scan_ns"] = [scan.time_ns for scan in scans]
        rows["scan"] = [int(scan.frame.number("scan")) for scan in scans]
        rows["begins"][0], self._begins = self._begins, False
        rows["valid"] = valid @ (1 << np.arange(valid.shape[1]))
        rows["pose"], rows["travel_m"], rows["speed_mps"] = track.pose, track.travel_m, track.speed_mps
        rows["sigma_yaw_rad"] = track.sigma_yaw_rad
        return rows

    def _rows(self, scans: list[_Scan], found: DriveFixes) -> Shaped[np.ndarray, " scan"]:
        fix = found.fix
        rows = np.zeros(len(scans), FIX)
        rows["scan_ns"] = [scan.time_ns for scan in scans]
        rows["scan"] = [int(scan.frame.number("scan")) for scan in scans]
        # A propagated fix is no observation, except at standstill and at a crawl, where there is no other.
        own, weight = np.array(found.searched), np.ones(len(scans))
        for number, scan in enumerate(scans):
            own[number] |= scan.time_ns - self._told_ns >= _STANDING_NS
            if own[number]:
                self._told_ns = scan.time_ns
            # A repeated match adds no information: all repeats together have a third of its weight.
            self._repeats = 0 if found.searched[number] else min(self._repeats + own[number], _MOST_REPEATS)
            weight[number] = _REPEATED**self._repeats
        rows["code"] = np.where(own, fix.code, Code.NO_WINDOW)
        rows["waiting"] = len(self._waiting)
        rows["window_dm"] = np.where(np.isfinite(fix.window_m), np.round(10.0 * fix.window_m), -1)
        rows["correlation"], rows["margin"] = np.where(own, fix.correlation, np.nan), fix.margin
        overlap = np.maximum(np.asarray(fix.overlap, np.float64), 0.0)
        rows["strength"] = np.asarray(fix.correlation, np.float64) * np.sqrt(overlap)
        rows["overlap_channels"] = fix.overlap_channels
        rows["pose"], rows["covariance"] = fix.pose, weight[:, None, None] * np.asarray(fix.covariance, np.float64)
        rows["p_false"] = fix.p_false
        return rows


def array_place(vehicle: VehicleFile) -> tuple[float, float]:
    """Centre of the array ahead of the rear axle, and its height; that both are there is checked by ``Search``."""
    place = vehicle.array
    assert place.x_m is not None
    assert place.height_m is not None
    return place.x_m, place.height_m


class RegistrationProcess:
    """The process's state and its loop."""

    def __init__(self, started: Started) -> None:
        self._started = started
        config = started.config
        self._fixes, self._log = started.ring("fixes"), started.ring("registration_log")
        self._priors = started.ring("priors")
        live = config.output is not None and config.output.live_port is not None
        # Without a map there is nothing to search: the scans are recorded.
        self._records = not config.map
        page = config.mode == "record"
        self._view = started.ring("page_scans" if page else "view_scans") if live or page else None
        table = config.ports.radar
        assert table is not None
        port = Port.frames(Source.RADAR, table.url, table.baud, "radar")
        self._radar = RadarLine(port, config.radar, self._log, self._fixes)
        self._clock = StampClock()
        self._queue: ScanQueue | None = None
        self._wished_s = 0.0
        self._ended = False
        self._scans = 0
        self._said = RadarSelf(calibrated=config.radar.calibration is not None)
        signal.signal(signal.SIGTERM, self._end)

    def run(self) -> None:
        """Until SIGTERM."""
        started, config = self._started, self._started.config
        if self._records:
            self._record_only()
            return
        vehicle = read_vehicle(config.path(config.vehicle))
        while not (self._said.complete and not self._radar.preparing) and not self._ended:
            started.beat(ProcessStage.WARMING)
            self._listen()
            time.sleep(_IDLE_S)
        description = self._said.description
        if description is None or not self._said.complete:
            self._radar.close()
            return
        path = config.path(config.map)
        with MapFile.open(path) as source, MapFile.open(path) as beside:
            search = Search(config, vehicle, source, beside, description, self._said.lookup)
            search.warm_up()
            # Scans received meanwhile are old.
            self._listen()
            self._queue = ScanQueue(search, self._clock, *array_place(vehicle))
            # Objects existing now are permanent: excluding them avoids pauses of the garbage collector.
            gc.collect()
            gc.freeze()
            known, compiles = 0, count_compiles()
            while not self._ended:
                started.beat(ProcessStage.READY)
                self._listen()
                for message in self._priors.take():
                    self._queue.priors.take(unpack(message).payload)
                searched = self._queue.step()
                self._look_ahead(search, self._queue.priors)
                if searched is None:
                    time.sleep(_IDLE_S)
                else:
                    self._tell(searched)
                if compiles() != known:
                    known = compiles()
                    head = json.dumps({"compiled": known}).encode()
                    self._log.put(pack(Record(RecordKind.EVENT, Source.REGISTRATION, 0, time.monotonic_ns(), head)))
            search.ahead.close()
        self._radar.close()

    def _record_only(self) -> None:
        """Until SIGTERM: take the scans, and report their number to the control process."""
        told, told_s = 0, time.monotonic()
        while not self._ended:
            self._started.beat(ProcessStage.READY)
            self._listen()
            if time.monotonic() - told_s >= _TELL_S and self._scans != told:
                fresh, told, told_s = self._scans - told, self._scans, time.monotonic()
                head = json.dumps({"scans": fresh}).encode()
                self._fixes.put(pack(Record(RecordKind.EVENT, Source.REGISTRATION, 0, time.monotonic_ns(), head)))
            time.sleep(_IDLE_S)
        self._radar.close()

    def _end(self, *_: object) -> None:
        self._ended = True

    def _listen(self) -> None:
        """Take arrivals; send the next order to the radar."""
        for arrival in self._radar.arrivals():
            self._take(arrival)
        self._radar.order()

    def _take(self, arrival: Arrival[Frame]) -> None:
        frame = arrival.item
        record = pack(Record(RecordKind.PORT_IN, Source.RADAR, 0, arrival.mono_ns, frame.raw))
        self._log.put(record)
        self._radar.take(frame)
        if frame.name in SCAN_MESSAGES:
            self._scans += 1
            if self._view is not None:
                self._view.put(record)
            if self._queue is None:
                self._clock.feed(frame.stamp_us, arrival.mono_ns)
            else:
                self._queue.take(frame, arrival.mono_ns)
        elif not self._records:
            try:
                self._said.take(frame)
            except ValueError as error:
                # The compiled programs are for other scans: a restart makes them for these.
                raise SystemExit(str(error)) from None

    def _look_ahead(self, search: Search, priors: PriorTrack) -> None:
        now_s = time.monotonic()
        if now_s - self._wished_s < _WISH_S:
            return
        self._wished_s = now_s
        places = [place for place in (priors.ahead(way) for way in AHEAD_M) if place is not None]
        search.ahead.wish(places, priors.speed_mps, search.drive.prepared)

    def _tell(self, searched: Searched) -> None:
        now_ns = time.monotonic_ns()
        for kind, payload in searched.records:
            record = pack(Record(kind, Source.REGISTRATION, 0, now_ns, payload))
            if kind is RecordKind.FIX:
                self._fixes.put(record)
            self._log.put(record)


def run(started: Started) -> None:
    """The process."""
    RegistrationProcess(started).run()
