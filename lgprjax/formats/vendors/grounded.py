"""GROUNDED-style runs (two NumPy files a run: radar cube and antenna positions in UTM) as drive logs."""

from pathlib import Path

import numpy as np
import pyproj
from jaxtyping import Float

from lgprjax.errors import ArgumentError, InputError
from lgprjax.formats.drive import DriveDescription, DriveWriter, NavigationTrack, OdometryTrack, TraceRecording
from lgprjax.formats.profile import Assumed
from lgprjax.formats.survey_track import TRACK_ASSUMED, check_utm, time_zero_assumed, track, utm_projection
from lgprjax.formats.travel import smoothed_travel
from lgprjax.radar.array import ArrayGeometry

_BLOCK_SCANS = 4096
# Stored type in the drive log and zero level, by the type of the run.
_STORED: dict[str, tuple[type[np.generic], float]] = {
    "uint8": (np.uint8, 128.0),
    "int16": (np.int16, 0.0),
    "int32": (np.int32, 0.0),
    "float16": (np.float32, 0.0),
    "float32": (np.float32, 0.0),
    "float64": (np.float32, 0.0),
}


def import_grounded(
    run_dir: str | Path,
    *,
    utm_zone: str,
    sample_interval_ns: float,
    scan_rate_hz: float,
    time_zero_ns: float = 0.0,
    output: str | Path,
    force: bool = False,
) -> None:
    """Write the run in a folder as a drive log, streaming.

    ``run.npy`` is [scan, sample, channel], ``run_UTM_point.npy`` [scan, channel, 2] (easting and northing of each
    channel, metres). Channels may be in either order: the one that is leftmost in the direction of motion becomes
    channel 0. The heading is perpendicular to the channel line, so that standing scans keep it; the body origin is the
    middle of the channels.

    Args:
        run_dir: the folder.
        utm_zone: number and hemisphere, such as ``19N``.
        sample_interval_ns: two-way travel time between samples.
        scan_rate_hz: scans per second.
        time_zero_ns: time zero, relative to sample 0 (the files do not have it).
        output: the drive log.
        force: replace an output that exists.

    Raises:
        InputError: a file is missing or damaged, shapes disagree, or positions are not finite or never move.
    """
    folder = Path(run_dir)
    projection = utm_projection(utm_zone)
    for name, value in (("sample_interval_ns", sample_interval_ns), ("scan_rate_hz", scan_rate_hz)):
        if not (np.isfinite(value) and value > 0):
            raise ArgumentError(name, "a number above zero", f"{value:g}")
    cube = _load(folder / "run.npy", "[scan, sample, channel]")
    points = _load(folder / "run_UTM_point.npy", "[scan, channel, 2]")
    scans, samples, channels = cube.shape
    if points.shape != (scans, channels, 2):
        expected = f"shape {(scans, channels, 2)}, as run.npy has {scans} scans of {channels} channels"
        raise InputError(folder / "run_UTM_point.npy", "shape", expected, f"shape {points.shape}")
    if scans < 2:
        raise InputError(folder / "run.npy", "scans", "at least 2", str(scans))
    if cube.dtype.name not in _STORED:
        raise InputError(folder / "run.npy", "type", " or ".join(_STORED), cube.dtype.name)
    dtype, zero_level = _STORED[cube.dtype.name]

    positions_m = _positions_m(folder / "run_UTM_point.npy", points)
    motion_m = np.gradient(positions_m.mean(axis=1), axis=0)
    if not np.any(motion_m):
        raise InputError(folder / "run_UTM_point.npy", "positions", "a vehicle that moves", "a stationary vehicle")
    flipped = _is_right_to_left(folder, positions_m, motion_m)
    if flipped:
        positions_m = positions_m[:, ::-1]
    forward = _forward(positions_m, motion_m)
    time_s = np.arange(scans) / scan_rate_hz
    travelled = smoothed_travel(time_s, _travel_m(positions_m.mean(axis=1), forward))
    assumed: Assumed = {
        "time": f"{scan_rate_hz:g} scans a second, as given; the date is unknown",
        **time_zero_assumed(time_zero_ns, samples * sample_interval_ns),
        "odometry": travelled.in_words(),
        "height": "taken as 0",
        **TRACK_ASSUMED,
    }
    if channels == 1:
        assumed["heading"] = "along the path"
    description = DriveDescription(
        name=folder.resolve().name,
        # The run has no clock: the epoch means that the date is unknown.
        t0_utc="1970-01-01T00:00:00Z",
        array=_array(folder, positions_m, forward),
        recording=TraceRecording(sample_interval_ns, time_zero_ns, zero_level, None, samples),
        navigation=_track(projection, positions_m.mean(axis=1), forward, time_s),
        odometry=OdometryTrack(time_s, travelled.distance_m),
        truth=None,
        vehicle=None,
        provenance={
            "made_by": "lgprjax import grounded",
            "run": folder.resolve().name,
            "utm_zone": utm_zone,
            "scan_rate_hz": scan_rate_hz,
            "channels_flipped": flipped,
            "assumed": assumed,
        },
    )
    with DriveWriter.create(output, description, channels=channels, dtype=dtype, force=force) as writer:
        for start in range(0, scans, _BLOCK_SCANS):
            block = cube[start : start + _BLOCK_SCANS].transpose(0, 2, 1).astype(dtype)
            writer.append(time_s[start : start + len(block)], block[:, ::-1] if flipped else block)


