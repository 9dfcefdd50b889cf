"""A map of any length in memory: one generated stretch of road, repeated with shifted positions."""

import numpy as np
from jaxtyping import Array, Float, Int

from benchmarks.registration import SAMPLE_INTERVAL_NS, SAMPLES
from lgprjax.frames import LocalFrame
from lgprjax.radar import ArrayGeometry, default_chain, profile_operator, profile_samples, uniform_array
from lgprjax.registration import LiveBlock, Track
from lgprjax.subsurface import MapDescription, StationPlaces, StationPositions, Stations, TilePlacer

CHANNELS, PITCH_M, HEIGHT_M = 11, 0.127, 0.3
SCAN_STEP_M = 0.035
TILE_SPACING_M = 4.0
_CORRELATION_M = 0.12
_NOISE = 1.5
"""Of the live traces, beside unit power of the ground in the band: about 0.55 of correlation."""
_SPEED_MPS = 4.375


class RepeatedRoad:
    """A straight road east, of lanes side by side each driven once; a ``StationSource``.

    Args:
        length_m: of the road; a multiple of ``repeat_m``.
        repeat_m: of the stretch that is generated.
        lanes: baselines, each as wide as the array.
        seed: of the ground.
    """

    def __init__(self, length_m: float, repeat_m: float = 1000.0, lanes: int = 1, seed: int = 0) -> None:
        settings = default_chain(250e6, SCAN_STEP_M)
        kept = profile_samples(SAMPLES, SAMPLE_INTERVAL_NS, 0.0, settings)
        self.operator = profile_operator(SAMPLES, SAMPLE_INTERVAL_NS, 0.0, settings, kept=kept)
        self.array: ArrayGeometry = uniform_array(CHANNELS, PITCH_M, height_m=HEIGHT_M)
        self._once = round(repeat_m / settings.step_m)
        self._ground = _draw(np.random.default_rng(seed), (self._once, lanes * CHANNELS, kept), settings.step_m)
        self._level = np.float32(1.0 / np.sqrt(np.mean(self._ground[:1000].astype(np.float32) ** 2)))
        repeats = round(length_m / repeat_m)
        along = np.arange(self._once * repeats) * settings.step_m
        middle = (0.5 * (lanes - 1) - np.arange(lanes)) * CHANNELS * PITCH_M
        self._pose = np.zeros((lanes * len(along), 5))
        self._pose[:, 0] = np.tile(along, lanes)
        self._pose[:, 1] = np.repeat(middle, len(along))
        self._pose[:, 2] = HEIGHT_M
        lane = np.repeat(np.arange(lanes, dtype=np.int32), len(along))
        # The road is level.
        self._places = StationPlaces.held(StationPositions(self._pose, np.zeros(len(lane)), lane))
        self._along = len(along)
        placer = TilePlacer(TILE_SPACING_M)
        for baseline in range(lanes):
            first = baseline * self._along
            placer.place(self._pose[first : first + self._once])
        turns = np.repeat(np.arange(repeats) * self._once * settings.step_m, len(placer.frames))
        self._frames = np.tile(placer.frames, (repeats, 1)) + turns[:, None] * np.array([1.0, 0.0, 0.0])
        self._reference_m = np.full(len(self._frames), HEIGHT_M)
        self._description = MapDescription(
            "repeated road",
            LocalFrame(42.0, -71.0, 0.0),
            settings,
            PITCH_M,
            CHANNELS,
            TILE_SPACING_M,
            np.ones(kept, np.float32),
            (0.0,) * lanes,
        )

    @property
    def description(self) -> MapDescription:
        """What holds for the whole map."""
        return self._description

    @property
    def pose(self) -> Float[np.ndarray, "scan 5"]:
        """Of every station."""
        return self._pose

    @property
    def places(self) -> StationPlaces:
        """Where the stations stand."""
        return self._places

    @property
    def tile_frame(self) -> Float[np.ndarray, "tile 3"]:
        """East, north and yaw of every tile."""
        return np.asarray(self._frames)

    @property
    def height_reference_m(self) -> Float[np.ndarray, " tile"]:
        """The same for every tile."""
        return self._reference_m

    def read_stations(self, stations: Int[np.ndarray, " scan"]) -> Stations:
        """Profiles of these stations."""
        lane, along = np.divmod(stations, self._along)
        channel = lane[:, None] * CHANNELS + np.arange(CHANNELS)
        profile = self._ground[(along % self._once)[:, None], channel] * self._level
        antenna = np.stack([self.array.x_m, self.array.y_m, np.full(CHANNELS, HEIGHT_M)], axis=-1)
        valid = np.ones(channel.shape, bool)
        return Stations(profile, valid, np.broadcast_to(antenna, (len(stations), CHANNELS, 3)))

    def operators(self, time_scale: float) -> Float[Array, "recorded sample"]:
        """The drive's operator; the ground is as it was on the map's day."""
        assert time_scale == 1.0
        return self.operator

    def live_block(self, begin_m: float, scans: int, seed: int) -> LiveBlock:
        """Scans of the first lane as recorded, with noise and a position that is wrong by up to a metre either way.

        Args:
            begin_m: where it starts.
            scans: of 369 samples a channel, 3.5 cm apart.
            seed: of noise and positions.
        """
        rng = np.random.default_rng(seed)
        travel = begin_m + np.arange(scans) * SCAN_STEP_M
        node = travel / self._description.settings.step_m
        low = np.floor(node).astype(int)
        part = (node - low).astype(np.float32)[:, None, None]
        near, far = (self._ground[(low + k) % self._once, :CHANNELS] * self._level for k in (0, 1))
        heard = (1.0 - part) * near + part * far
        heard = heard + _NOISE * rng.standard_normal(heard.shape).astype(np.float32)
        traces = (heard @ np.linalg.pinv(np.asarray(self.operator))).astype(np.float32)
        pose = np.zeros((scans, 5))
        pose[:, 0] = travel + rng.uniform(-1.0, 1.0, scans)
        pose[:, 1] = self._pose[0, 1] + rng.uniform(-1.0, 1.0, scans)
        pose[:, 2] = HEIGHT_M
        truth = pose.copy()
        truth[:, 0], truth[:, 1] = travel, self._pose[0, 1]
        track = Track(
            pose,
            travel - begin_m,
            np.full(scans, _SPEED_MPS),
            np.full(scans, np.radians(1.0)),
            np.full(scans, np.nan),
            np.zeros(scans, np.int64),
        )
        return LiveBlock(traces, np.ones(heard.shape[:2], bool), track, truth)


def _draw(rng: np.random.Generator, size: tuple[int, int, int], step_m: float) -> np.ndarray:
    """Smooth in plan (a torus) and over the sample; int8 [station, channel, sample]."""
    stations, channels, samples = size
    wave = 2.0 * np.pi * np.fft.rfftfreq(stations, step_m)
    along = np.exp(-0.25 * (wave * _CORRELATION_M) ** 2)[:, None].astype(np.float32)
    beside = np.exp(-2.0 * (np.arange(-1, 2) * PITCH_M / _CORRELATION_M) ** 2)
    ground = np.zeros(size, np.float32)
    for channel in range(channels):
        white = rng.standard_normal((stations, samples), np.float32)
        smooth = np.fft.irfft(np.fft.rfft(white, axis=0) * along, n=stations, axis=0)
        for step, weight in zip((-1, 0, 1), beside, strict=True):
            ground[:, (channel + step) % channels] += (weight * smooth).astype(np.float32)
    return np.asarray(np.clip(np.round(ground * (25.0 / ground[:1000].std())), -127, 127), np.int8)
