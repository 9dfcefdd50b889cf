"""The onboard search: map, array and the radar's description, prepared and compiled."""

import json
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.batch.register import HeldGround
from lgprjax.errors import InputError
from lgprjax.formats import MapFile, SweepRecording, VehicleFile, read_radar_calibration, read_thresholds
from lgprjax.radar import ArrayGeometry
from lgprjax.recordings import array_of_vehicle, of_channels
from lgprjax.registration import (
    FINISH_SWARM,
    SEARCH_SWARM,
    TRACK_SCANS,
    DriveFixes,
    LiveBlock,
    Operators,
    PreparedGround,
    PreparedTile,
    RegisterOptions,
    Registration,
    TemplateKey,
    Thresholds,
    Track,
    ground_map_for,
    live_chain,
)
from lgprjax.run_records import PRIOR, Record, RecordKind, Source, pack
from lgprjax.runtime.config import RadarTable, RuntimeConfig
from lgprjax.runtime.port import Arrival, Port
from lgprjax.runtime.registration.scans import (
    SCAN_MESSAGES,
    AnyDescription,
    LookUpSweeps,
    RadarDescription,
    ScanReader,
    SweepReader,
    TraceReader,
)
from lgprjax.runtime.ring import Ring
from lgprjax.wire import Frame, Sender, draw_session

# Tiles prepared before the vehicle reaches them: in a thread, on a separate map object.

AHEAD_M = (0.0, 1.0, 2.0, 3.0)
"""Distances ahead of the array at which tiles are prepared; the first is at the array."""
_SLACK_M = 0.5  # extent of the search's lattice beyond its region, up to a step


