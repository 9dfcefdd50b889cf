"""How well a registered drive was located, in the metrics of the literature, each by its name."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.batch.recording import track_of_drive
from lgprjax.batch.register import RegisteredDrive, true_poses
from lgprjax.formats import DriveLog
from lgprjax.frames import LocalFrame, along_cross
from lgprjax.registration import WRONG_M, Code
from lgprjax.subsurface import SpatialIndex

_NEAR_M = 5.0


class Labels(NamedTuple):
    """What baselines' positions are wrong by: true places of their array centres, and label less truth."""

    truth_m: Float[np.ndarray, "scan 2"]
    error_m: Float[np.ndarray, "scan 2"]


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


def true_errors(drive: RegisteredDrive) -> Float[np.ndarray, "scan 2"]:
    """Fix less truth along and across the true heading; NaN without an ok fix, and where no truth is known."""
    if drive.truth is None:
        return np.full((len(drive.table), 2), np.nan)
    ok = np.asarray(drive.fix.code) == Code.OK
    error = np.where(ok[:, None], np.asarray(drive.fix.pose)[:, :2] - drive.truth[:, :2], np.nan)
    return np.stack(along_cross(error[:, 0], error[:, 1], drive.truth[:, 3]), axis=1)


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


def _rms(values: Float[np.ndarray, " scan"]) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def _mean(values: Float[np.ndarray, " scan"]) -> float:
    return float(np.mean(values)) if len(values) else float("nan")
