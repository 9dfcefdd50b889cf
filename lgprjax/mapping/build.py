"""Drive logs -> subsurface database, streaming."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pyproj
from jaxtyping import Array, Float

from lgprjax import __version__
from lgprjax.batch.chance import measure_chance
from lgprjax.errors import InputError
from lgprjax.files import file_hash
from lgprjax.formats import MAP_PRECISIONS, DriveLog, MapFile, MapPrecision, MapWriter, assumed_of
from lgprjax.frames import LocalFrame
from lgprjax.radar import ChainSettings, apply_operator, centre_of, coherence_gain
from lgprjax.recordings.drives import (
    DriveTrack,
    antennas_of,
    at_levels,
    depth_level,
    recording_of,
    scan_spacing_m,
    track_of_drive,
)
from lgprjax.registration import Chance
from lgprjax.subsurface import (
    Coherence,
    MapDescription,
    ScanBlock,
    StationBlock,
    TilePlacer,
    coherence_lags,
    stations_of_drive,
)

_BLOCK_SCANS = 512
_LONE_CHANNEL_PITCH_M = 0.2  # distance from its line over which a single channel represents the ground

Progress = Callable[[int], None]
"""Called with the number of scans done since the last call."""

MEASURING = "measuring the map's noise floor"
"""Last step of a map's writer."""


_FARTHEST_M = 50e3
"""Drives farther apart are not one site: local metres are float32 and on one tangent plane."""


def _require_near(log: DriveLog, frame: LocalFrame, first: str | Path) -> None:
    """Refuse a drive that is elsewhere on the earth. Raises ``InputError`` with the distance."""
    place = log.description.navigation
    here = (float(place.longitude_deg[0]), float(place.latitude_deg[0]))
    away_m = pyproj.Geod(ellps="WGS84").inv(*here, frame.longitude_deg, frame.latitude_deg)[2]
    if away_m > _FARTHEST_M:
        expected = f"a drive within {_FARTHEST_M / 1e3:g} km of {Path(first).name}"
        raise InputError(log.path, "/navigation", expected, f"a drive that starts {away_m / 1e3:.0f} km away")


def build_map(
    drives: Sequence[str | Path],
    output: str | Path,
    *,
    centre_frequency_hz: float | None = None,
    travel_time_ns: float | None = None,
    precision: MapPrecision = MAP_PRECISIONS["standard"],
    force: bool = False,
    measure: Callable[[MapFile], Chance] | None = measure_chance,
    progress: Progress = lambda _: None,
    stage: Callable[[str], None] = lambda _: None,
) -> MapDescription:
    """Build a subsurface database from one or more drives over the same ground.

    Args:
        drives: drive logs, of traces or of sweeps; the first gives anchor, channels and chain.
        output: path of the database.
        centre_frequency_hz: centre frequency of the antennas, if missing in the first log; sweeps always have it.
        travel_time_ns: largest travel time of the profiles; by default traces extend to the recording's end and sweeps
            to fifteen periods of their centre frequency, never beyond the unambiguous range.
        precision: precision of the stored traces.
        force: whether to replace an existing output.
        measure: function that measures the map's chance, which is stored in it; ``None``: left to the first
            registration.
        progress: function called as scans are done.
        stage: function called with each step after the last scan.

    Returns:
        Description of the map.

    Raises:
        InputError: a log is unusable, drives do not fit together, or the output cannot be written.
    """
    with DriveLog.open(drives[0]) as first:
        recording = recording_of(first)
        frame, spacing_m = _plan(first)
        settings = recording.chain(spacing_m, centre_frequency_hz)
        samples = recording.samples(settings, travel_time_ns)
        steps = [*recording.steps, "stations", "zero-phase track filter", "coherence gain (stored beside)"]
        pitch_m = _pitch(first)
        channels = first.channels
    tile_spacing_m = max(4.0, 10.0 * settings.step_m)
    tiles = TilePlacer(tile_spacing_m)
    references: list[float] = []
    coherence: Coherence | None = None
    inputs: list[dict[str, object]] = []
    hashes: list[str] = []
    for path in drives:
        with DriveLog.open(path) as log:
            _require_near(log, frame, drives[0])
        own = file_hash(path)
        if own in hashes:
            # It would agree with itself, and the map would believe that its labels are known better than they are.
            raise InputError(path, "drives", "each drive once", f"the same contents as {drives[hashes.index(own)]}")
        hashes.append(own)
    with MapWriter.create(output, precision=precision, force=force) as writer:
        for number, path in enumerate(drives):
            with DriveLog.open(path) as log:
                if log.channels != channels:
                    raise InputError(path, "/array/y_m", f"{channels} channels as in {drives[0]}", str(log.channels))
                lags = coherence_lags(settings, spacing_m)
                operator = recording_of(log).operator(settings, samples)
                if recording_of(log).kind != recording.kind:
                    levels = (_level(path, frame, settings, samples) for path in (drives[0], drives[number]))
                    operator = at_levels(operator, *levels)
                track = track_of_drive(log, frame)
                for block in baseline_stations(log, track, operator, settings, spacing_m, progress):
                    coherence = (coherence or Coherence.empty(block.profile.shape[2])).add(block, lags)
                    references += [float(np.median(block.pose[:, 2]))] * tiles.place(block.pose)
                    writer.append(block, number)
                inputs.append(
                    {
                        "file": Path(path).name,
                        "sha256": hashes[number],
                        "t0_utc": log.description.t0_utc,
                        "scans": log.scans,
                        "position_sigma_m": position_sigma_m(log),
                        "assumed": assumed_of(log.description.provenance),
                    }
                )
        assert coherence is not None
        description = MapDescription(
            name=Path(output).name.removesuffix(".map.h5"),
            frame=frame,
            settings=settings,
            channel_pitch_m=pitch_m,
            channels=channels,
            tile_spacing_m=tile_spacing_m,
            gain=coherence_gain(*coherence.means).astype(np.float32),
            label_sigma_m=tuple(float(str(row["position_sigma_m"] or 0.0)) for row in inputs),
        )
        provenance: dict[str, object] = {
            "program": f"lgprjax {__version__}",
            "recording": recording.kind,
            "steps": steps,
            "inputs": inputs,
        }
        writer.finish(description, tiles.frames, np.asarray(references), provenance)
        if measure is not None:
            stage(MEASURING)
            writer.add_chance(measure)
    return description


