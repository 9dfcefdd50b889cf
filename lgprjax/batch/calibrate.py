"""Thresholds calibrated on the user's drives: matches at their true places, and at wrong places of the map."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.batch.register import RegisteredDrive, register_log
from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, MapFile
from lgprjax.recordings.drives import track_of_drive
from lgprjax.registration import Outcomes, RegisterOptions, Thresholds, Track, calibrate, joined, outcomes_of

_OPEN = Thresholds(strength_by_chance=0.0, margin_by_chance=0.0, overlap=0.8)
_LEAST_RIGHT = 0.5
_APART = 2.0
"""A false place is at least this many search squares away from the true one."""


class CalibrationMatches(NamedTuple):
    """Matches at their true places on a map, and at wrong ones."""

    true: Outcomes
    false: Outcomes


def try_drives(
    source: MapFile,
    logs: Sequence[DriveLog],
    options: RegisterOptions,
    progress: Callable[[int], None] = lambda _: None,
) -> CalibrationMatches:
    """Register drives at their own places and at others of the same map.

    The truth is the log's true track where it holds one, else its navigation, whose own sigma then counts as the
    truth's error.

    Args:
        source: the map.
        logs: drives over it.
        options: the search; its thresholds do not matter.
        progress: called with the number of scans done since the last call; every drive is read twice.

    Raises:
        InputError: a drive is too short to be moved elsewhere, or is not on the map's ground.
    """
    search = RegisterOptions(
        search_m=options.search_m, window_m=options.window_m, time_scale=options.time_scale, own_thresholds=_OPEN
    )
    apart_m = _APART * 2.0 * options.search_half_m() + (options.window_m or 0.0)
    for log in logs:  # before any is matched, which takes long
        _elsewhere(track_of_drive(log, source.description.frame).track, log=log, apart_m=apart_m)
    true, false = [], []
    for log in logs:
        own = register_log(source, log, search, progress)
        outcomes = _outcomes(own, log, led_astray=False)
        share = float(np.mean(outcomes.right)) if len(outcomes.right) else 0.0
        if share < _LEAST_RIGHT:
            expected = f"a drive over the ground of {source.path.name}, half of its matches or more at their places"
            found = f"{share:.0%} of {len(outcomes.right)} matches" if len(outcomes.right) else "no match"
            raise InputError(log.path, "drive", expected, found)
        true.append(outcomes)
        # The same time scale is used elsewhere: one estimated on ground that does not match would be arbitrary.
        known = RegisterOptions(**{**vars(search), "time_scale": _common_scale(own)})
        other = register_log(source, log, known, progress, partial(_elsewhere, log=log, apart_m=apart_m))
        false.append(_outcomes(other, log, led_astray=True))
    return CalibrationMatches(joined(true), joined(false))


def thresholds_from(trials: CalibrationMatches, risk: float) -> Thresholds:
    """Thresholds at which a false match passes with probability ``risk``. Raises ``ValueError`` on too few trials."""
    return calibrate(trials.true, trials.false, risk)


def _outcomes(drive: RegisteredDrive, log: DriveLog, *, led_astray: bool) -> Outcomes:
    if led_astray:
        return outcomes_of(drive.fix, None, drive.map_odometry_covariance)
    if drive.truth is not None:
        return outcomes_of(drive.fix, drive.truth[:, :2], drive.map_odometry_covariance)
    navigation = log.description.navigation
    said = [s for s in (navigation.sigma_east_m, navigation.sigma_north_m) if s is not None]
    own = np.zeros(log.scans) if len(said) < 2 else np.interp(log.scan_time_s, navigation.time_s, np.mean(said, axis=0))
    truth_m = drive.track.pose[:, :2]
    return outcomes_of(drive.fix, truth_m, drive.map_odometry_covariance, own**2)


def _common_scale(drive: RegisteredDrive) -> float:
    return float(np.median(drive.time_scale))


def _elsewhere(track: Track, *, log: DriveLog, apart_m: float) -> Track:
    """The track with every prior moved along the drive to a place that cannot match."""
    path_m = np.cumsum(np.abs(np.diff(track.travel_m, prepend=track.travel_m[0])))
    scans, farthest_m = len(path_m), 0.0
    for share in (0.5, 0.4, 0.6, 0.3, 0.7):
        pose: Float[np.ndarray, "scan 5"] = np.roll(track.pose, int(share * scans), axis=0)
        away_m = np.hypot(*(pose[:, :2] - track.pose[:, :2]).T)
        farthest_m = max(farthest_m, float(np.quantile(away_m, 0.05)))
        if np.mean(away_m >= apart_m) > 0.95:
            pose[away_m < apart_m, :2] += 1e6  # what cannot be moved is put off the map
            return track._replace(pose=pose)
    expected = f"a drive with wrong places {apart_m:.3g} m from the right ones"
    found = f"{path_m[-1]:.3g} m of travel, with places {farthest_m:.3g} m apart; try a smaller search or window"
    raise InputError(log.path, "/odometry/distance_m", expected, found)
