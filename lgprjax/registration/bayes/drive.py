"""The filter led along a drive: stops in chunks, the lattice where the posterior is, tiles under it (host side).

Where nothing is known the lattice covers the region about the prior, at every time scale and height. Once a place is
known, a small lattice about it is enough, with the neighbouring alternatives: all the rest counts as foreign ground,
whose evidence is one. Where foreign ground wins, the whole region is searched anew. Each is a compiled shape.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from lgprjax.radar import LIGHT_SPEED_M_PER_NS, WAVE_SPEED_M_PER_NS, centre_of
from lgprjax.registration.bayes.filter import FilterState, Model, Posterior, Stop, begin, run
from lgprjax.registration.bayes.heading import HeadingError
from lgprjax.registration.bayes.likelihood import RHOS, Likelihood
from lgprjax.registration.bayes.score import LatticeGround, channel_offsets, lattice_ground, live_components, surfaces
from lgprjax.registration.estimates import WIDEST
from lgprjax.registration.judge import RegisterOptions
from lgprjax.registration.lattice import _heights
from lgprjax.registration.queries import LiveChain, LiveScans, Stops, rotation
from lgprjax.registration.template_bank import PreparedGround

CHUNK = 16
"""Stops of a chunk: a compiled shape."""
SPACING = 0.25  # of the wavelength, from stop to stop
_STEP = 0.2  # of the wavelength, from place to place, and no more than
_MOST_STEP_M = 0.08  # as 0.3 m aside is another place, which the posterior must not reach by leaps
_COMPONENTS = 32
_SEARCHING_M = 0.06  # from stop to stop while the whole region is searched, where short waves would have them closer
_NARROW = 2  # channels
_SCALES = np.arange(0.92, 1.1301, 0.015)
_NEAR_SCALE = 0.0075
_ROOM_M = 0.5  # by which the lattice reaches beyond the region
_HELD = 1.5  # wavelengths about a known place, and no less than
_HELD_M = 0.5
_APART = 8.0  # wavelengths from the mode at which layered ground does not resemble that of the mode any more
_DECIDED, _LOST = 3e-5, 0.5  # mass elsewhere below which a place is known, and above which it is lost
_PRIOR_FOREIGN = 0.5
_LEAK_LOST, _LEAK_FOREIGN, _LEAK_BACK, _MIXING = 1e-5, 1e-5, 1e-3, 0.02  # a metre
_WANDER_M = 0.02  # of dead reckoning, per root of a metre
_LEAP = 0.01  # probability that a step of positions was one of the vehicle
_LEAP_M, _LEAP_NOISES = 0.1, 6.0
SMOOTH_M = 2.0  # of travel over which the prior's offset from dead reckoning is estimated
_WIDEN_M = 4.0
"""Travel without a place from which on heights far from the log's are searched as well."""
_FAR_HEIGHTS = 0.1  # of the mass beyond the lattice, on such heights
_TILE_M = 0.5  # of travel from which on a tile is looked up again
_DIRECT = 0.5


class Alternatives(NamedTuple):
    """Time scales and what is added to the prior's height, a plane each."""

    scale: Float[np.ndarray, " plane"]
    height_m: Float[np.ndarray, " plane"]

    @staticmethod
    def grid(scale: Float[np.ndarray, " _"], height_m: Float[np.ndarray, " _"]) -> "Alternatives":
        """All pairs."""
        s, h = np.meshgrid(scale, height_m, indexing="ij")
        return Alternatives(s.ravel(), h.ravel())

    def neighbours(self, scale_step: float, height_step_m: float) -> Float[np.ndarray, "plane plane"]:
        """1 where two differ by one step."""
        apart = np.abs(self.scale[:, None] - self.scale) / scale_step
        apart += np.abs(self.height_m[:, None] - self.height_m) / height_step_m
        return np.asarray(((apart > 0.1) & (apart < 1.1)).astype(np.float32))

    def nearest(self, of: "Alternatives", scale_step: float, height_step_m: float) -> Float[np.ndarray, "plane other"]:
        """Share of each other's mass that these take: all of it goes to the nearest."""
        apart = ((self.scale[:, None] - of.scale) / scale_step) ** 2
        apart += ((self.height_m[:, None] - of.height_m) / height_step_m) ** 2
        return np.asarray((np.arange(len(self.scale))[:, None] == np.argmin(apart, axis=0)).astype(np.float32))