def baseline_stations(
    log: DriveLog,
    track: DriveTrack,
    operator: Float[Array, "recorded sample"],
    settings: ChainSettings,
    spacing_m: float,
    progress: Progress,
) -> Iterator[StationBlock]:
    """A drive as stations of a map, in units of its own RMS.

    Args:
        log: log of the drive.
        track: track of its scans, in the map's frame.
        operator: matrix from its recording to the map's profiles.
        settings: processing chain of the map.
        spacing_m: typical distance between scans.
        progress: function called as scans are done.

    Raises:
        InputError: nothing was received, or the drive makes fewer than two stations.
    """
    scale: float | None = None
    stations = 0
    for block in stations_of_drive(scan_blocks(log, track, operator, progress), settings, spacing_m):
        if scale is None and np.any(block.profile):
            scale = float(np.sqrt(np.mean(block.profile[block.valid] ** 2)))
        if scale is None:
            # Nothing has been received: these stations hold no ground.
            block = block._replace(valid=np.zeros_like(block.valid))
        stations += len(block.pose)
        yield block._replace(profile=block.profile / np.float32(scale or 1.0))
    if scale is None and stations:
        raise InputError(log.path, "/radar", "a signal that changes along the drive", "none")
    if stations < 2:
        raise InputError(log.path, "/odometry/distance_m", f"travel of at least {2 * settings.step_m:.3g} m", "less")


def scan_blocks(
    log: DriveLog, moved: DriveTrack, operator: Float[Array, "recorded sample"], progress: Progress
) -> Iterator[ScanBlock]:
    """Profiled scans of a drive with their places, block by block."""
    track, ground_up = moved.track, moved.ground_up_m
    antennas = antennas_of(track, log.description.array)
    for start, recorded, valid in recording_of(log).blocks(_BLOCK_SCANS):
        span = slice(start, start + len(recorded))
        padded = np.pad(recorded, [(0, _BLOCK_SCANS - len(recorded)), (0, 0), (0, 0)])
        yield ScanBlock(
            profile=np.asarray(apply_operator(jnp.asarray(padded), operator))[: len(recorded)],
            valid=valid,
            travel_m=track.travel_m[span],
            pose=track.pose[span],
            ground_up_m=ground_up[span],
            antenna_m=antennas[span],
            time_s=log.scan_time_s[span],
        )
        progress(len(recorded))


def _plan(log: DriveLog) -> tuple[LocalFrame, float]:
    """Frame and scan spacing that the first drive sets for the map."""
    navigation = log.description.navigation
    frame = LocalFrame(
        float(navigation.latitude_deg[0]), float(navigation.longitude_deg[0]), float(navigation.height_m[0])
    )
    return frame, scan_spacing_m(track_of_drive(log, frame).track)


def _level(path: str | Path, frame: LocalFrame, settings: ChainSettings, samples: int) -> Float[np.ndarray, " sample"]:
    with DriveLog.open(path) as log:
        recording, track = recording_of(log), track_of_drive(log, frame).track
        return depth_level(recording, recording.operator(settings, samples), track, settings.track_filter_m)


def _pitch(log: DriveLog) -> float:
    y_m = log.description.array.y_m
    return float(np.median(np.abs(np.diff(y_m)))) if len(y_m) > 1 else _LONE_CHANNEL_PITCH_M


def position_sigma_m(log: DriveLog) -> float | None:
    """Position sigma of the array stated by the drive's navigation, root mean square over the drive and both axes.

    An error of heading rotates the array about the body's origin. None if navigation states no sigma.
    """
    navigation = log.description.navigation
    if navigation.sigma_east_m is None or navigation.sigma_north_m is None:
        return None
    variance = 0.5 * (np.mean(navigation.sigma_east_m**2) + np.mean(navigation.sigma_north_m**2))
    if navigation.sigma_heading_deg is not None:
        lever_m = np.hypot(*centre_of(log.description.array))
        variance += 0.5 * lever_m**2 * np.mean(np.radians(navigation.sigma_heading_deg) ** 2)
    return float(np.sqrt(variance))
