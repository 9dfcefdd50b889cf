"""Tiles on demand: one grid for a whole map, the same tile however long the map is, a bounded number held."""

from itertools import pairwise

import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float, Int

from lgprjax.frames import LocalFrame
from lgprjax.radar import default_chain
from lgprjax.subsurface import (
    GroundMap,
    MapDescription,
    StationPlaces,
    StationPositions,
    Stations,
    TilePlacer,
    sample_tile,
)

CHANNELS, SAMPLES, PITCH_M = 5, 40, 0.127


class Road:
    """A winding road in memory, its ground a smooth function of the place."""

    def __init__(self, length_m: float) -> None:
        travel = np.arange(0.0, length_m, 0.04)
        yaw = 0.6 * np.sin(travel / 30.0)
        east, north = np.cumsum(0.04 * np.cos(yaw)), np.cumsum(0.04 * np.sin(yaw))
        self.pose: Float[np.ndarray, "scan 5"] = np.stack([east, north, 0 * yaw + 0.3, yaw, 0 * yaw], axis=1)
        self.places = StationPlaces.held(StationPositions(self.pose, 0.01 * travel, np.zeros(len(travel), int)))
        placer = TilePlacer(4.0)
        placer.place(self.pose)
        self.tile_frame: Float[np.ndarray, "tile 3"] = placer.frames
        self.height_reference_m: Float[np.ndarray, " tile"] = np.full(len(self.tile_frame), 0.3)
        settings = default_chain(250e6, 0.036)
        gain = np.ones(SAMPLES, np.float32)
        self.description = MapDescription("road", LocalFrame(42.0, -71.0, 0.0), settings, PITCH_M, CHANNELS, 4.0, gain)
        self.read = 0

    def read_stations(self, stations: Int[np.ndarray, " scan"]) -> Stations:
        self.read += len(stations)
        pose = self.pose[stations]
        y = (2 - np.arange(CHANNELS)) * PITCH_M
        offset = np.stack([-np.sin(pose[:, 3:4]) * y, np.cos(pose[:, 3:4]) * y], axis=-1)
        place = pose[:, None, :2] + offset
        phase = np.arange(SAMPLES) * 0.9 + 4.0 * place[..., :1] + 3.0 * place[..., 1:]
        antenna = np.concatenate([offset, np.full((*offset.shape[:2], 1), 0.3)], axis=-1)
        return Stations(np.cos(phase).astype(np.float32), np.ones(place.shape[:2], bool), antenna)


@pytest.fixture(scope="module")
def road() -> Road:
    return Road(300.0)


def ground_map(road: Road) -> GroundMap:
    return GroundMap(road, half_along_m=4.0, half_cross_m=4.0)


def test_a_tile_holds_the_ground_of_its_stations(road: Road) -> None:
    tiles = ground_map(road)
    number = len(road.tile_frame) // 2
    tile, (east, north, yaw) = tiles.tile(number), tiles.frame(number)
    near = np.flatnonzero(np.hypot(*(road.pose[:, :2] - [east, north]).T) < 2.0)
    apart = road.pose[near, :2] - [east, north]
    place = np.stack([apart @ [np.cos(yaw), np.sin(yaw)], apart @ [-np.sin(yaw), np.cos(yaw)]], axis=1).astype(
        np.float32
    )
    sampled, covered = sample_tile(tile, jnp.asarray(place))
    assert np.asarray(covered).all()
    recorded = road.read_stations(near).profile[:, 2] @ np.asarray(tiles.basis.matrix)
    value = np.asarray(sampled)
    r = np.sum(value * recorded, axis=1) / np.linalg.norm(value, axis=1) / np.linalg.norm(recorded, axis=1)
    assert r.min() > 0.99


def test_a_look_up_reads_no_more_of_a_longer_map(road: Road) -> None:
    longer = Road(3000.0)
    for source in (road, longer):
        source.read = 0
        ground_map(source).tile(20)
    assert longer.read == pytest.approx(road.read, abs=5)
    np.testing.assert_allclose(longer.tile_frame[:20], road.tile_frame[:20])


def test_all_tiles_share_one_grid_few_are_held_and_far_places_have_none(road: Road) -> None:
    tiles = ground_map(road)
    assert len({tiles.grid_of(number)[0] for number in range(len(road.tile_frame))}) == 1
    first = tiles.tile(10)
    assert tiles.tile(10) is first
    for number in (11, 12, 13, 14):
        tiles.tile(number)
    assert tiles.tile(10) is not first
    assert tiles.tile_near(np.array([1e4, 0.0]), 1.5) is None
    assert tiles.tile_near(road.pose[0, :2], 1.5) == 0
    up = tiles.ground_up_at(np.array([[1e4, 0.0], [*road.pose[40, :2]]]))
    np.testing.assert_allclose(up, [np.nan, 0.01 * 40 * 0.04])


def drive_over(tiles: GroundMap, points_m: np.ndarray, reach_m: float) -> list[int | None]:
    """Tiles in use, point after point."""
    used: list[int | None] = []
    for point in points_m:
        used.append(tiles.tile_holding(used[-1] if used else None, point, reach_m))
    return used


def test_a_tile_is_kept_while_its_grid_serves(road: Road) -> None:
    tiles, reach_m = GroundMap(road, half_along_m=10.0, half_cross_m=6.0), 2.0
    there = road.pose[::10, :2]
    for points in (there, there[::-1]):
        used = drive_over(tiles, points, reach_m)
        changes = sum(a != b for a, b in pairwise(used))
        # Of 300 m; a tile serves from its frame on over its half length less the reach.
        assert 25 <= changes <= 40
        for point, tile in zip(points, used, strict=True):
            assert tile is not None
            east, north, yaw = tiles.frame(tile)
            spec, origin = tiles.grid_of(tile)
            # Every station about the point lies on the grid.
            turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            near = road.pose[np.hypot(*(road.pose[:, :2] - point).T) <= reach_m, :2]
            cells = ((near - [east, north]) @ turn - origin) / [spec.along_cell_m, spec.cross_cell_m]
            assert np.all((cells >= 0.0) & (cells <= [spec.along_cells - 1, spec.cross_cells - 1]))


def test_beyond_the_end_of_the_map_a_tile_serves_until_the_map_is_out_of_reach(road: Road) -> None:
    tiles = GroundMap(road, half_along_m=10.0, half_cross_m=6.0)
    yaw = road.pose[-1, 3]
    beyond = road.pose[-1, :2] + np.arange(0.0, 20.0, 0.5)[:, None] * [np.cos(yaw), np.sin(yaw)]
    last = len(road.tile_frame) - 2
    used = drive_over(tiles, np.concatenate([road.pose[-60:-1, :2], beyond]), 2.0)
    assert used[-1] is None
    assert tiles.tile_holding(last, road.pose[-1, :2] + 1e-3, 2.0) == last
    assert tiles.tile_holding(last, np.array([1e4, 0.0]), 2.0) is None
    assert tiles.tile_holding(None, road.pose[0, :2], 2.0) == 0


def test_a_tile_far_from_the_point_is_left(road: Road) -> None:
    """Its ends are the map's own there, but the ground about the point is none of its grid."""
    tiles = GroundMap(road, half_along_m=10.0, half_cross_m=6.0)
    point = road.pose[len(road.pose) // 2, :2]
    near = tiles.tile_near(point, 2.0)
    assert tiles.tile_holding(0, point, 2.0) == near
    assert tiles.tile_holding(len(road.tile_frame) - 1, point, 2.0) == near
