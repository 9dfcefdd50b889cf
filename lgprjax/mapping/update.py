"""Update of a map by new drives: they are located, added and weighted, and changed ground is retired.

A drive is registered on the map, its labels are corrected by its fixes, and it becomes one more baseline. Nothing of
the map is deleted: stations of ground that has changed stay in the file, marked with the number of the update that
retired them. Stations of the new drive are held back (marked with the number of its own update) if they are over the
map's ground and could not be located, or only contradict it (see ``changes``).

The new map is written next to the old one and takes its name in one step: if anything fails, the old one is intact.
"""

import os
import shutil
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax import __version__
from lgprjax.batch.chance import measure_chance
from lgprjax.batch.register import register_log
from lgprjax.errors import InputError
from lgprjax.files import file_hash
from lgprjax.formats import (
    DriveLog,
    MapFile,
    MapHistory,
    MapWriter,
    assumed_of,
    copy_stations,
    locked_map,
    scratch_folder,
)
from lgprjax.frames import wrap_angle
from lgprjax.mapping.build import MEASURING, baseline_stations, position_sigma_m
from lgprjax.mapping.changes import (
    BaselineChanges,
    BaselinePlaces,
    StationMarks,
    agreement_with,
    find_changes,
    lay_places,
    repeats_of,
)
from lgprjax.mapping.weights import (
    BaselineWeight,
    DriveUpdate,
    UpdatedMap,
    UpdateStretch,
    file_of,
    moment_of,
    newer_than,
    plain,
    weigh_baselines,
)
from lgprjax.radar import centre_of
from lgprjax.recordings.drives import Alignment, DriveTrack, live_operators, scan_spacing_m, track_of_drive
from lgprjax.registration import Code, Fix, RegisterOptions, Track
from lgprjax.subsurface import MapDescription, TilePlacer

# Labels of one drive corrected by its fixes on a fixed map.
#
# GNSS and INS keep the shape of a short stretch and drift slowly: the error of a label is a random walk along the
# track, observed by the fixes and smoothed forward and backward (Rauch, Tung and Striebel 1965). Where the labels step
# and the wheels do not, the walk may step too. Wrong fixes lose their weight by the loss of Geman and McClure (1985),
# starting from the median of their surroundings: they must be a minority within fifteen metres. Far from all fixes the
# labels stay as given.

_NODE_M = 1.0
_NODE_SCANS = 5  # a node is longer where scans are far apart
_LEAST_FIXES = 3  # of a node: fewer are ignored
_LEAST_NODES = 3  # with fixes, of those around a node: fewer cannot be compared
_ABOUT_NODES = 15
_WALK_M = 0.03  # a root metre, of east and of north
_WALK_RAD = np.radians(0.03)
_LEAST_SIGMA_M = 0.02  # fixes of one metre of ground share most of their errors
_LEAST_SIGMA_RAD = np.radians(0.2)
_STEP = 0.1  # metres a metre by which labels may differ from wheels and heading; more is a step of the labels
_STEPPED_M = 0.1  # from node to node: labels with larger steps are not corrected there
_WRONG_M = 0.15  # a fix this far from its neighbours keeps a quarter of its weight
_WRONG_RAD = np.radians(2.0)
_HEARD = 0.25  # of its weight that a node keeps to count as located
_ROUNDS = 6
_SURE_M, _LOST_M = 0.15, 0.26  # sigma up to which labels are corrected in full, and from which they stay as given


class LabelCorrection(NamedTuple):
    """Correction of a drive's labels, one row per scan.

    Attributes:
        offset: correction of east_m, north_m, yaw_rad.
        sigma_m: standard deviation of the corrected position relative to the map's ground, in east and in north each;
            infinite if it is not corrected.
        corrected: mask of scans corrected by fixes, up to 25 m beyond the last of them and across gaps of 100 m, where
            sigma reaches 0.15 m.
        between: mask of corrected scans with located places before and after: ground that does not match there has
            changed.
        located_m: travel on which fixes agree with their neighbours.
    """

    offset: Float[np.ndarray, "scan 3"]
    sigma_m: Float[np.ndarray, " scan"]
    corrected: Bool[np.ndarray, " scan"]
    between: Bool[np.ndarray, " scan"]
    located_m: float

    def applied(self, track: Track) -> Track:
        """The track with corrected poses."""
        pose = track.pose.copy()
        pose[:, [0, 1, 3]] += self.offset
        return track._replace(pose=pose)


