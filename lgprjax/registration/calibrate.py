"""Thresholds from data: scores of matches on the map's ground and on ground known not to match."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.registration.fix import WRONG_M, Fix
from lgprjax.registration.judge import Thresholds

_TAIL = 0.05  # share of the false matches that the tail is fitted to
_LEAST_FALSE = 200
_OVERLAP = 0.8
"""Least overlap: with a fifth of the traces off the map, its edge already shifts a match by decimetres."""


class Outcomes(NamedTuple):
    """Matches known to be right or wrong, one row each.

    Attributes:
        score, margin, noise_floor: measures of the fix (see ``Fix``).
        right: whether the match is within ``WRONG_M`` of the truth.
        error_m: position error, east and north; NaN for matches that cannot be right.
        spread_m: position error minus the mean error of the correct matches of its drive.
        match_covariance: covariance of the position from the match alone, with a ``sigma_scale`` of 1.
        other_covariance: covariance of the position due to the map's own positions, the odometer and the truth.
    """

    score: Float[np.ndarray, " match"]
    margin: Float[np.ndarray, " match"]
    noise_floor: Float[np.ndarray, " match"]
    right: Bool[np.ndarray, " match"]
    error_m: Float[np.ndarray, "match 2"]
    spread_m: Float[np.ndarray, "match 2"]
    match_covariance: Float[np.ndarray, "match 2 2"]
    other_covariance: Float[np.ndarray, "match 2 2"]


def outcomes_of(
    fix: Fix,
    truth_m: Float[np.ndarray, "scan 2"] | None,
    map_odometry_covariance: Float[np.ndarray, "scan 2 2"],
    truth_variance: Float[np.ndarray, " scan"] | None = None,
) -> Outcomes:
    """Outcomes of a drive's fixes, without fixes that have no pose.

    Args:
        fix: fixes of a drive registered with a ``sigma_scale`` of 1; poses in the map's frame.
        truth_m: true positions; ``None`` for a search on ground that cannot match.
        map_odometry_covariance: part of the fixes' covariance due to map and odometer.
        truth_variance: variance of the truth's own error, in east and in north each; ``None``: zero.
    """
    pose, covariance = np.asarray(fix.pose)[:, :2], np.asarray(fix.covariance)[:, :2, :2]
    error_m = np.full_like(pose, np.nan) if truth_m is None else pose - truth_m
    known = np.isfinite(pose[:, 0]) & (np.asarray(fix.overlap) >= _OVERLAP)
    if truth_m is not None:
        known &= np.isfinite(truth_m[:, 0])
    right = np.hypot(error_m[:, 0], error_m[:, 1]) <= WRONG_M
    used = right & known
    mean_m = np.mean(error_m[used], axis=0) if used.any() else np.zeros(2)
    score = np.asarray(fix.margin) + np.asarray(fix.runner_up)
    own = 0.0 if truth_variance is None else truth_variance[:, None, None] * np.eye(2)
    rows = (
        score,
        np.asarray(fix.margin),
        np.asarray(fix.noise_floor),
        right,
        error_m,
        error_m - mean_m,
        covariance - map_odometry_covariance,
        map_odometry_covariance + own,
    )
    return Outcomes(*(field[known] for field in rows))


def joined(parts: list[Outcomes]) -> Outcomes:
    """Concatenate the rows of several."""
    return Outcomes(*(np.concatenate(fields) for fields in zip(*parts, strict=True)))


def calibrate(matches: Outcomes, false: Outcomes, risk: float) -> Thresholds:
    """Thresholds that a match on foreign ground passes with probability ``risk``.

    Both the score and its margin over the runner-up are measured in units of the noise floor over the search region,
    which makes clear days, rain and false ground comparable. The tails of the false matches are exponential; both
    limits follow from the fits. A place that resembles another has a small margin, so the margin must also exceed that
    of every wrong match on the true ground. The sigma scale makes the errors consistent with their covariances.

    Args:
        matches: outcomes on the ground of the map.
        false: outcomes on ground known not to match.
        risk: accepted probability of a false match, per match.

    Raises:
        ValueError: there are too few false matches to fit their tail, or no correct match.
    """
    if len(false.score) < _LEAST_FALSE:
        raise ValueError(f"{len(false.score)} false matches; at least {_LEAST_FALSE} are needed")
    if not matches.right.any():
        raise ValueError("no match near the true positions: labels, map and drive do not belong together")
    wrong = ~matches.right
    score = tail_limit(false.score / false.noise_floor, risk)
    lead = tail_limit(false.margin / false.noise_floor, risk**0.5)
    if wrong.any():
        lead = max(lead, 1.2 * float(np.max((matches.margin / matches.noise_floor)[wrong])))
    return Thresholds(
        strength_by_chance=score, margin_by_chance=lead, overlap=_OVERLAP, sigma_scale=sigma_scale(matches)
    )


def tail_limit(values: Float[np.ndarray, " match"], risk: float) -> float:
    """The value that is exceeded with probability ``risk``, by an exponential fit to the upper twentieth."""
    start = float(np.quantile(values, 1.0 - _TAIL))
    beyond = float(np.mean(values[values > start] - start)) if np.any(values > start) else 0.0
    return start + beyond * float(np.log(_TAIL / risk)) if risk < _TAIL else start


def sigma_scale(matches: Outcomes) -> float:
    """Scale of the match's sigmas that makes errors about their drive's mean consistent with their covariances.

    The map's own errors hardly change along a drive, those of the match do: an error minus the drive's mean is that of
    the match. (On a drive of many kilometres part of the map's error remains; the scale is then conservative.)
    """
    right = matches.right
    spread, covariance = matches.spread_m[right], matches.match_covariance[right]
    solved = np.linalg.solve(covariance, spread[..., None])[..., 0]
    return float(np.sqrt(np.mean(np.sum(spread * solved, axis=1)) / 2.0))


def squared_errors(matches: Outcomes, scale: float) -> Float[np.ndarray, " match"]:
    """Squared error of each place in units of its covariance; its mean is 2 where the covariance is right."""
    covariance = scale**2 * matches.match_covariance + matches.other_covariance
    solved = np.linalg.solve(covariance, matches.error_m[..., None])[..., 0]
    return np.asarray(np.sum(matches.error_m * solved, axis=1))
