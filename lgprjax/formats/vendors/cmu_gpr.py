"""Sequences of the CMU-GPR data set (a folder of CSV files a sequence) as drive logs."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyproj
from jaxtyping import Float

from lgprjax.errors import ArgumentError, InputError
from lgprjax.formats.drive import DriveDescription, DriveWriter, NavigationTrack, OdometryTrack, TraceRecording
from lgprjax.formats.line_layout import inputs_of
from lgprjax.formats.profile import Assumed
from lgprjax.formats.survey_track import (
    TRACK_ASSUMED,
    SurveyOrigin,
    path_headings_deg,
    straight_track,
    time_zero_assumed,
    track,
)
from lgprjax.radar.array import ArrayGeometry

# The first is in the data set's README, the second in its programs.
_ODOMETRY = ("we_odom.csv", "we_odom_meas.csv")
# The antenna of every sequence is a Noggin 500.
_CENTRE_FREQUENCY_HZ = 500e6


def import_cmu(
    sequence_dir: str | Path,
    *,
    time_window_ns: float,
    time_zero_ns: float = 0.0,
    place: SurveyOrigin,
    output: str | Path,
    force: bool = False,
) -> None:
    """Write a sequence as a drive log of one channel.

    ``gpr_meas.csv`` is time and amplitudes, ``we_odom.csv`` time and signed distance in metres, ``ts_meas.csv`` time
    and x, y, z of a total station in metres; the latter may be absent or empty. Times are Unix seconds. With a total
    station its positions are navigation and truth, its frame placed with the origin at ``place`` and x along the
    heading, and the vehicle's heading follows the path (reversing is detected from the odometry). Without, the vehicle
    drives straight along the heading by the distance of the odometry. Scans outside the time of odometry or truth are
    left out. ``imu_meas.csv`` and the camera are not used: a drive log has no datasets for them.

    Args:
        sequence_dir: the folder.
        time_window_ns: two-way travel time of a trace, which is not published with the data set.
        time_zero_ns: time zero, relative to sample 0.
        place: origin and direction; the sequences have no latitude and longitude.
        output: the drive log.
        force: replace an output that exists.

    Raises:
        InputError: a file is missing or damaged, or times do not overlap.
    """
    folder = Path(sequence_dir)
    place.check()
    if not (np.isfinite(time_window_ns) and time_window_ns > 0):
        raise ArgumentError("time_window_ns", "a number above zero", f"{time_window_ns:g}")
    at_first = time_zero_assumed(time_zero_ns, time_window_ns)
    radar_file = folder / "gpr_meas.csv"
    odometry_file = next((folder / name for name in _ODOMETRY if (folder / name).exists()), folder / _ODOMETRY[0])
    truth_file = folder / "ts_meas.csv"
    radar, repeated = _table(radar_file, "time and amplitudes", columns=None)
    odometry, odometry_repeated = _table(odometry_file, "time and distance", columns=2)
    truth, truth_repeated = (
        _table(truth_file, "time, x, y, z", columns=4) if truth_file.exists() else (np.zeros((0, 4)), 0)
    )
    for file, rows in ((radar_file, radar), (odometry_file, odometry)):
        if len(rows) < 2:
            raise InputError(file, "rows", "at least 2", str(len(rows)))
    spans = [odometry] if len(truth) < 2 else [odometry, truth]
    first_s, last_s = max(t[0, 0] for t in spans), min(t[-1, 0] for t in spans)
    kept = (radar[:, 0] >= first_s) & (radar[:, 0] <= last_s)
    if np.count_nonzero(kept) < 2:
        found = f"scans from {radar[0, 0]:.2f} to {radar[-1, 0]:.2f} s"
        raise InputError(
            radar_file, "times", f"scans within {first_s:.2f} to {last_s:.2f} s, as the other files", found
        )

    t0_s = float(radar[kept, 0][0])
    samples = radar.shape[1] - 1
    odometry_time_s, distance_m = odometry[:, 0] - t0_s, odometry[:, 1]
    navigation, true_track = _tracks(truth_file, truth, odometry_time_s, distance_m, t0_s, place)
    description = DriveDescription(
        name=Path(output).name.split(".")[0],
        t0_utc=_utc(radar_file, t0_s),
        array=ArrayGeometry(np.zeros(1), np.zeros(1), np.zeros(1), 0.0),
        recording=TraceRecording(time_window_ns / samples, time_zero_ns, 0.0, _CENTRE_FREQUENCY_HZ, samples),
        navigation=navigation,
        odometry=OdometryTrack(odometry_time_s, distance_m),
        truth=true_track,
        vehicle=None,
        provenance={
            "made_by": "lgprjax import cmu",
            "sequence": folder.resolve().name,
            "inputs": inputs_of([radar_file, odometry_file, *([truth_file] if len(truth) >= 2 else [])]),
            "time_window_ns": time_window_ns,
            "origin": place._asdict(),
            "assumed": at_first | _assumed(place, surveyed=true_track is not None),
            "positions": "total station" if true_track is not None else "odometry along a straight line",
            "scans_left_out": int(np.count_nonzero(~kept)),
            "rows_of_repeated_time": repeated + odometry_repeated + truth_repeated,
        },
    )
    traces = _stored(radar[kept, 1:])[:, None, :]
    with DriveWriter.create(output, description, channels=1, dtype=traces.dtype, force=force) as writer:
        writer.append(radar[kept, 0] - t0_s, traces)


def _assumed(place: SurveyOrigin, *, surveyed: bool) -> Assumed:
    if surveyed:
        return {"heading": "along the path", **TRACK_ASSUMED, **place.assumed()}
    straight: Assumed = {"position": "straight from the origin", "heading": f"{place.heading_deg:g} degrees all along"}
    return {**straight, "height": "taken as 0", **TRACK_ASSUMED, **place.assumed()}


def _table(file: Path, what: str, columns: int | None) -> tuple[Float[np.ndarray, "row column"], int]:
    """Rows of numbers under a heading, times strictly rising; and the number of rows left out for repeated times."""
    read: dict[str, Any] = {"header": None, "low_memory": False, "skip_blank_lines": True}
    try:
        with file.open("rb") as stream:
            heading = stream.readline().decode("latin-1").split(",")[0].strip()
        table = pd.read_csv(file, skiprows=0 if _is_number(heading) else 1, **read)
    except OSError as error:
        raise InputError(file, "file", "a readable file", error.strerror or str(error)) from None
    except pd.errors.EmptyDataError:
        return np.zeros((0, columns or 3)), 0
    except (pd.errors.ParserError, UnicodeDecodeError) as error:
        raise InputError(file, "file", f"rows of {what}, separated by commas", str(error)) from None
    values = table.apply(pd.to_numeric, errors="coerce").to_numpy(dtype=np.float64)
    if values.shape[1] != columns and (columns is not None or values.shape[1] < 3):
        expected = f"{what}: {columns or 'at least 3'}"
        raise InputError(file, "columns", expected, str(values.shape[1]))
    bad = np.argwhere(~np.isfinite(values))
    if bad.size:
        row, column = bad[0]
        cell = table.iat[row, column]
        found = "none" if pd.isna(cell) else repr(str(cell)[:40])
        raise InputError(file, f"row {row + 1} below the heading, column {column + 1}", "a number", found)
    steps = np.diff(values[:, 0], prepend=-np.inf)
    if np.any(steps < 0):
        row = int(np.argmax(steps < 0))
        raise InputError(
            file,
            f"row {row + 1} below the heading",
            "increasing times",
            f"{values[row, 0]:.6f} after {values[row - 1, 0]:.6f}",
        )
    return values[steps > 0], int(np.count_nonzero(steps == 0))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _tracks(
    truth_file: Path,
    truth: Float[np.ndarray, "row 4"],
    odometry_time_s: Float[np.ndarray, " odometry"],
    distance_m: Float[np.ndarray, " odometry"],
    t0_s: float,
    place: SurveyOrigin,
) -> tuple[NavigationTrack, NavigationTrack | None]:
    """Navigation, and truth where there is a total station."""
    if len(truth) < 2:
        return straight_track(distance_m - distance_m[0], place, odometry_time_s), None
    time_s = truth[:, 0] - t0_s
    angle = np.deg2rad(place.heading_deg)
    # The frame's x is along the heading and y to the left of it.
    east_m = truth[:, 1] * np.sin(angle) - truth[:, 2] * np.cos(angle)
    north_m = truth[:, 1] * np.cos(angle) + truth[:, 2] * np.sin(angle)
    plane = pyproj.Proj(proj="aeqd", ellps="WGS84", lat_0=place.latitude_deg, lon_0=place.longitude_deg)
    longitude_deg, latitude_deg = (np.asarray(v) for v in plane(east_m, north_m, inverse=True))
    try:
        heading_deg = path_headings_deg(latitude_deg, longitude_deg, np.interp(time_s, odometry_time_s, distance_m))
    except ValueError:
        raise InputError(truth_file, "positions", "a vehicle that moves", "a stationary vehicle") from None
    poses = (time_s, latitude_deg, longitude_deg, heading_deg, truth[:, 3])
    return track(*poses), track(*poses)


def _utc(file: Path, time_s: float) -> str:
    try:
        return datetime.fromtimestamp(time_s, UTC).isoformat().replace("+00:00", "Z")
    except (ValueError, OverflowError, OSError):
        raise InputError(file, "times", "Unix seconds", f"{time_s:g}") from None


def _stored(amplitudes: Float[np.ndarray, "scan sample"]) -> np.ndarray:
    """The converter's counts as int16; anything else as float32."""
    whole = np.array_equal(amplitudes, np.rint(amplitudes)) and np.abs(amplitudes).max() <= 32767
    return amplitudes.astype(np.int16 if whole else np.float32)
