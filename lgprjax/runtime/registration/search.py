"""The search as the vehicle runs it: a map, an array and a radar's own description made ready and warmed."""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from lgprjax.archive.held_ground import HeldGround
from lgprjax.errors import InputError
from lgprjax.formats import MapFile, VehicleFile, read_thresholds
from lgprjax.radar import ArrayGeometry, trace_operators, uniform_array
from lgprjax.registration import (
    DriveFixes,
    LiveBlock,
    Operators,
    RegisterOptions,
    Registration,
    Thresholds,
    Track,
    live_chain,
)
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.registration.tiles_ahead import TilesAhead
from lgprjax.runtime.wire import Frame

BLOCK_SCANS = 4
"""Most scans that are searched at once: a compiled shape."""
_HELD_TILES = 10
_WARM_UP_M = 12.0
"""Of travel: after less, a drive that is lost looks for another time scale, and for places farther away."""


class RadarDescription(NamedTuple):
    """What scans are, by the radar's own word; times in ns, the period in s."""

    channels: int
    samples: int
    sample_interval_ns: float
    time_zero_ns: float
    zero_level: float
    scan_period_s: float


def description_of(frame: Frame) -> RadarDescription:
    """A radar_description."""
    return RadarDescription(
        int(frame.number("channels")),
        int(frame.number("samples")),
        frame.number("sample_interval_ps") / 1e3,
        frame.number("time_zero_ps") / 1e3,
        frame.number("zero_level"),
        frame.number("scan_period_us") / 1e6,
    )


def options_of(config: RuntimeConfig) -> RegisterOptions:
    """The search by the configuration.

    Raises:
        InputError: the thresholds' file cannot be used, or is for windows of another length.
    """
    told, own = config.registration, None
    if told.thresholds is not None:
        path = config.path(told.thresholds)
        if told.window_m is None:
            raise InputError(path, "window_m", "registration.window_m of the configuration, as long", "none")
        own = Thresholds(**read_thresholds(path, told.window_m))
    return RegisterOptions(
        search_m=told.search_m,
        window_m=told.window_m,
        risk=told.risk,
        time_scale=told.time_scale,
        own_thresholds=own,
    )


class Search:
    """Scans of one drive to fixes.

    Args:
        config: of the run.
        vehicle: its file's contents.
        source: the map, open for as long as the search lives; beside it for the tiles ahead.
        radar: what it says of itself.

    Attributes:
        array: geometry.
        drive: the search.
        ahead: makes tiles ready.

    Raises:
        InputError: radar and map do not fit, or the vehicle file does not say where the array stands.
    """

    def __init__(
        self,
        config: RuntimeConfig,
        vehicle: VehicleFile,
        source: MapFile,
        beside: MapFile,
        radar: RadarDescription,
    ) -> None:
        known = source.description
        if radar.channels != known.channels:
            assert config.ports.radar is not None
            raise InputError(
                config.ports.radar.url, "radar_description", f"{known.channels} channels", f"{radar.channels}"
            )
        place = vehicle.array
        if place.x_m is None or place.height_m is None:
            raise InputError(config.path(config.vehicle), "array", "x_m and height_m", "none")
        options = options_of(config)
        self.array: ArrayGeometry = uniform_array(
            known.channels,
            known.channel_pitch_m,
            x_m=place.x_m,
            height_m=place.height_m,
            scan_period_s=radar.scan_period_s,
        )
        self._radar, self._source, self._options = radar, source, options
        self._operators: Operators = trace_operators(
            radar.samples,
            radar.sample_interval_ns,
            radar.time_zero_ns,
            known.settings,
            len(known.gain),
            height_m=place.height_m,
        )
        self._held = HeldGround(source, options, tiles=_HELD_TILES)
        self.drive = self._begin(options)
        self.ahead = TilesAhead(beside, self.array, options)

    def warm_up(self) -> None:
        """Compile everything that a drive needs: one along the map's first stations that finds itself, one that hears
        noise and looks for another time scale, and one that hears noise and looks farther away."""
        fixed = replace(self._options, time_scale=self._options.time_scale or 1.0)
        for known, options in ((True, self._options), (False, self._options), (False, fixed)):
            drive = self._begin(options)
            for block in self._over_stations(known=known):
                drive.feed(block)
        # Ground for either way along a tile.
        tile = self._held.ground.tile_near(self._source.pose[0, :2].astype(np.float64), 1.0)
        if tile is not None:
            for direction in (-1, 1):
                self._held.ground.tile(tile, direction)
        # All that is remembered is brought to another scale at once.
        channels, recorded = self._radar.channels, self._radar.samples
        chain = live_chain(self._held.ground, self._operators, channels, recorded)
        rows = 1
        while rows < 2 * (self.drive.search.plan.history + BLOCK_SCANS):
            blank = np.zeros((rows, channels, recorded), np.float32)
            chain.coefficients(blank, np.ones((rows, channels), bool), fixed.time_scale or 1.0)
            rows *= 2
        jax.effects_barrier()

    def _begin(self, options: RegisterOptions) -> Registration:
        return Registration(
            self._held.ground,
            self._operators,
            self.array,
            options,
            chance=self._held.chance,
            recorded=self._radar.samples,
            prepared=self._held.prepared_for(self.array),
            block_scans=BLOCK_SCANS,
        )

    def _over_stations(self, *, known: bool) -> Iterator[LiveBlock]:
        """Scans along the map's first stations: their traces as the radar would record them, or noise."""
        source, draw = self._source, np.random.default_rng(0)
        count = min(len(source.pose), int(_WARM_UP_M / source.description.settings.step_m))
        count = int(np.argmax(source.drive[:count] != source.drive[0])) or count
        back = np.linalg.pinv(np.asarray(self._operators(1.0), np.float64)).astype(np.float32)
        pose = np.array(source.pose[:count], np.float64)
        pose[:, 2], pose[:, 3] = self.array.height_m, np.unwrap(pose[:, 3])
        travel = np.cumsum(np.hypot(*np.diff(pose[:, :2], axis=0, prepend=pose[:1, :2]).T))
        still = np.zeros(count)
        track = Track(pose, travel, still + 1.0, still + np.radians(1.0), still * np.nan, np.zeros(count, np.int64))
        for low in range(0, count, BLOCK_SCANS):
            span = slice(low, min(low + BLOCK_SCANS, count))
            stations = source.read_stations(np.arange(count)[span])
            traces = stations.profile @ back
            noise = draw.normal(scale=np.std(traces), size=traces.shape)
            own = Track(*(field[span] for field in track))
            yield LiveBlock((traces if known else noise).astype(np.float32), stations.valid, own)

    def feed(self, frames: list[Frame], track: Track) -> DriveFixes:
        """Fixes of at most ``BLOCK_SCANS`` scans.

        Args:
            frames: radar_scan.
            track: of them.
        """
        shape = (self._radar.channels, self._radar.samples)
        traces: list[Float[np.ndarray, "channel sample"]] = []
        valid: list[Bool[np.ndarray, " channel"]] = []
        bits = np.arange(self._radar.channels)
        for frame in frames:
            data = frame.fields["data"]
            assert isinstance(data, bytes)
            traces.append(np.frombuffer(data, np.uint8).reshape(shape).astype(np.float32) - self._radar.zero_level)
            valid.append((int(frame.number("valid")) >> bits & 1).astype(bool))
        return self.drive.feed(LiveBlock(np.stack(traces), np.stack(valid), track))
