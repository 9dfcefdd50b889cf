"""Acceptance of a match: the map's false-match probability, thresholds, and the options of a search.

A score means little by itself: a match on one ground on a clear day is chance on another. In units of the noise floor
(the score of the same scans at decoys, outside the region) wet days, dry days and foreign ground share one scale. The
remaining difference between maps is measured on each map: pieces of its baselines are matched at other places of it,
where they cannot be right, by the same search that registers a drive.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.special import ndtr

from lgprjax.pso import SwarmConfig
from lgprjax.registration.fix import Code

LADDER_M = (0.0, 1.0, 2.0, 4.0, 8.0)
"""Lengths of the windows that a search tries at every scan; 0 is the scan alone. See ``ladder_of``."""

PIECE_M = 4.0
"""Travel after which a match counts as independent of the one before; see ``ladder_of``."""


def ladder_of(wavelength_m: float) -> tuple[float, ...]:
    """Windows for a wavelength in the soil: those of ``LADDER_M`` up to a metre, in proportion to it beyond."""
    return tuple(length_m * max(1.0, wavelength_m) for length_m in LADDER_M)


_TAIL = 0.1
"""Share of the false pieces used to fit the tail."""
_LEAST_PIECES = 60
_LEAST_SCALE = 2.0  # scale of a Gaussian field
LEAST_INDEPENDENT = 10.0
"""Least number of independent pieces of a map for the use of its own tail."""
_LEAST_SHARE = 0.02  # least share of the area: a region is at least as large as the peak
_SURE = 1.3
"""Safety margin of the fitted tail, in standard errors."""


POOLED_SIGMA = 1.25
"""Root of the normalised squared error that the search's matches on many grounds had, about 1.6."""
_POOLED_WEIGHT = 20.0
"""Weight of the value pooled over many grounds, in pieces, relative to a map's own pieces."""
_MOST_SIGMA = 3.0


class Chance(NamedTuple):
    """Tail of the best score that foreign ground reaches within a piece, for each length of the ladder.

    With z the score in units of the noise floor, the largest z² of a piece exceeds t > ``start`` with
    the probability share · exp(-(t - start) / scale): the tail of a Gaussian field has a scale of 2, ground with few
    strong reflectors a longer one.

    Attributes:
        start: start of the tail, in z².
        share: share of the pieces beyond the start.
        scale: scale of the tail, in z².
        area_m2: mean area of the region on the map in the fitted searches; more places have more chances.
        pieces: number of independent pieces of the fit.
        own: whether it was fitted to this map; else it is pooled over many grounds.
        sigma_scale: factor from a match's sigmas to those of its errors on this map.
        left_out: number of pieces of left-out baselines to which the factor was fitted; 0 if it is pooled.
        label_scatter_m: error of a baseline's labels per axis, from left-out baselines; 0 with fewer than three.
    """

    start: Float[np.ndarray, " window"]
    share: Float[np.ndarray, " window"]
    scale: Float[np.ndarray, " window"]
    area_m2: Float[np.ndarray, " window"]
    pieces: int
    own: bool
    sigma_scale: float = POOLED_SIGMA
    left_out: int = 0
    label_scatter_m: float = 0.0

    def for_windows(self, windows_m: tuple[float, ...], wavelength_m: float) -> "Chance":
        """The chance for other lengths, each from the next shorter one of the ladder, which has a longer tail."""
        at = np.searchsorted(np.asarray(ladder_of(wavelength_m)), np.asarray(windows_m) + 1e-9, side="right") - 1
        start, share, scale, area_m2 = (np.asarray(field)[at] for field in self[:4])
        return self._replace(start=start, share=share, scale=scale, area_m2=area_m2)


POOLED = Chance(
    start=np.full(5, 16.0),
    share=np.full(5, 0.1),
    scale=np.full(5, 2.7),
    area_m2=np.full(5, 9.0),
    pieces=0,
    own=False,
)
"""Chance pooled over grounds surveyed with a wavelength of 0.4 m; see ``pooled_chance``."""
_POOLED_WAVELENGTH_M = 0.4


def pooled_chance(wavelength_m: float) -> Chance:
    """Chance pooled over many grounds, for a map too small to have its own: chances scale with the area and the travel
    of a piece in wavelengths.
    """
    longer = wavelength_m / _POOLED_WAVELENGTH_M
    return POOLED._replace(area_m2=POOLED.area_m2 * longer**2 * longer / max(1.0, wavelength_m))


