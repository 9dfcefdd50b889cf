"""A lattice of prior errors about a middle that follows the prior, and the surfaces of stops over it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from lgprjax.radar import LIGHT_SPEED_M_PER_NS, WAVE_SPEED_M_PER_NS, centre_of
from lgprjax.registration.options import RegisterOptions
from lgprjax.registration.prepared import Aspect, PreparedGround
from lgprjax.registration.stops import Plan, Stops
from lgprjax.registration.surfaces import ScanBatch, scan_surfaces
from lgprjax.registration.tiles import to_tile

SLACK_M = 0.5
"""What a prior may wander from the lattice's middle before the lattice follows."""
HELD_M = 0.75
"""Half side of the lattice about a place that is held."""
_DECOYS = 192
_FEW = 4  # times fewer places than a tile has: products scan by scan cost less then than with all together
_TILE_ROOM_M = 0.5
_LATELY = 4
_TURN_RAD = np.radians(15.0)


def decoy_reach_m(wavelength_m: float) -> float:
    """How far beyond the region decoys lie: hundreds of independent places ahead and behind."""
    return max(3.0, min(7.0, 17.5 * wavelength_m), 8.0 * wavelength_m)


class Surfaces(NamedTuple):
    """Of consecutive stops, see ``scan_surfaces``."""

    lattice: Float[np.ndarray, "stop plane forward left"]
    decoys: Float[np.ndarray, "stop plane decoy"]
    power: Float[np.ndarray, " stop"]


