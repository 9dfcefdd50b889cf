"""A map brought up to date by new drives: located on it, added to it, weighed, and what they find changed retired.

A drive is registered on the map, its labels are corrected by its fixes, and it becomes one more baseline. Nothing of
the map is deleted: stations of ground that has changed stay in the file, marked with the number of the update that
retired them. Of the new drive's own stations those are held back (marked with the number of its own update) that lie
over the map's ground and could not be located, or that only contradict it (see ``ground_changes``).

The new map is written beside the old one and takes its name in one step: whatever fails, the old one is there whole.
"""

import os
import shutil
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path

import numpy as np

from lgprjax import __version__
from lgprjax.archive.baseline_changes import BaselineChanges, StationMarks, find_changes
from lgprjax.archive.baseline_strengths import BaselinePlaces, lay_places
from lgprjax.archive.baseline_weights import BaselineWeight, moment_of, newer_than, weigh_baselines
from lgprjax.archive.located_drive import LocatedDrive, locate_drive, refuse_unfit
from lgprjax.archive.map_building import MEASURING, position_sigma_m
from lgprjax.archive.map_chance import measure_chance
from lgprjax.archive.staged_map import stage_map
from lgprjax.archive.update_record import DriveUpdate, UpdatedMap, UpdateStretch, file_of, plain
from lgprjax.archive.update_weights import agreement_with, repeats_of
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

UPDATE_PASSES = 3
"""How often an update tells of a drive's scans: registered, added, compared."""


def update_map(
    path: str | Path,
    drives: Sequence[str | Path],
    output: str | Path | None = None,
    *,
    force: bool = False,
    progress: Callable[[int], None] = lambda _: None,
    stage: Callable[[str], None] = lambda _: None,
) -> UpdatedMap:
    """Bring a map up to date by drives, the oldest first.

    Args:
        path: the map.
        drives: drive logs over its ground.
        output: a new map; without it the map itself is replaced.
        force: replace an output that exists.
        progress: told the number of scans done since the last call, ``UPDATE_PASSES`` times every scan.
        stage: told what is being done.

    Raises:
        InputError: a drive that does not fit or lies elsewhere, another process that writes the map, an output that
            cannot be written, or a damaged map. Then nothing has changed.
    """
    # A link would be replaced, and what it points at stay old.
    target = Path(os.path.realpath(path)) if output is None else Path(output)
    if output is not None and target.exists() and not force:
        raise InputError(target, "output", "a new file, or --force", "the file exists")
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
    """The drives by their dates; what cannot be used is refused before any is worked on."""
    dated: list[tuple[float, str, Path]] = []
    with MapFile.open(path) as source:
        for drive in drives:
            with DriveLog.open(drive) as log:
                digest = refuse_unfit(source, log)
                moment = moment_of(log.description.t0_utc)
            if digest in [other for _, other, _ in dated]:
                raise InputError(drive, "drives", "drives of different content", "one that is given twice")
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
    strength = changes.strength.copy()
    for ground in changes.verdict.changed:
        strength[ground.drive, ground.first : ground.last + 1] = np.nan
    agreement = agreement_with(stage, in_force, history.agreement, strength)
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
                strength=ground.strength,
                usual=changes.verdict.usual,
                agreeing=ground.agreeing,
            )
            for ground in changes.verdict.changed
        ),
    )


def _label_sigma_m(log: DriveLog, located: LocatedDrive, changes: BaselineChanges) -> float:
    """What the new baseline's labels are wrong by, such that the mean of all baselines is not called too good.

    Corrected labels share the map's errors, m² of variance, and add those of the match. Where they join K baselines of
    independent errors, whose mean has m², the mean of all is no better than m² but for the match; registration, which
    takes all baselines for independent, finds just that with (2 K + 1) m² and the match's variance for the new one.
    """
    corrected = located.correction.corrected
    beside = np.isfinite(changes.strength).sum(axis=0)
    joined = float(np.median(beside[beside > 0])) if np.any(beside > 0) else 1.0
    tied_m2 = (2.0 * joined + 1.0) * located.map_sigma_m**2 + located.match_sigma_m**2
    given_m2 = (position_sigma_m(log) or 0.0) ** 2
    share = float(np.mean(corrected))
    return float(np.sqrt(share * tied_m2 + (1.0 - share) * given_m2))
