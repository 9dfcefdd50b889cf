"""How well a driven course was located: errors relative to the map's labels, and an error model of the fixes."""

from collections.abc import Iterable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.batch.register import RegisteredDrive, true_errors, true_poses
from lgprjax.formats import DriveLog
from lgprjax.frames import LocalFrame, along_cross
from lgprjax.recordings.drives import track_of_drive
from lgprjax.registration import WRONG_M, Code
from lgprjax.subsurface import SpatialIndex

_NEAR_M = 5.0


class Labels(NamedTuple):
    """What baselines' positions are wrong by: true places of their array centres, and label less truth."""

    truth_m: Float[np.ndarray, "scan 2"]
    error_m: Float[np.ndarray, "scan 2"]


def labels_of(baselines: Iterable[DriveLog], frame: LocalFrame) -> Labels:
    """Label errors of a map's baselines, where their truth is known.

    Raises:
        ValueError: no baseline holds its truth.
    """
    places, errors = [], []
    for log in baselines:
        truth = true_poses(log, frame)
        if truth is None:
            continue
        label = track_of_drive(log, frame).track.pose[:, :2]
        known = np.isfinite(truth[:, 0])
        places.append(truth[known, :2])
        errors.append((label - truth[:, :2])[known])
    if not places:
        raise ValueError("no baseline holds its truth")
    return Labels(np.concatenate(places), np.concatenate(errors))


class DriveAccuracy(NamedTuple):
    """Figures of one registered drive whose truth is known; those of errors are of its ok fixes.

    Attributes:
        scans, ok, wrong: all that were tried (inside a window none is); those called ok; those of them more than
            ``WRONG_M`` off.
        correlation_at_truth: median of the plain score at the true pose: how hard the drive is.
        overlap_channels: median channels of the scan on the map.
        along_rms_m, cross_rms_m: of fix less truth in the map's frame, along and across the true heading.
        relative_mean_m, relative_cross_mean_m: mean of |(truth_live - truth_map) - (fix_live - label_map)|, whole and
            across, with one clock offset a drive taken out (RA-L 2020): free of what the map's labels are wrong by,
            and of a constant lag along the track.
    """

    name: str
    scans: int
    ok: int
    wrong: int
    correlation_at_truth: float
    overlap_channels: float
    along_rms_m: float
    cross_rms_m: float
    relative_mean_m: float
    relative_cross_mean_m: float

    @property
    def availability(self) -> float:
        """Share of the scans called ok."""
        return self.ok / max(self.scans, 1)


def accuracy_of(drive: RegisteredDrive, labels: Labels) -> DriveAccuracy:
    """Accuracy of a drive against its truth.

    Raises:
        ValueError: the drive's truth is not known.
    """
    if drive.truth is None:
        raise ValueError(f"the truth of {drive.name} is not known")
    code, errors = np.asarray(drive.fix.code), true_errors(drive)
    ok = np.isfinite(errors[:, 0])
    along, cross = errors[ok].T
    wrong = np.hypot(along, cross) > WRONG_M
    error = np.asarray(drive.fix.pose)[ok, :2] - drive.truth[ok, :2]
    relative = relative_error(error, drive.truth[ok, :2], drive.truth[ok, 3], labels)
    tried = np.isfinite(drive.correlation_at_truth)
    return DriveAccuracy(
        name=drive.name,
        scans=int(np.sum(code != Code.NO_WINDOW)),
        ok=int(ok.sum()),
        wrong=int(wrong.sum()),
        correlation_at_truth=float(np.median(drive.correlation_at_truth[tried])) if tried.any() else float("nan"),
        overlap_channels=float(np.median(np.asarray(drive.fix.overlap_channels)[ok])) if ok.any() else float("nan"),
        along_rms_m=_rms(along),
        cross_rms_m=_rms(cross),
        relative_mean_m=relative.mean_m,
        relative_cross_mean_m=relative.cross_mean_m,
    )


def _rms(values: Float[np.ndarray, " scan"]) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


class RelativeError(NamedTuple):
    """Means of |(truth_live - truth_map) - (found_live - label_map)| and of its part across (RA-L 2020)."""

    mean_m: float
    cross_mean_m: float


def relative_error(
    error_m: Float[np.ndarray, "place 2"],
    truth_m: Float[np.ndarray, "place 2"],
    yaw_rad: Float[np.ndarray, " place"],
    labels: Labels,
) -> RelativeError:
    """Errors less the label's at the nearest true point of the map, where there is one, without a lag along the track.

    Args:
        error_m: found less true, in the map's frame.
        truth_m, yaw_rad: true places of the array's centre, and headings.
        labels: of the map.
    """
    index = SpatialIndex(labels.truth_m, 0.5)
    nearest = [index.nearest(place, _NEAR_M) for place in truth_m]
    kept = np.array([number for number, near in enumerate(nearest) if near is not None], np.int64)
    near = np.array([near for near in nearest if near is not None], np.int64)
    wrong = error_m[kept] - labels.error_m[near]
    along, cross = along_cross(wrong[:, 0], wrong[:, 1], yaw_rad[kept])
    # One clock offset a drive moves every fix along the track by speed times offset; a lag is all it can hide.
    along -= np.median(along) if len(along) else 0.0
    return RelativeError(_mean(np.hypot(along, cross)), _mean(np.abs(cross)))


