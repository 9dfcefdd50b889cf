"""A registered drive in numbers, whole and cell by cell of the map's plane."""

import numpy as np
from jaxtyping import Float

from lgprjax.archive.accuracy import true_errors
from lgprjax.archive.job_record import CELL_M, CellTally, DriveFigures
from lgprjax.archive.registering import RegisteredDrive
from lgprjax.registration import WRONG_M, Code


def figures_of(drive: RegisteredDrive) -> DriveFigures:
    """Counts, accuracy where the truth is known, time a scan."""
    code, correlation = np.asarray(drive.fix.code), np.asarray(drive.fix.correlation)
    errors = true_errors(drive)
    along, cross = errors[np.isfinite(errors[:, 0])].T
    apart = np.hypot(along, cross)
    return DriveFigures(
        scans=len(code),
        tried=int(np.sum(code != Code.NO_WINDOW)),
        counts={each.label: int(np.sum(code == each)) for each in Code if np.any(code == each)},
        way_m=float(np.abs(np.diff(drive.track.travel_m)).sum()),
        correlation_ok=_median(correlation[code == Code.OK]),
        correlation_at_truth=_median(drive.correlation_at_truth),
        judged=len(apart),
        wrong=None if drive.truth is None else int(np.sum(apart > WRONG_M)),
        rms_along_m=_rms(along),
        rms_cross_m=_rms(cross),
        largest_m=float(apart.max()) if len(apart) else None,
        milliseconds_per_scan=drive.milliseconds_per_scan,
    )


def cells_of(drive: RegisteredDrive) -> tuple[CellTally, ...]:
    """What was found in each cell that the drive's searched scans lie in.

    A scan lies where its truth is, where that is not known where its ok fix is, else where its prior was.
    """
    code = np.asarray(drive.fix.code)
    tried = np.flatnonzero(code != Code.NO_WINDOW)
    place = _places(drive)[tried]
    ok, error_m = code[tried] == Code.OK, np.hypot(*true_errors(drive)[tried].T)
    time_s = drive.table["time_s"].to_numpy()[tried]
    cell, member = np.unique(np.floor(place / CELL_M).astype(np.int64), axis=0, return_inverse=True)
    tallies = []
    for number, (east, north) in enumerate(cell):
        own = np.flatnonzero(member.reshape(-1) == number)
        judged = own[np.isfinite(error_m[own])]
        worst = judged[np.argmax(error_m[judged])] if len(judged) else None
        declined = own[~ok[own]]
        tallies.append(
            CellTally(
                east=int(east),
                north=int(north),
                tried=len(own),
                ok=int(ok[own].sum()),
                judged=len(judged),
                square_m2=float(np.sum(error_m[judged] ** 2)),
                largest_m=0.0 if worst is None else float(error_m[worst]),
                largest_s=0.0 if worst is None else float(time_s[worst]),
                declined_s=float(time_s[declined[0]]) if len(declined) else None,
            )
        )
    return tuple(tallies)


def _places(drive: RegisteredDrive) -> Float[np.ndarray, "scan 2"]:
    found = np.where((np.asarray(drive.fix.code) == Code.OK)[:, None], np.asarray(drive.fix.pose)[:, :2], np.nan)
    place = np.where(np.isfinite(found), found, drive.track.pose[:, :2])
    return place if drive.truth is None else np.where(np.isfinite(drive.truth[:, :2]), drive.truth[:, :2], place)


def _median(values: Float[np.ndarray, " any"]) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else None


def _rms(values: Float[np.ndarray, " any"]) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if len(values) else None