def correct_labels(
    track: Track, fix: Fix, beside: Float[np.ndarray, "scan 2 2"], lever_m: tuple[float, float]
) -> LabelCorrection:
    """Smooth corrections of a drive's labels from its fixes.

    Args:
        track: track with the labels.
        fix: fixes of every scan; only those with code ok are used.
        beside: part of the fixes' covariances due to map and odometer (see ``DriveFixes``).
        lever_m: position of the array's centre, forward and left of the point that moves along its heading (the rear
            axle).
    """
    path_m = path_of(track)
    length_m = max(_NODE_M, _NODE_SCANS * float(path_m[-1]) / max(len(path_m) - 1, 1))
    node = (path_m / length_m).astype(np.int64)
    value, variance = _observed(track, fix, beside, node)
    walk = _walk(track, lever_m, path_m, length_m, len(value))
    off = _from_surroundings(value)
    value[~np.isfinite(off[:, 0])] = np.nan
    weight = _weights(off)
    smooth, spread = value, variance
    for _ in range(_ROUNDS):
        smooth, spread = _smoothed(value, variance / np.maximum(weight, 1e-9)[:, None], walk)
        weight = _weights(value - smooth)
    located = weight >= _HEARD
    sigma_m = np.sqrt(spread[:, 0]) if located.any() else np.full(len(value), np.inf)
    share = np.clip((_LOST_M - sigma_m) / (_LOST_M - _SURE_M), 0.0, 1.0)
    # Within a node in which labels step, the side of the step on which a scan is remains unknown.
    stepped = walk[:, 0] > _STEPPED_M**2
    corrected = (sigma_m <= _SURE_M) & ~stepped & ~np.append(stepped[1:], False)
    between = np.logical_or.accumulate(located) & np.logical_or.accumulate(located[::-1])[::-1] & corrected
    at_m = (np.arange(len(value)) + 0.5) * length_m
    return LabelCorrection(
        offset=np.stack([np.interp(path_m, at_m, share * column) for column in smooth.T], axis=1),
        sigma_m=np.where(corrected, sigma_m, np.inf)[node],
        corrected=corrected[node],
        between=between[node],
        located_m=float(located.sum()) * length_m,
    )


def path_of(track: Track) -> Float[np.ndarray, " scan"]:
    """Metres driven since the first scan; reverse counts as well."""
    return np.asarray(np.cumsum(np.abs(np.diff(track.travel_m, prepend=track.travel_m[0]))))


def _observed(
    track: Track, fix: Fix, beside: Float[np.ndarray, "scan 2 2"], node: Int[np.ndarray, " scan"]
) -> tuple[Float[np.ndarray, "node 3"], Float[np.ndarray, "node 3"]]:
    """Median of fix minus label at each node, and its variance; NaN and infinite where there are too few fixes."""
    off = np.asarray(fix.pose, np.float64)[:, [0, 1, 3]] - track.pose[:, [0, 1, 3]]
    off[:, 2] = wrap_angle(off[:, 2])
    covariance = np.asarray(fix.covariance, np.float64)
    place = 0.5 * np.trace(covariance[:, :2, :2] - beside, axis1=1, axis2=2)
    ok = (np.asarray(fix.code) == Code.OK) & np.isfinite(off).all(axis=1) & np.isfinite(place)
    scans = np.flatnonzero(ok)
    count = int(node[-1]) + 1
    value, variance = np.full((count, 3), np.nan), np.full((count, 3), np.inf)
    observed, first, many = np.unique(node[scans], return_index=True, return_counts=True)
    for number, low, fixes in zip(observed, first, many, strict=True):
        if fixes >= _LEAST_FIXES:
            own = scans[low : low + fixes]
            value[number] = np.median(off[own], axis=0)
            variance[number, :2] = _LEAST_SIGMA_M**2 + np.median(place[own])
            variance[number, 2] = _LEAST_SIGMA_RAD**2 + np.median(covariance[own, 3, 3])
    return value, variance


