"""A drive located on a map, its labels corrected: what is needed before it may become one of the map's baselines."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.archive.depth_levels import Alignment
from lgprjax.archive.label_correction import LabelCorrection, correct_labels, path_of
from lgprjax.archive.registering import register_log
from lgprjax.archive.tracks import DriveTrack, track_of_drive
from lgprjax.errors import InputError
from lgprjax.files import file_hash
from lgprjax.formats import DriveLog, MapFile
from lgprjax.radar import centre_of
from lgprjax.registration import Code, RegisterOptions
from lgprjax.subsurface import MapDescription

_SEARCH_M, _WINDOW_M = 1.5, 1.0
_LEAST_LOCATED_M = 5.0
_LEAST_SHARE = 0.2
"""Of the way over the map's ground that fixes must locate: other ground gives no fixes that agree with each other."""
_NOT_TRIED = (Code.OFF_MAP, Code.LOW_OVERLAP, Code.NON_FINITE, Code.NO_WINDOW)


class LocatedDrive(NamedTuple):
    """A drive whose labels follow the map's ground.

    Attributes:
        track: of the scans, poses corrected.
        correction: of the labels.
        alignment: how its traces are to be changed to be the map's.
        path_m: of the scans, along the drive.
        tried: scans over the map's ground.
        ok: scans whose fix is ok.
        match_sigma_m: of the corrected labels against the map's ground, root mean square.
        map_sigma_m: what the map's own labels are wrong by there, root mean square.
    """

    track: DriveTrack
    correction: LabelCorrection
    alignment: Alignment
    path_m: Float[np.ndarray, " scan"]
    tried: Bool[np.ndarray, " scan"]
    ok: Bool[np.ndarray, " scan"]
    match_sigma_m: float
    map_sigma_m: float


def update_search(description: MapDescription) -> RegisterOptions:
    """Search of a drive that shall become a baseline: in windows that no ground which has changed is bridged with."""
    wavelength_m = description.settings.wavelength_m
    window_m = _WINDOW_M * max(1.0, wavelength_m)
    return RegisterOptions(search_m=max(_SEARCH_M, wavelength_m), window_m=window_m, time_scale=1.0)


def locate_drive(source: MapFile, log: DriveLog, progress: Callable[[int], None] = lambda _: None) -> LocatedDrive:
    """Register a drive on a map and correct its labels.

    Args:
        source: the map.
        log: the drive.
        progress: told the number of scans done since the last call.

    Raises:
        InputError: the drive does not fit the map: other channels, a drive that the map holds already, ground that is
            not the map's, or ground on which it cannot be located.
    """
    refuse_unfit(source, log)
    options = update_search(source.description)
    drive = register_log(source, log, options, progress)
    correction = correct_labels(drive.track, drive.fix, drive.beside_match, centre_of(log.description.array))
    path_m, code = path_of(drive.track), np.asarray(drive.fix.code)
    tried = ~np.isin(code, _NOT_TRIED)
    _refuse_elsewhere(log, drive.away, options, correction, path_m, tried)
    ok, known = code == Code.OK, correction.corrected
    beside = 0.5 * np.trace(drive.beside_match[ok], axis1=1, axis2=2)
    moved = track_of_drive(log, source.description.frame)
    return LocatedDrive(
        track=moved._replace(
            track=correction.applied(drive.track),
            ground_up_m=moved.ground_up_m[::-1] if drive.alignment.reversed else moved.ground_up_m,
        ),
        correction=correction,
        alignment=drive.alignment,
        path_m=path_m,
        tried=tried,
        ok=ok,
        match_sigma_m=float(np.sqrt(np.mean(correction.sigma_m[known] ** 2))),
        map_sigma_m=float(np.sqrt(np.mean(beside))),
    )


def refuse_unfit(source: MapFile, log: DriveLog) -> str:
    """Hash of a drive that may become part of a map. Raises ``InputError`` for other channels, or a part of it."""
    channels = source.description.channels
    if log.channels != channels:
        raise InputError(log.path, "/array/y_m", f"{channels} channels as in {source.path}", str(log.channels))
    digest = file_hash(log.path)
    inputs = source.provenance.get("inputs")
    for row in inputs if isinstance(inputs, list) else []:
        if isinstance(row, dict) and row.get("sha256") == digest:
            found = f"{row.get('file')}, whose ground {source.path.name} holds already"
            raise InputError(log.path, "drive", "a drive that is not part of the map", found)
    return digest


def _refuse_elsewhere(
    log: DriveLog,
    away: str | None,
    options: RegisterOptions,
    correction: LabelCorrection,
    path_m: Float[np.ndarray, " scan"],
    tried: Bool[np.ndarray, " scan"],
) -> None:
    if not tried.any():
        expected = f"a drive over the map's ground, known to {options.search_half_m():.1f} m"
        raise InputError(log.path, "/gnss_ins", expected, away or "no scan over it")
    metres = np.diff(path_m, prepend=0.0)
    over_m = float(metres[tried].sum())
    least_m = max(_LEAST_LOCATED_M, _LEAST_SHARE * over_m)
    if correction.located_m < least_m or not correction.corrected.any():
        expected = f"fixes that agree over {_LEAST_LOCATED_M:g} m and {100 * _LEAST_SHARE:.0f} % of the way on the map"
        found = f"{correction.located_m:.0f} m of {over_m:.0f} m: other ground than the map's, or too noisy"
        raise InputError(log.path, "fixes", expected, found)
