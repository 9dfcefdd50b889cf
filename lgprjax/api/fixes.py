"""Registration of whole drives on a map: one in this process, many by worker processes."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float

from lgprjax.api.inputs import PathLike, axes_or_new, path_of, paths_of, told_as_arguments, whole_number
from lgprjax.api.maps import check_options, held_ground, using_map
from lgprjax.errors import InputError
from lgprjax.files import file_hash
from lgprjax.formats import DriveLog, read_fixes
from lgprjax.registration import Fix, RegisterOptions

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from lgprjax.batch import RegisteredDrive
    from lgprjax.batch.locate import LocatedDrive
    from lgprjax.report import DriveResult, DriveSummary

_LEAST_COLOUR_M = 0.02


@dataclass(frozen=True, eq=False)
class Fixes:
    """Fixes of a drive on a map, one per scan.

    Attributes:
        name: name of the drive.
        map_name: name of the map.
        table: DataFrame with the columns of ``X.fixes.csv``, a row per scan (data_schema/fixes.toml).
        fix: fixes as arrays [scan, ...]; poses in metres east and north of the map origin.
        truth: true poses [scan, 5] in the same frame, NaN if unknown; None if the log has none.
        result: data for pictures: priors, distance and sigmas per scan.
    """

    name: str
    map_name: str
    table: pd.DataFrame
    fix: Fix
    truth: Float[np.ndarray, "scan 5"] | None
    result: "DriveResult"
    _saved_with: "tuple[RegisteredDrive, Path, Path, RegisterOptions, tuple[str, str]]"

    def __repr__(self) -> str:
        told = self.summary
        tried = f"{told.ok} of {told.tried} searched are ok"
        wrong = "" if told.max_error_m is None else f", at most {told.max_error_m:.2f} m off"
        return f"Fixes of {self.name!r} on {self.map_name!r}: {told.scans} scans, {tried}{wrong}"

    def __len__(self) -> int:
        return len(self.table)

    @property
    def ok(self) -> Bool[np.ndarray, " scan"]:
        """Boolean mask of the scans with an accepted fix."""
        return np.asarray(self.table["code"].to_numpy() == "ok")

    @cached_property
    def summary(self) -> "DriveSummary":
        """Counts by code, and errors if the truth is known."""
        from lgprjax.report import summarise

        return summarise(self.result)

    def plot(self, *, ax: "Axes | None" = None) -> "Axes":
        """Draw baselines, prior, truth and fixes from above, fixes coloured by cross-track error.

        Without truth the colour shows the difference from the prior. Returns the axes.
        """
        from lgprjax.report import track_errors
        from lgprjax.report.drive import draw_plan, plan_frame, reference_track

        axes = axes_or_new(ax)
        frame = plan_frame(reference_track(self.result))
        error_m = track_errors(self.result).cross_m
        shown = np.abs(error_m[self.ok & np.isfinite(error_m)])
        limit_m = max(float(np.percentile(shown, 98.0)), _LEAST_COLOUR_M) if shown.size else _LEAST_COLOUR_M
        points = draw_plan(axes, self.result, frame, error_m, limit_m)
        axes.set_xlabel("along the road (m)" if frame.along_road else "east (m)")
        axes.set_ylabel("left (m)" if frame.along_road else "north (m)")
        word = "error" if self.result.has_truth else "fix - prior"
        axes.figure.colorbar(points, ax=axes, label=f"cross-track {word} (m)", extend="both", pad=0.01)
        return axes

    def save(self, folder: PathLike, *, force: bool = False) -> Path:
        """Write ``NAME.fixes.csv`` and ``NAME.fixes.h5`` to a folder, created if missing; both appear, or neither.

        Args:
            folder: folder for the files.
            force: replace existing files.

        Returns:
            The CSV file.

        Raises:
            InputError: a file exists (without ``force``) or cannot be written, or map or drive log changed since the
                registration.
        """
        from lgprjax.batch import write_registered

        drive, map_path, log_path, options, sha256 = self._saved_with
        target = path_of(folder, "folder")
        with told_as_arguments():
            # The outputs name both files and use the map's anchor, so the files must be unchanged.
            for path, then in zip((map_path, log_path), sha256, strict=True):
                if file_hash(path) != then:
                    raise InputError(path, "file", "the same file as at registration", "a changed file")
            target.mkdir(parents=True, exist_ok=True)
            with using_map(map_path) as site, DriveLog.open(log_path) as log:
                write_registered(drive, site.source, log, options, target, force, sha256)
        return target / f"{self.name}.fixes.csv"


def register(site: PathLike, drive: PathLike, *, options: RegisterOptions | None = None) -> Fixes:
    """Locate every scan of a drive on a map (registration).

    By default the function matches the single scan or the last 1, 2, 4 or 8 m of travel, whichever is shortest and
        keeps the probability of a false match within the risk.

    Args:
        site: open map, or its path. An open map caches the ground for the next drive.
        drive: a drive log or an open drive.
        options: options of the search.

    Returns:
        Fixes: ``table`` is a DataFrame, ``plot()`` returns axes, ``save(folder)`` writes the files of the command line.

    Raises:
        InputError: a file or an option cannot be used, or the navigation of the drive does not cover its scans.

    Example:
        site = lx.open_map("site.map.h5")
        fixes = lx.register(site, "drives/live.drive.h5", options=lx.RegisterOptions(window_m=2.0))
        print(fixes)                       # Fixes of 'live' on 'site': 3094 scans, ... are ok
        located = fixes.table[fixes.ok]    # only these are positions
        fixes.plot().set_title("live")
    """
    from lgprjax.batch import register_log
    from lgprjax.recordings.drives import gnss_gaps
    from lgprjax.report.registered import drive_result

    options = RegisterOptions() if options is None else options
    path = path_of(drive, "drive")
    with using_map(site) as opened:
        check_options(options, opened)
        with DriveLog.open(path) as log:
            sha256 = (opened.sha256, file_hash(path))
            done = register_log(opened.source, log, options, held=held_ground(opened, options))
            result = drive_result(done, opened.source, impostor=False, gnss_gap=gnss_gaps(log))
        return Fixes(
            name=done.name,
            map_name=opened.name,
            table=done.table,
            fix=done.fix,
            truth=done.truth,
            result=result,
            _saved_with=(done, opened.path, path.absolute(), options, sha256),
        )


@dataclass(frozen=True, eq=False)
class ManyFixes(Mapping[str, pd.DataFrame]):
    """Drives registered on a map, with results in a folder: a mapping from drive name to table of fixes.

    Attributes:
        folder: folder with ``NAME.fixes.csv``, ``NAME.fixes.h5``, ``archive.csv`` and the page ``archive.html``.
        table: DataFrame with a row per drive: scans by code, errors if the truth is known, computing time.
        failed: error messages by drive name; results of earlier runs are kept.
    """

    folder: Path
    table: pd.DataFrame
    failed: dict[str, str]

    def __repr__(self) -> str:
        done = self.table[self.table["state"] == "done"]
        share = "" if not len(done) else f", {100.0 * done['ok'].sum() / max(done['tried'].sum(), 1):.0f} % ok"
        lost = f", {len(self.failed)} failed" if self.failed else ""
        return f"ManyFixes: {len(done)} drives{share}{lost} ({self.folder})"

    def __getitem__(self, name: str) -> pd.DataFrame:
        if name not in set(self):
            raise KeyError(name)
        return read_fixes(self.folder / f"{name}.fixes.h5")

    def __iter__(self) -> Iterator[str]:
        return iter(self.table.loc[self.table["state"] == "done", "drive"].tolist())

    def __len__(self) -> int:
        return int((self.table["state"] == "done").sum())


def register_many(
    site: PathLike,
    drives: Iterable[PathLike],
    folder: PathLike,
    *,
    options: RegisterOptions | None = None,
    workers: int | None = None,
    threads: int | None = None,
    scheduler: str | None = None,
    force: bool = False,
) -> ManyFixes:
    """Register many drives by worker processes into one folder; existing results are kept.

    Args:
        site: a map, open or its path.
        drives: drive logs or open drives with different names.
        folder: folder for the results; created if missing.
        options: options of the search.
        workers: number of processes on this machine; default: 1.
        threads: threads per process; default: an equal share of the cores. The same number gives bit-identical fixes.
        scheduler: address of a dask scheduler, ``tcp://HOST:8786``, instead of processes on this machine.
        force: register all drives again, and replace results of another map.

    Returns:
        Tables of fixes by drive. ``failed`` lists drives that cannot be registered; the other drives are not affected.

    Raises:
        InputError: map, folder or option cannot be used, or two drives have the same name.

    Example:
        many = lx.register_many("site.map.h5", ["drives/live.drive.h5", "drives/impostor.drive.h5"], "out/", workers=2)
        print(many.table[["drive", "ok", "tried"]])
        print(many["live"].code.value_counts())
    """
    from lgprjax.batch import drive_name
    from lgprjax.batch.folder import Workforce, register_folder
    from lgprjax.report.registered_folder import write_views

    workers, threads = (
        None if count is None else whole_number(name, count)
        for name, count in (("workers", workers), ("threads", threads))
    )
    options = RegisterOptions() if options is None else options
    paths, target = paths_of(drives, "drive"), path_of(folder, "folder").absolute()
    with using_map(site) as opened:
        check_options(options, opened)
        map_path = opened.path
    crew = Workforce(1 if workers is None and scheduler is None else workers, threads, scheduler)
    with told_as_arguments(), register_folder(map_path, paths, target, options, crew, force=force) as done:
        write_views(done.run)
    whole = pd.read_csv(
        target / "archive.csv", keep_default_na=False, na_values=[""], dtype={"error": str, "drive": str}
    )
    names = [drive_name(path) for path in paths]
    table = whole[whole["drive"].isin(names)].reset_index(drop=True)
    lost = table[table["error"].notna()]
    return ManyFixes(target, table, dict(zip(lost["drive"], lost["error"], strict=True)))


def locate(site: PathLike, drive: PathLike, *, every_m: float | None = None) -> "LocatedDrive":
    """Find where a drive begins on a map, from its scans and its travel alone; its positions are not used.

    Args:
        site: a map, open or its path.
        drive: a drive log, open or its path.
        every_m: distance between starts; default: one start, at the beginning.

    Returns:
        ``table`` with a row per start: ``start_scan``, ``scan``, ``driven_m``, position, heading and sigmas at
        ``scan``, ``p_false``, ``hypotheses`` and ``code`` (``ok``, ``ambiguous``, ``not_yet``, ``off_map``).
        ``save(folder)`` writes ``NAME.located.csv``.

    Raises:
        InputError: a file cannot be used, or the recording does not suit the map.

    Example:
        found = lx.locate("site.map.h5", "drives/live.drive.h5")
        print(found.table[["scan", "latitude_deg", "longitude_deg", "p_false", "code"]])
    """
    from lgprjax.batch.locate import MapLines, check_every, locate_log

    with told_as_arguments():
        check_every(every_m)
        with using_map(site) as opened, DriveLog.open(path_of(drive, "drive")) as log:
            return locate_log(MapLines(opened.source), log, every_m)
