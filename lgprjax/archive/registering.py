"""A drive log against a subsurface database: fixes in files, streaming."""

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float, Int

from lgprjax import __version__
from lgprjax.archive.depth_levels import live_operators
from lgprjax.archive.fixes_table import fixes_table
from lgprjax.archive.held_ground import HeldGround
from lgprjax.archive.map_building import file_hash
from lgprjax.archive.moisture import SCALES, find_time_scales
from lgprjax.archive.recordings import recording_of
from lgprjax.archive.tracks import DriveTrack, poses_of, track_of_drive
from lgprjax.formats import DriveLog, MapFile, write_fixes
from lgprjax.frames import LocalFrame
from lgprjax.registration import (
    BLOCK_SCANS,
    DriveFixes,
    Fix,
    LiveBlock,
    Operators,
    RegisterOptions,
    Track,
    TrackedFixes,
    register_drive,
    track_drive,
)


@dataclass(frozen=True)
class RegisteredDrive:
    """What registering a drive gave, one row a scan, in the map's frame.

    Attributes:
        table: the columns of the fixes CSV.
        fix: poses, covariances and quality.
        track: prior poses and travel.
        truth: true poses of the array's centre, where the log holds them.
        correlation_at_truth: NaN where not known.
        time_scale: of each scan; None where it is 1 throughout.
        beside_match: see ``DriveFixes``.
        rung: of the ladder that each scan was searched on, -1 where it was not; None where the drive was not tracked.
        milliseconds_per_scan: wall time a scan of the drive, reading and all processing included.
    """

    name: str
    table: pd.DataFrame
    fix: Fix
    track: Track
    truth: Float[np.ndarray, "scan 5"] | None
    correlation_at_truth: Float[np.ndarray, " scan"]
    time_scale: Float[np.ndarray, " scan"] | None
    beside_match: Float[np.ndarray, "scan 2 2"]
    rung: Int[np.ndarray, " scan"] | None
    milliseconds_per_scan: float


def live_blocks(
    log: DriveLog,
    track: Track,
    truth: Float[np.ndarray, "scan 5"] | None,
    start: int = 0,
    time_scale: Float[np.ndarray, " scan"] | None = None,
) -> Iterator[LiveBlock]:
    """Scans of a log from ``start`` on, in blocks of ``BLOCK_SCANS``."""
    for low, recorded, valid in recording_of(log).blocks(BLOCK_SCANS, start):
        span = slice(low, low + len(recorded))
        part = Track(*(field[span] for field in track))
        yield LiveBlock(
            recorded,
            valid,
            part,
            None if truth is None else truth[span],
            None if time_scale is None else time_scale[span],
        )


def passes_over(options: RegisterOptions) -> int:
    """How often a drive's scans are gone through: once, and once for every time scale that is tried."""
    return 1 + (len(SCALES) if options.time_scale is None else 0)


def register_log(
    source: MapFile,
    log: DriveLog,
    options: RegisterOptions,
    progress: Callable[[int], None] = lambda _: None,
    led_to: Callable[[Track], Track] = lambda track: track,
    held: HeldGround | None = None,
) -> RegisteredDrive:
    """Register every scan of a drive log.

    Traces stream through in blocks; what is kept is a few hundred bytes a scan.

    Args:
        source: the database.
        log: the drive.
        options: the search.
        progress: told the number of scans done since the last call; ``passes_over`` a drive in all.
        led_to: changes where the vehicle believes to be, to see what is said of ground that cannot match.
        held: ground of the same map and search, held from drive to drive.

    Raises:
        InputError: navigation does not span the drive, or the recording misses most of the map's band.
    """
    frame = source.description.frame
    held, array = held or HeldGround(source, options), log.description.array
    moved: DriveTrack = track_of_drive(log, frame)
    moved = moved._replace(track=led_to(moved.track))
    truth = true_poses(log, frame)
    began = time.perf_counter()
    parts: list[Fix] = []
    at_truth: list[Float[np.ndarray, " scan"]] = []
    beside: list[Float[np.ndarray, "scan 2 2"]] = []
    rungs: list[Int[np.ndarray, " scan"]] = []
    operators = live_operators(source, log, moved.track)
    time_scale = _time_scales(source, log, moved.track, operators, options, progress)
    blocks = live_blocks(log, moved.track, truth, time_scale=time_scale)
    found: Iterable[DriveFixes | TrackedFixes] = (
        track_drive(held.ground, operators, array, blocks, options)
        if options.track
        else register_drive(held.ground, operators, array, blocks, options, held.prepared_for(array))
    )
    for fixes in found:
        parts.append(fixes.fix)
        at_truth.append(fixes.correlation_at_truth)
        beside.append(fixes.beside_match)
        if isinstance(fixes, TrackedFixes):
            rungs.append(fixes.rung)
        progress(len(fixes.scan))
    fix = Fix(*(np.concatenate(field) for field in zip(*parts, strict=True)))
    took_s = time.perf_counter() - began
    return RegisteredDrive(
        name=log.path.name.removesuffix(".drive.h5"),
        table=_with_time_scale(fixes_table(fix, log.scan_time_s, frame, held.ground), time_scale),
        fix=fix,
        track=moved.track,
        truth=truth,
        correlation_at_truth=np.concatenate(at_truth),
        time_scale=time_scale,
        beside_match=np.concatenate(beside),
        rung=np.concatenate(rungs) if rungs else None,
        milliseconds_per_scan=1e3 * took_s / log.scans,
    )