class Followed(NamedTuple):
    """The filter's report of each stop, and where its lattice was.

    Attributes:
        error_m: mode of the error of dead reckoning, east and north.
        p_false, foreign, rim, r, cover, widest, variance, aside_m2: see ``Posterior``.
        heading: of the prior, corrected, radians.
        turn_rad, turn_sigma_rad: what corrects the prior's heading, and its standard deviation.
        scale, height_m: mean over the alternatives.
        rho: mean of the repeatability.
        crop: mass of the places about the mode; ``first_m`` the error at the crop's first place, ``yaw`` its axis.
    """

    error_m: Float[np.ndarray, "stop 2"]
    p_false: Float[np.ndarray, " stop"]
    foreign: Float[np.ndarray, " stop"]
    rim: Float[np.ndarray, " stop"]
    r: Float[np.ndarray, " stop"]
    cover: Float[np.ndarray, " stop"]
    widest: Float[np.ndarray, " stop"]
    variance: Float[np.ndarray, " stop"]
    aside_m2: Float[np.ndarray, " stop"]
    heading: Float[np.ndarray, " stop"]
    turn_rad: Float[np.ndarray, " stop"]
    turn_sigma_rad: Float[np.ndarray, " stop"]
    scale: Float[np.ndarray, " stop"]
    height_m: Float[np.ndarray, " stop"]
    rho: Float[np.ndarray, " stop"]
    crop: Float[np.ndarray, "stop _ _"]
    first_m: Float[np.ndarray, "stop 2"]
    yaw: Float[np.ndarray, " stop"]


@dataclass
class _Lattice:
    """Where the state's lattice is: centre as an error of dead reckoning, axes of a tile, alternatives."""

    centre_m: Float[np.ndarray, "2"]
    yaw: float
    shape: tuple[int, int]
    planes: Alternatives
    held: bool


