"""A map's own chance: how well ground that is not the map's matches it, and what a fix is worth against that.

A score says little by itself: what is a match on one ground on a clear day is chance on another. In units of the noise
floor (what the same scans score at decoys, beyond the region) wet days, dry days and foreign ground come to one scale.
What is left of the difference between maps each map measures on itself: pieces of its baselines are matched at other
places of it, where they can never be right, by the very search that registers a drive.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

LADDER_M = (0.0, 1.0, 2.0, 4.0, 8.0)
"""Lengths of the windows that a search tries at every scan; 0 is the scan alone. See ``ladder_of``."""

PIECE_M = 4.0
"""Travel after which a match counts as independent of the one before; see ``ladder_of``."""


def ladder_of(wavelength_m: float) -> tuple[float, ...]:
    """Windows for a wavelength in the soil: those of ``LADDER_M`` up to a metre, in proportion to it beyond."""
    return tuple(length_m * max(1.0, wavelength_m) for length_m in LADDER_M)


_TAIL = 0.1
"""Share of the false pieces that the tail is fitted to."""
_LEAST_PIECES = 60
_LEAST_SCALE = 2.0  # that of a Gaussian field
LEAST_INDEPENDENT = 10.0
"""Pieces of a map that share no ground, from which its own tail is believed."""
_LEAST_SHARE = 0.02  # of the area: no region is smaller than the peak itself
_SURE = 1.3
"""The fitted tail is taken at so many of its standard errors to the safe side."""


class Chance(NamedTuple):
    """Tail of the best score that foreign ground reaches within a piece, for each length of the ladder.

    With z the score in units of the noise floor, the largest z² of a piece exceeds t > ``start`` with
    the probability share · exp(-(t - start) / scale): the tail of a Gaussian field has a scale of 2, ground with few
    strong reflectors a longer one.

    Attributes:
        start: of the tail, in z².
        share: of the pieces beyond it.
        scale: of the tail, in z².
        area_m2: mean area of the region that lay on the map in those searches; more places have more chances.
        pieces: independent pieces that it was fitted to.
        own: fitted to this map; else pooled over many grounds.
    """

    start: Float[np.ndarray, " window"]
    share: Float[np.ndarray, " window"]
    scale: Float[np.ndarray, " window"]
    area_m2: Float[np.ndarray, " window"]
    pieces: int
    own: bool

    def for_windows(self, windows_m: tuple[float, ...], wavelength_m: float) -> "Chance":
        """The chance for other lengths: each as the next shorter one of the ladder, whose tail is the longer."""
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
"""Of grounds looked at with a wavelength of 0.4 m; see ``pooled_chance``."""
_POOLED_WAVELENGTH_M = 0.4


def pooled_chance(wavelength_m: float) -> Chance:
    """What many grounds have, for a map that cannot tell its own: chances go with the area and the travel of a piece in
    wavelengths."""
    longer = wavelength_m / _POOLED_WAVELENGTH_M
    return POOLED._replace(area_m2=POOLED.area_m2 * longer**2 * longer / max(1.0, wavelength_m))


def fit_chance(
    highest: Float[np.ndarray, "piece window"],
    area_m2: Float[np.ndarray, "piece window"],
    independent: float,
    pooled: Chance = POOLED,
) -> Chance:
    """Chance of a map from its false pieces.

    The same pieces serve with many places: a map with few independent ones cannot tell how rare its highest scores are,
    and borrows what many grounds have.

    Args:
        highest: largest z within each piece and window length; NaN where a window did not fit.
        area_m2: mean area of its region on the map.
        independent: pieces of the map that share no ground.
        pooled: what many grounds have.
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
    return Chance(start, share, np.full(len(start), max(scale, _LEAST_SCALE)), area, pieces=int(independent), own=True)


def p_foreign(
    z: Float[np.ndarray, "*end window"], area_m2: Float[np.ndarray, "*end window"], chance: Chance, trials: float
) -> Float[np.ndarray, "*end window"]:
    """Probability that ground that is not the map's gives a z as high somewhere within a piece, in any window tried.

    Args:
        z: score in units of the noise floor.
        area_m2: of the region that lies on the map.
        chance: of the map.
        trials: window lengths, time scales and polarities that were tried.
    """
    square = np.square(np.maximum(z, 0.0))
    beyond = chance.share * np.exp(-(square - chance.start) / chance.scale)
    below = chance.share ** (square / chance.start)
    more = np.maximum(area_m2 / chance.area_m2, _LEAST_SHARE)
    return np.asarray(np.clip(trials * more * np.where(square > chance.start, beyond, below), 0.0, 1.0))


def least_z(risk: float, chance: Chance) -> Float[np.ndarray, " window"]:
    """Score in units of the noise floor that each window of the ladder must reach in the whole region, where no time
    scale but one was tried."""
    more = len(chance.start) * chance.share / risk
    return np.asarray(np.sqrt(chance.start + chance.scale * np.log(np.maximum(more, 1.0))))


def p_rival(z: Float[np.ndarray, "*end"], rival: Float[np.ndarray, "*end"]) -> Float[np.ndarray, "*end"]:
    """Bound on the probability that the rival is the true place, and the best one only looks like it.

    Let the ground at the best place resemble that of the rival by a share rho, and the rival be the true place. Then
    the best place's score is rho times the rival's and noise of sqrt(1 - rho²) noise floors; it comes out at z or above
    with the probability Q((z - rho z_rival) / sqrt(1 - rho²)), which is largest for rho = z_rival / z, where it is
    Q(sqrt(z² - z_rival²)): no resemblance, known or not, makes a mistake more probable.

    Args:
        z, rival: scores of the best place and of the best one apart from it, in units of the noise floor.
    """
    lead = np.sqrt(np.maximum(np.square(np.maximum(z, 0.0)) - np.square(np.maximum(rival, 0.0)), 0.0))
    return np.asarray(ndtr(-lead))