def _load(path: Path, axes: str) -> np.ndarray:
    """Memory-mapped array of three axes."""
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except OSError as error:
        raise InputError(path, "file", "a readable file", error.strerror or str(error)) from None
    except (ValueError, EOFError):
        found = "a truncated file or another format"
        raise InputError(path, "file", f"a whole NumPy file of {axes}", found) from None
    if not isinstance(array, np.ndarray) or array.ndim != 3 or 0 in array.shape:
        raise InputError(path, "shape", f"axes {axes}", f"shape {getattr(array, 'shape', None)}")
    return array


def _positions_m(path: Path, points: np.ndarray) -> Float[np.ndarray, "scan channel 2"]:
    if points.dtype.kind not in "fiu":
        raise InputError(path, "type", "numbers", points.dtype.name)
    positions_m = np.asarray(points, dtype=np.float64)
    bad = np.asarray(~np.isfinite(positions_m).all(axis=(1, 2)))
    if np.any(bad):
        found = f"{np.count_nonzero(bad)} of {len(bad)} scans without, the first is {np.argmax(bad)}"
        raise InputError(path, "positions", "finite eastings and northings", found)
    check_utm(path, "positions", positions_m[..., 0], positions_m[..., 1])
    return positions_m


def _is_right_to_left(
    folder: Path, positions_m: Float[np.ndarray, "scan channel 2"], motion_m: Float[np.ndarray, "scan 2"]
) -> bool:
    """Whether the first channel is the right one, decided over all metres of the run, most of which is driven
    forward.
    """
    if positions_m.shape[1] == 1:
        return False
    across = positions_m[:, 0] - positions_m[:, -1]
    length = np.hypot(across[:, 0], across[:, 1])
    if not np.all(length > 0):
        scan = int(np.argmin(length))
        raise InputError(
            folder / "run_UTM_point.npy", f"scan {scan}", "channels along a line", "both end channels at one position"
        )
    vote_m = float(np.sum((motion_m[:, 0] * across[:, 1] - motion_m[:, 1] * across[:, 0]) / length))
    path_m = float(np.sum(np.hypot(motion_m[:, 0], motion_m[:, 1])))
    if abs(vote_m) < 1.0 and abs(vote_m) <= 0.5 * path_m:
        raise InputError(folder / "run_UTM_point.npy", "positions", "motion across the line of channels", "none")
    return vote_m < 0


def _forward(
    positions_m: Float[np.ndarray, "scan channel 2"], motion_m: Float[np.ndarray, "scan 2"]
) -> Float[np.ndarray, "scan 2"]:
    """Unit vector of the vehicle's heading on the grid; from the motion if there is only one channel."""
    if positions_m.shape[1] > 1:
        left = positions_m[:, 0] - positions_m[:, -1]
        forward = np.stack([left[:, 1], -left[:, 0]], axis=1)
    else:
        moving = np.flatnonzero(np.hypot(motion_m[:, 0], motion_m[:, 1]) > 0)
        last = np.clip(np.searchsorted(moving, np.arange(len(motion_m)), side="right") - 1, 0, None)
        forward = motion_m[moving[last]]
    unit: np.ndarray = forward / np.hypot(forward[:, 0], forward[:, 1])[:, None]
    return unit


def _array(
    folder: Path, positions_m: Float[np.ndarray, "scan channel 2"], forward: Float[np.ndarray, "scan 2"]
) -> ArrayGeometry:
    """Antennas about their middle: the median over the run of the positions in the body frame."""
    offsets = positions_m - positions_m.mean(axis=1, keepdims=True)
    along = offsets[..., 0] * forward[:, None, 0] + offsets[..., 1] * forward[:, None, 1]
    leftward = offsets[..., 1] * forward[:, None, 0] - offsets[..., 0] * forward[:, None, 1]
    y_m = np.median(leftward, axis=0)
    if np.any(np.diff(y_m) >= 0):
        raise InputError(folder / "run_UTM_point.npy", "channels", "channels sorted from side to side", "another order")
    return ArrayGeometry(np.median(along, axis=0), y_m, np.zeros(len(y_m)), 0.0)


def _travel_m(
    centre_m: Float[np.ndarray, "scan 2"], forward: Float[np.ndarray, "scan 2"]
) -> Float[np.ndarray, " scan"]:
    """Signed cumulative travel along the heading: backward counts negative, jitter while standing cancels."""
    along_m = np.sum(np.diff(centre_m, axis=0) * (forward[:-1] + forward[1:]) / 2, axis=1)
    return np.concatenate([[0.0], np.cumsum(along_m)])


def _track(
    projection: pyproj.Proj,
    centre_m: Float[np.ndarray, "scan 2"],
    forward: Float[np.ndarray, "scan 2"],
    time_s: Float[np.ndarray, " scan"],
) -> NavigationTrack:
    longitude_deg, latitude_deg = projection(centre_m[:, 0], centre_m[:, 1], inverse=True)
    # Grid north deviates from true north by the meridian convergence, which counts clockwise.
    convergence_deg = projection.get_factors(longitude_deg, latitude_deg).meridian_convergence
    grid_deg = np.rad2deg(np.arctan2(forward[:, 0], forward[:, 1]))
    return track(time_s, latitude_deg, longitude_deg, (grid_deg + convergence_deg) % 360.0)