def fit_chance(
    highest: Float[np.ndarray, "piece window"],
    area_m2: Float[np.ndarray, "piece window"],
    independent: float,
    pooled: Chance = POOLED,
) -> Chance:
    """Chance of a map from its false pieces.

    The same pieces are tried at many places: a map with few independent pieces does not show how rare its highest
        scores
    are, and uses the pooled chance.

    Args:
        highest: largest z within each piece and window length; NaN where a window did not fit.
        area_m2: mean area of its region on the map.
        independent: pieces of the map that share no ground.
        pooled: the chance pooled over many grounds.
    """
    known = np.isfinite(highest)
    if len(highest) < _LEAST_PIECES or independent < LEAST_INDEPENDENT:
        return pooled._replace(pieces=int(independent))
    start, share, area = (np.array(field) for field in (pooled.start, pooled.share, pooled.area_m2))
    beyond: list[Float[np.ndarray, " piece"]] = []
    for window in range(highest.shape[1]):
        square = highest[known[:, window], window] ** 2
        if len(square) < _LEAST_PIECES:
            continue
        start[window] = float(np.quantile(square, 1.0 - _TAIL))
        share[window] = _TAIL
        area[window] = float(np.mean(area_m2[known[:, window], window]))
        beyond.append(square[square > start[window]] - start[window])
    excess = np.concatenate(beyond) if beyond else np.zeros(0)
    if len(excess) < _LEAST_PIECES * _TAIL:
        return pooled._replace(pieces=int(independent))
    # In units of the noise floor all windows have one tail; their pieces are the same, so that they count once.
    scale = float(excess.mean()) * (1.0 + _SURE / np.sqrt(len(excess) / len(beyond)))
    return Chance(
        start=start,
        share=share,
        scale=np.full(len(start), max(scale, _LEAST_SCALE)),
        area_m2=area,
        pieces=int(independent),
        own=True,
    )


def fit_sigma_scale(
    squared: Float[np.ndarray, " piece"], line_spacing_m: float, left_out_spacing_m: float, wavelength_m: float
) -> tuple[float, int]:
    """Factor on the sigmas of matches on a map, and the number of pieces that determine it.

    The covariance of a match counts its independent numbers by the scatter of scores on foreign ground. Errors are
    larger where the map's lines disagree, and where ground between them has to be interpolated: of lines farther apart
    than half a wavelength only that share is known, so that only that share of the numbers is independent.

    Args:
        squared: squared position error of each piece of a left-out baseline, match minus the piece's own label, in
            units of the match's covariance, per degree of freedom.
        line_spacing_m: distance of neighbouring lines of the map.
        left_out_spacing_m: distance of neighbouring lines with a baseline left out.
        wavelength_m: wavelength in the soil.
    """
    here, there = (max(1.0, 2.0 * each_m / wavelength_m) for each_m in (line_spacing_m, left_out_spacing_m))
    # Clipped, because a single wrong match would dominate the mean.
    known = np.minimum(squared, 4.0 * _MOST_SIGMA**2) * here / there
    own = (_POOLED_WEIGHT * POOLED_SIGMA**2 * here + float(np.sum(known))) / (_POOLED_WEIGHT + len(known))
    return float(np.clip(np.sqrt(own), 1.0, _MOST_SIGMA)), len(known)


def p_foreign(
    z: Float[np.ndarray, "*end window"],
    area_m2: Float[np.ndarray, "*end window"],
    chance: Chance,
    trials: float | Float[np.ndarray, "*end window"],
) -> Float[np.ndarray, "*end window"]:
    """Probability that foreign ground reaches this z somewhere within a piece, in any window tried.

    Args:
        z: score in units of the noise floor.
        area_m2: area of the region on the map.
        chance: chance of a false match on the map.
        trials: number of window lengths, time scales and polarities tried.
    """
    return np.asarray(np.exp(log_p_foreign(z, area_m2, chance, trials)))