def _time_scales(
    source: MapFile,
    log: DriveLog,
    track: Track,
    operators: Operators,
    options: RegisterOptions,
    progress: Callable[[int], None],
) -> Float[np.ndarray, " scan"] | None:
    """Of every scan: as given, or found along the drive; None where it is 1."""
    if options.time_scale is None:
        return find_time_scales(source, log, track, operators, options, progress)
    return None if options.time_scale == 1.0 else np.full(log.scans, options.time_scale)


def _with_time_scale(table: pd.DataFrame, time_scale: Float[np.ndarray, " scan"] | None) -> pd.DataFrame:
    return table if time_scale is None else table.assign(time_scale=time_scale)


def true_poses(log: DriveLog, frame: LocalFrame) -> Float[np.ndarray, "scan 5"] | None:
    """True poses of the array's centre; NaN where the truth does not reach."""
    known, time_s = log.description.truth, log.scan_time_s
    if known is None:
        return None
    pose = poses_of(known, time_s, frame, log.description.array)[0]
    # Half a scan period of slack: the truth's clock may end a rounding error before the last scan.
    slack_s = 0.5 * float(np.median(np.diff(time_s)))
    reached = (time_s >= known.time_s[0] - slack_s) & (time_s <= known.time_s[-1] + slack_s)
    return np.where(reached[:, None], pose, np.nan)


def write_registered(
    drive: RegisteredDrive,
    source: MapFile,
    log: DriveLog,
    options: RegisterOptions,
    folder: Path,
    force: bool,
    sha256: tuple[str, str] | None = None,
) -> None:
    """Write ``DRIVE.fixes.csv`` and ``DRIVE.fixes.h5``; both appear, or neither.

    ``sha256`` is that of the map's file and of the log's where both are known; else they are read.
    """
    map_sha256, drive_sha256 = sha256 or (file_hash(source.path), file_hash(log.path))
    thresholds = {name: float(value) for name, value in options.thresholds._asdict().items()}
    provenance = {
        "program": f"lgprjax {__version__}",
        "map": {"file": source.path.name, "sha256": map_sha256},
        "drive": {"file": log.path.name, "sha256": drive_sha256},
        "search_m": options.search_m,
        "window_m": options.window_m,
        "track": options.track,
        "time_scale": "found along the drive" if options.time_scale is None else options.time_scale,
        "seed": options.seed,
        "thresholds": thresholds,
        "chain": source.description.settings.as_provenance(),
    }
    frame = source.description.frame
    attributes = {
        "name": drive.name,
        "map": source.description.name,
        "t0_utc": log.description.t0_utc,
        "anchor_latitude_deg": frame.latitude_deg,
        "anchor_longitude_deg": frame.longitude_deg,
        "anchor_height_m": frame.height_m,
        "provenance": provenance,
    }
    write_fixes(
        folder / f"{drive.name}.fixes.csv",
        folder / f"{drive.name}.fixes.h5",
        drive.table,
        attributes=attributes,
        pose_m=np.asarray(drive.fix.pose),
        covariance=np.asarray(drive.fix.covariance, dtype=np.float32),
        force=force,
    )
