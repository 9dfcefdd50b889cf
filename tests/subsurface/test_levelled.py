"""Tiles of a map whose antennas stand at many heights, against the whole way written out in float64."""

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float, Int

from lgprjax.frames import LocalFrame
from lgprjax.radar import default_chain
from lgprjax.subsurface import GroundMap, MapDescription, StationPlaces, StationPositions, Stations
from lgprjax.subsurface.ground_map import Levelling

CHANNELS, SAMPLES, STATIONS, PITCH_M, STEP_M = 3, 48, 700, 0.127, 0.05
LIGHT_M_PER_NS = 0.299792458
WEIGHT = (0.4, 1.0)


class Lanes:
    """Two baselines of a straight road, the second on its way back, with noise for ground and dead channels."""

    def __init__(self) -> None:
        rng = np.random.default_rng(5)
        count = 2 * STATIONS
        back = np.arange(count) >= STATIONS
        travel = STEP_M * (np.arange(count) % STATIONS)
        east = np.where(back, STEP_M * STATIONS - travel, travel) + rng.uniform(-0.01, 0.01, count)
        yaw = np.where(back, np.pi, 0.0) + rng.uniform(-0.2, 0.2, count)
        self.pose: Float[np.ndarray, "scan 5"] = np.stack([east, 0.2 * back, 0.3 + 0 * yaw, yaw, 0 * yaw], axis=1)
        left = (1 - np.arange(CHANNELS)) * PITCH_M
        height = rng.uniform(0.2, 0.45, (count, CHANNELS))
        self.stations = Stations(
            profile=rng.normal(size=(count, CHANNELS, SAMPLES)).astype(np.float32),
            valid=rng.random((count, CHANNELS)) < 0.8,
            antenna_m=np.stack([-np.sin(yaw)[:, None] * left, np.cos(yaw)[:, None] * left, height], axis=-1),
        )
        self.places = StationPlaces.held(StationPositions(self.pose, 0 * east, back.astype(int)))
        self.tile_frame: Float[np.ndarray, "tile 3"] = np.array([[x, 0.1, 0.02] for x in (4.0, 17.0, 30.0)])
        self.height_reference_m: Float[np.ndarray, " tile"] = np.array([0.3, 0.27, 0.34])
        gain = np.linspace(1.0, 3.0, SAMPLES).astype(np.float32)
        settings = replace(default_chain(250e6, 0.036), step_m=STEP_M)
        frame = LocalFrame(42.0, -71.0, 0.0)
        self.description = MapDescription("lanes", frame, settings, PITCH_M, CHANNELS, 13.0, gain, weight=WEIGHT)
        self.read = 0

    def read_stations(self, stations: Int[np.ndarray, " scan"]) -> Stations:
        self.read += len(stations)
        return Stations(*(field[stations] for field in self.stations))


