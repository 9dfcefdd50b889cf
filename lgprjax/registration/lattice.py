"""A lattice of prior errors around a centre that follows the prior, and the surfaces of stops on it (host side).

``coarse`` computes a surface; this module chooses places on the map and stops, and keeps sums over windows.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from lgprjax.radar import LIGHT_SPEED_M_PER_NS, WAVE_SPEED_M_PER_NS, centre_of
from lgprjax.registration.coarse import ScanBatch, scan_surfaces
from lgprjax.registration.estimates import WIDEST
from lgprjax.registration.judge import RegisterOptions
from lgprjax.registration.queries import SearchSizes, Stops
from lgprjax.registration.template_bank import PreparedGround, TileBatch, to_tile

SLACK_M = 0.5
"""Distance that the prior may move from the lattice's centre before the lattice follows."""
HELD_M = 0.75
"""Half side of the lattice around a tracked place."""
_DECOYS = 192
_FEW = 4  # times fewer places than a tile has: below this, products scan by scan cost less than all together
_TILE_ROOM_M = 0.5
_LATELY = 4
_TURN_RAD = np.radians(15.0)


def decoy_reach_m(wavelength_m: float) -> float:
    """Distance of the decoys beyond the region: hundreds of independent places ahead and behind."""
    return max(3.0, min(7.0, 17.5 * wavelength_m), 8.0 * wavelength_m)


class Surfaces(NamedTuple):
    """Surfaces of consecutive stops, see ``scan_surfaces``."""

    lattice: Float[np.ndarray, "*batch plane forward left"]
    decoys: Float[np.ndarray, "*batch plane decoy"]
    power: Float[np.ndarray, "*batch"]


class RunningSums:
    """Sums of the surfaces of consecutive stops up to each of them: that of a window is a difference of two.

    In double precision, since a drive has no end; kept for as many stops as the longest window needs.

    Args:
        blank: surfaces of no stop, of one lattice.
        first: number of the first stop.
        room: stops kept, at least.
    """

    def __init__(self, blank: Surfaces, first: int, room: int) -> None:
        # Twice the size, so that old sums are moved out only once per that many stops.
        self._sums = Surfaces(*(np.zeros((2 * room + 1, *field.shape[1:])) for field in blank))
        self._first, self._room, self._count = first, room, 0

    @property
    def end(self) -> int:
        """Number of the next stop."""
        return self._first + self._count

    def renumber(self, dropped: int) -> None:
        """Count stops from a later one on."""
        self._first -= dropped

    def append(self, surfaces: Surfaces) -> None:
        """Add the surfaces of the next stops, at most as many as there is room for."""
        more = len(surfaces.power)
        if self._count + more > 2 * self._room:
            keep = self._room
            for whole in self._sums:
                whole[: keep + 1] = whole[self._count - keep : self._count + 1].copy()
            self._first, self._count = self.end - keep, keep
        # Plane after plane: memory is passed through in order, which a running sum along the first axis does not.
        for whole, part in zip(self._sums, surfaces, strict=True):
            for at, one in enumerate(part, self._count):
                np.add(whole[at], one, out=whole[at + 1, ...])
        self._count += more

    def over(self, first: Int[np.ndarray, "end window"], last: Int[np.ndarray, " end"]) -> Surfaces:
        """Sums over windows, from their first to their last stop; of no stop where the first is -1."""
        after = last - self._first + 1
        before = np.where(first >= 0, first - self._first, after[:, None])
        windows = Surfaces(*(np.empty((*first.shape, *whole.shape[1:]), np.float32) for whole in self._sums))
        for whole, window in zip(self._sums, windows, strict=True):
            for end, number in np.ndindex(*first.shape):
                sums = whole[after[end]], whole[before[end, number]]
                np.subtract(*sums, out=window[end, number, ...], casting="same_kind")
        return windows