def log_p_foreign(
    z: Float[np.ndarray, "*end window"],
    area_m2: Float[np.ndarray, "*end window"],
    chance: Chance,
    trials: float | Float[np.ndarray, "*end window"],
) -> Float[np.ndarray, "*end window"]:
    """Natural logarithm of ``p_foreign``, which is below the smallest number where metres of ground match well."""
    square = np.square(np.maximum(z, 0.0))
    share = np.log(chance.share)
    tail = np.where(
        square > chance.start, share - (square - chance.start) / chance.scale, share * square / chance.start
    )
    more = np.maximum(area_m2 / chance.area_m2, _LEAST_SHARE)
    return np.asarray(np.minimum(np.log(trials * more) + tail, 0.0))


def least_z(risk: float, chance: Chance) -> Float[np.ndarray, " window"]:
    """Score in units of the noise floor that each window of the ladder must reach in the whole region, with a single
    time scale tried.
    """
    more = len(chance.start) * chance.share / risk
    return np.asarray(np.sqrt(chance.start + chance.scale * np.log(np.maximum(more, 1.0))))


def p_rival(z: Float[np.ndarray, "*end"], rival: Float[np.ndarray, "*end"]) -> Float[np.ndarray, "*end"]:
    """Bound on the probability that the rival is the true place, and the best one only resembles it.

    Let the ground at the best place resemble that of the rival by a share rho, and the rival be the true place. Then
    the best place's score is rho times the rival's and noise of sqrt(1 - rho²) noise floors; it comes out at z or above
    with the probability Q((z - rho z_rival) / sqrt(1 - rho²)), which is largest for rho = z_rival / z, where it is
    Q(sqrt(z² - z_rival²)): no resemblance, known or not, makes a mistake more probable.

    Args:
        z, rival: scores of the best place and of the best one apart from it, in units of the noise floor.
    """
    lead = np.sqrt(np.maximum(np.square(np.maximum(z, 0.0)) - np.square(np.maximum(rival, 0.0)), 0.0))
    return np.asarray(ndtr(-lead))


# How certain a match must be to be called ok.

MIN_OVERLAP = 0.6
"""Least share of a template's traces on the map."""

_ONE_LOOK = 0.1  # of the independent matches of a piece


class Thresholds(NamedTuple):
    """Thresholds of a match for ``ok``, in units of the noise floor, which is the score due to chance alone.

    Attributes:
        strength_by_chance: least score.
        margin_by_chance: least lead over the runner-up.
        overlap: least share of the template's traces on the map.
        sigma_scale: factor from a match's sigmas to those of its errors.
    """

    strength_by_chance: float
    margin_by_chance: float
    overlap: float = MIN_OVERLAP
    sigma_scale: float = 1.0


def thresholds_at(
    risk: float, window_m: float, area_m2: float, wavelength_m: float, chance: Chance = POOLED
) -> Thresholds:
    """Thresholds of a single match that foreign ground passes with probability ``risk``.

    A drive has many looks within a piece, which its search counts (``p_foreign``); a template that is matched once has
    one.
    """
    own = chance.for_windows((window_m,), wavelength_m)
    more = max(area_m2 / float(own.area_m2[0]), 0.1)
    square = float(own.start[0] + own.scale[0] * np.log(max(_ONE_LOOK * float(own.share[0]) * more / risk, 1e-3)))
    return Thresholds(strength_by_chance=max(square, 4.0) ** 0.5, margin_by_chance=1.0)


