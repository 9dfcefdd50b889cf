"""The search by a particle swarm: place, height and attitude at once, on the score itself, without a lattice.

The search of the first system of this kind (LL). It begins anywhere in its region and knows no derivative; region,
particles and iterations follow the correlation: small where the last place was certain, the whole region where it was
not. Evidence, codes, probabilities and the time scale are those of the exhaustive search, which it can replace and
check: a place that both accept was found in two ways.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt32

from lgprjax.pso import SwarmConfig, run_swarm
from lgprjax.registration.candidates import ChosenWindows
from lgprjax.registration.coarse import NEAR_RIM, Peaks
from lgprjax.registration.evidence import CARRIED_M, CHUNK_M, DRIFT, EvidenceSearch
from lgprjax.registration.fix import Code
from lgprjax.registration.queries import Stops, templates_of
from lgprjax.registration.score import OFF_MAP_SCORE, Template, score_poses
from lgprjax.registration.template_bank import fixes_to_map, to_tile
from lgprjax.registration.windows import APART, LOST_M
from lgprjax.subsurface import Tile

_LEVELS = ((0.25, 0.5), (0.5, 0.75), (1.0, 1.0))
"""Shares of the largest swarm's particles and iterations: around the last place, in a region of some times its side,
and in the whole region."""
_WHOLE = len(_LEVELS) - 1
_WIDER = 3.0  # times the side of the region around the last place
_ATTITUDES = 4.0  # independent ones within what a log claims
_WIDE_ATTITUDES = 15.0  # the same before the ground has confirmed the claims
_DECOYS = 64
_NOW_AND_THEN_M = 1.0  # of travel
_RIM = 0.98  # of the half side of a region


class SwarmPeak(NamedTuple):
    """The best pose that a swarm found in its region, in the tile's frame; scores as of ``Score``.

    Attributes:
        pose: along_m, cross_m, height_m, yaw_rad, roll_rad.
        score: there; ``OFF_MAP_SCORE`` where nothing was on the map.
        rival: best score that a second swarm found at least a distance apart.
        floor: root mean square score at decoys; 0 where too few of them are on the map.
        region_floor: the same of the first positions far from the best.
        overlap: largest share of the template on the map.
        on_map: share of the region on the map.
        ends: the map ends close to the place, on its left and on its right.
    """

    pose: Float[Array, "5"]
    score: Float[Array, ""]
    rival: Float[Array, ""]
    floor: Float[Array, ""]
    region_floor: Float[Array, ""]
    overlap: Float[Array, ""]
    on_map: Float[Array, ""]
    ends: Bool[Array, "2"]


@partial(jax.jit, static_argnames="config")
def search_region(
    tile: Tile,
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    min_overlap: Float[Array, ""],
    template: Template,
    middle: Float[Array, "5"],
    half_width: Float[Array, "5"],
    free: Bool[Array, "5"],
    decoys: Float[Array, "height decoy 5"],
    apart_m: Float[Array, ""],
    seed: UInt32[Array, "2"],
    *,
    config: SwarmConfig,
) -> SwarmPeak:
    """Search a region of poses by a swarm that begins anywhere in it, and for a rival by a second one.

    Args:
        tile, height_reference_m, angular_frequency_rad_per_ns, min_overlap: as for ``score_poses``.
        template: a single one.
        middle, half_width: of the region, in the tile's frame.
        free: degrees of freedom that may move.
        decoys: poses where a match is due to chance; of the heights the best counts.
        apart_m: places closer than this are the same place.
        seed: of the drive and of this search.
        config: of the swarms.
    """

    def score(pose: Float[Array, "particle 5"]) -> tuple[Array, Array]:
        found = score_poses(tile, template, pose, height_reference_m, angular_frequency_rad_per_ns, min_overlap)
        return found.score, found.covered

    def hunt(avoided_m: Float[Array, "2"], key: Array) -> tuple[Array, tuple[Array, Array]]:
        def objective(u: Float[Array, "particle 5"]) -> Float[Array, " particle"]:
            pose = middle[None] + u * half_width[None]
            near = jnp.sum((pose[:, :2] - avoided_m[None]) ** 2, axis=1) < apart_m**2
            return jnp.where(near, -jnp.inf, score(pose)[0])

        end = run_swarm(key, cloud, objective, free, config=config)
        place = middle + end.position * half_width
        return place[:2], (place, jnp.maximum(end.score, OFF_MAP_SCORE))

    keys = jax.random.split(jax.random.fold_in(jax.random.key(seed[0]), seed[1]), 3)
    cloud = jax.random.uniform(keys[0], (config.particles, 5), minval=-1.0, maxval=1.0)
    cloud = jnp.where(free[None], cloud, 0.0)
    # One after the other, as one program: the second avoids what the first has found.
    _, (found, scores) = jax.lax.scan(hunt, jnp.full(2, jnp.inf), keys[1:])
    pose = found[0]
    begun, places = middle[None] + cloud * half_width[None], decoys.reshape(-1, 5)
    sideways = NEAR_RIM * apart_m * jnp.stack([-jnp.sin(pose[3]), jnp.cos(pose[3])])
    beside = jnp.stack([pose.at[:2].add(sideways), pose.at[:2].add(-sideways)])
    sampled, covered = score(jnp.concatenate([begun, places, beside]))
    chance, decoy, ends = jnp.split(sampled, [len(begun), len(begun) + len(places)])
    decoy = jnp.max(decoy.reshape(decoys.shape[:2]), axis=0)
    traces = jnp.maximum(jnp.sum(template.valid, dtype=jnp.float32), 1.0)
    apart = jnp.sum((begun[:, :2] - pose[None, :2]) ** 2, axis=1) >= 4.0 * apart_m**2
    return SwarmPeak(
        pose,
        scores[0],
        scores[1],
        _root_mean_square(decoy, decoy > OFF_MAP_SCORE, 12),
        _root_mean_square(chance, apart & (chance > OFF_MAP_SCORE), 16),
        jnp.max(jnp.sum(covered[: len(begun)], axis=1, dtype=jnp.float32)) / traces,
        jnp.mean(chance > OFF_MAP_SCORE, dtype=jnp.float32),
        ends <= OFF_MAP_SCORE,
    )


def _root_mean_square(score: Float[Array, " place"], counts: Bool[Array, " place"], least: int) -> Float[Array, ""]:
    """Of the places that count; 0 where they are fewer than ``least``."""
    number = jnp.sum(counts, dtype=jnp.float32)
    mean = jnp.sum(jnp.where(counts, score**2, 0.0)) / jnp.maximum(number, 1.0)
    return jnp.where(number >= least, jnp.sqrt(mean), 0.0)


class _Region(NamedTuple):
    """A region of places around an error of the prior, east and north from dead reckoning."""

    middle_m: Float[np.ndarray, "2"]
    half_m: float
    level: int


class SwarmSearch(EvidenceSearch):
    """Search of one drive by swarms of at most ``options.search_swarm``; arguments as for ``EvidenceSearch``."""

    _window, _level = 0, _WHOLE
    _whole_m = -np.inf

    @property
    def _may_hold(self) -> bool:
        return False

    def _note(self, stops: Stops, high: int, judged: ChosenWindows) -> bool:  # noqa: ARG002
        """Whether there was a fix: each was taken where it was found."""
        return bool(np.any(judged.code == Code.OK))

    def _judge(self, stops: Stops, low: int, high: int, astray: Float[np.ndarray, "stop 2"]) -> ChosenWindows:
        """Stop by stop: the region at each follows from the fix before."""
        at = np.arange(low, high)
        self._make_ready(stops, high)
        fitting = self._windows.first_of(stops, at)
        first, shape = np.full_like(fitting, -1), fitting.shape
        found, offset = _no_peaks(shape), np.zeros((*shape, 3))
        floor, foreign, rivals = np.full(shape, 0.5), np.ones(shape), np.ones(shape)
        at_edge, good = np.zeros(shape, bool), np.zeros(shape, bool)
        for row, end in enumerate(at):
            own = slice(row, row + 1)
            if row and not self._due(stops, int(end)):
                for whole in (*found, offset, first, floor, foreign, rivals, at_edge):
                    whole[row] = whole[row - 1]
                continue
            for region, window in self._looks(stops, int(end), fitting[row], astray[end]):
                begin = int(fitting[row, window])
                member = np.round(np.linspace(end, begin, self.plan.members if begin < end else 1)).astype(int)
                seed = int(stops.number[end]) * 64 + 4 * window + region.level
                peak, offset[row, window] = self._look(stops, member, region, seed)
                for whole, part in zip(found, peak, strict=True):
                    whole[row, window] = part
                first[row, window] = begin
                here = Peaks(*(field[own] for field in found))
                floor[own] = self._windows.settled_floor(stops, at[own], first[own], here)
                here = here._replace(floor=floor[own])
                attitudes = self._attitudes(stops, int(end))
                tried, chose = attitudes * self._scale.tried, None
                if region.level < _WHOLE:
                    tried, chose = attitudes, self._windows.chose(stops, first[own])
                foreign[own], rivals[own] = self._windows.weigh(here, first[own], tried, chose)
                at_edge[own] = here.at_rim | self._windows.beyond(here, foreign[own])
                certain = max(foreign[row, window], rivals[row, window]) <= self._options.risk
                good[row, window] = certain and not at_edge[row, window]
                self._level = max(region.level - 1, 0) if good[row, window] else _WHOLE
                if good[row, window]:
                    error_m = self._lattice.error_of(np.asarray(peak.point))
                    self._windows.take(float(stops.path_m[end]), error_m, float(peak.area), tried)
                    self._window = window
                    break
            else:
                # Evidence that one length lacks, the next may hold.
                self._window = min(self._window + 1, int(np.max(np.flatnonzero(fitting[row] >= 0), initial=0)))
        chosen = self._windows.chosen(stops, at, first, found._replace(floor=floor), foreign, rivals, at_edge, good)
        return chosen._replace(offset=offset[np.arange(len(at)), chosen.window])

    def _due(self, stops: Stops, end: int) -> bool:
        """Whether to search at a stop: where no place has been found for a while, only now and then."""
        here_m = float(stops.path_m[end])
        return here_m - self._place.seen_m <= LOST_M or here_m - self._whole_m >= _NOW_AND_THEN_M

    def _looks(
        self, stops: Stops, end: int, first: Int[np.ndarray, " window"], prior_m: Float[np.ndarray, "2"]
    ) -> Iterator[tuple[_Region, int]]:
        """Regions and windows to search at a stop, until one of them gives a fix."""
        here_m = float(stops.path_m[end])
        whole = _Region(prior_m, self._lattice.region_m, _WHOLE)
        regions = [whole]
        since_m = here_m - self._place.seen_m
        if self._place.error_m is not None and since_m <= LOST_M and here_m - self._whole_m < CHUNK_M:
            near_m = CARRIED_M + DRIFT * since_m
            sides = (near_m, _WIDER * near_m)
            around = [_Region(self._place.error_m, side_m, level) for level, side_m in enumerate(sides)]
            regions = [*around[self._level :], whole]
        begin = max(0, self._window - 1)
        windows = [window for window in range(begin, min(begin + 2, len(first))) if first[window] >= 0]
        for region in regions:
            if region.level == _WHOLE:
                self._whole_m = here_m
            for window in windows or [0]:
                if first[window] >= 0:
                    yield region, window

    def _attitudes(self, stops: Stops, end: int) -> float:
        """Independent attitudes among those searched."""
        half = self._attitude.half_width(stops.sigma_yaw_rad[end : end + 1])[0]
        claimed = self._attitude.claimed(stops.sigma_yaw_rad[end : end + 1])[0]
        return _WIDE_ATTITUDES if np.any(half > 2.0 * claimed) else _ATTITUDES

    def _look(
        self,
        stops: Stops,
        member: Int[np.ndarray, " member"],
        region: _Region,
        seed: int,
    ) -> tuple[Peaks, Float[np.ndarray, "3"]]:
        """Search a region for the place of one window.

        Args:
            stops: the scans.
            member: those of the window, the last one first.
            region: of places.
            seed: of the swarm.

        Returns:
            its peak, and the offset of height, heading and roll from the prior.
        """
        lattice, ground, array = self._lattice, self._ground, self._prepared.array
        end = member[:1]
        prior = stops.pose[end].copy()
        prior[:, :2] = stops.reckoned_m[end] + region.middle_m
        blank = _no_peaks(())
        tiles = lattice.tiles_at(prior[:, :2], region.half_m)
        if tiles[0] < 0:
            return blank, np.zeros(3)
        aspect, _ = self._prepared.aspects(tiles, prior[:, 3], stops.speed_mps[end])[0]
        frame, (particles, iterations) = ground.frame(aspect.tile), _LEVELS[region.level]
        largest = self._options.search_swarm
        assert largest is not None
        config = replace(
            largest,
            particles=max(8, round(particles * largest.particles)),
            iterations=max(4, round(iterations * largest.iterations)),
        )
        fresh = np.diff(member, prepend=member[0] + 1)[None] != 0
        template = templates_of(stops, array, end, member[None], fresh)
        half = self._options.half_width(stops.sigma_yaw_rad[end], region.half_m)[0, :5]
        half[2:] = self._attitude.half_width(stops.sigma_yaw_rad[end])[0]
        middle = to_tile(prior, frame)[0]
        turn = lattice.facing_rad - frame[2]
        cos, sin = np.cos(turn), np.sin(turn)
        apart_m = lattice.decoys_about[:: -(-len(lattice.decoys_about) // _DECOYS)] @ np.array(
            [[cos, sin], [-sin, cos]]
        )
        heights = lattice.heights_m
        decoys = np.broadcast_to(middle, (len(heights), len(apart_m), 5)).copy()
        decoys[..., :2] += apart_m[None]
        decoys[..., 2] += heights[:, None]
        several = len(array.x_m) > 1
        peak: SwarmPeak = jax.device_get(
            search_region(
                self._prepared.at(aspect).tile,
                np.float32(ground.source.height_reference_m[aspect.tile]),
                ground.basis.angular_frequency_rad_per_ns,
                np.float32(self.plan.min_overlap),
                Template(*(field[0] for field in template)),
                middle.astype(np.float32),
                half.astype(np.float32),
                np.array([True, True, True, self.plan.members > 1 or several, several]),
                decoys.astype(np.float32),
                np.float32(APART * self._wavelength_m),
                np.array([self._options.seed, seed], np.uint32),
                config=config,
            )
        )
        pose = fixes_to_map(np.asarray(peak.pose)[None], np.zeros((1, 5, 5)), frame)[0][0]
        offset = pose[2:] - prior[0, 2:]
        offset[1] = np.mod(offset[1] + np.pi, 2.0 * np.pi) - np.pi
        away = np.abs(peak.pose[:2] - middle[:2])
        ends = np.asarray(peak.ends)
        area = float(peak.on_map) * (2.0 * region.half_m) ** 2 / float(np.prod(self.plan.lattice_m))
        return Peaks(
            point=lattice.point_of(pose[:2] - stops.reckoned_m[end[0]]),
            height=np.zeros((), int),
            score=peak.score,
            rival=peak.rival,
            floor=peak.floor,
            region_floor=peak.region_floor,
            overlap=peak.overlap,
            area=np.asarray(area),
            at_rim=np.asarray(np.any(away > _RIM * region.half_m)),
            open_sides=np.asarray(0 if self._windows.measures_edges else int(ends[0]) + 2 * int(ends[1])),
        ), offset


def _no_peaks(shape: tuple[int, ...]) -> Peaks:
    """Of windows that were not searched."""
    off = np.full(shape, OFF_MAP_SCORE)
    nothing = np.zeros(shape)
    none = np.zeros(shape, int)
    return Peaks(
        np.zeros((*shape, 2)),
        none,
        off,
        off.copy(),
        nothing,
        nothing.copy(),
        nothing.copy(),
        nothing.copy(),
        np.zeros(shape, bool),
        none.copy(),
    )
