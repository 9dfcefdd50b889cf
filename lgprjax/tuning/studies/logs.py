"""Common parts of studies: task, outcome, signals of a log, and refusal of insufficient logs."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float

from lgprjax.config import Table, TableKey, fill_table
from lgprjax.errors import InputError
from lgprjax.formats import NavigationTrack, Study, VehicleFile, VehicleLog, read_fixes, with_values
from lgprjax.formats.fixes import read_fix_poses
from lgprjax.frames import LocalFrame, body_to_local
from lgprjax.recordings.vehicles import chassis_of
from lgprjax.tuning import DriveSignals, Estimate, NotExcitedError
from lgprjax.tuning.studies.needs import SIGNAL_NAMES, Contradiction
from lgprjax.vehicle import Chassis

# Signals of a drive log on the vehicle's clock, in local metres, for calibrations.

# A sensor silent for longer than this many of its usual steps has a gap, which is not interpolated.
_GAP_STEPS = 3.0
_FIXES_HZ = 10.0


def fixes_beside(path: Path) -> Path:
    """Path of the fixes of a drive log: ``X.fixes.h5`` next to ``X.drive.h5``."""
    return path.with_name(path.name.removesuffix(".drive.h5") + ".fixes.h5")


def require_fixes(path: Path) -> Path:
    """Path of the fixes of a drive log.

    Raises:
        InputError: there is no such file.
    """
    fixes = fixes_beside(path)
    if not fixes.is_file():
        expected = f"the fixes of {path.name} in its folder (lgprjax register MAP {path.name} -o {path.parent})"
        raise InputError(fixes, "file", expected, "none")
    return fixes


def read_causal_fixes(path: Path) -> tuple[pd.DataFrame, Float[np.ndarray, "scan 5 5"]]:
    """Fixes as ``register`` writes them, and their covariances.

    Raises:
        InputError: the file cannot be read, has no covariances, or its fixes are smoothed.
    """
    table, (_, spread) = read_fixes(path), read_fix_poses(path)
    if spread is None:
        raise InputError(path, "/covariance", "fix covariances", "none")
    if "smoothed" in table and table["smoothed"].any():
        raise InputError(path, "smoothed", "fixes from earlier scans alone (register --causal), as on board", "1")
    return table, spread


def signals_of(
    log: VehicleLog, path: str = "drive log", *, fixes: Path | None = None, array_x_m: float = 0.0
) -> DriveSignals:
    """Signals at the records of the vehicle, without those outside the odometry's time or in a gap of it.

    Each position is given to one record, the nearest, moved to its time between neighbours: a value interpolated at
    every record would repeat the noise of one position many times. Records without a position of their own, and those
    next to a gap, hold NaN. Metres are relative to the first position of the navigation.

    Args:
        log: drive log.
        path: path of the log, for error messages.
        fixes: ``X.fixes.h5``, whose positions replace those of the navigation; headings stay those of the navigation.
        array_x_m: centre of the array ahead of the rear axle, which fixes refer to.

    Raises:
        InputError: the log holds no signals of the vehicle, or none while navigation and odometry were available; the
            fixes cannot be used.
    """
    if log.vehicle is None:
        raise InputError(path, "/vehicle", "vehicle signals", "none")
    time_s = np.asarray(log.vehicle["time_s"], np.float64)
    covered = ~_in_gap(log.odometry.time_s, time_s)
    if np.count_nonzero(covered) < 2:
        raise InputError(path, "/vehicle/time_s", "at least two records within the odometry's time span", "fewer")
    time_s = time_s[covered]
    track = log.navigation
    frame = LocalFrame(*(float(values[0]) for values in (track.latitude_deg, track.longitude_deg, track.height_m)))
    east_m, north_m, _ = frame.to_local(track.latitude_deg, track.longitude_deg, track.height_m)
    yaw_rad = np.unwrap(frame.yaw_of_heading(track.heading_deg, track.longitude_deg))
    placed_s, sigma_m = track.time_s, _position_sigma_m(track)
    owned = _own_fix(placed_s, time_s)
    if fixes is not None:
        placed_s, (east_m, north_m), sigma_m = _axle_by_fixes(fixes, frame, (track.time_s, yaw_rad), array_x_m)
        owned = _own_fix(placed_s, time_s) & ~_in_gap(track.time_s, time_s)
    optional = {
        signal: None if name not in log.vehicle else np.asarray(log.vehicle[name], np.float64)[covered]
        for signal, name in SIGNAL_NAMES.items()
    }
    return DriveSignals(
        time_s=time_s,
        east_m=np.where(owned, np.interp(time_s, placed_s, east_m), np.nan),
        north_m=np.where(owned, np.interp(time_s, placed_s, north_m), np.nan),
        sigma_position_m=np.interp(time_s, placed_s, sigma_m),
        yaw_rad=np.where(owned, np.interp(time_s, track.time_s, yaw_rad), np.nan),
        sigma_yaw_rad=np.interp(time_s, track.time_s, np.radians(_sigma(track.sigma_heading_deg, track))),
        travel_m=np.interp(time_s, log.odometry.time_s, log.odometry.distance_m),
        **optional,
    )


def _axle_by_fixes(
    path: Path,
    frame: LocalFrame,
    heading: tuple[Float[np.ndarray, " navigation"], Float[np.ndarray, " navigation"]],
    array_x_m: float,
) -> tuple[Float[np.ndarray, " fix"], Float[np.ndarray, "2 fix"], Float[np.ndarray, " fix"]]:
    """Times, places of the rear axle and sigmas, ten a second at most: the fixes of neighbouring scans share theirs.

    Args:
        path: of the fixes.
        frame: of the places.
        heading: times and yaw of the navigation. Headings of fixes follow the turn centre that the log states, and with
            it the rear ratio that is sought.
        array_x_m: centre of the array ahead of the rear axle.

    Raises:
        InputError: the fixes cannot be used, or fewer than two are ``ok``.
    """
    table, spread = read_causal_fixes(path)
    time_s = table["time_s"].to_numpy()
    good = (table["code"].to_numpy() == "ok") & np.isfinite(spread[:, :2, :2]).all(axis=(1, 2))
    good &= (time_s >= heading[0][0]) & (time_s <= heading[0][-1])
    _, first = np.unique(np.floor(time_s[good] * _FIXES_HZ), return_index=True)
    rows = np.flatnonzero(good)[first]
    if len(rows) < 2:
        raise InputError(path, "code", "two ok fixes or more within the time of the navigation", str(len(rows)))
    chosen = table.iloc[rows]
    columns = (chosen[name].to_numpy() for name in ("latitude_deg", "longitude_deg", "height_m"))
    east_m, north_m, _ = frame.to_local(*columns)
    yaw = np.interp(time_s[rows], *heading)
    axle_m = body_to_local(east_m, north_m, yaw, -array_x_m, 0.0)
    return time_s[rows], np.stack(axle_m), np.sqrt(0.5 * np.trace(spread[rows, :2, :2], axis1=1, axis2=2))


def _position_sigma_m(track: NavigationTrack) -> Float[np.ndarray, " navigation"]:
    """Standard deviation of the position, m: one number for east and north."""
    east_m, north_m = _sigma(track.sigma_east_m, track), _sigma(track.sigma_north_m, track)
    return np.asarray(np.sqrt(0.5 * (east_m**2 + north_m**2)))


def _sigma(values: np.ndarray | None, track: NavigationTrack) -> Float[np.ndarray, " navigation"]:
    return np.zeros(len(track.time_s)) if values is None else np.asarray(values, np.float64)


def _in_gap(known_s: Float[np.ndarray, " known"], time_s: Float[np.ndarray, " record"]) -> Bool[np.ndarray, " record"]:
    """Times before or after everything known, or between two known times that are too far apart."""
    steps = np.diff(known_s)
    after = np.clip(np.searchsorted(known_s, time_s, side="left"), 1, len(known_s) - 1)
    wide = steps[after - 1] > _GAP_STEPS * np.median(steps)
    # Either end of a gap has a known value.
    at_end = (time_s == known_s[after]) | (time_s == known_s[after - 1])
    return np.asarray((time_s < known_s[0]) | (time_s > known_s[-1]) | (wide & ~at_end))


def _own_fix(fix_s: Float[np.ndarray, " fix"], time_s: Float[np.ndarray, " record"]) -> Bool[np.ndarray, " record"]:
    """Records that are the nearest ones to some fix and have fixes nearby on both sides."""
    after = np.clip(np.searchsorted(time_s, fix_s), 1, len(time_s) - 1)
    nearest = np.where(fix_s - time_s[after - 1] <= time_s[after] - fix_s, after - 1, after)
    owned = np.zeros(len(time_s), dtype=bool)
    owned[nearest] = True
    return np.asarray(owned & ~_in_gap(fix_s, time_s))


class LoggedDrive(NamedTuple):
    """A drive and its file; ``by_fixes``: its positions are fixes of the radar."""

    path: Path
    signals: DriveSignals
    by_fixes: bool = False


class Task(NamedTuple):
    """Task of a study: vehicle, drives to fit, and held-out drives (``judges``)."""

    study: Study
    vehicle: VehicleFile
    drives: tuple[LoggedDrive, ...]
    judges: tuple[LoggedDrive, ...]


class Figure(NamedTuple):
    """A figure of the quality of a fit, with its 95 % interval where it has one."""

    name: str
    value: float
    unit: str
    low: float | None = None
    high: float | None = None


class Outcome(NamedTuple):
    """Result of a study.

    Attributes:
        found: estimates with intervals, by path in the vehicle file; a list of estimates for a key that holds a list.
        fixed: numbers of the vehicle file that were chosen and not measured, such as the knots of a map.
        figures: quality of the fit, on its logs and on held-out logs.
        notes: remarks, one line each.
        detail: fits and signals for pictures; the type depends on the kind of study.
        contradictions: held-out logs that disagree with the fit; if there are any, no vehicle file is written.
    """

    found: dict[str, Estimate | list[Estimate]]
    fixed: dict[str, Any]
    figures: tuple[Figure, ...]
    notes: tuple[str, ...]
    detail: Any
    contradictions: tuple[Contradiction, ...] = ()


@contextmanager
def fitting(path: Path) -> Iterator[None]:
    """Turn a fit's refusal of a log into an error that names the log.

    Raises:
        InputError: the log does not hold what the fit needs.
    """
    try:
        yield
    except NotExcitedError as error:
        raise InputError(path, error.what, error.expected, error.found) from None


def one_drive(task: Task) -> LoggedDrive:
    """The log of a study that takes exactly one.

    Raises:
        InputError: the study has several logs.
    """
    if len(task.drives) != 1:
        raise InputError(
            task.study.file, "logs", f"one drive log for a study of {task.study.kind}", str(len(task.drives))
        )
    return task.drives[0]


def refuse_options(task: Task) -> None:
    """Refuse options of a study that takes none.

    Raises:
        InputError: the study file sets an option.
    """
    for name in task.study.options:
        raise InputError(task.study.file, f"options.{name}", f"no options for {task.study.kind}", "an unknown key")


def options_of(task: Task, kind: type[Table]) -> Table:
    """Options of a study.

    Raises:
        InputError: an option is unknown or its value is wrong.
    """
    return fill_table(kind, TableKey(task.study.file, "options"), task.study.options)


def potentiometer_of(drive: LoggedDrive) -> Float[np.ndarray, " record"]:
    """Potentiometer voltage at each record, V.

    Raises:
        InputError: the log has no potentiometer signal.
    """
    return signal_of(drive, "potentiometer_v")


def signal_of(drive: LoggedDrive, name: str) -> Float[np.ndarray, " record"]:
    """A signal that a study requires.

    Raises:
        InputError: the log lacks the signal.
    """
    values = getattr(drive.signals, name)
    if values is None:
        raise InputError(drive.path, f"/vehicle/{SIGNAL_NAMES[name]}", "a vehicle signal", "none")
    return np.asarray(values)


def front_angles(task: Task, drive: LoggedDrive) -> tuple[Float[np.ndarray, " record"], str]:
    """Front wheel angle at every record, rad, and its source: the vehicle file's map, or a sensor of the angle itself.

    The angle is NaN beyond the map's ends.

    Raises:
        InputError: the log lacks the signal.
    """
    held = task.vehicle.wheel_map
    if held is None:
        return signal_of(drive, "front_rad"), "the wheel angle's sensor"
    knots_v = held.first_v + held.step_v * np.arange(len(held.front_rad))
    front = np.interp(potentiometer_of(drive), knots_v, held.front_rad, left=np.nan, right=np.nan)
    return np.asarray(front), "wheel_map"


def fixed_records(signals: DriveSignals) -> DriveSignals:
    """The records with a position and a heading of their own: GNSS/INS is slower than the vehicle's signals."""
    fixed = np.isfinite(signals.east_m + signals.north_m + signals.yaw_rad)
    held = {name: values[fixed] for name, values in signals._asdict().items() if values is not None}
    return DriveSignals(**held)


def rms(values: Float[np.ndarray, " value"]) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def chassis_without_anchor(task: Task) -> Chassis:
    """The chassis for fits, without the anchor point, which a vehicle being calibrated does not have yet.

    Rear wheels that the file does not describe are taken as straight, the start of a study of k.

    Raises:
        InputError: another required number is not in the vehicle file.
    """
    vehicle = task.vehicle
    if vehicle.pursuit.anchor_m is None:
        vehicle = with_values(vehicle, {"pursuit.anchor_m": 0.0}, {})
    if task.study.kind == "rear_ratio" and vehicle.steering.rear_ratio is None:
        vehicle = with_values(vehicle, {"steering.rear_ratio": 0.0}, {})
    return chassis_of(vehicle, task.study.vehicle)
