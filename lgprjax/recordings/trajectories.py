"""Trajectories of a drive, by its fixes, its navigation or its truth, and two registrations of a drive compared."""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float

from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, NavigationTrack, Trajectory, drive_hash_of, refuse_other_drive
from lgprjax.frames import LocalFrame, along_cross
from lgprjax.recordings.drives import poses_of
from lgprjax.registration import WRONG_M

_SAME_TIME_S = 1e-3
_SHOWN = ("code", "correlation", "margin", "sigma_along_m", "sigma_cross_m", "p_false")


def frame_of_drive(log: DriveLog) -> LocalFrame:
    """Metres around the first recorded place: the same for fixes, navigation and truth of a drive."""
    place = log.description.navigation
    return LocalFrame(float(place.latitude_deg[0]), float(place.longitude_deg[0]), float(place.height_m[0]))


def trajectory_of_fixes(log: DriveLog, fixes: pd.DataFrame, path: str | Path) -> Trajectory:
    """The fixes that are ok, of a drive.

    Raises:
        InputError: the fixes in ``path`` are of another drive.
    """
    if len(fixes) != log.scans:
        raise InputError(path, "rows", f"{log.scans}, one per scan of {log.path.name}", str(len(fixes)))
    if not np.allclose(fixes["time_s"].to_numpy(np.float64), log.scan_time_s, rtol=0.0, atol=_SAME_TIME_S):
        raise InputError(path, "time_s", f"the scan times of {log.path.name}", "other times")
    refuse_other_drive(path, fixes, log.path)
    ok = fixes[fixes["code"] == "ok"]
    time_s, latitude, longitude, height, heading, roll = (
        ok[name].to_numpy(np.float64)
        for name in ("time_s", "latitude_deg", "longitude_deg", "height_m", "heading_deg", "roll_deg")
    )
    return Trajectory(
        name=log.path.name.removesuffix(".drive.h5"),
        what="fixes that are ok",
        t0_utc=log.description.t0_utc,
        time_s=time_s,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        heading_deg=heading,
        roll_deg=roll,
        properties={
            "scan": ok["scan"].to_numpy(),
            **{name: ok[name].to_numpy() for name in _SHOWN if name in ok.columns},
        },
    )


def trajectory_of_track(log: DriveLog, *, truth: bool) -> Trajectory:
    """The array's centre at every scan, by the drive's navigation, or by its truth.

    Raises:
        InputError: no truth in this log.
    """
    known: NavigationTrack | None = log.description.truth if truth else log.description.navigation
    if known is None:
        raise InputError(log.path, "/truth", "the true poses of a simulated or surveyed drive", "none")
    time_s, frame = log.scan_time_s, frame_of_drive(log)
    within = (time_s >= known.time_s[0]) & (time_s <= known.time_s[-1])
    time_s = time_s[within]
    pose, up = poses_of(known, time_s, frame, log.description.array)
    latitude, longitude, height = frame.to_geodetic(pose[:, 0], pose[:, 1], up + pose[:, 2])
    return Trajectory(
        name=log.path.name.removesuffix(".drive.h5"),
        what="truth" if truth else "navigation as recorded",
        t0_utc=log.description.t0_utc,
        time_s=time_s,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        heading_deg=frame.heading_of_yaw(pose[:, 3], longitude),
        roll_deg=np.degrees(pose[:, 4]),
        properties={"scan": np.flatnonzero(within)},
    )


