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
        key = _key(*np.floor(points_m / cell_m).astype(np.int64).T)
        self._order = np.argsort(key, kind="stable")
        self._key = key[self._order]

    def near(self, point_m: Float[np.ndarray, "2"], radius_m: float) -> Int[np.ndarray, " found"]:
        """Indices, rising, of the points within ``radius_m``."""
        low = np.floor((point_m - radius_m) / self._cell_m).astype(np.int64)
        high = np.floor((point_m + radius_m) / self._cell_m).astype(np.int64)
        rows = np.arange(low[0], high[0] + 1)
        # Cells of one column are neighbours in the order of keys: one range a column.
        first = np.searchsorted(self._key, _key(rows, low[1:]), "left")
        last = np.searchsorted(self._key, _key(rows, high[1:]), "right")
        found = np.concatenate([self._order[a:b] for a, b in zip(first, last, strict=True)])
        apart = self._points_m[found] - point_m
        return np.asarray(np.sort(found[np.sum(apart**2, axis=1) <= radius_m**2]))

    def near_each(
        self, points_m: Float[np.ndarray, "query 2"], radius_m: float
    ) -> tuple[Int[np.ndarray, " found"], Int[np.ndarray, " found"]]:
        """What ``near`` finds of many places at once: number of the place, rising, and index, in no order."""
        low = np.floor((points_m - radius_m) / self._cell_m).astype(np.int64)
        high = np.floor((points_m + radius_m) / self._cell_m).astype(np.int64)
        rows = low[:, :1] + np.arange(1 + int(np.max(high[:, 0] - low[:, 0], initial=0)))
        first = np.searchsorted(self._key, _key(rows, low[:, 1:]), "left")
        last = np.searchsorted(self._key, _key(rows, high[:, 1:]), "right")
        count = np.where(rows <= high[:, :1], last - first, 0)
        before = np.cumsum(count.ravel()) - count.ravel()
        taken = np.repeat(first.ravel() - before, count.ravel()) + np.arange(int(count.sum()))
        query, found = np.repeat(np.arange(len(points_m)), count.sum(axis=1)), self._order[taken]
        east, north = (self._points_m[found] - points_m[query]).T
        within = east**2 + north**2 <= radius_m**2
        return query[within], found[within]

    def nearest(self, point_m: Float[np.ndarray, "2"], radius_m: float) -> int | None:
        """Index of the nearest point within ``radius_m`` (the lowest of equals), or None."""
        found = self.near(point_m, radius_m)
        if not len(found):
            return None
        return int(found[np.argmin(np.sum((self._points_m[found] - point_m) ** 2, axis=1))])

    def nearest_each(self, points_m: Float[np.ndarray, "query 2"], radius_m: float) -> Int[np.ndarray, " query"]:
        """What ``nearest`` finds of many places at once; -1 for none."""
        query, found = self.near_each(points_m, radius_m)
        apart = np.sum((self._points_m[found] - points_m[query]) ** 2, axis=1)
        order = np.lexsort((found, apart, query))
        place, first = np.unique(query[order], return_index=True)
        nearest = np.full(len(points_m), -1)
        nearest[place] = found[order][first]
        return nearest


def _key(column: Int[np.ndarray, "..."], row: Int[np.ndarray, "..."]) -> Int[np.ndarray, "..."]:
    return np.asarray(column * (1 << 32) + row + (1 << 31))


class TilePlacer:
    """Places tile frames (east_m, north_m, yaw_rad) along drives, where earlier ones do not serve yet.

    A tile stands on the drive, its axis along it. A station is served by a frame within half the spacing: a second
    drive over the same road, in either direction, adds hardly any.

    Args:
        spacing_m: no station is farther than half of this from a frame.
    """

    def __init__(self, spacing_m: float) -> None:
        self._spacing_m = spacing_m
        self._frames: list[tuple[float, float, float]] = []
        self._cells: dict[tuple[int, int], list[int]] = {}

    @property
    def frames(self) -> Float[np.ndarray, "tile 3"]:
        """All frames so far."""
        return np.asarray(self._frames, dtype=np.float64).reshape(-1, 3)

    def place(self, pose: Float[np.ndarray, "scan 5"]) -> int:
        """Place frames for the next stations of a drive; returns how many were added."""
        before = len(self._frames)
        for east, north, _, yaw, _ in pose:
            if not self._served(float(east), float(north)):
                self._cells.setdefault(self._cell(east, north), []).append(len(self._frames))
                self._frames.append((float(east), float(north), float(yaw)))
        return len(self._frames) - before

    def _cell(self, east: float, north: float) -> tuple[int, int]:
        return int(east // self._spacing_m), int(north // self._spacing_m)

    def _served(self, east: float, north: float) -> bool:
        column, row = self._cell(east, north)
        for i in (column - 1, column, column + 1):
            for j in (row - 1, row, row + 1):
                for number in self._cells.get((i, j), ()):
                    x, y, _ = self._frames[number]
                    if np.hypot(east - x, north - y) <= 0.5 * self._spacing_m:
                        return True
        return False