class DriveFilter:
    """The filter of one drive.

    Args:
        prepared: ground of the map for the drive's array.
        chain: of the drive.
        options: of the search.
        likelihood: of map and array.
        chunk: stops led through the filter together; 1 on board.

    Attributes:
        fix_tile: that the last fix was refined on.
    """

    def __init__(
        self,
        prepared: PreparedGround,
        chain: LiveChain,
        options: RegisterOptions,
        likelihood: Likelihood,
        chunk: int = CHUNK,
    ) -> None:
        self._prepared, self.ground, self._chain, self._options = prepared, prepared.ground, chain, options
        self.likelihood, self._chunk = likelihood, chunk
        self.wavelength_m = self.ground.description.settings.wavelength_m
        self.spacing_m = SPACING * self.wavelength_m
        spec, _ = self.ground.grid_of(0)
        cell_m = np.array([spec.along_cell_m, spec.cross_cell_m])
        # Lines of one or two channels are hardly wider than their pitch: places farther apart would miss them.
        description = self.ground.description
        narrow = min(description.channels, len(prepared.array.x_m)) <= _NARROW
        least_m = min(_STEP * self.wavelength_m, _MOST_STEP_M)
        wanted_m = least_m, min(least_m, description.channel_pitch_m * (0.5 if narrow else 1.0))
        self._stride = tuple(int(max(1, round(w / each + 1e-6))) for w, each in zip(wanted_m, cell_m, strict=True))
        # Cells grow with the wavelength, what counts as another place does not.
        self._finer = tuple(int(np.ceil(each / _MOST_STEP_M - 1e-6)) for each in cell_m)
        self.step_m = cell_m * np.array(self._stride) / np.array(self._finer)
        self._components = self.ground.components[:, :_COMPONENTS]
        centre, array = centre_of(prepared.array), prepared.array
        self._body_m = np.stack([array.x_m - centre[0], array.y_m - centre[1]], axis=1)
        # Half a period of delay is 0.5 c T / 2 of height: a quarter of a period leaves an eighth to either side.
        period_m = 0.5 * LIGHT_SPEED_M_PER_NS * self.wavelength_m / WAVE_SPEED_M_PER_NS
        self._height_step_m = {False: 0.25 * period_m, True: 0.125 * period_m}
        self._scale_step = {False: float(_SCALES[1] - _SCALES[0]), True: _NEAR_SCALE}
        self.crop = 2 * int(np.ceil(max(_HELD * self.wavelength_m, _HELD_M) / self.step_m.min())) + 1
        self._half_m = options.search_half_m()
        self._tiles: dict[tuple[int, int], LatticeGround] = {}
        self._tile: int | None = None
        self._widen_at_m, self._apart_m = np.inf, _SEARCHING_M
        self._heading = HeadingError()
        self._state: FilterState | None = None
        self._lattice: _Lattice | None = None
        self._last: tuple[float, int, Float[np.ndarray, 2]] | None = None
        self._steps: list[float] = []
        self._told: Followed | None = None
        self.fix_tile: int | None = None

    def choose(self, scans: LiveScans, next_m: float) -> tuple[Int[np.ndarray, " stop"], float]:
        """Scans that become stops, and travel of the next, see ``first_of_each``."""
        return first_of_each(scans.path_m, self.spacing_m, next_m)

    def follow(self, stops: Stops, astray: Float[np.ndarray, "stop 2"]) -> Followed:
        """Lead the filter over stops, which go on from those before.

        Args:
            stops: in the order of travel, or against it.
            astray: prior minus dead reckoning at each, east and north.
        """
        parts: list[Followed] = []
        low, count = 0, len(stops.number)
        while low < count:
            if self._lost(stops, low):
                self._heading = HeadingError()
                own, apart = stops, np.zeros_like(astray)
                self._begin(astray[low], float(stops.path_m[low]))
            else:
                own, apart = self._corrected(stops)
            self._place_lattice(own, astray - apart, low)
            heard, high = self._heard_of(own, low)
            at = np.searchsorted(heard, np.arange(low, high), side="right") - 1
            # Stops that are not heard have the report of the one before.
            if len(heard):
                told = self._follow_chunk(own, heard)
                self._told = Followed(*(field[-1:] for field in told))
                each = Followed(*(field[np.maximum(at, 0)] for field in told))
                place_m, sigma_rad = own.reckoned_m[heard] + told.error_m, float(np.median(stops.sigma_yaw_rad[heard]))
                self._heading.hear(stops.path_m[heard], stops.reckoned_m[heard], place_m, told.p_false, sigma_rad)
            else:
                assert self._told is not None
                each = Followed(*(np.repeat(field, high - low, axis=0) for field in self._told))
            # Reports are of dead reckoning as recorded.
            error_m, first_m = (field + apart[low:high] for field in (each.error_m, each.first_m))
            parts.append(each._replace(error_m=error_m, first_m=first_m))
            low = high
        return Followed(*(np.concatenate(field) for field in zip(*parts, strict=True)))

    def _heard_of(self, stops: Stops, low: int) -> tuple[Int[np.ndarray, " heard"], int]:
        """Stops of a chunk that are heard, and the first of the next: fewer while the whole region is searched."""
        assert self._lattice is not None
        apart_m, limit = 0.0 if self._lattice.held else self._apart_m, self._end_of_chunk(stops, low)
        heard: list[int] = []
        last_m = self._last[0] if self._last is not None and self._last[1] == stops.leg[low] else -np.inf
        for at in range(low, limit):
            if stops.path_m[at] >= last_m + apart_m - 0.5 * self.spacing_m:
                if len(heard) == self._chunk:
                    return np.asarray(heard, dtype=int), at
                heard.append(at)
                last_m = float(stops.path_m[at])
        return np.asarray(heard, dtype=int), limit

    # The heading's error.

    def _corrected(self, stops: Stops) -> tuple[Stops, Float[np.ndarray, "stop 2"]]:
        """Stops with headings and dead reckoning corrected, and how far that moves each."""
        if not self._heading.used:
            return stops, np.zeros_like(stops.reckoned_m)
        reckoned_m, pose = self._heading.corrected_m(stops.reckoned_m), stops.pose.copy()
        pose[:, 3] += self._heading.turn_rad
        return stops._replace(pose=pose, reckoned_m=reckoned_m), reckoned_m - stops.reckoned_m

    # Where the lattice is.

    def _lost(self, stops: Stops, at: int) -> bool:
        """Nothing is known, another stretch of travel begins, or foreign ground has won."""
        if self._state is None or self._last is None or self._last[1] != stops.leg[at]:
            return True
        assert self._lattice is not None
        return self._lattice.held and float(self._state.foreign) > _LOST

    def _place_lattice(self, stops: Stops, astray: Float[np.ndarray, "stop 2"], at: int) -> None:
        """Narrow the lattice down, add heights, or move it, before a chunk."""
        assert self._lattice is not None
        lattice = self._lattice
        if lattice.held:
            self._recentre()
        else:
            self._narrow()
            if self._lattice is lattice and stops.path_m[at] > self._widen_at_m:
                self._add_heights()
            if not lattice.held and np.max(np.abs(astray[at] - lattice.centre_m)) > _ROOM_M:
                self._shift(np.round(self._to_lattice(astray[at] - lattice.centre_m) / self.step_m).astype(int))
        self._find_tile(stops, at)

    def _begin(self, centre_m: Float[np.ndarray, "2"], path_m: float) -> None:
        options, half_m = self._options, self._half_m + _ROOM_M
        scales = _SCALES if options.time_scale is None else np.array([options.time_scale])
        heights_m = _heights(options.height_m, self._height_step_m[False])
        planes = Alternatives.grid(scales, heights_m)
        along, cross = (2 * int(np.ceil(half_m / each)) + 1 for each in self.step_m)
        shape = (along, cross)
        yaw = 0.0 if self._lattice is None else self._lattice.yaw
        self._lattice = _Lattice(np.asarray(centre_m, float), yaw, shape, planes, held=False)
        self._widen_at_m, self._apart_m = path_m + _WIDEN_M, _SEARCHING_M
        variance = self.likelihood.variance if self._state is None else self._state.variance
        self._state = begin(len(planes.scale), shape, _PRIOR_FOREIGN, float(variance))

    def _narrow(self) -> None:
        """A small lattice about the mode, once nearly all mass is there."""
        assert self._state is not None
        assert self._lattice is not None
        mass = self._state.mass
        place = np.asarray(jnp.sum(mass, axis=(0, 1)))
        mode = np.array(np.unravel_index(np.argmax(place), place.shape))
        half = np.ceil(max(_HELD * self.wavelength_m, _HELD_M) / self.step_m).astype(int)
        low, high = np.maximum(mode - half, 0), np.minimum(mode + half + 1, place.shape)
        near = float(place[low[0] : high[0], low[1] : high[1]].sum())
        if 1.0 - near > _DECIDED:
            return
        lattice = self._lattice
        plane = np.asarray(jnp.sum(mass, axis=(1, 2, 3)))
        best = int(np.argmax(plane))
        planes = self._near(lattice.planes.scale[best], lattice.planes.height_m[best])
        share = planes.nearest(lattice.planes, self._scale_step[False], self._height_step_m[False])
        padded = jnp.pad(mass, [(0, 0), (0, 0), (half[0],) * 2, (half[1],) * 2])
        shape = (int(2 * half[0] + 1), int(2 * half[1] + 1))
        cut = jax.lax.dynamic_slice(padded, (0, 0, *mode), (*mass.shape[:2], *shape))
        self._take(jnp.einsum("gh,hrij->grij", jnp.asarray(share), cut))
        moved_m = (mode - np.asarray(lattice.shape) // 2) * self.step_m
        centre_m = lattice.centre_m + rotation(lattice.yaw) @ moved_m
        self._lattice = replace(lattice, centre_m=centre_m, shape=shape, planes=planes, held=True)

    def _add_heights(self) -> None:
        """Heights far from the log's, with some of the mass beyond the lattice."""
        assert self._state is not None
        assert self._lattice is not None
        planes, step_m = self._lattice.planes, self._height_step_m[False]
        wide = Alternatives.grid(np.unique(planes.scale), _heights(max(self._options.height_m, WIDEST[0]), step_m))
        share = wide.nearest(planes, self._scale_step[False], step_m)
        fresh = share.sum(axis=1) == 0.0
        mass = jnp.einsum("gh,hrij->grij", jnp.asarray(share), self._state.mass)
        each = _FAR_HEIGHTS * self._state.foreign / float(max(fresh.sum(), 1) * mass[0].size)
        self._take(mass + each * jnp.asarray(fresh, jnp.float32)[:, None, None, None])
        self._lattice, self._widen_at_m = replace(self._lattice, planes=wide), np.inf
        # A stop costs as many planes more: fewer are heard.
        self._apart_m *= len(wide.scale) / len(planes.scale)

    def _near(self, scale: float, height_m: float) -> Alternatives:
        """Alternatives about one."""
        about = np.array([-1.0, 0.0, 1.0])
        scales = scale + _NEAR_SCALE * about if self._options.time_scale is None else np.array([scale])
        return Alternatives.grid(scales, height_m + self._height_step_m[True] * about)

    def _recentre(self) -> None:
        """Follow the mode in place and in the alternatives."""
        assert self._state is not None
        assert self._lattice is not None
        mass = self._state.mass
        place = np.asarray(jnp.sum(mass, axis=(0, 1)))
        mode = np.array(np.unravel_index(np.argmax(place), place.shape))
        away = mode - np.asarray(self._lattice.shape) // 2
        if np.max(np.abs(away)) > 2:
            self._shift(away)
        lattice = self._lattice
        plane = np.asarray(jnp.sum(self._state.mass, axis=(1, 2, 3)))
        best = int(np.argmax(plane))
        if best != len(plane) // 2:
            planes = self._near(lattice.planes.scale[best], lattice.planes.height_m[best])
            share = planes.nearest(lattice.planes, self._scale_step[True], self._height_step_m[True])
            self._take(jnp.einsum("gh,hrij->grij", jnp.asarray(share), self._state.mass))
            self._lattice = replace(lattice, planes=planes)

    def _shift(self, cells: Int[np.ndarray, "2"]) -> None:
        """Move the lattice by whole places; what falls off is elsewhere."""
        assert self._state is not None
        assert self._lattice is not None
        mass = np.asarray(self._state.mass)
        out = np.zeros_like(mass)
        size = mass.shape[2:]
        to, of = [], []
        for each, length in zip(cells, size, strict=True):
            to.append(slice(max(-each, 0), max(min(length - each, length), 0)))
            of.append(slice(max(each, 0), max(min(length + each, length), 0)))
        out[:, :, to[0], to[1]] = mass[:, :, of[0], of[1]]
        self._take(jnp.asarray(out))
        moved_m = rotation(self._lattice.yaw) @ (np.asarray(cells) * self.step_m)
        self._lattice = replace(self._lattice, centre_m=self._lattice.centre_m + moved_m)

    def _take(self, mass: jax.Array) -> None:
        """Replace the mass; the missing share counts as elsewhere."""
        assert self._state is not None
        foreign = jnp.maximum(1.0 - jnp.sum(mass), 0.0)
        summed = jnp.zeros(mass.shape[2:], jnp.float32)
        self._state = self._state._replace(
            mass=mass, foreign=foreign.astype(jnp.float32), summed=summed, alone=jnp.float32(0.0)
        )

    def _to_lattice(self, error_m: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
        assert self._lattice is not None
        return np.asarray(error_m @ rotation(self._lattice.yaw))

    # Tiles.

    @property
    def _reach_m(self) -> float:
        assert self._lattice is not None
        return float(np.max(np.asarray(self._lattice.shape) // 2 * self.step_m) + np.max(np.hypot(*self._body_m.T)))

    def _find_tile(self, stops: Stops, at: int) -> None:
        assert self._state is not None
        assert self._lattice is not None
        place = stops.reckoned_m[at] + self._lattice.centre_m
        self._tile = self.ground.tile_holding(self._tile, place, self._reach_m + _TILE_M)
        if self._tile is None:
            return
        yaw = float(self.ground.frame(self._tile)[2])
        turn = float(np.mod(yaw - self._lattice.yaw + np.pi, 2.0 * np.pi) - np.pi)
        if abs(turn) > 1e-4:
            mass = _turned(self._state.mass, jnp.float32(turn), jnp.asarray(self.step_m, jnp.float32))
            self._state = self._state._replace(mass=mass)
            self._lattice = replace(self._lattice, yaw=yaw)

    def _end_of_chunk(self, stops: Stops, low: int) -> int:
        """The first stop that does not share leg, tile and direction with ``low``, or is as many stops ahead as a chunk
        holds.
        """
        assert self._lattice is not None
        most = self._chunk * (1 if self._lattice.held else max(1, round(self._apart_m / self.spacing_m)))
        high = min(low + most, len(stops.number))
        same = stops.leg[low:high] == stops.leg[low]
        away = np.hypot(*(stops.reckoned_m[low:high] - stops.reckoned_m[low]).T)
        for at in range(low + 1, high):
            if not same[at - low] or self._direction(stops, at) != self._direction(stops, low):
                return at
            if self._tile is None or (away[at - low] > _TILE_M and at % 4 == 0):
                place = stops.reckoned_m[at] + self._lattice.centre_m
                if self.ground.tile_holding(self._tile, place, self._reach_m + _TILE_M) != self._tile:
                    return at
        return high

    def _direction(self, stops: Stops, at: int) -> int:
        """Of the live filter along the tile's axis, see ``GroundMap.tile``."""
        if self._tile is None:
            return 0
        moving = np.cos(stops.pose[at, 3] - self.ground.frame(self._tile)[2])
        moving *= -1.0 if stops.speed_mps[at] < 0.0 else 1.0
        return int(np.sign(moving)) if abs(moving) > _DIRECT else 0

    @property
    def _whole(self) -> tuple[int, int]:
        half = np.ceil((self._half_m + _ROOM_M) / self.step_m).astype(int)
        return int(half[0]), int(half[1])

    @property
    def places(self) -> int:
        """Of the whole lattice."""
        return (2 * self._whole[0] + 1) * (2 * self._whole[1] + 1)

    def _ground_of(self, tile: int, direction: int, border: tuple[int, int]) -> LatticeGround:
        key = (tile, direction)
        if key not in self._tiles:
            if len(self._tiles) >= 4:
                self._tiles.pop(next(iter(self._tiles)))
            made = self.ground.tile(tile, direction)
            self._tiles[key] = lattice_ground(
                made, self._components, stride=self._stride, finer=self._finer, border=border
            )
        return self._tiles[key]

    # A chunk.

    def _follow_chunk(self, stops: Stops, heard: Int[np.ndarray, " heard"]) -> Followed:
        assert self._state is not None
        travel_m, leap = self._travel(stops, heard)
        chunk, ground, reach = self._heard(stops, heard, travel_m, leap)
        self._state, posterior = run(self._state, chunk, ground, self._model(), reach=reach, crop=self.crop)
        last = int(heard[-1])
        self._last = float(stops.path_m[last]), int(stops.leg[last]), self._raw(stops, last)
        return self._reported(
            jax.tree.map(lambda field: np.asarray(field)[: len(heard)], posterior), stops.pose[heard, 3]
        )

    def _heard(
        self,
        stops: Stops,
        heard: Int[np.ndarray, " heard"],
        travel_m: Float[np.ndarray, " stop"],
        leap: Float[np.ndarray, " stop"],
    ) -> tuple[Stop, LatticeGround, tuple[int, int]]:
        """A chunk filled to its size, its ground, and how many places its channels reach."""
        assert self._lattice is not None
        lattice, count = self._lattice, len(heard)
        at = np.concatenate([heard, np.full(self._chunk - count, heard[-1])])
        forward_m = self._body_m[None, :, 0] + stops.speed_mps[at, None] * self._prepared.array.time_offset_s
        body_m = np.stack([forward_m, np.broadcast_to(self._body_m[:, 1], forward_m.shape)], axis=-1)
        most_m = float(np.max(np.hypot(body_m[..., 0], body_m[..., 1])))
        reach = (_fours(most_m / self.step_m[0]), _fours(most_m / self.step_m[1]))
        # A prior outside a narrow map has its lattice's middle up to half the region beyond the grid.
        border = (2 * self._whole[0] + reach[0] + 2, 2 * self._whole[1] + reach[1] + 2)
        tile = 0 if self._tile is None else self._tile
        frame = self.ground.frame(tile)
        ground = self._ground_of(tile, self._direction(stops, int(heard[0])), border)
        origin_m = np.asarray(self.ground.tile(tile).origin_m, np.float64)
        about = (stops.reckoned_m[at] + lattice.centre_m - frame[:2]) @ rotation(frame[2])
        corner = (about - origin_m) / self.step_m - np.asarray(lattice.shape) // 2 + np.asarray(border)
        room = np.asarray(ground.power.shape) - np.asarray(lattice.shape) - np.asarray(reach) - 2
        inside = np.all((corner >= np.asarray(reach)) & (corner < room), axis=1) & (self._tile is not None)
        above_m = stops.pose[at, 2, None] + self._body_m[None, :, 1] * np.sin(stops.pose[at, 4, None])
        scales, number = np.unique(lattice.planes.scale, return_inverse=True)
        coefficients = np.stack(
            [self._chain.coefficients(stops.filtered[at], stops.valid[at], float(each)) for each in scales]
        )
        live = live_components(
            coefficients,
            (above_m - self.ground.source.height_reference_m[tile]).astype(np.float32),
            lattice.planes.height_m.astype(np.float32),
            number.astype(np.int32),
            self._components,
            self.ground.basis.angular_frequency_rad_per_ns,
        )
        turn = stops.pose[at, 3] - frame[2]
        wander_m2 = travel_m * (_WANDER_M**2 + np.minimum(stops.sigma_yaw_rad[at], 0.1) ** 2)
        chunk = Stop(
            live=live,
            valid=jnp.asarray(stops.valid[at] & inside[:, None], jnp.float32),
            corner=jnp.asarray(np.where(inside[:, None], corner, np.asarray(reach)), jnp.float32),
            offset=jnp.asarray(channel_offsets(body_m, turn, self.step_m), jnp.float32),
            facing=jnp.asarray(np.stack([np.cos(turn), np.sin(turn)], axis=-1), jnp.float32),
            travel_m=jnp.asarray(travel_m, jnp.float32),
            wander=jnp.asarray(wander_m2[:, None] / self.step_m**2, jnp.float32),
            leap=jnp.asarray(leap, jnp.float32),
            there=jnp.asarray(np.arange(self._chunk) < count),
        )
        return chunk, ground, reach

    def correlations(
        self, stops: Stops, half: int
    ) -> tuple[Float[np.ndarray, "stop place"], Float[np.ndarray, "stop place"]]:
        """Correlation and cover of each stop at places about dead reckoning, ``half`` of them to each side (where the
        lattice is finer than the map's cells, ``half`` cells), at the map's own time scale and height.
        """
        r, cover = [], []
        size = (2 * half * self._finer[0] + 1, 2 * half * self._finer[1] + 1)
        one = Alternatives(np.ones(1), np.zeros(1))
        self._lattice = _Lattice(self._raw(stops, 0), 0.0, size, one, held=True)
        self._state = begin(1, size, 0.5, 0.0)
        low = 0
        while low < len(stops.number):
            self._find_tile(stops, low)
            high = min(self._end_of_chunk(stops, low), low + self._chunk)
            nothing = np.zeros(self._chunk)
            chunk, ground, reach = self._heard(stops, np.arange(low, high), nothing, nothing)
            made = surfaces(ground, chunk.live, chunk.valid, chunk.corner, chunk.offset, shape=size, reach=reach)
            r.append(np.asarray(made.r)[: high - low, 0].reshape(high - low, -1))
            cover.append(np.asarray(made.cover)[: high - low].reshape(high - low, -1))
            low = high
        return np.concatenate(r), np.concatenate(cover)

    def _raw(self, stops: Stops, at: int) -> Float[np.ndarray, "2"]:
        return np.asarray(stops.pose[at, :2] - stops.reckoned_m[at])

    def _travel(
        self, stops: Stops, heard: Int[np.ndarray, " heard"]
    ) -> tuple[Float[np.ndarray, " stop"], Float[np.ndarray, " stop"]]:
        """Travel to each stop of a chunk, and the probability that dead reckoning was lost on the way."""
        low = int(heard[0])
        before = float(stops.path_m[low]) - self.spacing_m, self._raw(stops, low)
        if self._last is not None and self._last[1] == stops.leg[low]:
            before = self._last[0], self._last[2]
        travel_m, leap = np.zeros(self._chunk), np.zeros(self._chunk)
        for number, at in enumerate(heard):
            here = self._raw(stops, at)
            travel_m[number] = max(stops.path_m[at] - before[0], 0.0)
            moved_m = float(np.hypot(*(here - before[1])))
            if self._steps and moved_m > _LEAP_M + _LEAP_NOISES * float(np.median(self._steps)):
                leap[number] = _LEAP
            self._steps = [*self._steps[-31:], moved_m]
            before = float(stops.path_m[at]), here
        return travel_m, leap

    def _model(self) -> Model:
        assert self._lattice is not None
        held = self._lattice.held
        # From foreign ground mass comes back to the whole region, of which a small lattice is a part.
        share = float(np.prod(self._lattice.shape)) / float(np.prod([2 * each + 1 for each in self._whole]))
        lost = _LEAK_LOST * (share if held else 1.0)
        foreign = _LEAK_FOREIGN + (_LEAK_LOST - lost)
        known, neighbour = self.likelihood, self._lattice.planes.neighbours
        return Model(
            likelihood=Likelihood(*(jnp.float32(field) for field in (known.variance, known.memory, known.tail))),
            step_m=jnp.asarray(self.step_m, jnp.float32),
            wavelength_m=jnp.float32(self.wavelength_m),
            spacing_m=jnp.float32(self.spacing_m),
            apart=jnp.float32(_APART * self.wavelength_m / self.step_m[0]),
            lost=jnp.float32(lost),
            foreign=jnp.float32(foreign),
            back=jnp.float32(_LEAK_BACK * min(share, 1.0)),
            mixing=jnp.float32(_MIXING),
            neighbour=jnp.asarray(neighbour(self._scale_step[held], self._height_step_m[held])),
            whole=jnp.asarray(not held),
        )

    def _reported(self, posterior: Posterior, heading: Float[np.ndarray, " heard"]) -> Followed:
        assert self._lattice is not None
        lattice = self._lattice
        half = np.asarray(lattice.shape) // 2
        turn = rotation(lattice.yaw).T
        count = len(posterior.p_false)
        plane = np.asarray(posterior.plane)
        share = plane / np.maximum(plane.sum(axis=1, keepdims=True), 1e-30)
        rho = np.asarray(posterior.rho)
        crop = np.zeros((count, self.crop, self.crop), np.float32)
        size = posterior.crop.shape[1:]
        crop[:, : size[0], : size[1]] = posterior.crop
        same = ("p_false", "foreign", "rim", "r", "cover", "widest", "variance", "aside_m2")
        return Followed(
            error_m=lattice.centre_m + ((posterior.mode - half) * self.step_m) @ turn,
            heading=heading,
            turn_rad=np.full(count, self._heading.turn_rad),
            turn_sigma_rad=np.full(count, self._heading.sigma_rad),
            scale=share @ lattice.planes.scale,
            height_m=share @ lattice.planes.height_m,
            rho=rho @ np.asarray(RHOS) / np.maximum(rho.sum(axis=1), 1e-30),
            crop=crop,
            first_m=lattice.centre_m + ((posterior.crop_at - half) * self.step_m) @ turn,
            yaw=np.full(count, lattice.yaw),
            **{name: np.asarray(getattr(posterior, name), np.float64) for name in same},
        )


def first_of_each(
    path_m: Float[np.ndarray, " scan"], spacing_m: float, next_m: float
) -> tuple[Int[np.ndarray, " stop"], float]:
    """The first scan of each step of travel from ``next_m`` on, and travel of the next."""
    chosen = []
    for scan, at_m in enumerate(path_m):
        if at_m >= next_m - 1e-9:
            chosen.append(scan)
            next_m = max(next_m, float(at_m) - 0.5 * spacing_m) + spacing_m
    return np.asarray(chosen, dtype=int), next_m


def _fours(places: float) -> int:
    """Whole fours of places that hold so many and one more: few shapes are compiled."""
    return 4 * int(np.ceil((places + 1.0) / 4.0))


def astray_of(stops: Stops) -> Float[np.ndarray, "stop 2"]:
    """Prior minus dead reckoning at each stop: the median over the last metres, to suppress the noise of positions."""
    apart = stops.pose[:, :2] - stops.reckoned_m
    first = np.searchsorted(stops.path_m, stops.path_m - SMOOTH_M)
    first = np.maximum(first, np.searchsorted(stops.leg, stops.leg))
    return np.stack([np.median(apart[low : at + 1], axis=0) for at, low in enumerate(first)])


@jax.jit
def _turned(mass: jax.Array, turn: jax.Array, step_m: jax.Array) -> jax.Array:
    """Mass on a lattice whose axes are turned by an angle, with the same centre and sum."""
    size = mass.shape[2:]
    x = (jnp.arange(size[0], dtype=jnp.float32) - size[0] // 2)[:, None] * step_m[0]
    y = (jnp.arange(size[1], dtype=jnp.float32) - size[1] // 2)[None] * step_m[1]
    cos, sin = jnp.cos(turn), jnp.sin(turn)
    at = [(cos * x - sin * y) / step_m[0] + size[0] // 2, (sin * x + cos * y) / step_m[1] + size[1] // 2]

    def one(plane: jax.Array) -> jax.Array:
        found: jax.Array = jax.scipy.ndimage.map_coordinates(plane, at, order=1, mode="nearest")
        return found

    moved = jax.vmap(jax.vmap(one))(mass)
    turned: jax.Array = moved * (jnp.sum(mass) / jnp.maximum(jnp.sum(moved), 1e-30))
    return turned
