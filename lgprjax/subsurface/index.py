"""What lies near a point: a hash of square cells, so that a look-up costs the same on a map of any length."""

import numpy as np
from jaxtyping import Float, Int


class SpatialIndex:
    """Points of the plane by square cells.

    Args:
        points_m: east and north of each point, metres.
        cell_m: side of a cell; best near the radius that is asked for.
    """

    def __init__(self, points_m: Float[np.ndarray, "point 2"], cell_m: float) -> None:
        self._points_m = points_m
        self._cell_m = cell_m
        key = _key(np.floor(points_m / cell_m).astype(np.int64))
        self._order = np.argsort(key, kind="stable")
        self._key = key[self._order]

    def near(self, point_m: Float[np.ndarray, "2"], radius_m: float) -> Int[np.ndarray, " found"]:
        """Indices, rising, of the points within ``radius_m``."""
        low = np.floor((point_m - radius_m) / self._cell_m).astype(np.int64)
        high = np.floor((point_m + radius_m) / self._cell_m).astype(np.int64)
        rows = np.arange(low[0], high[0] + 1)
        # Cells of one column are neighbours in the order of keys: one range a column.
        first = np.searchsorted(self._key, _key(np.stack([rows, np.full_like(rows, low[1])], axis=1)), "left")
        last = np.searchsorted(self._key, _key(np.stack([rows, np.full_like(rows, high[1])], axis=1)), "right")
        found = np.concatenate([self._order[a:b] for a, b in zip(first, last, strict=True)])
        apart = self._points_m[found] - point_m
        return np.asarray(np.sort(found[np.sum(apart**2, axis=1) <= radius_m**2]))

    def nearest(self, point_m: Float[np.ndarray, "2"], radius_m: float) -> int | None:
        """Index of the nearest point within ``radius_m`` (the lowest of equals), or None."""
        found = self.near(point_m, radius_m)
        if not len(found):
            return None
        return int(found[np.argmin(np.sum((self._points_m[found] - point_m) ** 2, axis=1))])


def _key(cell: Int[np.ndarray, "point 2"]) -> Int[np.ndarray, " point"]:
    return np.asarray(cell[:, 0] * (1 << 32) + cell[:, 1] + (1 << 31))


def place_tiles(
    pose: Float[np.ndarray, "scan 5"],
    known: Float[np.ndarray, "tile 3"],
    spacing_m: float,
) -> Float[np.ndarray, "added 3"]:
    """Frames (east_m, north_m, yaw_rad) of the tiles along a drive that earlier ones do not serve yet.

    A tile stands on the drive, its axis along it. A stretch is served when a frame lies within half the
    spacing; a second drive over the same road, in either direction, adds none.

    Args:
        pose: of the drive's stations.
        known: frames there are.
        spacing_m: distance between frames along the drive.
    """
    frames = [tuple(frame) for frame in known]
    added: list[tuple[float, float, float]] = []
    cells: dict[tuple[int, int], list[int]] = {}

    def remember(number: int) -> None:
        east, north, _ = frames[number]
        cells.setdefault((int(east // spacing_m), int(north // spacing_m)), []).append(number)

    for number in range(len(frames)):
        remember(number)
    for east, north, _, yaw, _ in pose:
        column, row = int(east // spacing_m), int(north // spacing_m)
        around = (
            frames[number]
            for i in (column - 1, column, column + 1)
            for j in (row - 1, row, row + 1)
            for number in cells.get((i, j), ())
        )
        if all(np.hypot(east - e, north - n) > 0.5 * spacing_m for e, n, _ in around):
            frames.append((float(east), float(north), float(yaw)))
            added.append(frames[-1])
            remember(len(frames) - 1)
    return np.asarray(added, dtype=np.float64).reshape(-1, 3)
