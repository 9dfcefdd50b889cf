"""The search by a particle swarm: place, height and attitude at once, on the score itself, without a lattice.

The search of the first system of this kind (LL). It begins anywhere in its region and knows no derivative; region,
particles and iterations follow the correlation: small where the last place was certain, the whole region where it was
not. A swarm finds the best pose. Whether that is certain, and in which window, is decided as by default, by
scores close to the place and at decoys: probabilities, codes and the time scale mean the same, and a place that both
accept was found in two ways.
"""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt32

from lgprjax.pso import SwarmConfig, run_swarm
from lgprjax.registration.candidates import ChosenWindows
from lgprjax.registration.coarse import Peaks
from lgprjax.registration.evidence import CARRIED_M, DRIFT, EvidenceSearch
from lgprjax.registration.fix import Code
from lgprjax.registration.judge import independent_numbers
from lgprjax.registration.lattice import HELD_M
from lgprjax.registration.queries import Stops, rotation, templates_of
from lgprjax.registration.refine import held_score
from lgprjax.registration.score import OFF_MAP_SCORE, Template, score_poses
from lgprjax.registration.template_bank import fixes_to_map, to_tile
from lgprjax.registration.windows import APART, LOST_M
from lgprjax.subsurface import Tile

_LEVELS = ((0.25, 0.5), (0.5, 0.75), (1.0, 1.0))
"""Shares of the largest swarm's particles and iterations: around the last place, in a region of some times its side,
and in the whole region."""
_WHOLE = len(_LEVELS) - 1
_WIDER = 3.0  # times the side of the region around the last place
_NOW_AND_THEN_M = 1.0  # of travel
_SEEDS = _WHOLE + 3  # of searches at one stop: anew, about a known place at each level, against others


class SwarmPeak(NamedTuple):
    """The best pose that a swarm found in its region, in the tile's frame; scores as in ``Score``.

    Attributes:
        pose: along_m, cross_m, height_m, yaw_rad, roll_rad of each swarm: of the best place and, in a search for a
            rival, of the best one at least a distance apart.
        score: score of each pose; ``OFF_MAP_SCORE`` if nothing was on the map.
        on_map: share of the region on the map.
    """

    pose: Float[Array, "swarm 5"]
    score: Float[Array, " swarm"]
    on_map: Float[Array, ""]


@partial(jax.jit, static_argnames=("config", "rival"))
def search_region(
    tile: Tile,
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    min_overlap: Float[Array, ""],
    template: Template,
    middle: Float[Array, "5"],
    half_width: Float[Array, "5"],
    free: Bool[Array, "5"],
    floor: Float[Array, ""],
    apart_m: Float[Array, ""],
    seed: UInt32[Array, "2"],
    *,
    config: SwarmConfig,
    rival: bool,
) -> SwarmPeak:
    """Search a region of poses by a swarm with random starts in it, and for a rival by a second one.

    Args:
        tile, height_reference_m, angular_frequency_rad_per_ns, min_overlap: as for ``score_poses``.
        template: single template.
        middle, half_width: middle and half widths of the region, in the tile's frame.
        free: mask of free degrees of freedom.
        floor: noise floor of the template: its match is weighed against the prior's height and attitude, as on a climb.
        apart_m: distance below which places are the same.
        seed: seeds of the drive and of this search.
        config: configuration of the swarms.
        rival: whether to search for a rival.
    """

    numbers = independent_numbers(floor)

    def hunt(avoided_m: Float[Array, "2"], key: Array) -> tuple[Array, tuple[Array, Array]]:
        def objective(u: Float[Array, "particle 5"]) -> Float[Array, " particle"]:
            pose = middle[None] + u * half_width[None]
            near = jnp.sum((pose[:, :2] - avoided_m[None]) ** 2, axis=1) < apart_m**2
            return jnp.where(near, -jnp.inf, score(pose))

        end = run_swarm(key, cloud, objective, free, config=config)
        place = middle + end.position * half_width
        return place[:2], (place, jnp.maximum(end.score, OFF_MAP_SCORE))

    def score(pose: Float[Array, "particle 5"]) -> Float[Array, " particle"]:
        found = score_poses(tile, template, pose, height_reference_m, angular_frequency_rad_per_ns, min_overlap)
        held = held_score(found, pose, middle, half_width, numbers)
        return jnp.where(found.score > OFF_MAP_SCORE, held, OFF_MAP_SCORE)

    keys = jax.random.split(jax.random.fold_in(jax.random.key(seed[0]), seed[1]), 3)
    cloud = jax.random.uniform(keys[0], (config.particles, 5), minval=-1.0, maxval=1.0)
    cloud = jnp.where(free[None], cloud, 0.0)
    # One after the other, as one program: the second avoids what the first has found.
    _, (found, scores) = jax.lax.scan(hunt, jnp.full(2, jnp.inf), keys[1:] if rival else keys[1:2])
    begun = score(middle[None] + cloud * half_width[None])
    return SwarmPeak(found, scores, jnp.mean(begun > OFF_MAP_SCORE, dtype=jnp.float32))