def _mean(values: Float[np.ndarray, " scan"]) -> float:
    return float(np.mean(values)) if len(values) else float("nan")


# An error model of fixes from a drive whose truth is known: slow and white parts, and where there were none.

_BINS_M = (0.15, 0.3, 0.5, 0.8, 1.2, 1.8, 2.5, 3.5, 5.0)
_FEWEST = 50


class FixErrorFit(NamedTuple):
    """What fixes of a drive were wrong by; along (m), across (m), in heading (rad).

    Attributes:
        bias: mean.
        slow_sigma, white_sigma: of the part that neighbouring fixes share, and of the rest.
        slow_m: way over which the slow part is lost, of the cross-track errors.
        found_m, lost_m: mean lengths of stretches with fixes and without.
        strength, p_false: medians of the ok fixes' matches.
    """

    bias: Float[np.ndarray, "3"]
    slow_sigma: Float[np.ndarray, "3"]
    white_sigma: Float[np.ndarray, "3"]
    slow_m: float
    found_m: float
    lost_m: float
    strength: float
    p_false: float


def fit_fix_errors(
    travel_m: Float[np.ndarray, " scan"],
    ok: Bool[np.ndarray, " scan"],
    error: Float[np.ndarray, "scan 3"],
    strength: Float[np.ndarray, " scan"],
    p_false: Float[np.ndarray, " scan"],
) -> FixErrorFit:
    """Moments of a drive's errors.

    The covariance of two fixes of a drive falls with the way between them as σ² exp(−d / L); what it is short of the
    variance at no distance is white. Level and length are fitted by least squares on the logarithm, over distances at
    which the covariance is clearly above zero.

    Args:
        travel_m: way driven at each scan.
        ok: there was a fix.
        error: of it; what stands where there was none is not used.
        strength, p_false: of its match.

    Raises:
        ValueError: fewer than 50 fixes.
    """
    if int(ok.sum()) < _FEWEST:
        raise ValueError(f"{int(ok.sum())} fixes are too few for an error model, {_FEWEST} are needed")
    place, wrong = travel_m[ok], error[ok]
    bias = wrong.mean(axis=0)
    rest = wrong - bias
    variance = rest.var(axis=0)
    shared = np.array([_shared(place, rest, low, high) for low, high in pairwise(_BINS_M)])
    middle = 0.5 * (np.array(_BINS_M[1:]) + np.array(_BINS_M[:-1]))
    slow_m = _length(middle, shared[:, 1], variance[1])
    slow = np.clip(shared[0] * np.exp(middle[0] / slow_m), 0.0, variance)
    found_m, lost_m = _stretches(travel_m, ok)
    matched = float(np.median(strength[ok])), float(np.median(p_false[ok]))
    return FixErrorFit(bias, np.sqrt(slow), np.sqrt(variance - slow), slow_m, found_m, lost_m, *matched)


def _shared(
    place_m: Float[np.ndarray, " fix"], rest: Float[np.ndarray, "fix 3"], low_m: float, high_m: float
) -> Float[np.ndarray, "3"]:
    """Mean product of errors of fixes between two distances apart."""
    first = np.searchsorted(place_m, place_m + low_m)
    last = np.searchsorted(place_m, place_m + high_m)
    sums = np.concatenate([np.zeros((1, rest.shape[1])), np.cumsum(rest, axis=0)])
    products = rest * (sums[last] - sums[first])
    return np.asarray(products.sum(axis=0) / max(int((last - first).sum()), 1))


def _length(distance_m: Float[np.ndarray, " bin"], shared: Float[np.ndarray, " bin"], variance: float) -> float:
    """Way over which a covariance falls by a factor of e."""
    clear = shared > 0.05 * variance
    until = len(clear) if clear.all() else int(np.argmin(clear))
    if until < 2:
        return float(distance_m[0])
    slope = np.polyfit(distance_m[:until], np.log(shared[:until]), 1)[0]
    return float(np.clip(-1.0 / slope, distance_m[0], distance_m[-1])) if slope < 0.0 else float(distance_m[-1])


def _stretches(travel_m: Float[np.ndarray, " scan"], ok: Bool[np.ndarray, " scan"]) -> tuple[float, float]:
    """Mean lengths of the stretches with fixes and without."""
    changes = np.flatnonzero(np.diff(ok.astype(int)))
    step_m = float(np.median(np.diff(travel_m)))
    runs = max((len(changes) + 1) / 2.0, 1.0)
    share = float(ok.mean())
    return share * len(ok) * step_m / runs, max((1.0 - share) * len(ok) * step_m / runs, 0.1 * step_m)
