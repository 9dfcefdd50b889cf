"""The search as the vehicle runs it: a map, an array and a radar's own description made ready and warmed."""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from lgprjax.errors import InputError
from lgprjax.formats import MapFile, VehicleFile, read_thresholds
from lgprjax.radar import ArrayGeometry, trace_operators, uniform_array
from lgprjax.registration import LiveBlock, RegisterOptions, Thresholds, Track, TrackedFixes, Tracker, tracking_ground
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.registration.tiles_ahead import TilesAhead
from lgprjax.runtime.wire import Frame

BLOCK_SCANS = 4
"""Most scans that are searched at once: a compiled shape."""
_HELD_TILES = 10


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
    told = config.registration
    held = None if told.thresholds is None else read_thresholds(config.path(told.thresholds), told.window_m)
    return RegisterOptions(
        search_m=told.search_m,
        window_m=told.window_m,
        time_scale=told.time_scale,
        own_thresholds=None if held is None else Thresholds(**held),
        # Navigation says how far off it may be; on poor ground wider searches would only take time.
        never_wider=True,
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
        tracker: the search.
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
        known, told = source.description, config.registration
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
        self._radar, self._time_scale = radar, told.time_scale
        operators = trace_operators(
            radar.samples,
            radar.sample_interval_ns,
            radar.time_zero_ns,
            known.settings,
            len(known.gain),
            height_m=place.height_m,
        )
        ground = tracking_ground(source, options)
        self.tracker = Tracker(
            ground,
            operators,
            self.array,
            options,
            block_scans=BLOCK_SCANS,
            held_tiles=_HELD_TILES,
            together=BLOCK_SCANS,
        )
        self.ahead = TilesAhead(beside, self.array, options)

    def warm_up(self) -> None:
        """Compile everything that a drive will need."""
        self.tracker.warm_up()
        jax.effects_barrier()

    def feed(self, frames: list[Frame], track: Track) -> TrackedFixes:
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
        scale = None if self._time_scale == 1.0 else np.full(len(frames), self._time_scale)
        return self.tracker.feed(LiveBlock(np.stack(traces), np.stack(valid), track, None, scale))