def written_out(source: Lanes, ground: GroundMap, tile: int) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients and valid cells of a tile: every trace with every cell, all in float64."""
    gain, matrix, omega = (np.asarray(field, np.float64) for field in ground.basis)
    read = source.stations
    gained = np.where(read.valid[..., None], read.profile.astype(np.float64), 0.0) * gain
    rms = np.sqrt(np.sum(gained**2, axis=(1, 2)) / (SAMPLES * np.maximum(read.valid.sum(axis=1), 1)))
    limit = 2.5 * rms[:, None, None]
    value = np.minimum(np.maximum(gained, -limit), limit) @ matrix
    wave = value[..., : len(omega)] + 1j * value[..., len(omega) :]
    # Recorded higher means later; earlier is a factor exp(+i w t) on re + i im.
    above_m = read.antenna_m[..., 2] - source.height_reference_m[tile]
    wave = wave * np.exp(1j * omega * 2.0 * above_m[..., None] / LIGHT_M_PER_NS)
    level = np.concatenate([wave.real, wave.imag], axis=-1)
    spec, origin_m = ground.grid_of(tile)
    east, north, yaw = source.tile_frame[tile]
    i, j = np.meshgrid(np.arange(spec.along_cells), np.arange(spec.cross_cells), indexing="ij")
    along, cross = origin_m[0] + i * spec.along_cell_m, origin_m[1] + j * spec.cross_cell_m
    cell_east = east + np.cos(yaw) * along - np.sin(yaw) * cross
    cell_north = north + np.sin(yaw) * along + np.cos(yaw) * cross
    total, weights, valid = np.zeros((*i.shape, level.shape[-1])), np.zeros(i.shape), np.zeros(i.shape, bool)
    for station, channel in np.argwhere(read.valid):
        heading = source.pose[station, 3]
        x = cell_east - source.pose[station, 0] - read.antenna_m[station, channel, 0]
        y = cell_north - source.pose[station, 1] - read.antenna_m[station, channel, 1]
        a = (np.cos(heading) * x + np.sin(heading) * y) / spec.along_spread_m
        c = (np.cos(heading) * y - np.sin(heading) * x) / spec.cross_spread_m
        near = (np.abs(a) <= 2.0) & (np.abs(c) <= 2.0)
        w = np.where(near, np.exp(-(a**2 + c**2) / 2.0), 0.0) * WEIGHT[int(station >= STATIONS)]
        total[near] += w[near, None] * level[station, channel]
        weights += w
        valid |= (np.abs(a) <= 1.5) & (np.abs(c) <= 1.0)
    return np.where(valid[..., None], total / np.maximum(weights, 1e-12)[..., None], 0.0), valid


@pytest.fixture(scope="module")
def lanes() -> Lanes:
    return Lanes()


@pytest.mark.parametrize("tile", [0, 2])
def test_a_tile_is_its_stations_brought_to_its_own_height(lanes: Lanes, tile: int) -> None:
    ground = GroundMap(lanes, half_along_m=2.0, half_cross_m=1.0)
    made = ground.tile(tile)
    value, valid = written_out(lanes, ground, tile)
    np.testing.assert_array_equal(made.valid, valid)
    np.testing.assert_allclose(made.coefficients, value, atol=1e-5 * np.abs(value).max())
    np.testing.assert_allclose(made.power, np.sum(value**2, axis=-1), rtol=1e-4, atol=1e-5)
    assert 0.2 < valid.mean() < 0.9


def test_neighbours_share_what_was_read(lanes: Lanes) -> None:
    ground = GroundMap(lanes, half_along_m=20.0, half_cross_m=1.0, keep=1)
    lanes.read = 0
    first = ground.tile(0)
    once = lanes.read
    assert once <= 2 * STATIONS
    ground.tile(1)
    assert lanes.read <= 2 * STATIONS
    np.testing.assert_array_equal(ground.tile(0).coefficients, first.coefficients)
    assert lanes.read <= 2 * STATIONS


def test_what_is_held_is_bounded_and_changes_nothing(lanes: Lanes, monkeypatch: pytest.MonkeyPatch) -> None:
    """With room for one block; the map's last one is short."""
    basis = GroundMap(lanes, half_along_m=2.0, half_cross_m=1.0).basis
    some = [np.arange(200, 300), np.arange(2 * STATIONS - 30, 2 * STATIONS), np.array([3, 400, 1399])]
    ample = Levelling(lanes, basis, 0.3)
    expected = [ample.read(stations) for stations in some]
    monkeypatch.setattr("lgprjax.subsurface.ground_map._HELD_BYTES", 1.0)
    scarce = Levelling(lanes, basis, 0.3)
    for stations, right in zip(some, expected, strict=True):
        for a, b in zip(scarce.read(stations), right, strict=True):
            np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(right.yaw_rad, lanes.pose[stations, 3])
    scarce.read(np.array([0]))
    lanes.read = 0
    for numbers in ([256], [257, 300], [511]):
        scarce.read(np.array(numbers))
    assert lanes.read == 256
    scarce.read(np.array([0]))
    assert lanes.read == 512