# Two registrations of a drive.


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Comparison of two registrations of a drive. Figures are ``None`` if nothing is comparable.

    Attributes:
        scans: number of scans of the drive.
        ok_first, ok_second, ok_both: number of scans with a position.
        codes: number of scans by their two codes, for different codes, most frequent first.
        rms_along_m, rms_cross_m, largest_m: second minus first, where both are ok, in axes of the first's heading.
        within_95: share of these differences within the 95 % interval of the combined sigmas.
        apart: number of scans, both ok, more than ``WRONG_M`` apart, so that one of the two is wrong.
        apart_at: first and last scan of each run of these scans.
        median_correlation_first, median_correlation_second: median correlation of the ok fixes.
    """

    scans: int
    ok_first: int
    ok_second: int
    ok_both: int
    codes: dict[str, int]
    rms_along_m: float | None
    rms_cross_m: float | None
    largest_m: float | None
    within_95: float | None
    apart: int
    apart_at: tuple[tuple[int, int], ...]
    median_correlation_first: float | None
    median_correlation_second: float | None

    def as_json(self) -> dict[str, object]:
        """All fields, ready for ``json.dump``."""
        return asdict(self)


_CHI2_95 = 5.991
"""95 % quantile of chi-square with two degrees of freedom."""


def compare_fixes(first: pd.DataFrame, second: pd.DataFrame, path: str | Path) -> Comparison:
    """Compare two registrations, scan by scan.

    Args:
        first, second: fixes of one drive.
        path: path of the second file, for the message.

    Raises:
        InputError: the fixes are of different drives.
    """
    hashes = [drive_hash_of(table) for table in (first, second)]
    if None not in hashes and hashes[0] != hashes[1]:
        raise InputError(path, "provenance", "fixes of the same drive as the first file", "fixes of another drive")
    if len(first) != len(second):
        raise InputError(path, "rows", f"{len(first)} as in the first file (fixes of the same drive)", str(len(second)))
    if float(np.abs(first["time_s"].to_numpy() - second["time_s"].to_numpy()).max()) > _SAME_TIME_S:
        raise InputError(path, "column time_s", "the times of the first file (fixes of the same drive)", "other times")
    one, other = (table["code"].to_numpy().astype(str) == "ok" for table in (first, second))
    both = one & other
    along, cross, covered = _differences(first[both], second[both])
    far = np.zeros(len(first), bool)
    far[both] = np.hypot(along, cross) > WRONG_M
    changed = first["code"].astype(str) + " → " + second["code"].astype(str)
    counts = changed[first["code"].to_numpy() != second["code"].to_numpy()].value_counts()
    return Comparison(
        scans=len(first),
        ok_first=int(one.sum()),
        ok_second=int(other.sum()),
        ok_both=int(both.sum()),
        codes={str(name): int(count) for name, count in counts.items()},
        rms_along_m=float(np.sqrt(np.mean(along**2))) if both.any() else None,
        rms_cross_m=float(np.sqrt(np.mean(cross**2))) if both.any() else None,
        largest_m=float(np.hypot(along, cross).max()) if both.any() else None,
        within_95=float(np.mean(covered)) if both.any() else None,
        apart=int(far.sum()),
        apart_at=_runs(far),
        median_correlation_first=float(first["correlation"][one].median()) if one.any() else None,
        median_correlation_second=float(second["correlation"][other].median()) if other.any() else None,
    )


def _differences(
    first: pd.DataFrame, second: pd.DataFrame
) -> tuple[Float[np.ndarray, " ok"], Float[np.ndarray, " ok"], Bool[np.ndarray, " ok"]]:
    """Second minus first along and across the first's heading, and whether their sigmas cover it."""
    if not len(first):
        return np.zeros(0), np.zeros(0), np.zeros(0, bool)
    frame = LocalFrame(float(first["latitude_deg"].iloc[0]), float(first["longitude_deg"].iloc[0]), 0.0)
    zero = np.zeros(len(first))
    (east, north, _), (east_2, north_2, _) = (
        frame.to_local(table["latitude_deg"].to_numpy(), table["longitude_deg"].to_numpy(), zero)
        for table in (first, second)
    )
    yaw = frame.yaw_of_heading(first["heading_deg"].to_numpy(), first["longitude_deg"].to_numpy())
    along, cross = along_cross(east_2 - east, north_2 - north, yaw)
    squared = sum(
        each**2 / (first[name].to_numpy() ** 2 + second[name].to_numpy() ** 2)
        for each, name in ((along, "sigma_along_m"), (cross, "sigma_cross_m"))
    )
    return along, cross, np.asarray(squared <= _CHI2_95)


def _runs(held: Bool[np.ndarray, " scan"]) -> tuple[tuple[int, int], ...]:
    edges = np.diff(np.concatenate([[False], held, [False]]).astype(np.int8))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return tuple((int(start), int(stop) - 1) for start, stop in zip(starts, stops, strict=True))