class _Region(NamedTuple):
    """A region of places around an error of the prior, east and north from dead reckoning."""

    middle_m: Float[np.ndarray, "2"]
    half_m: float
    level: int


class _Found(NamedTuple):
    """Result of each swarm; poses are offsets from dead reckoning and from the prior's height, heading and roll."""

    offset: Float[np.ndarray, "swarm 5"]
    score: Float[np.ndarray, " swarm"]
    on_map: float


class SwarmSearch(EvidenceSearch):
    """Search of one drive by swarms of at most ``options.search_swarm``; arguments as for ``EvidenceSearch``."""

    _window, _level = 0, 0
    _whole_m = -np.inf
    _declined: ChosenWindows | None = None

    def _judge(self, stops: Stops, low: int, high: int, astray: Float[np.ndarray, "stop 2"]) -> ChosenWindows:
        """Judge stop by stop while no place is tracked; from then on as by default around the place, with each accepted
        window's pose found by a swarm.
        """
        parts: list[ChosenWindows] = []
        at, tracked = low, self._lattice.place_m is not None
        while at < high:
            if self._lattice.place_m is not None:
                parts.append(self._confirmed(stops, at, super()._judge(stops, at, high, astray), astray))
                break
            parts.append(self._anew(stops, at, astray))
            at += 1
        if not tracked:
            # Whether a new place is kept is decided after these metres.
            self._hold(None)
        whole: ChosenWindows = jax.tree.map(lambda *fields: np.concatenate(fields), *parts)
        return whole

    def _anew(self, stops: Stops, end: int, astray: Float[np.ndarray, "stop 2"]) -> ChosenWindows:
        """Look for a place in the whole region about the prior."""
        plan, lattice, windows = self.plan, self._lattice, self._windows
        at, prior_m, here_m = np.array([end]), astray[end], float(stops.path_m[end])
        # Noise floors are those of scores about the prior, of all windows.
        self._hold(prior_m)
        known, _, first, _ = self._peaks(stops, end, end + 1, astray)
        self._hold(None)
        # One strong stone is one scan: a place is found by more.
        least = int(len(plan.windows_m) > 1 and self._options.own_thresholds is None)
        fitting = np.flatnonzero(first[0] >= 0)
        fitting = fitting[fitting >= least]
        peaks = _no_peaks(first.shape)
        nothing = np.ones(first.shape)
        none = np.zeros(first.shape, bool)
        # Where no place has been found for a while, only now and then.
        due = here_m - self._place.seen_m <= LOST_M or here_m - self._whole_m >= _NOW_AND_THEN_M
        if self._declined is not None and not due:
            return self._declined
        if not len(fitting):
            return windows.chosen(stops, at, np.full_like(first, -1), peaks, nothing, nothing, none, none)
        # Evidence that one length lacks, the next may hold.
        window = int(np.clip(self._window, fitting[0], fitting[-1]))
        self._window, self._whole_m = window + 1, here_m
        first = np.where(np.arange(first.shape[1]) == window, first, -1)
        region = _Region(prior_m, lattice.region_m, _WHOLE)
        begin = int(first[0, window])
        floor, seed = float(known.floor[0, window]), _SEEDS * int(stops.number[end])
        found = self._look(stops, self._members(end, begin), region, floor, seed=seed)
        there_m, rival_m = self._at_prior_heading(stops, end, begin, found.offset)
        near, place_m = self._around(stops, end, begin, there_m)
        other, other_m = self._around(stops, end, begin, rival_m)
        rival = other.score if windows.apart(other_m, place_m) else other.rival
        near = near._replace(
            point=lattice.point_of(place_m),
            score=np.where(found.score[0] > OFF_MAP_SCORE, near.score, OFF_MAP_SCORE),
            rival=np.maximum(near.rival, np.where(found.score[1] > OFF_MAP_SCORE, rival, OFF_MAP_SCORE)),
            area=np.asarray(found.on_map * (2.0 * region.half_m) ** 2 / np.prod(plan.lattice_m)),
        )
        for whole, part in zip(peaks, near, strict=True):
            whole[0, window] = part
        sides = 0 if windows.measures_edges else peaks.open_sides
        peaks = peaks._replace(floor=known.floor, open_sides=np.broadcast_to(sides, first.shape))
        foreign, rivals = windows.weigh(peaks, first, self._scale.tried)
        away_m = float(np.max(np.abs(place_m - prior_m)))
        at_edge = peaks.at_rim | windows.beyond(peaks, foreign) | (away_m > region.half_m)
        same = not windows.apart(place_m, there_m)
        risk = self._options.risk
        good = (first >= 0) & (foreign <= risk) & (rivals <= risk) & ~at_edge & same
        judged = windows.chosen(
            stops, at, first, peaks, foreign, np.where(same, rivals, 1.0), np.asarray(at_edge), good
        )
        if judged.code[0] == Code.OK:
            windows.take(here_m, place_m, float(near.area), self._scale.tried)
            self._window = self._level = 0
            if self._may_hold:
                self._hold(place_m)
            judged = judged._replace(offset=found.offset[:1] - np.pad(place_m, (0, 3)))
        else:
            self._declined = judged._replace(first=np.full(1, -1))
        return judged

    def _confirmed(
        self, stops: Stops, low: int, judged: ChosenWindows, astray: Float[np.ndarray, "stop 2"]
    ) -> ChosenWindows:
        """Windows accepted around the tracked place, where a swarm finds the place too, with its pose.

        It looks within a small region around the last place, where it misses that in one of some times its side, and
        then in the whole one.
        """
        code, offset = judged.code.copy(), judged.offset.copy()
        assert self._place.error_m is not None
        last_m, seen_m = self._place.error_m, self._place.seen_m
        for row in np.flatnonzero(code == Code.OK):
            end, begin = low + int(row), int(judged.first[row])
            here_m, place_m, floor = float(stops.path_m[end]), judged.error_m[row], float(judged.peak.floor[row])
            near_m, seed = CARRIED_M + DRIFT * abs(here_m - seen_m), _SEEDS * int(stops.number[end]) + 1
            code[row] = Code.AMBIGUOUS
            for level in range(self._level, _WHOLE + 1):
                region = (
                    _Region(astray[end], self._lattice.region_m, _WHOLE)
                    if level == _WHOLE
                    else _Region(last_m, near_m * _WIDER**level, level)
                )
                found = self._look(stops, self._members(end, begin), region, floor, seed=seed + level)
                there_m = self._at_prior_heading(stops, end, begin, found.offset[:1])[0]
                if found.score[0] > OFF_MAP_SCORE and not self._windows.apart(there_m, place_m):
                    code[row], offset[row] = Code.OK, found.offset[0] - np.pad(place_m, (0, 3))
                    last_m, seen_m, self._level = place_m, here_m, max(level - 1, 0)
                    break
            else:
                self._level = _WHOLE
        return judged._replace(code=code, offset=offset)

    def _compared(
        self, stops: Stops, at: Int[np.ndarray, " stop"], prior_m: Float[np.ndarray, "2"]
    ) -> tuple[float, float] | None:
        """Comparison by two swarms in the whole region."""
        assert self._place.error_m is not None
        near = self._one_window(stops, at, stops.coefficients[at], self._place.error_m, HELD_M)
        if near.floor == 0.0:
            return None
        end, begin = int(at[-1]), int(at[0])
        region = _Region(prior_m, self._lattice.half_m, _WHOLE)
        seed = _SEEDS * int(stops.number[end]) + _SEEDS - 1
        found = self._look(stops, self._members(end, begin), region, float(near.floor), seed=seed)
        there_m = self._at_prior_heading(stops, end, begin, found.offset)[0]
        here, there = (float(score) for score in found.score)
        if self._windows.apart(there_m, self._place.error_m):
            here, there = there, here
        # Both may have missed the known place.
        return max(here, float(near.score)) / float(near.floor), there / float(near.floor)

    def _around(
        self, stops: Stops, end: int, begin: int, place_m: Float[np.ndarray, "2"]
    ) -> tuple[Peaks, Float[np.ndarray, "2"]]:
        """Peaks of a window close to a place, at the prior's attitude as by default, and the place of the best."""
        at = np.arange(begin, end + 1)
        peaks = self._one_window(stops, at, stops.coefficients[at], place_m, HELD_M)
        return peaks, self._lattice.error_of(np.asarray(peaks.point), place_m, self.plan.points(HELD_M))

    def _members(self, end: int, begin: int) -> Int[np.ndarray, " member"]:
        """Stops of a window that are matched, the last one first."""
        return np.round(np.linspace(end, begin, self.plan.members if begin < end else 1)).astype(int)

    def _at_prior_heading(
        self, stops: Stops, end: int, begin: int, offset: Float[np.ndarray, "swarm 5"]
    ) -> Float[np.ndarray, "swarm 2"]:
        """Errors of the prior at which a window's middle is where poses have it: a lattice knows the prior's heading
        alone.
        """
        middle_m = 0.5 * (stops.reckoned_m[begin] - stops.reckoned_m[end])
        turned_m = np.einsum("ijs,j->si", rotation(offset[:, 3]), middle_m)
        return np.asarray(offset[:, :2] + turned_m - middle_m)

    def _look(
        self, stops: Stops, member: Int[np.ndarray, " member"], region: _Region, floor: float, *, seed: int
    ) -> _Found:
        """Search a region for the pose of one window.

        Args:
            stops: scans of the drive.
            member: scans of the window, the last one first, padded by repetition to the compiled number.
            region: region of places; for the whole region a rival is searched.
            floor: noise floor of the window.
            seed: seed of the swarm.
        """
        lattice, ground, array = self._lattice, self._ground, self._prepared.array
        end = member[:1]
        prior = stops.pose[end].copy()
        prior[:, :2] = stops.reckoned_m[end] + region.middle_m
        tiles = lattice.tiles_at(prior[:, :2], region.half_m)
        if tiles[0] < 0:
            return _Found(np.tile(np.pad(region.middle_m, (0, 3)), (2, 1)), np.full(2, OFF_MAP_SCORE), 0.0)
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
                np.float32(floor),
                np.float32(APART * self._wavelength_m),
                np.array([self._options.seed, seed], np.uint32),
                config=config,
                rival=region.level == _WHOLE,
            )
        )
        pose, score = np.asarray(peak.pose), np.asarray(peak.score)
        pose, _ = fixes_to_map(pose, np.zeros((len(pose), 5, 5)), frame)
        offset = pose - np.concatenate([stops.reckoned_m[end[0]], prior[0, 2:]])
        offset[:, 3] = np.mod(offset[:, 3] + np.pi, 2.0 * np.pi) - np.pi
        return _Found(offset, score, float(peak.on_map))


def _no_peaks(shape: tuple[int, ...]) -> Peaks:
    """Peaks of windows that were not searched."""
    off = np.full(shape, OFF_MAP_SCORE)
    nothing = np.zeros(shape)
    none = np.zeros(shape, int)
    return Peaks(
        point=np.zeros((*shape, 2)),
        height=none,
        score=off,
        rival=off.copy(),
        floor=nothing,
        region_floor=nothing.copy(),
        overlap=nothing.copy(),
        area=nothing.copy(),
        at_rim=np.zeros(shape, bool),
        open_sides=none.copy(),
    )