def _walk(
    track: Track, lever_m: tuple[float, float], path_m: Float[np.ndarray, " scan"], length_m: float, count: int
) -> Float[np.ndarray, "node 3"]:
    """Variance that the correction may gain from the node before to each node."""
    scan = np.minimum(np.searchsorted(path_m, (np.arange(count) + 0.5) * length_m), len(path_m) - 1)
    yaw = track.pose[scan, 3]
    cos, sin = np.cos(yaw), np.sin(yaw)
    x_m, y_m = lever_m
    axle = track.pose[scan, :2] - np.stack([cos * x_m - sin * y_m, sin * x_m + cos * y_m], axis=1)
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    wheels = np.diff(track.travel_m[scan])[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1)
    step_m = np.linalg.norm(np.diff(axle, axis=0) - wheels, axis=1)
    out = np.zeros((count, 3))
    out[1:, :2] = (_WALK_M**2 * length_m + np.maximum(step_m - _STEP * length_m, 0.0) ** 2)[:, None]
    out[1:, 2] = _WALK_RAD**2 * length_m
    return out


def _from_surroundings(value: Float[np.ndarray, "node 3"]) -> Float[np.ndarray, "node 3"]:
    """Difference of each node from the median of those around it; NaN without enough observations."""
    off = np.full_like(value, np.nan)
    for number in np.flatnonzero(np.isfinite(value[:, 0])):
        about = value[max(number - _ABOUT_NODES, 0) : number + _ABOUT_NODES + 1]
        about = about[np.isfinite(about[:, 0])]
        if len(about) >= _LEAST_NODES:
            off[number] = value[number] - np.median(about, axis=0)
    return off


def _weights(off: Float[np.ndarray, "node 3"]) -> Float[np.ndarray, " node"]:
    """Geman and McClure's; 0 where nothing was observed."""
    squared = (off[:, 0] ** 2 + off[:, 1] ** 2) / _WRONG_M**2 + (off[:, 2] / _WRONG_RAD) ** 2
    return np.asarray(np.nan_to_num(1.0 / (1.0 + squared) ** 2))


def _smoothed(
    value: Float[np.ndarray, "node 3"], variance: Float[np.ndarray, "node 3"], walk: Float[np.ndarray, "node 3"]
) -> tuple[Float[np.ndarray, "node 3"], Float[np.ndarray, "node 3"]]:
    """Mean and variance of a random walk at every node from all observations."""
    count = len(value)
    mean, spread = np.zeros((count, 3)), np.zeros((count, 3))
    here, wide = np.zeros(3), np.full(3, 1e6)
    for number in range(count):
        wide = wide + walk[number]
        if np.isfinite(value[number, 0]):
            gain = wide / (wide + variance[number])
            here, wide = here + gain * (value[number] - here), wide * (1.0 - gain)
        mean[number], spread[number] = here, wide
    for number in range(count - 2, -1, -1):
        ahead = spread[number] + walk[number + 1]
        gain = spread[number] / ahead
        mean[number] += gain * (mean[number + 1] - mean[number])
        spread[number] += gain**2 * (spread[number + 1] - ahead)
    return mean, spread


# A drive located on a map, its labels corrected: required before it becomes one of the map's baselines.

_SEARCH_M, _WINDOW_M = 1.5, 1.0
_LEAST_LOCATED_M = 5.0
_LEAST_SHARE = 0.2
"""Share of the travel over the map's ground that fixes must locate: fixes on other ground do not agree."""
_NOT_TRIED = (Code.OFF_MAP, Code.LOW_OVERLAP, Code.NON_FINITE, Code.NO_WINDOW)


