"""Refinement of the chosen window at each stop to a fix in the map's frame."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.radar import centre_of
from lgprjax.registration.coarse import Peaks
from lgprjax.registration.estimates import AttitudeEstimate
from lgprjax.registration.fix import WRONG_M, Code, Fix, blank_fixes
from lgprjax.registration.judge import RegisterOptions
from lgprjax.registration.lattice import ErrorLattice
from lgprjax.registration.queries import SETTLED, LiveScans, SearchSizes, Stops, rotation, templates_of
from lgprjax.registration.refine import (
    CLIMB_STEPS,
    FAR_STEPS,
    LARGEST_STEP,
    Finished,
    Region,
    finish_best,
    trial_headings,
)
from lgprjax.registration.score import OFF_MAP_SCORE, Template, score_each
from lgprjax.registration.template_bank import PreparedGround, TileBatch, fixes_to_map, to_tile

# Errors that no match can observe: those of the map's own positions and of the odometer that lays out a window.


def map_odometry_covariance(
    prepared: PreparedGround, tiles: Int[np.ndarray, " end"], fix: Fix, odometer_sigma: float
) -> Float[np.ndarray, "end 2 2"]:
    """Part of the east and north covariances due to map and odometer; NaN without a fix.

    The centre of a window is half its length behind the scan of its fix; an odometer scale error displaces it by that
    share of the distance, along the heading.

    Args:
        prepared: map and array.
        tiles: tile of each fix; -1 for none.
        fix: fixes with poses in the map's frame.
        odometer_sigma: relative standard deviation of the odometer's scale.
    """
    yaw, window_m = np.asarray(fix.pose)[:, 3], np.asarray(fix.window_m)
    heading = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    along_m2 = (0.5 * window_m * odometer_sigma) ** 2
    out = along_m2[:, None, None] * heading[:, :, None] * heading[:, None, :]
    for tile in np.unique(tiles[tiles >= 0]):
        rows = np.flatnonzero(tiles == tile)
        out[rows] += label_variance(prepared, int(tile), np.asarray(fix.pose)[rows])[:, None, None] * np.eye(2)
    return np.asarray(out)


def label_variance(prepared: PreparedGround, tile: int, pose: Float[np.ndarray, "end 5"]) -> Float[np.ndarray, " end"]:
    """Variance, square metres, of the map's positions under each fix, in east and in north each.

    Where baselines overlap, the ground is their mean, and their errors, which are independent, average out: with w_d
    the share of the channels over baseline d, the variance is the sum of (w_d sigma_d)².

    Args:
        prepared: map and array.
        tile: tile of the fixes.
        pose: poses of the fixes in the map's frame.
    """
    ground = prepared.ground
    across_m = ground.baselines_across(tile)
    if not len(across_m):
        return np.zeros(len(pose))
    east, north, yaw = ground.frame(tile)
    cross_m = (pose[:, 1] - north) * np.cos(yaw) - (pose[:, 0] - east) * np.sin(yaw)
    left_m = (prepared.array.y_m - centre_of(prepared.array)[1])[None] * np.cos(pose[:, 3] - yaw)[:, None]
    place = (cross_m[:, None] + left_m)[:, None]
    covered = (place >= across_m[None, :, :1]) & (place <= across_m[None, :, 1:])
    share = np.mean(covered / np.maximum(covered.sum(axis=1, keepdims=True), 1), axis=2)
    sigma_m = np.asarray(ground.description.label_sigma_m)
    # Channels off all baselines (a crossing road, a curve) count as over the least certain baseline.
    missing = 1.0 - share.sum(axis=1)
    return np.asarray(np.sum((share * sigma_m) ** 2, axis=1) + missing**2 * np.max(sigma_m**2))


_RIM = 0.25  # share of the wavelength: sigma across at the map's edge
_SETTLING = 0.3  # of the wavelength: sigma along at a drive's start, falling to none where its background is known
_RIM_OF_ATTITUDE = 0.98  # of the half width of a region of attitudes
_FAR = 3.0  # of a climb's largest step: two reach the rim of a region as wide
_AWAY = 0.6  # of the wavelength: a climb that ends farther off left its peak


class ChosenWindows(NamedTuple):
    """The window chosen at each stop.

    Attributes:
        window: number of the window in the ladder.
        peak: fields of ``Peaks`` of that window.
        p_false: see ``chance``.
        code: ``Code`` of the stop.
        first: first stop of the window.
        error_m: east and north of the place, minus dead reckoning.
        offset: offset from there, at the prior's height, heading and roll, to the start pose of the climb.
    """

    window: Int[np.ndarray, " stop"]
    peak: Peaks
    p_false: Float[np.ndarray, " stop"]
    code: Int[np.ndarray, " stop"]
    first: Int[np.ndarray, " stop"]
    error_m: Float[np.ndarray, "stop 2"]
    offset: Float[np.ndarray, "stop 5"]


class StopFixes:
    """Refines the candidates of one drive.

    Args:
        prepared: ground of the map for the drive's array.
        lattice: error lattice of the drive.
        plan, options: sizes and options of the search.
        sigma_scale: factor on the match's sigmas, unless the options hold user thresholds.
        batch: number of climbs run together; a compiled shape.

    Attributes:
        sigma_scale: factor in use.
    """

    def __init__(
        self,
        prepared: PreparedGround,
        lattice: ErrorLattice,
        plan: SearchSizes,
        options: RegisterOptions,
        sigma_scale: float,
        batch: int,
    ) -> None:
        self._prepared, self._ground, self._lattice = prepared, prepared.ground, lattice
        self._plan, self._options, self._batch = plan, options, batch
        own = options.own_thresholds
        self.sigma_scale = sigma_scale if own is None else own.sigma_scale
        self._wavelength_m = self._ground.description.settings.wavelength_m

    def finish(
        self, stops: Stops, before: int, judged: ChosenWindows, attitude: AttitudeEstimate
    ) -> tuple[Fix, Float[np.ndarray, "stop 2 2"]]:
        """Refine every candidate.

        Args:
            stops: stops, history first.
            before: number of stops of the history.
            judged: chosen windows of the stops that follow.
            attitude: estimate of the priors' attitude errors, which is updated with the accepted matches.

        Returns:
            Fixes in the map's frame, and the part of each covariance due to map and odometer.
        """
        count = len(judged.code)
        fixes = blank_fixes(count)
        fixes.code[:] = judged.code
        at = before + np.arange(count)
        place = stops.reckoned_m[at] + judged.error_m
        # A climb that begins at the very edge of the map leaves it: start half a step inwards.
        yaw, ends = stops.pose[at, 3], np.asarray(judged.peak.open_sides)
        inwards_m = 0.5 * self._plan.lattice_m[1] * ((ends == 2).astype(float) - (ends == 1))
        place = place + inwards_m[:, None] * np.stack([-np.sin(yaw), np.cos(yaw)], axis=-1)
        candidate = np.flatnonzero((judged.peak.score > OFF_MAP_SCORE) & (judged.first >= 0))
        tiles = np.full(count, -1)
        tiles[candidate] = self._lattice.tiles_at(place[candidate], 1.0)
        candidate = candidate[tiles[candidate] >= 0]
        half = attitude.half_width(stops.sigma_yaw_rad[at])
        # A swarm ends near a peak, in all dimensions, but not as near as a lattice's step.
        far = np.any(half > _FAR * np.asarray(LARGEST_STEP[2:5]), axis=1)
        far |= self._options.search_swarm is not None
        fixes.p_false[candidate] = judged.p_false[candidate]
        # A leg may be shorter than the window it was matched with.
        length_m = np.asarray(self._plan.windows_m)[judged.window]
        leg_m = stops.path_m[at] - stops.path_m[np.searchsorted(stops.leg, stops.leg[at])]
        length_m = np.where(leg_m < length_m - 0.5 * self._plan.spacing_m - 1e-6, leg_m, length_m)
        fixes.window_m[candidate] = length_m[candidate]
        for batch in self._prepared.batches(tiles, yaw, stops.speed_mps[at], self._batch):
            self._finish_some(stops, at, place, judged, batch, half, far, fixes)
        told = np.flatnonzero((judged.code == Code.OK) & np.isfinite(fixes.pose[:, 0]))
        away = np.asarray(fixes.pose)[told, 2:] - stops.pose[at[told], 2:]
        away[:, 1] = np.mod(away[:, 1] + np.pi, 2.0 * np.pi) - np.pi
        # At the rim of its region an attitude is not the ground's but the region's.
        rim = np.any(np.abs(away) > _RIM_OF_ATTITUDE * half[told], axis=1)
        fixes.code[told[rim & (fixes.code[told] == Code.OK)]] = Code.EDGE
        attitude.take(
            away,
            np.asarray(fixes.covariance)[told, 2:, 2:],
            half[told],
            stops.path_m[at[told]],
            np.asarray(fixes.window_m)[told],
            stops.sigma_yaw_rad[at[told]],
        )
        fixes.covariance[:] *= self.sigma_scale**2
        # Where the ground hardly changes along the way, places that count as wrong match as well as the best one.
        facing = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
        along_m2 = np.einsum("si,sij,sj->s", facing, np.asarray(fixes.covariance)[:, :2, :2], facing)
        fixes.code[(fixes.code == Code.OK) & (along_m2 > WRONG_M**2)] = Code.AMBIGUOUS
        beside = map_odometry_covariance(self._prepared, tiles, fixes, self._options.odometer_sigma)
        # If the map ends next to the best place, the match does not determine how far beyond it the true one is.
        left = np.stack([-np.sin(yaw), np.cos(yaw)], axis=-1)
        label_m2 = np.nan_to_num(np.einsum("si,sij,sj->s", left, beside, left))
        at_end = ((ends > 0) * (_RIM * self._wavelength_m) ** 2)[:, None, None]
        # The background of the first scans is that of the ground ahead of them, which moves what remains.
        settled_m = SETTLED * self._ground.description.settings.track_filter_m
        settling = np.maximum(1.0 - np.abs(stops.path_m[at]) / settled_m, 0.0)
        at_start = ((_SETTLING * self._wavelength_m * settling) ** 2)[:, None, None]
        beside = (
            beside + at_end * left[:, :, None] * left[:, None, :] + at_start * facing[:, :, None] * facing[:, None, :]
        )
        fixes.covariance[:, :2, :2] += np.nan_to_num(beside)
        fixes.covariance[:, 2:, 2:] += np.diag(attitude.unobserved**2)
        # The map is turned by the difference of its labels' errors at the two ends of the window.
        reach_m = np.hypot(fixes.window_m, np.ptp(self._prepared.array.y_m))
        fixes.covariance[:, 3, 3] += 2.0 * label_m2 / np.maximum(reach_m, 0.5 * self._wavelength_m) ** 2
        return fixes, beside

    def _finish_some(
        self,
        stops: Stops,
        at: Int[np.ndarray, " stop"],
        place: Float[np.ndarray, "stop 2"],
        judged: ChosenWindows,
        batch: TileBatch,
        half_width: Float[np.ndarray, "stop 3"],
        far: Bool[np.ndarray, " stop"],
        fixes: Fix,
    ) -> None:
        ground, some = self._ground, batch.rows
        frame = ground.frame(batch.number)
        rows = np.concatenate([some, np.full(self._batch - len(some), some[0])])
        last, first = at[rows], judged.first[rows]
        member = np.round(np.linspace(last, first, self._plan.members, axis=1)).astype(int)
        fresh = np.diff(member, axis=1, prepend=last[:, None] + 1) != 0
        template = templates_of(stops, self._prepared.array, last, member, fresh)
        prior = stops.pose[last]
        start = np.concatenate([place[rows], stops.pose[last, 2:]], axis=1) + judged.offset[rows]
        half = self._options.half_width(stops.sigma_yaw_rad[last], self._lattice.half_m)
        half[:, 2:5] = half_width[rows]
        # Along and across the tile, like the half widths.
        from_prior = to_tile(start, frame)[:, :2] - to_tile(prior, frame)[:, :2]
        half[:, :2] = np.maximum(half[:, :2], np.abs(from_prior) + self._wavelength_m)
        level = [(0, 0), (0, 1)]
        middle_m = 0.5 * (stops.reckoned_m[np.maximum(first, 0)] - stops.reckoned_m[last])
        # Rejected matches have no position, so their heading does not matter.
        swing_m = half[:, 3] * np.hypot(*middle_m.T) * (judged.code[rows] == Code.OK)
        found: Finished = jax.device_get(
            finish_best(
                batch.ready.tile,
                np.float32(ground.source.height_reference_m[batch.number]),
                ground.basis.angular_frequency_rad_per_ns,
                template,
                np.pad(to_tile(start, frame), level).astype(np.float32),
                Region(
                    jnp.asarray(np.pad(to_tile(prior, frame), level), dtype=jnp.float32),
                    jnp.asarray(half, dtype=jnp.float32),
                    jnp.asarray(stops.number[last], dtype=jnp.uint32),
                ),
                judged.peak.floor[rows].astype(np.float32),
                np.float32(self._plan.min_overlap),
                heading=self._plan.members * len(self._prepared.array.x_m) > 1,
                pitch=self._options.pitch_deg > 0.0,
                headings=np.int32(trial_headings(float(np.max(swing_m)), self._wavelength_m)),
                swarm=self._options.swarm,
                seed=np.uint32(self._options.seed),
                steps=np.int32(FAR_STEPS if far[rows].any() else CLIMB_STEPS),
            )
        )
        found = jax.tree.map(lambda field: np.asarray(field)[: len(some)], found)
        pose, covariance = fixes_to_map(np.asarray(found.pose), np.asarray(found.covariance), frame)
        fixes.pose[some], fixes.covariance[some] = pose, covariance
        fixes.correlation[some] = found.correlation
        score = np.asarray(judged.peak.score)[some]
        fixes.runner_up[some] = np.maximum(np.asarray(judged.peak.rival)[some], -1.0)
        fixes.margin[some] = score - fixes.runner_up[some]
        fixes.noise_floor[some] = np.asarray(judged.peak.floor)[some]
        fixes.overlap[some], fixes.overlap_channels[some] = found.overlap, found.overlap_channels
        # The climb must end at its start: a separate peak, not a slope that leads off the map. The heading turns a
        # window about its middle.
        middle_m = middle_m[: len(some)]
        turn = rotation(pose[:, 3] - stops.pose[at[some], 3])
        away = np.hypot(*(pose[:, :2] - place[some] - middle_m + np.einsum("ijs,sj->si", turn, middle_m)).T)
        left = np.asarray(found.unfinished) | (away > _AWAY * self._wavelength_m)
        lost = ~np.isfinite(pose[:, 0])
        fixes.code[some] = np.where(
            lost,
            int(Code.LOW_OVERLAP),
            np.where(left & (judged.code[some] == Code.OK), int(Code.EDGE), judged.code[some]),
        )

    def score_at(
        self,
        scans: LiveScans,
        at: Int[np.ndarray, " stop"],
        coefficients: Float[np.ndarray, "stop channel coefficient"],
        truth: Float[np.ndarray, "stop 5"],
    ) -> Float[np.ndarray, " stop"]:
        """Correlation of single scans at poses in the map's frame; NaN off the map.

        Args:
            scans: scans of a block.
            at: indices of the stops among the scans.
            coefficients: coefficients of the stops.
            truth: true poses of the stops.
        """
        out = np.full(len(at), np.nan)
        known = np.flatnonzero(np.isfinite(truth[:, 0]))
        tiles = np.full(len(at), -1)
        tiles[known] = self._lattice.tiles_at(truth[known, :2], 1.0)
        speed = scans.track.speed_mps[at]
        array, centre_m = self._prepared.array, centre_of(self._prepared.array)
        for batch in self._prepared.batches(tiles, truth[:, 3], speed, self._batch):
            full = np.concatenate([batch.rows, np.full(self._batch - len(batch.rows), batch.rows[0])])
            x_m = array.x_m - centre_m[0] + speed[full, None] * array.time_offset_s
            offset = np.stack([x_m, np.broadcast_to(array.y_m - centre_m[1], x_m.shape)], axis=-1)
            valid = scans.valid[at][full]
            one_scan = np.zeros(valid.shape, np.int32)
            template = Template(
                *(jnp.asarray(part) for part in (coefficients[full], offset.astype(np.float32), valid, one_scan))
            )
            scores = score_each(
                batch.ready.tile,
                template,
                to_tile(truth[full], self._ground.frame(batch.number)).astype(np.float32),
                np.float32(self._ground.source.height_reference_m[batch.number]),
                self._ground.basis.angular_frequency_rad_per_ns,
            )
            out[batch.rows] = np.asarray(scores)[: len(batch.rows)]
        return out