def independent_numbers(floor: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Number of independent numbers in a template, from the scatter of scores on ground that does not match."""
    return jnp.clip(1.0 / jnp.maximum(floor, 1e-3) ** 2, 4.0, 4000.0)


def judge(
    score: Float[Array, "*batch"],
    rival: Float[Array, "*batch"],
    floor: Float[Array, "*batch"],
    best_overlap: Float[Array, "*batch"],
    on_edge: Bool[Array, "*batch"],
    finite: Bool[Array, "*batch"],
    thresholds: Thresholds,
) -> Int[Array, "*batch"]:
    """The code of a fix; the first reason that applies, from the input outward.

    Args:
        score, rival: scores of the best place and of the best one apart from it.
        floor: standard deviation of the score over the rest of the region.
        best_overlap: largest share of the template on the map anywhere in the region.
        on_edge: whether the best pose is at the region's rim.
        finite: whether enough of the template's traces hold finite data.
        thresholds: acceptance thresholds.
    """
    reasons = (
        (~finite, Code.NON_FINITE),
        (best_overlap <= 0.0, Code.OFF_MAP),
        (best_overlap < thresholds.overlap, Code.LOW_OVERLAP),
        (~(score >= thresholds.strength_by_chance * floor), Code.LOW_CORRELATION),
        (on_edge, Code.EDGE),
        (~(score - rival >= thresholds.margin_by_chance * floor), Code.AMBIGUOUS),
    )
    code = jnp.full(score.shape, Code.OK, dtype=jnp.int32)
    for applies, reason in reversed(reasons):
        code = jnp.where(applies, jnp.int32(reason), code)
    return code


# User options of a registration.

_UNSTATED_M = 2.5
_LEAST_M, _MOST_M = 2.0, 6.0
_SIGMAS = 4.0


FINISH_SWARM = SwarmConfig(particles=24, iterations=16)
"""About a candidate: enough for what the coarse stage leaves open."""
SEARCH_SWARM = SwarmConfig(particles=192, iterations=40)
"""Begun anywhere in a region of 5 m and 30 degrees: largest size; around a known place a quarter and half of these."""


@dataclass(frozen=True)
class RegisterOptions:
    """Options of a registration; all have defaults.

    Attributes:
        search_m: half width of the search region around the prior, m; None: four sigma of the log plus 0.5 m, at least
            2 m (the sigma of a receiver does not cover the error of the map labels), or 2.5 m without a sigma. If no
            match is found, or the best one is at the edge, a region of twice the width is searched as well.
        window_m: length of the matched window of travel, m; 0 for single scans, None for the shortest of 0, 1, 2, 4 and
            8 m that meets the risk.
        risk: largest accepted probability, per 4 m of travel, that other ground passes the search.
        time_scale: ratio of two-way travel time in the ground, drive to map (wetter ground: above 1); None to estimate
            it along the drive.
        height_m, roll_deg, pitch_deg: half widths of the search in height, roll and pitch (0: no pitch). The half width
            in heading follows the prior: three sigma, between one and five degrees.
        odometer_sigma: relative error of the odometer scale, which varies with load, wear and pressure of the tyres.
        own_thresholds: acceptance thresholds calibrated on drives, in place of noise floor and risk.
        swarm: refinement by a particle swarm of this size around each candidate; None: Gauss-Newton.
        search_swarm: search by particle swarms of at most this size over five dimensions, instead of all positions of
            the region: an independent check, slower.
        seed: random seed of the swarms.
        track: causal registration, as on board: each fix uses earlier scans only, headings come from a filter that the
            fixes correct. False: later scans also decide on earlier fixes.
    """

    search_m: float | None = None
    window_m: float | None = None
    risk: float = 1e-4
    time_scale: float | None = None
    height_m: float = 0.08
    roll_deg: float = 1.5
    pitch_deg: float = 0.0
    odometer_sigma: float = 0.005
    own_thresholds: Thresholds | None = None
    swarm: SwarmConfig | None = None
    search_swarm: SwarmConfig | None = None
    seed: int = 0
    track: bool = False
    filter: Literal["causal", "smoothed"] | None = None

    def search_half_m(self, sigma_m: Float[np.ndarray, " scan"] | None = None) -> float:
        """Half side of the search square around priors with these sigmas (NaN: not stated)."""
        if self.search_m is not None:
            return self.search_m
        if sigma_m is None or not np.isfinite(sigma_m).all():
            return _UNSTATED_M
        # Steps of half a metre: each is a compiled shape.
        wanted_m = _SIGMAS * float(np.max(sigma_m)) + 0.5
        return float(np.clip(np.ceil(2.0 * wanted_m) / 2.0, _LEAST_M, _MOST_M))

    def half_width(self, sigma_yaw_rad: Float[np.ndarray, " scan"], half_m: float) -> Float[np.ndarray, "scan 6"]:
        """Half widths of the search about priors: along, cross, height, yaw, roll, pitch."""
        yaw = np.clip(3.0 * sigma_yaw_rad, np.radians(1.0), np.radians(5.0))
        # A pitch that is not searched keeps a width: it divides.
        pitch_deg = self.pitch_deg or 1.0
        widths = (half_m, half_m, self.height_m, yaw, np.radians(self.roll_deg), np.radians(pitch_deg))
        return np.stack(np.broadcast_arrays(*widths), axis=-1)