class ErrorLattice:
    """Prior errors of one drive: forward and left of the way it faces, about the prior's distance from dead reckoning.

    Args:
        prepared: ground of the map for the drive's array.
        plan, options: of the search.
        batch: scans that look at the ground at once, a shape that is compiled.

    Attributes:
        half_m: half side of the region searched about the prior; the lattice reaches ``SLACK_M`` farther.
        wide: a region of twice the side is searched.
        place_m: error about which alone the lattice lies while a place is held; None where there is none.
        origin_m: where the lattice lies while no place is held, east and north from dead reckoning: about the prior.
        heights_m: added to the prior's height.
    """

    def __init__(self, prepared: PreparedGround, plan: Plan, options: RegisterOptions, batch: int) -> None:
        self._prepared, self._ground, self._plan, self._batch = prepared, prepared.ground, plan, batch
        self._left_m = prepared.array.y_m - centre_of(prepared.array)[1]
        self._wavelength_m = self._ground.description.settings.wavelength_m
        # Half a step of height is a twentieth of a period: the finish finds the rest.
        period_ns = self._wavelength_m / WAVE_SPEED_M_PER_NS
        count = int(np.ceil(options.height_m / (LIGHT_SPEED_M_PER_NS * period_ns / 40.0)))
        steps = np.arange(count) * (2.0 / count) + (1.0 / count - 1.0)
        self.heights_m = (options.height_m * steps).astype(np.float32)
        self.half_m, self.wide = options.search_half_m(), False
        self.place_m: Float[np.ndarray, 2] | None = None
        self.origin_m: Float[np.ndarray, 2] = np.full(2, np.nan)
        self._facing_rad = 0.0
        self._lately: list[int] = []

    def follow(self, stops: Stops, astray: Float[np.ndarray, "stop 2"], low: int, high: int) -> bool:
        """Move the lattice where the prior has left its middle, and turn it with the vehicle; whether it did."""
        turned = False
        yaw = float(stops.pose[low, 3])
        if abs(np.mod(yaw - self._facing_rad + np.pi, 2.0 * np.pi) - np.pi) > _TURN_RAD:
            self._facing_rad, turned = yaw, True
        if np.all(np.abs(astray[low] - self.origin_m) <= SLACK_M):
            return turned
        ahead = astray[low:high]
        near = np.median(ahead[np.all(np.abs(ahead - astray[low]) <= SLACK_M, axis=1)], axis=0)
        self.origin_m = near if np.all(np.abs(astray[low] - near) <= SLACK_M) else astray[low].copy()
        return turned or self.place_m is None

    @property
    def region_m(self) -> float:
        """Half side of the region about the prior as it is now."""
        return self.half_m * (2.0 if self.wide else 1.0)

    @property
    def middle_m(self) -> Float[np.ndarray, "2"]:
        """The lattice's middle, east and north from dead reckoning."""
        return self.origin_m if self.place_m is None else self.place_m

    @property
    def points(self) -> tuple[int, int]:
        """Of the lattice, forward and left."""
        return self._plan.points(self.region_m + SLACK_M if self.place_m is None else HELD_M)

    def point_of(self, error_m: Float[np.ndarray, "*stop 2"]) -> Float[np.ndarray, "*stop 2"]:
        """Lattice point of an error of the prior, east and north from dead reckoning."""
        about_m = (error_m - self.middle_m) @ _turn(self._facing_rad).T
        return np.asarray((about_m + self._corner_m(self.points)) / self._plan.lattice_m)

    def error_of(
        self,
        point: Float[np.ndarray, "*stop 2"],
        middle_m: Float[np.ndarray, "2"] | None = None,
        points: tuple[int, int] | None = None,
    ) -> Float[np.ndarray, "*stop 2"]:
        """The reverse of ``point_of``, for this lattice or another."""
        about_m = point * self._plan.lattice_m - self._corner_m(points or self.points)
        return np.asarray(about_m @ _turn(self._facing_rad) + (self.middle_m if middle_m is None else middle_m))

    def blank(self, stops: int, points: tuple[int, int] | None = None) -> Surfaces:
        """Surfaces of stops that hear nothing."""
        planes, points = len(self.heights_m) + 2, self.points if points is None else points
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
    ) -> Surfaces:
        """Surfaces of some stops, about another middle and of other points where these are given."""
        middle_m, points = self.middle_m if middle_m is None else middle_m, points or self.points
        out = self.blank(len(at), points)
        centre = stops.reckoned_m[at] + middle_m
        tiles = self.tiles_at(centre, float(np.max(self._corner_m(points))))
        known = np.flatnonzero(tiles >= 0)
        for aspect, rows in self._prepared.aspects(tiles[known], stops.pose[at[known], 3], stops.speed_mps[at[known]]):
            rows = known[rows]
            for low in range(0, len(rows), self._batch):
                some = rows[low : low + self._batch]
                made = self._on_tile(stops, at[some], coefficients[some], centre[some], aspect, points)
                for whole, part in zip(out, made, strict=True):
                    whole[some] = part[: len(some)]
        return out

    def _on_tile(
        self,
        stops: Stops,
        at: Int[np.ndarray, " stop"],
        coefficients: Float[np.ndarray, "stop channel coefficient"],
        centre: Float[np.ndarray, "stop 2"],
        aspect: Aspect,
        points: tuple[int, int],
    ) -> Surfaces:
        ground, ready = self._ground, self._prepared.at(aspect)
        frame, fill = ground.frame(aspect.tile), self._batch - len(at)
        aside = _turn(self._facing_rad - frame[2])
        half = self._corner_m(points) @ aside
        rows = np.concatenate([at, np.full(fill, at[0])])
        middle = np.concatenate([centre, np.tile(centre[:1], (fill, 1))])
        pose = stops.pose[rows]
        corner = to_tile(np.concatenate([middle, pose[:, 2:]], axis=1), frame)[:, :2] - half
        above = pose[:, 2, None] + self._left_m * np.sin(pose[:, 4, None])
        made = scan_surfaces(
            ready.columns,
            ground.components,
            ScanBatch(
                np.concatenate([coefficients, np.tile(coefficients[:1], (fill, 1, 1))]),
                stops.valid[rows],
                (above - ground.source.height_reference_m[aspect.tile]).astype(np.float32),
                corner.astype(np.float32),
            ),
            (self._plan.lattice_m[:, None] * aside).astype(np.float32),
            (self._decoys_about @ aside + half).astype(np.float32),
            self.heights_m,
            ground.basis.angular_frequency_rad_per_ns,
            points=points,
            box=self._box(points, ready.columns.power.shape),
        )
        return Surfaces(*(np.asarray(part) for part in made))

    def _box(self, points: tuple[int, int], places: tuple[int, ...]) -> tuple[int, int] | None:
        """Places of a tile that hold the lattice however it is turned; None where these are not few."""
        across_m = float(np.linalg.norm((np.asarray(points) - 1) * self._plan.lattice_m))
        along, cross = (
            min(int(np.ceil(across_m / step_m)) + 3, count)
            for step_m, count in zip(self._prepared.step_m, places, strict=True)
        )
        return (along, cross) if _FEW * along * cross < places[0] * places[1] else None

    def _corner_m(self, points: tuple[int, int]) -> Float[np.ndarray, "2"]:
        """Forward and left, in metres, from a lattice's first point to its middle."""
        return np.asarray((np.asarray(points) // 2) * self._plan.lattice_m)

    @property
    def _decoys_about(self) -> Float[np.ndarray, "decoy 2"]:
        """Forward and left of places beyond the region: evenly ahead and behind, as far to the sides as it is."""
        number, half_m = np.arange(_DECOYS), self.half_m
        forward, left = np.mod(0.5 + number * 0.7548776662, 1.0), np.mod(0.5 + number * 0.5698402910, 1.0)
        least_m = half_m + self._wavelength_m
        ahead = np.where(number % 2 == 0, 1.0, -1.0) * (least_m + forward * decoy_reach_m(self._wavelength_m))
        # Half of them on the vehicle's own line: a map may be no wider than that.
        pitch_m = self._ground.description.channel_pitch_m
        aside = np.where(number % 4 < 2, half_m + 0.5, 0.5 * pitch_m)
        return np.stack([ahead, (2.0 * left - 1.0) * aside], axis=1)

    def tiles_at(self, places_m: Float[np.ndarray, "stop 2"], reach_m: float) -> Int[np.ndarray, " stop"]:
        """Tile of each place; -1 for none. Asked for anew every half metre: a tile holds more than it must."""
        out = np.full(len(places_m), -1)
        asked: Float[np.ndarray, 2] | None = None
        tile: int | None = None
        for row, place in enumerate(places_m):
            if asked is None or np.max(np.abs(place - asked)) > _TILE_ROOM_M:
                tile, asked = self._tile_at(place, reach_m + _TILE_ROOM_M), place
            out[row] = -1 if tile is None else tile
        return out

    def _tile_at(self, place_m: Float[np.ndarray, "2"], reach_m: float) -> int | None:
        """One of those used lately, the newest first, or the nearest: what is made of a tile is made once."""
        nearest = self._ground.tile_near(place_m, reach_m)
        if nearest is None:
            return None
        for tile in self._lately:
            if self._ground.serves(tile, nearest, place_m, reach_m):
                return tile
        self._lately = [nearest, *self._lately[: _LATELY - 1]]
        return nearest


def _turn(angle_rad: float) -> Float[np.ndarray, "2 2"]:
    """What a row of forward and left is multiplied by to be one of east and north."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, sin], [-sin, cos]])