class ErrorLattice:
    """Prior errors of one drive: forward and left of its heading, around the prior's offset from dead reckoning.

    Args:
        prepared: ground of the map for the drive's array.
        plan, options: sizes and options of the search.
        batch: number of scans processed together; a compiled shape.

    Attributes:
        half_m: half side of the region searched around the prior; the lattice extends ``SLACK_M`` farther.
        wide: whether a region of twice the side is searched.
        place_m: error on which the lattice is centred while a place is tracked; None otherwise.
        origin_m: centre of the lattice while no place is tracked, east and north from dead reckoning: the prior.
        facing_rad: heading of the lattice, from east.
        heights_m: offsets added to the prior's height.
        wide_heights_m: offsets for a prior height that may be far off.
    """

    def __init__(self, prepared: PreparedGround, plan: SearchSizes, options: RegisterOptions, batch: int) -> None:
        self._prepared, self._ground, self._plan, self._batch = prepared, prepared.ground, plan, batch
        self._left_m = prepared.array.y_m - centre_of(prepared.array)[1]
        self._wavelength_m = self._ground.description.settings.wavelength_m
        # Half a step of height is a twentieth of a period: refinement finds the rest.
        period_ns = self._wavelength_m / WAVE_SPEED_M_PER_NS
        apart_m = LIGHT_SPEED_M_PER_NS * period_ns / 20.0
        self.heights_m = _heights(options.height_m, apart_m)
        self.wide_heights_m = _heights(max(options.height_m, WIDEST[0]), apart_m)
        self.half_m, self.wide = options.search_half_m(), False
        self.place_m: Float[np.ndarray, 2] | None = None
        self.origin_m: Float[np.ndarray, 2] = np.full(2, np.nan)
        self.facing_rad = 0.0
        self._lately: list[int] = []

    def follow(self, stops: Stops, astray: Float[np.ndarray, "stop 2"], low: int, high: int) -> bool:
        """Move the lattice when the prior has left its centre, and turn it with the vehicle; True if it moved."""
        turned = False
        yaw = float(stops.pose[low, 3])
        if abs(np.mod(yaw - self.facing_rad + np.pi, 2.0 * np.pi) - np.pi) > _TURN_RAD:
            self.facing_rad, turned = yaw, True
        if np.all(np.abs(astray[low] - self.origin_m) <= SLACK_M):
            return turned
        ahead = astray[low:high]
        near = np.median(ahead[np.all(np.abs(ahead - astray[low]) <= SLACK_M, axis=1)], axis=0)
        self.origin_m = near if np.all(np.abs(astray[low] - near) <= SLACK_M) else astray[low].copy()
        return turned or self.place_m is None

    @property
    def region_m(self) -> float:
        """Present half side of the region around the prior."""
        return self.half_m * (2.0 if self.wide else 1.0)

    @property
    def middle_m(self) -> Float[np.ndarray, "2"]:
        """Centre of the lattice, east and north from dead reckoning."""
        return self.origin_m if self.place_m is None else self.place_m

    @property
    def points(self) -> tuple[int, int]:
        """Number of lattice points, forward and left."""
        return self._plan.points(self.region_m + SLACK_M if self.place_m is None else HELD_M)

    def point_of(self, error_m: Float[np.ndarray, "*stop 2"]) -> Float[np.ndarray, "*stop 2"]:
        """Lattice point of an error of the prior, east and north from dead reckoning."""
        about_m = (error_m - self.middle_m) @ _turn(self.facing_rad).T
        return np.asarray((about_m + self._corner_m(self.points)) / self._plan.lattice_m)

    def error_of(
        self,
        point: Float[np.ndarray, "*stop 2"],
        middle_m: Float[np.ndarray, "2"] | None = None,
        points: tuple[int, int] | None = None,
    ) -> Float[np.ndarray, "*stop 2"]:
        """The reverse of ``point_of``, for this lattice or another."""
        about_m = point * self._plan.lattice_m - self._corner_m(points or self.points)
        return np.asarray(about_m @ _turn(self.facing_rad) + (self.middle_m if middle_m is None else middle_m))

    def blank(
        self, stops: int, points: tuple[int, int] | None = None, heights_m: Float[np.ndarray, " height"] | None = None
    ) -> Surfaces:
        """Surfaces of stops without a signal."""
        planes = len(self.heights_m if heights_m is None else heights_m) + 2
        points = self.points if points is None else points
        return Surfaces(
            np.zeros((stops, planes, *points), np.float32),
            np.zeros((stops, planes, _DECOYS), np.float32),
            np.zeros(stops, np.float32),
        )

    def surfaces_of(
        self,
        stops: Stops,
        at: Int[np.ndarray, " stop"],
        coefficients: Float[np.ndarray, "stop channel coefficient"],
        middle_m: Float[np.ndarray, "2"] | None = None,
        points: tuple[int, int] | None = None,
        heights_m: Float[np.ndarray, " height"] | None = None,
    ) -> Surfaces:
        """Surfaces of some stops, with another centre, other points and other heights where these are given."""
        middle_m, points = self.middle_m if middle_m is None else middle_m, points or self.points
        heights_m = self.heights_m if heights_m is None else heights_m
        out = self.blank(len(at), points, heights_m)
        centre = stops.reckoned_m[at] + middle_m
        tiles = self.tiles_at(centre, float(np.max(self._corner_m(points))))
        for batch in self._prepared.batches(tiles, stops.pose[at, 3], stops.speed_mps[at], self._batch):
            some = batch.rows
            made = self._on_tile(stops, at[some], coefficients[some], centre[some], batch, points, heights_m)
            for whole, part in zip(out, made, strict=True):
                whole[some] = part[: len(some)]
        return out

    def _on_tile(
        self,
        stops: Stops,
        at: Int[np.ndarray, " stop"],
        coefficients: Float[np.ndarray, "stop channel coefficient"],
        centre: Float[np.ndarray, "stop 2"],
        batch: TileBatch,
        points: tuple[int, int],
        heights_m: Float[np.ndarray, " height"],
    ) -> Surfaces:
        ground, columns = self._ground, batch.ready.columns
        frame, fill = ground.frame(batch.number), self._batch - len(at)
        aside = _turn(self.facing_rad - frame[2])
        half = self._corner_m(points) @ aside
        rows = np.concatenate([at, np.full(fill, at[0])])
        middle = np.concatenate([centre, np.tile(centre[:1], (fill, 1))])
        pose = stops.pose[rows]
        corner = to_tile(np.concatenate([middle, pose[:, 2:]], axis=1), frame)[:, :2] - half
        above = pose[:, 2, None] + self._left_m * np.sin(pose[:, 4, None])
        made = scan_surfaces(
            columns,
            ground.components,
            ScanBatch(
                np.concatenate([coefficients, np.tile(coefficients[:1], (fill, 1, 1))]),
                stops.valid[rows],
                (above - ground.source.height_reference_m[batch.number]).astype(np.float32),
                corner.astype(np.float32),
            ),
            (self._plan.lattice_m[:, None] * aside).astype(np.float32),
            (self.decoys_about @ aside + half).astype(np.float32),
            heights_m,
            ground.basis.angular_frequency_rad_per_ns,
            points=points,
            box=self._box(points, columns.power.shape),
            count=np.int32(len(at)),
        )
        return Surfaces(*(np.asarray(part) for part in made))

    def _box(self, points: tuple[int, int], places: tuple[int, ...]) -> tuple[int, int] | None:
        """Places of a tile that contain the lattice at any rotation; None where these are not few."""
        across_m = float(np.linalg.norm((np.asarray(points) - 1) * self._plan.lattice_m))
        along, cross = (
            min(int(np.ceil(across_m / step_m)) + 3, count)
            for step_m, count in zip(self._prepared.step_m, places, strict=True)
        )
        return (along, cross) if _FEW * along * cross < places[0] * places[1] else None

    def _corner_m(self, points: tuple[int, int]) -> Float[np.ndarray, "2"]:
        """Forward and left, in metres, from a lattice's first point to its centre."""
        return np.asarray((np.asarray(points) // 2) * self._plan.lattice_m)

    @property
    def decoys_about(self) -> Float[np.ndarray, "decoy 2"]:
        """Forward and left of places beyond the region: evenly ahead and behind, as far to the sides as it is."""
        number, half_m = np.arange(_DECOYS), self.half_m
        forward, left = np.mod(0.5 + number * 0.7548776662, 1.0), np.mod(0.5 + number * 0.5698402910, 1.0)
        least_m = half_m + self._wavelength_m
        ahead = np.where(number % 2 == 0, 1.0, -1.0) * (least_m + forward * decoy_reach_m(self._wavelength_m))
        # Half of them straight ahead and behind: a map may be no wider than that.
        pitch_m = self._ground.description.channel_pitch_m
        aside = np.where(number % 4 < 2, half_m + 0.5, 0.5 * pitch_m)
        return np.stack([ahead, (2.0 * left - 1.0) * aside], axis=1)

    def tiles_at(self, places_m: Float[np.ndarray, "stop 2"], reach_m: float) -> Int[np.ndarray, " stop"]:
        """Tile of each place; -1 for none. Looked up every half metre: tiles overlap by more than that."""
        out = np.full(len(places_m), -1)
        points_given: Float[np.ndarray, 2] | None = None
        tile: int | None = None
        for row, place in enumerate(places_m):
            if points_given is None or np.max(np.abs(place - points_given)) > _TILE_ROOM_M:
                tile, points_given = self._tile_at(place, reach_m + _TILE_ROOM_M), place
            out[row] = -1 if tile is None else tile
        return out

    def _tile_at(self, place_m: Float[np.ndarray, "2"], reach_m: float) -> int | None:
        """A recently used tile, newest first, or else the nearest, so that what is derived from a tile is computed
        once.
        """
        nearest = self._ground.tile_near(place_m, reach_m)
        if nearest is None:
            return None
        for tile in self._lately:
            if self._ground.serves(tile, nearest, place_m, reach_m):
                return tile
        self._lately = [nearest, *self._lately[: _LATELY - 1]]
        return nearest


def _heights(half_m: float, apart_m: float) -> Float[np.ndarray, " height"]:
    """Heights, at most this far apart, of which one is within half of that of any within the half width."""
    count = int(np.ceil(2.0 * half_m / apart_m))
    steps = np.arange(count) * (2.0 / count) + (1.0 / count - 1.0)
    return np.asarray((half_m * steps).astype(np.float32))


def _turn(angle_rad: float) -> Float[np.ndarray, "2 2"]:
    """Matrix that takes a row (forward, left) to (east, north)."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, sin], [-sin, cos]])