class LocatedDrive(NamedTuple):
    """A drive whose labels follow the map's ground.

    Attributes:
        track: track of the scans, with corrected poses.
        correction: correction of the labels.
        alignment: adjustment of its traces to the map's.
        path_m: distance of the scans along the drive.
        tried: mask of scans over the map's ground.
        ok: mask of scans whose fix is ok.
        match_sigma_m: standard deviation of the corrected labels relative to the map's ground, root mean square.
        map_sigma_m: standard deviation of the map's own labels there, root mean square.
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
    """Search for a drive that is to become a baseline: with windows too short to bridge changed ground."""
    wavelength_m = description.settings.wavelength_m
    window_m = _WINDOW_M * max(1.0, wavelength_m)
    return RegisterOptions(search_m=max(_SEARCH_M, wavelength_m), window_m=window_m, time_scale=1.0)


def locate_drive(source: MapFile, log: DriveLog, progress: Callable[[int], None] = lambda _: None) -> LocatedDrive:
    """Register a drive on a map and correct its labels.

    Args:
        source: the map.
        log: the drive.
        progress: called with the number of scans done since the last call.

    Raises:
        InputError: the drive does not fit the map: other channels, a drive that the map holds already, other ground, or
            ground on which it cannot be located.
    """
    refuse_unfit(source, log)
    options = update_search(source.description)
    drive = register_log(source, log, options, progress)
    correction = correct_labels(drive.track, drive.fix, drive.map_odometry_covariance, centre_of(log.description.array))
    path_m, code = path_of(drive.track), np.asarray(drive.fix.code)
    tried = ~np.isin(code, _NOT_TRIED)
    _refuse_elsewhere(log, drive.away, options, correction, path_m, tried)
    ok, known = code == Code.OK, correction.corrected
    beside = 0.5 * np.trace(drive.map_odometry_covariance[ok], axis1=1, axis2=2)
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
    """Hash of a drive to be added to a map. Raises ``InputError`` for other channels, or a drive that it holds."""
    channels = source.description.channels
    if log.channels != channels:
        raise InputError(log.path, "/array/y_m", f"{channels} channels as in {source.path}", str(log.channels))
    digest = file_hash(log.path)
    inputs = source.provenance.get("inputs")
    for row in inputs if isinstance(inputs, list) else []:
        if isinstance(row, dict) and row.get("sha256") == digest:
            found = f"{row.get('file')}, already in {source.path.name}"
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
        expected = f"a drive over the mapped ground, with positions within {options.search_half_m():.1f} m"
        raise InputError(log.path, "/gnss_ins", expected, away or "no scan over the map")
    metres = np.diff(path_m, prepend=0.0)
    over_m = float(metres[tried].sum())
    least_m = max(_LEAST_LOCATED_M, _LEAST_SHARE * over_m)
    if correction.located_m < least_m or not correction.corrected.any():
        expected = (
            f"consistent fixes over {_LEAST_LOCATED_M:g} m and {100 * _LEAST_SHARE:.0f} % of the distance on the map"
        )
        found = f"{correction.located_m:.0f} m of {over_m:.0f} m: different ground from the map, or too noisy"
        raise InputError(log.path, "fixes", expected, found)


# A map with one more baseline, all in force: compared before an update decides.


class StagedMap(NamedTuple):
    """A scratch map.

    Attributes:
        path: path of the file.
        tile_frame, height_reference_m: tile frames and height references of the map, and those added by the new
            baseline.
        time_s: times of the new baseline's stations, in its drive.
    """

    path: Path
    tile_frame: Float[np.ndarray, "tile 3"]
    height_reference_m: Float[np.ndarray, " tile"]
    time_s: Float[np.ndarray, " scan"]


def stage_map(
    source: MapFile, log: DriveLog, located: LocatedDrive, path: Path, progress: Callable[[int], None]
) -> StagedMap:
    """Write a map with a drive as its last baseline.

    Tiles keep their places; the drive adds some where the existing ones do not cover it.

    Args:
        source: map.
        log, located: log of the drive, and its located track.
        path: path of the scratch map.
        progress: function called as scans are done.

    Raises:
        InputError: nothing was received along the drive, the map is damaged, or the output cannot be written.
    """
    description, track = source.description, located.track.track
    tiles = TilePlacer(description.tile_spacing_m)
    references: list[float] = []
    for frame, height_m in zip(source.tile_frame, source.height_reference_m, strict=True):
        pose = np.array([[frame[0], frame[1], height_m, frame[2], 0.0]])
        references += [float(height_m)] * tiles.place(pose)
    operator = live_operators(source, log, track, located.alignment)(1.0)
    # A line walked in the opposite direction has falling travel, like a vehicle in reverse, which stations leave out.
    passed = located.track
    if located.alignment.reversed:
        passed = passed._replace(track=track._replace(travel_m=-track.travel_m))
    blocks = baseline_stations(log, passed, operator, description.settings, scan_spacing_m(track), progress)
    times = []
    with MapWriter.create(path) as writer:
        copy_stations(source, writer)
        for block in blocks:
            references += [float(np.median(block.pose[:, 2]))] * tiles.place(block.pose)
            writer.append(block, len(description.label_sigma_m))
            times.append(block.time_s)
        writer.finish(description._replace(weight=()), tiles.frames, np.asarray(references), source.provenance)
    return StagedMap(path, tiles.frames, np.asarray(references), np.concatenate(times))


UPDATE_PASSES = 3
"""Number of progress reports of an update per scan of a drive: registered, added, compared."""


def update_map(
    path: str | Path,
    drives: Sequence[str | Path],
    output: str | Path | None = None,
    *,
    force: bool = False,
    progress: Callable[[int], None] = lambda _: None,
    stage: Callable[[str], None] = lambda _: None,
) -> UpdatedMap:
    """Update a map by drives, the oldest first.

    Args:
        path: the map.
        drives: drive logs over its ground.
        output: a new map; without it the map itself is replaced.
        force: replace an output that exists.
        progress: called with the number of scans done since the last call; every scan counts ``UPDATE_PASSES`` times.
        stage: called with each step.

    Raises:
        InputError: a drive that does not fit or is elsewhere, another process that writes the map, an output that
            cannot be written, or a damaged map. Nothing has changed then.
    """
    # A link would be replaced, and its target stay old.
    target = Path(os.path.realpath(path)) if output is None else Path(output)
    if output is not None and target.exists() and not force:
        raise InputError(target, "output", "a new file, or --force", "an existing file")
    with locked_map(target):
        scratch = scratch_folder(target)
        try:
            ordered = _oldest_first(path, drives)
            scratch.mkdir(exist_ok=True)
            current, done = Path(path), []
            for number, drive in enumerate(ordered):
                following = target if number + 1 == len(ordered) else scratch / f"{number}.map.h5"
                whole = scratch / f"{number}-whole.map.h5"
                done.append(_add_drive(current, drive, following, whole, progress, stage))
                current = following
        except InputError as error:
            if Path(error.file).parent != scratch:
                raise
            raise InputError(target, error.place, error.expected, error.found) from None
        except OSError as error:
            if error.filename != str(scratch):
                raise
            raise InputError(target, "output", "a file that can be written", os.strerror(error.errno or 0)) from None
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
        with MapFile.open(target) as written:
            files = tuple(file_of(row, number) for number, row in enumerate(MapHistory.of(written).inputs))
    return UpdatedMap(tuple(update for update, _ in done), done[-1][1], files)


def _oldest_first(path: str | Path, drives: Sequence[str | Path]) -> list[Path]:
    """The drives by date; unusable ones are refused before any is processed."""
    dated: list[tuple[float, str, Path]] = []
    with MapFile.open(path) as source:
        for drive in drives:
            with DriveLog.open(drive) as log:
                digest = refuse_unfit(source, log)
                moment = moment_of(log.description.t0_utc)
            if digest in [other for _, other, _ in dated]:
                raise InputError(drive, "drives", "drives with different contents", "a drive given twice")
            dated.append((np.inf if moment is None else moment.timestamp(), digest, Path(drive)))
    return [drive for _, _, drive in sorted(dated, key=lambda each: each[0])]


def _add_drive(
    path: Path,
    drive: Path,
    output: Path,
    whole: Path,
    progress: Callable[[int], None],
    stage: Callable[[str], None],
) -> tuple[DriveUpdate, tuple[BaselineWeight, ...]]:
    """One update: the map with one more drive."""
    stage(f"adding {drive.name}")
    with MapFile.open(path) as source, DriveLog.open(drive) as log:
        history = MapHistory.of(source)
        number = len(history.updates) + 1
        located = locate_drive(source, log, progress)
        staged = stage_map(source, log, located, whole, progress)
        row: dict[str, object] = {"file": drive.name, "sha256": file_hash(drive), "t0_utc": log.description.t0_utc}
        row |= {"scans": log.scans, "update": number, "assumed": assumed_of(log.description.provenance)}
        recorded = [moment_of(each.get("t0_utc")) for each in (*history.inputs, row)]
        with MapFile.open(staged.path) as built:
            places = lay_places(built, len(history.inputs))
            first = len(built.places) - len(staged.time_s)
            at = np.searchsorted(log.scan_time_s, staged.time_s[places.station - first]).clip(0, log.scans - 1)
            retired = np.append(source.retired.astype(np.int64), np.zeros(len(staged.time_s), np.int64))
            changes = find_changes(
                built,
                places,
                located.correction.corrected[at],
                located.correction.between[at],
                StationMarks(retired, (*history.added_by, number)),
                newer_than(recorded),
            )
            agreement, repeats, weights = _weigh(built, history, changes, recorded)
            progress(log.scans)
            update = _update_of(path, built, log, located, places, changes, number)
            row["position_sigma_m"] = update.label_sigma_m
            inputs = [{**old, "repeats": share} for old, share in zip((*history.inputs, row), repeats, strict=True)]
            provenance: dict[str, object] = {
                **source.provenance,
                "program": f"lgprjax {__version__}",
                "inputs": plain(inputs),
                "updates": [*history.updates, plain(update)],
                "agreement": plain(agreement),
                "weights": plain(weights),
            }
            with MapWriter.create(output, force=True) as writer:
                copy_stations(built, writer)
                writer.finish(
                    source.description._replace(weight=tuple(each.weight for each in weights)),
                    staged.tile_frame,
                    staged.height_reference_m,
                    provenance,
                    changes.marks.retired,
                )
                stage(MEASURING)
                writer.add_chance(measure_chance)
    return update, weights


def _weigh(
    stage: MapFile, history: MapHistory, changes: BaselineChanges, recorded: list[datetime | None]
) -> tuple[np.ndarray, np.ndarray, tuple[BaselineWeight, ...]]:
    """Agreement of all baselines in pairs, signal of each, and the weights that follow."""
    in_force = changes.marks.retired == 0
    score = changes.score.copy()
    for ground in changes.verdict.changed:
        score[ground.drive, ground.first : ground.last + 1] = np.nan
    agreement = agreement_with(stage, in_force, history.agreement, score)
    repeats = repeats_of(stage, in_force, np.append(history.repeats, np.nan))
    return agreement, repeats, weigh_baselines(recorded, agreement, repeats)


def _update_of(
    path: Path,
    stage: MapFile,
    log: DriveLog,
    located: LocatedDrive,
    places: BaselinePlaces,
    changes: BaselineChanges,
    number: int,
) -> DriveUpdate:
    correction = located.correction
    moved_m = np.hypot(*correction.offset[correction.corrected, :2].T)
    metres = np.diff(located.path_m, prepend=0.0)
    own = stage.drive == places.drive
    pose = places.pose
    latitude, longitude, _ = stage.description.frame.to_geodetic(pose[:, 0], pose[:, 1], np.zeros(len(pose)))
    ends = [(round(float(a), 9), round(float(b), 9)) for a, b in zip(latitude, longitude, strict=True)]
    return DriveUpdate(
        number=number,
        name=log.path.name.removesuffix(".drive.h5"),
        baseline=places.drive,
        map_sha256=file_hash(path),
        length_m=float(located.path_m[-1]),
        over_map_m=float(metres[located.tried].sum()),
        located_m=correction.located_m,
        ok_share=float(np.mean(located.ok[located.tried])),
        corrected_m=float(metres[correction.corrected].sum()),
        moved_rms_m=float(np.sqrt(np.mean(moved_m**2))),
        moved_max_m=float(moved_m.max()),
        match_sigma_m=located.match_sigma_m,
        label_sigma_m=_label_sigma_m(log, located, changes),
        stations=int(own.sum()),
        held_back=int(np.count_nonzero(changes.marks.retired[own])),
        retired=changes.retired,
        released=changes.released,
        changed=tuple(
            UpdateStretch(
                start_m=ground.start_m,
                stop_m=ground.stop_m,
                start=ends[ground.first],
                stop=ends[ground.last],
                baseline=ground.drive,
                score=ground.score,
                usual=changes.verdict.usual,
                agreeing=ground.agreeing,
            )
            for ground in changes.verdict.changed
        ),
    )


def _label_sigma_m(log: DriveLog, located: LocatedDrive, changes: BaselineChanges) -> float:
    """Sigma of the new baseline's labels, such that the mean of all baselines is not overconfident.

    Corrected labels share the map's errors, m² of variance, and add those of the match. Joined with K baselines of
    independent errors, whose mean has m², the mean of all is no better than m² except for the match; registration,
    which takes all baselines as independent, finds just that with (2 K + 1) m² plus the match's variance for the new
    one.
    """
    corrected = located.correction.corrected
    beside = np.isfinite(changes.score).sum(axis=0)
    joined = float(np.median(beside[beside > 0])) if np.any(beside > 0) else 1.0
    tied_m2 = (2.0 * joined + 1.0) * located.map_sigma_m**2 + located.match_sigma_m**2
    given_m2 = (position_sigma_m(log) or 0.0) ** 2
    share = float(np.mean(corrected))
    return float(np.sqrt(share * tied_m2 + (1.0 - share) * given_m2))