class TilesAhead:
    """A thread that prepares requested tiles, the newest request first.

    Its computations release the interpreter, so that the search runs in parallel; tiles are handed over on request of
    the search (``PreparedGround.hold``), never modified concurrently.
    """

    def __init__(self, source: MapFile, array: ArrayGeometry, options: RegisterOptions) -> None:
        self._ground = ground_map_for(source, options)
        self._prepared = PreparedGround(self._ground, array, keep=1)
        self._reach_m = options.search_half_m() + _SLACK_M
        self._tile: int | None = None
        self._wish: list[TemplateKey] = []
        self._ready: list[tuple[TemplateKey, PreparedTile]] = []
        self._news = threading.Condition()
        self._ending = False
        self._thread = threading.Thread(target=self._run, name="tiles ahead", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        with self._news:
            self._ending = True
            self._news.notify()
        self._thread.join(timeout=5.0)

    def wish(self, poses: Iterable[Float[np.ndarray, "5"]], speed_mps: float, into: PreparedGround) -> None:
        """Request tiles at these places, the first being the vehicle's own, except those that the search already
        holds. Prepared ones are handed over.
        """
        aspects: list[TemplateKey] = []
        tile = self._tile
        for number, pose in enumerate(poses):
            # Same choice as in the search: a tile stays in use as long as it serves.
            tile = self._ground.tile_holding(tile, pose[:2], self._reach_m)
            if number == 0:
                self._tile = tile
            if tile is None:
                continue
            aspect = self._prepared.aspects(np.array([tile]), pose[None, 3], np.array([speed_mps]))[0][0]
            if not into.holds(aspect) and aspect not in aspects:
                aspects.append(aspect)
        with self._news:
            done, self._ready = self._ready, []
            ready = {aspect for aspect, _ in done}
            self._wish = [aspect for aspect in aspects if aspect not in ready]
            if self._wish:
                self._news.notify()
        for aspect, tile_ready in done:
            if not into.holds(aspect):
                into.hold(aspect, tile_ready)

    def _run(self) -> None:
        while True:
            with self._news:
                while not self._wish and not self._ending:
                    self._news.wait()
                if self._ending:
                    return
                aspect = self._wish.pop(0)
                if any(aspect == known for known, _ in self._ready):
                    continue
            made = self._prepared.make(aspect)
            jax.block_until_ready(made)
            with self._news:
                self._ready.append((aspect, made))


_HELD_TILES = 10
_WARM_UP_M = 12.0
"""Travel within which a lost drive searches for another time scale, and for places farther away."""


def options_of(config: RuntimeConfig) -> RegisterOptions:
    """The search by the configuration.

    Raises:
        InputError: the thresholds' file cannot be used, or is for windows of another length.
    """
    table, own = config.registration, None
    if table.thresholds is not None:
        path = config.path(table.thresholds)
        if table.window_m is None:
            raise InputError(
                path, "window_m", "registration.window_m in the configuration, the window of these thresholds", "none"
            )
        own = Thresholds(**read_thresholds(path, table.window_m))
    return RegisterOptions(
        search_m=table.search_m,
        window_m=table.window_m,
        risk=table.risk,
        time_scale=table.time_scale,
        own_thresholds=own,
        swarm=FINISH_SWARM if table.finish == "swarm" else None,
        search_swarm=SEARCH_SWARM if table.search == "swarm" else None,
        filter="causal" if table.search == "filter" else None,
        track=True,
    )


class Search:
    """Search that converts scans of one drive to fixes.

    Args:
        config: configuration of the run.
        vehicle: contents of the vehicle file.
        source: map, open as long as the search.
        beside: the same map opened again, for the tiles ahead.
        radar: description of the radar.
        lookup: look-up of a stepped-frequency radar without a calibration file.

    Attributes:
        array: geometry of the array.
        drive: search of the drive.
        ahead: thread that prepares tiles.

    Raises:
        InputError: radar and map, or radar and calibration, do not fit; the vehicle file lacks the array's position.
    """

    def __init__(
        self,
        config: RuntimeConfig,
        vehicle: VehicleFile,
        source: MapFile,
        beside: MapFile,
        radar: AnyDescription,
        lookup: LookUpSweeps | None = None,
    ) -> None:
        known = source.description
        assert config.ports.radar is not None
        url = config.ports.radar.url
        if radar.channels != known.channels:
            raise InputError(url, "radar_description", f"{known.channels} channels", f"{radar.channels}")
        made_of = source.provenance.get("recording", "traces")
        if radar.kind != made_of:
            # Their levels over depth differ, and on board there is no earlier drive to measure them on.
            raise InputError(url, "radar_description", f"{made_of}, as in the map", radar.kind)
        options, path = options_of(config), config.path(config.vehicle)
        self.array: ArrayGeometry = array_of_vehicle(
            vehicle, path, channels=known.channels, pitch_m=known.channel_pitch_m, scan_period_s=radar.scan_period_s
        )
        self._radar, self._source, self._options = radar, source, options
        self._reader = reader_of(config, vehicle, radar, lookup)
        self._operators: Operators = self._reader.operators(known.settings, len(known.gain), self.array.height_m)
        self._held = HeldGround(source, options, tiles=_HELD_TILES)
        self.drive = self._begin(options)
        self.ahead = TilesAhead(beside, self.array, options)

    def warm_up(self) -> None:
        """Compile everything that a drive needs: one along the map's first stations that is located, one of noise
        that searches other time scales, and one of noise that searches farther away.
        """
        fixed = replace(self._options, time_scale=self._options.time_scale or 1.0)
        for known, options in ((True, self._options), (False, self._options), (False, fixed)):
            drive = self._begin(options)
            for block in self._over_stations(known=known):
                drive.feed(block)
        # Ground for both directions along a tile.
        tile = self._held.ground.tile_near(self._source.pose[0, :2].astype(np.float64), 1.0)
        if tile is not None:
            for direction in (-1, 1):
                self._held.ground.tile(tile, direction)
        # The whole history is converted to another scale at once.
        channels, recorded = self._radar.channels, self._radar.recorded
        chain = live_chain(self._held.ground, self._operators, self.array, recorded)
        rows = 1
        while rows < 2 * (self.drive.search.history + TRACK_SCANS):
            blank = np.zeros((rows, channels, recorded), np.float32)
            chain.coefficients(blank, np.ones((rows, channels), bool), fixed.time_scale or 1.0)
            rows *= 2
        jax.effects_barrier()

    def begin_anew(self) -> None:
        """Forget the drive so far: the next scan is searched as a first one."""
        self.drive = self._begin(self._options)

    def scans_per_second(self, seconds: float) -> float:
        """Scans searched in a second of this machine, over the map's first stations again and again."""
        done, spent_s = 0, 0.0
        while spent_s < seconds:
            drive, blocks = self._begin(self._options), list(self._over_stations(known=True))
            begun_s = time.perf_counter()
            for block in blocks:
                drive.feed(block)
            spent_s += time.perf_counter() - begun_s
            done += sum(len(block.traces) for block in blocks)
        return done / spent_s

    def _begin(self, options: RegisterOptions) -> Registration:
        return Registration(
            self._held.ground,
            self._operators,
            self.array,
            options,
            chance=self._held.chance,
            likelihood=None if options.filter is None else self._held.likelihood_for(self.array, self._source),
            recorded=self._radar.recorded,
            prepared=self._held.prepared_for(self.array),
            block_scans=TRACK_SCANS,
        )

    def _over_stations(self, *, known: bool) -> Iterator[LiveBlock]:
        """Scans along the map's first stations: their traces as recorded by the radar, or noise."""
        source, draw = self._source, np.random.default_rng(0)
        count = min(len(source.pose), int(_WARM_UP_M / source.description.settings.step_m))
        count = int(np.argmax(source.drive[:count] != source.drive[0])) or count
        back = np.linalg.pinv(np.asarray(self._operators(1.0), np.float64)).astype(np.float32)
        pose = np.array(source.pose[:count], np.float64)
        pose[:, 2], pose[:, 3] = self.array.height_m, np.unwrap(pose[:, 3])
        travel = np.cumsum(np.hypot(*np.diff(pose[:, :2], axis=0, prepend=pose[:1, :2]).T))
        still = np.zeros(count)
        track = Track(pose, travel, still + 1.0, still + np.radians(1.0), still * np.nan, np.zeros(count, np.int64))
        for low in range(0, count, TRACK_SCANS):
            span = slice(low, min(low + TRACK_SCANS, count))
            stations = source.read_stations(np.arange(count)[span])
            traces = stations.profile @ back
            noise = draw.normal(scale=np.std(traces), size=traces.shape)
            own = Track(*(field[span] for field in track))
            yield LiveBlock((traces if known else noise).astype(np.float32), stations.valid, own)

    def feed(self, frames: list[Frame], track: Track) -> tuple[DriveFixes, Bool[np.ndarray, "scan channel"]]:
        """Fixes of at most ``TRACK_SCANS`` scans, and mask of the channels used.

        Args:
            frames: radar_scan or radar_sweep frames.
            track: priors and motion of the scans.
        """
        recorded, valid = self._reader.read(frames)
        return self.drive.feed(LiveBlock(recorded, valid, track)), valid


# Pose by GNSS/INS at each scan: interpolated between the control loop's priors, or slightly beyond the last.

_KEPT = 256
_BEYOND_S = 0.1
_LEAST_YAW_SIGMA_RAD = math.radians(0.1)


class PriorTrack:
    """The last seconds of priors.

    Args:
        array_x_m: centre of the array ahead of the rear axle.
        height_m: height of the array.
    """

    def __init__(self, array_x_m: float, height_m: float) -> None:
        self._array_x_m, self._height_m = array_x_m, height_m
        self._held: deque[np.void] = deque(maxlen=_KEPT)
        self._ended = False

    def take(self, payload: bytes) -> None:
        """Take a prior; an invalid one ends the known track, because travel before and after it is unrelated."""
        prior = np.frombuffer(payload, PRIOR)[0]
        if not prior["valid"]:
            self._held.clear()
            self._ended = True
        elif not self._held or prior["time_ns"] > self._held[-1]["time_ns"]:
            self._held.append(prior)

    def take_end(self) -> bool:
        """Whether a known track ended since the last call."""
        ended, self._ended = self._ended, False
        return ended

    def covers(self, scan_ns: int) -> bool | None:
        """Whether there is a prior for a time; ``None`` if one may still arrive."""
        if not self._held:
            return None
        if scan_ns < self._held[0]["time_ns"]:
            return False
        return True if scan_ns <= self._held[-1]["time_ns"] + int(_BEYOND_S * 1e9) else None

    def track(self, scan_ns: Int[np.ndarray, " scan"]) -> Track:
        """Priors of scans that are covered."""
        held = np.array(list(self._held), PRIOR)
        at, time = (scan_ns - held["time_ns"][0]) / 1e9, (held["time_ns"] - held["time_ns"][0]) / 1e9
        last = held[-1]
        beyond = np.maximum(at - time[-1], 0.0)
        yaw_held = np.unwrap(held["pose"][:, 2])
        yaw = np.interp(at, time, yaw_held) + beyond * last["yaw_rate_radps"]
        # The extrapolation of the last prior stays small: a tick of the control loop.
        way = beyond * last["speed_mps"]
        turned = yaw_held[-1] + 0.5 * beyond * last["yaw_rate_radps"]
        x = np.interp(at, time, held["pose"][:, 0]) + way * np.cos(turned) + self._array_x_m * np.cos(yaw)
        y = np.interp(at, time, held["pose"][:, 1]) + way * np.sin(turned) + self._array_x_m * np.sin(yaw)
        roll = np.interp(at, time, held["roll_rad"])
        pose = np.stack([x, y, np.full(len(at), self._height_m), yaw, roll], axis=1)
        travel = np.interp(at, time, held["travel_m"]) + way
        speed = np.interp(at, time, held["speed_mps"])
        sigma = np.maximum(np.interp(at, time, held["sigma_yaw_rad"]), _LEAST_YAW_SIGMA_RAD)
        # A prior's record states no covariance of its position.
        unstated = np.full(len(at), np.nan)
        return Track(pose, travel, speed, sigma, unstated, np.zeros(len(at), np.int64))

    def ahead(self, way_m: float) -> Float[np.ndarray, "5"] | None:
        """Place of the array a distance ahead, in the present direction of motion; ``None`` at standstill."""
        if not self._held or abs(self._held[-1]["speed_mps"]) < 0.1:
            return None
        last = self._held[-1]
        way = math.copysign(way_m, last["speed_mps"])
        turn = float(last["yaw_rate_radps"] / last["speed_mps"]) * way
        x, y, yaw = last["pose"]
        x += way * math.cos(yaw + 0.5 * turn) + self._array_x_m * math.cos(yaw + turn)
        y += way * math.sin(yaw + 0.5 * turn) + self._array_x_m * math.sin(yaw + turn)
        return np.array([x, y, self._height_m, yaw + turn, last["roll_rad"]])

    @property
    def speed_mps(self) -> float:
        """Speed of the last prior, m/s."""
        return float(self._held[-1]["speed_mps"]) if self._held else 0.0


def reader_of(
    config: RuntimeConfig, vehicle: VehicleFile, radar: AnyDescription, lookup: LookUpSweeps | None
) -> ScanReader:
    """Reader of a radar's scans. Look-up, gains and delays of sweeps are those of the calibration file, else of the
    radar's messages and of the vehicle file.

    Raises:
        InputError: the calibration is of other sweeps, or the radar sends finished traces.
    """
    file = config.radar.calibration
    if isinstance(radar, RadarDescription):
        if file is not None:
            expected = "a radar of stepped-frequency sweeps, or no calibration"
            raise InputError(config.file, "radar.calibration", expected, "a radar of finished traces")
        return TraceReader(radar)
    place, path, channels = vehicle.array, config.path(config.vehicle), radar.channels
    gain = of_channels(place.channel_gain, 1.0, channels, path, "array.channel_gain")
    delay_ns = of_channels(place.channel_delay_ns, 0.0, channels, path, "array.channel_delay_ns")
    if file is not None:
        known = read_radar_calibration(config.path(file), radar.layout, gain=gain, delay_ns=delay_ns)
    else:
        assert lookup is not None
        frequencies_hz, late_ns = radar.frequencies_hz, radar.group_delay_ns
        known = SweepRecording(
            frequencies_hz=frequencies_hz,
            lookup_sweeps=lookup.sweeps,
            lookup_calibration_sweep=lookup.calibration,
            group_delay_ns=late_ns,
            channel_gain=gain,
            channel_delay_ns=delay_ns,
        )
    assert config.ports.radar is not None
    return SweepReader(radar, known, TRACK_SCANS, config.ports.radar.url)


# The radar's line: orders before scanning, start of scanning, and reports.

_ASK_S, _TELL_S = 1.0, 1.0
_STOP, _START, _CALIBRATE, _LOOK_UP = range(4)
_IDLE, _SCANNING, _CALIBRATING, _LOOKING_UP, _FAILED = range(5)
ERRORS = {
    1: "radar: a channel is lost",
    2: "radar: too hot",
    4: "radar: its clock",
    8: "radar: switch matrix",
    16: "radar: calibration out of range",
}
"""Bits of ``radar_health.errors`` in words."""


class RadarLine:
    """The radar's line: its port, and commands to the radar.

    A radar that scans already, as after a restart of this process, has received its commands.

    Args:
        port: port of the line.
        table: radar table of the configuration.
        log: ring to the recorder.
        control: ring to the control process.
        clock_ns: monotonic clock, ns; a lock-step run has its own.
    """

    def __init__(
        self,
        port: Port[Frame],
        table: RadarTable,
        log: Ring,
        control: Ring,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._port, self._table, self._log, self._control = port, table, log, control
        self._clock_ns = clock_ns
        self._sender = Sender(draw_session())
        self._orders = [_CALIBRATE] * table.calibrate + [_LOOK_UP] * table.look_up
        self._sweeps = table.sweep is not None
        self._state: int | None = None
        self._began = False
        self._requested_s = self._ordered_s = 0.0
        self._errors = 0

    @property
    def preparing(self) -> bool:
        """Whether calibration or look-up is still pending before scanning."""
        return bool(self._orders) and self._state != _SCANNING

    def take(self, frame: Frame) -> None:
        """Take a received frame."""
        if frame.name in SCAN_MESSAGES:
            self._state = _SCANNING
        elif frame.name == "radar_health":
            self._take_health(int(frame.number("state")), int(frame.number("errors")))

    def arrivals(self) -> list[Arrival[Frame]]:
        """Arrivals; refusals are recorded."""
        came = self._port.take()
        for refused in self._port.take_refused():
            payload = bytes([refused.item.reason]) + refused.item.data
            self._log.put(pack(Record(RecordKind.REFUSED, Source.RADAR, 0, refused.mono_ns, payload)))
        return came

    def order(self) -> None:
        """Send the next order: sweep plan, calibration, look-up, then scanning; once a second until it does."""
        now_s = self._clock_ns() / 1e9
        if self._state == _SCANNING or now_s - self._requested_s <= _ASK_S:
            return
        # A radar that scans already must not get other orders: wait for its messages first.
        noise_frames = self._state is None and (self._orders or self._sweeps)
        if noise_frames or self._state in (_CALIBRATING, _LOOKING_UP):
            return
        self._requested_s = now_s
        sweep = self._table.sweep
        if self._sweeps and sweep is not None:
            self._send("radar_sweep_plan", sweep.model_dump())
        action = self._orders[0] if self._orders else _START
        self._send("radar_command", {"action": action, "scan_period_us": self._table.scan_period_us})

    def close(self) -> None:
        """Stop the radar, and close the line."""
        self._send("radar_command", {"action": _STOP, "scan_period_us": 0})
        self._port.close()

    def _take_health(self, state: int, errors: int) -> None:
        doing = {_CALIBRATING: _CALIBRATE, _LOOKING_UP: _LOOK_UP}.get(state)
        if self._orders and doing == self._orders[0]:
            self._began = True
        elif self._orders and self._began and state == _IDLE:
            # The previous order is done.
            self._orders, self._began, self._requested_s = self._orders[1:], False, 0.0
        self._state = state
        now_s = self._clock_ns() / 1e9
        if errors != self._errors or (errors and now_s - self._ordered_s > _TELL_S):
            self._errors, self._ordered_s = errors, now_s
            words = [text for bit, text in ERRORS.items() if errors & bit]
            table = json.dumps({"radar": words + ["radar has failed"] * (state == _FAILED)}).encode()
            self._control.put(pack(Record(RecordKind.EVENT, Source.REGISTRATION, 0, self._clock_ns(), table)))

    def _send(self, name: str, fields: dict[str, Any]) -> None:
        now_ns = self._clock_ns()
        frame = self._sender.frame(name, fields, mode=0, mono_ns=now_ns)
        self._port.write(frame)
        self._log.put(pack(Record(RecordKind.PORT_OUT, Source.RADAR, 0, now_ns, frame)))
