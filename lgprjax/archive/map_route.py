"""The route of a map in equal steps, and what ground lies there: passes, width, share of the array on the map."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.formats import MapFile
from lgprjax.subsurface import SpatialIndex, Tile


class DrivePlaces(NamedTuple):
    """Places along one baseline's own track, in equal steps, across gaps of the baseline too.

    Attributes:
        pose: east_m, north_m, yaw_rad.
        station: nearest station of the baseline along its track; -1 where none in force is within half a step.
        fresh: in force, and no earlier baseline in force came by: here the route goes on.
    """

    pose: Float[np.ndarray, "place 3"]
    station: Int[np.ndarray, " place"]
    fresh: Bool[np.ndarray, " place"]


class Route(NamedTuple):
    """The map's ground in order of driving, each stretch counted once: the first baseline, then what later ones add.

    Attributes:
        at_m: metres along the route.
        pose: east_m, north_m, yaw_rad.
        drive, place: baseline that gives the place, and its number among that baseline's places.
    """

    at_m: Float[np.ndarray, " route"]
    pose: Float[np.ndarray, "route 3"]
    drive: Int[np.ndarray, " route"]
    place: Int[np.ndarray, " route"]


class Ground(NamedTuple):
    """What lies at each place of the route.

    Attributes:
        passes: baselines that came by within an array's width.
        width_m: ground across the route without a gap, through the place; 0 where there is none.
        overlap: share of an array's antennas on the map, its centre on the route.
    """

    passes: Int[np.ndarray, " route"]
    width_m: Float[np.ndarray, " route"]
    overlap: Float[np.ndarray, " route"]


def places_of_drives(source: MapFile, step_m: float) -> list[DrivePlaces]:
    """Places of every baseline, ``step_m`` apart along its own track."""
    radius_m = max(source.description.array_width_m, step_m)
    out: list[DrivePlaces] = []
    earlier, retired = np.zeros((0, 2)), source.retired > 0
    for number in range(int(source.drive.max()) + 1):
        stations = np.flatnonzero(source.drive == number)
        if len(stations) < 2:
            out.append(DrivePlaces(np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0, bool)))
            continue
        pose = source.pose[stations]
        path = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(pose[:, :2], axis=0).T))])
        at = np.arange(0.5 * step_m, max(path[-1], step_m), step_m)
        where = np.stack([np.interp(at, path, pose[:, column]) for column in (0, 1, 3)], axis=1)
        nearest = np.clip(np.searchsorted(path, at), 1, len(path) - 1)
        nearest = np.where(np.abs(path[nearest - 1] - at) < np.abs(path[nearest] - at), nearest - 1, nearest)
        in_force = ~retired[stations[nearest]]
        close = np.abs(path[nearest] - at) <= 0.5 * step_m
        station = np.where(close & in_force, stations[nearest], -1)
        fresh = in_force.copy()
        # Against the earlier places, not stations: a gap in one baseline is a hole, not another road.
        if len(earlier):
            index = SpatialIndex(earlier, 8.0)
            fresh &= np.array([index.nearest(point, radius_m) is None for point in where[:, :2]])
        out.append(DrivePlaces(where, station, fresh))
        earlier = np.concatenate([earlier, where[in_force, :2]])
    return out


def route_of(drives: list[DrivePlaces], step_m: float) -> Route:
    """The fresh places of all baselines, one after the other."""
    pose = np.concatenate([places.pose[places.fresh] for places in drives])
    drive = np.concatenate([np.full(int(places.fresh.sum()), number) for number, places in enumerate(drives)])
    place = np.concatenate([np.flatnonzero(places.fresh) for places in drives])
    return Route((np.arange(len(pose)) + 0.5) * step_m, pose, drive, place)


def passes_at(source: MapFile, route: Route) -> Int[np.ndarray, " route"]:
    """Baselines in force that came by each place within an array's width."""
    in_force = source.retired == 0
    index, radius_m = SpatialIndex(source.pose[in_force, :2], 8.0), source.description.array_width_m
    drive = source.drive[in_force]
    return np.array([len(np.unique(drive[index.near(point, radius_m)])) for point in route.pose[:, :2]])


class TileMask(NamedTuple):
    """The cells of a tile that a baseline covers, on the host."""

    valid: Bool[np.ndarray, "along cross"]
    origin_m: Float[np.ndarray, "2"]
    cell_m: Float[np.ndarray, "2"]


def mask_of(tile: Tile) -> TileMask:
    """A tile's mask."""
    return TileMask(np.asarray(tile.valid), np.asarray(tile.origin_m), np.asarray(tile.cell_m))


def on_map(mask: TileMask, position_m: Float[np.ndarray, "*place 2"]) -> Bool[np.ndarray, "*place"]:
    """Where a trace could be scored: all four cells about the position are covered (as ``sample_tile`` asks)."""
    base = np.floor((position_m - mask.origin_m) / mask.cell_m).astype(np.int64)
    size = np.array(mask.valid.shape)
    inside = np.all((base >= 0) & (base + 1 < size), axis=-1)
    i, j = np.moveaxis(np.clip(base, 0, size - 2), -1, 0)
    return np.asarray(
        inside & mask.valid[i, j] & mask.valid[i + 1, j] & mask.valid[i, j + 1] & mask.valid[i + 1, j + 1]
    )


def ground_at(mask: TileMask, pose: Float[np.ndarray, "3"], channels: int, pitch_m: float) -> tuple[float, float]:
    """Width of ground across a place, and the share of an array's antennas on the map.

    Args:
        mask: of the tile.
        pose: along_m, cross_m and yaw_rad of the place in the tile's frame.
        channels, pitch_m: of the array.
    """
    left = np.array([-np.sin(pose[2]), np.cos(pose[2])])
    antennas = (np.arange(channels) - 0.5 * (channels - 1)) * pitch_m
    overlap = float(np.mean(on_map(mask, pose[:2] + antennas[:, None] * left)))
    step_m = 0.5 * float(mask.cell_m[1])
    reach = int(max(mask.valid.shape) * max(mask.cell_m) / step_m)
    covered = on_map(mask, pose[:2] + (np.arange(-reach, reach + 1) * step_m)[:, None] * left)
    if not covered[reach]:
        return 0.0, overlap
    right_end = np.flatnonzero(~covered[: reach + 1])
    left_end = np.flatnonzero(~covered[reach:])
    cells = (left_end[0] if len(left_end) else reach) + (reach - right_end[-1] if len(right_end) else reach)
    return float(cells) * step_m, overlap
