"""A drive log against a subsurface database: fixes in files, streaming."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float

from lgprjax import __version__
from lgprjax.archive.depth_levels import AS_STATED, Alignment, live_operators
from lgprjax.archive.drive_alignment import find_alignment, may_be_misaligned, reversed_track
from lgprjax.archive.fixes_table import fixes_table
from lgprjax.archive.held_ground import HeldGround
from lgprjax.archive.map_assumptions import away_in_words, is_place_assumed
from lgprjax.archive.recordings import recording_of
from lgprjax.archive.tracks import DriveTrack, jump_line, poses_of, track_of_drive
from lgprjax.files import file_hash
from lgprjax.formats import DriveLog, MapFile, assumed_of, write_fixes
from lgprjax.frames import LocalFrame
from lgprjax.registration import (
    BLOCK_SCANS,
    DriveFixes,
    Fix,
    LiveBlock,
    RegisterOptions,
    Track,
    register_drive,
)


@dataclass(frozen=True)
class RegisteredDrive:
    """What registering a drive gave, one row a scan, in the map's frame.

    Attributes:
        table: the columns of the fixes CSV.
        fix: poses, covariances and quality.
        track: prior poses and travel.
        jumps: what was done about jumps of the recorded travel, in a line; None where there are none.
        alignment: how its traces were changed to be the map's.
        truth: true poses of the array's centre, where the log holds them.
        correlation_at_truth: NaN where not known.
        time_scale: that each scan was matched at.
        beside_match: see ``DriveFixes``.
        milliseconds_per_scan: wall time a scan of the drive, reading and all processing included.
        assumed: what no instrument recorded of the drive, and what stands in for it.
        away: how far it lies from the map, in words; None where it comes near it.
        place_assumed: whether nobody said where on the earth the drive, or the map, lies.
        channels: of the drive.
    """

    name: str
    table: pd.DataFrame
    fix: Fix
    track: Track
    jumps: str | None
    alignment: Alignment
    truth: Float[np.ndarray, "scan 5"] | None
    correlation_at_truth: Float[np.ndarray, " scan"]
    time_scale: Float[np.ndarray, " scan"]
    beside_match: Float[np.ndarray, "scan 2 2"]
    milliseconds_per_scan: float
    assumed: dict[str, str]
    away: str | None
    place_assumed: bool
    channels: int


def live_blocks(
    log: DriveLog, track: Track, truth: Float[np.ndarray, "scan 5"] | None, start: int = 0
) -> Iterator[LiveBlock]:
    """Scans of a log from ``start`` on, in blocks of ``BLOCK_SCANS``."""
    for low, recorded, valid in recording_of(log).blocks(BLOCK_SCANS, start):
        span = slice(low, low + len(recorded))
        yield LiveBlock(
            recorded, valid, Track(*(field[span] for field in track)), None if truth is None else truth[span]
        )


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
        progress: told the number of scans done since the last call.
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
    alignment = find_alignment(source, log, moved.track, options, held) if may_be_misaligned(log) else AS_STATED
    if alignment.reversed:
        moved = moved._replace(track=reversed_track(moved.track))
    operators = live_operators(source, log, moved.track, alignment)
    found = register_drive(
        held.ground,
        operators,
        array,
        live_blocks(log, moved.track, truth),
        options,
        chance=held.chance,
        recorded=int(operators(1.0).shape[0]),
        prepared=held.prepared_for(array),
    )
    parts: list[DriveFixes] = []
    for fixes in found:
        parts.append(fixes)
        progress(len(fixes.scan))
    fix = Fix(*(np.concatenate(field) for field in zip(*(part.fix for part in parts), strict=True)))
    fix = fix._replace(p_false=np.minimum(np.asarray(fix.p_false) + alignment.chance, 1.0))
    took_s = time.perf_counter() - began
    time_scale = np.concatenate([part.time_scale for part in parts])
    return RegisteredDrive(
        name=log.path.name.removesuffix(".drive.h5"),
        table=fixes_table(fix, log.scan_time_s, frame, held.ground).assign(time_scale=time_scale),
        fix=fix,
        track=moved.track,
        jumps=jump_line(moved),
        alignment=alignment,
        truth=truth,
        correlation_at_truth=np.concatenate([part.correlation_at_truth for part in parts]),
        time_scale=time_scale,
        beside_match=np.concatenate([part.beside_match for part in parts]),
        milliseconds_per_scan=1e3 * took_s / log.scans,
        assumed=assumed_of(log.description.provenance),
        away=away_in_words(source, log),
        place_assumed=is_place_assumed(source, log),
        channels=log.channels,
    )


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
    own = options.own_thresholds
    thresholds = None if own is None else {name: float(value) for name, value in own._asdict().items()}
    provenance = {
        "program": f"lgprjax {__version__}",
        "map": {"file": source.path.name, "sha256": map_sha256},
        "drive": {"file": log.path.name, "sha256": drive_sha256},
        "search_m": "from the log's own sigma" if options.search_m is None else options.search_m,
        "window_m": "shortest that reaches the risk" if options.window_m is None else options.window_m,
        "risk": options.risk,
        "time_scale": "found along the drive" if options.time_scale is None else options.time_scale,
        "seed": options.seed,
        "thresholds": thresholds,
        "against_the_map": drive.alignment._asdict(),
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
