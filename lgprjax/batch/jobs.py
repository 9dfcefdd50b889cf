"""Registration jobs: their inputs, the record of each, the folder of results, and the work of one process."""

import hashlib
import json
import os
import socket
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from pydantic import BaseModel, ConfigDict, ValidationError

from lgprjax import __version__
from lgprjax.batch.register import HeldGround, RegisteredDrive, register_log, true_errors, write_registered
from lgprjax.errors import InputError
from lgprjax.files import file_hash, lock_file, make_folder
from lgprjax.formats import DriveLog, MapFile, atomic_output
from lgprjax.machine import count_compiles, peak_rss_mb
from lgprjax.registration import WRONG_M, Code, RegisterOptions


class FileStamp(NamedTuple):
    """Signature of a file: size, and time of the last change in nanoseconds."""

    size: int
    changed_ns: int


class ArchiveRun(NamedTuple):
    """Settings common to all jobs of a run.

    Attributes:
        map_path: absolute path of the map.
        map_sha256: SHA-256 of the map's file.
        map_stamp: stamp of the map's file at the time of hashing.
        options: options of the search.
        folder: absolute path of the results.
        threads: thread limit of each worker.
    """

    map_path: Path
    map_sha256: str
    map_stamp: FileStamp
    options: RegisterOptions
    folder: Path
    threads: int


class Job(NamedTuple):
    """One drive to register.

    Attributes:
        name: name of the drive and of its outputs.
        drive: absolute path of its log.
        drive_sha256: SHA-256 of the log.
        key: key of the job, see ``key_of_job``.
        scans: number of scans; 0 if the log cannot be read, which the job will report.
    """

    name: str
    drive: Path
    drive_sha256: str
    key: str
    scans: int = 0


def stamp_of(path: Path) -> FileStamp:
    """Present stamp of a file."""
    found = path.stat()
    return FileStamp(found.st_size, found.st_mtime_ns)


def settings_of(options: RegisterOptions) -> dict[str, object]:
    """The search as plain numbers, ready for JSON."""
    settings: dict[str, object] = asdict(options)
    own = options.own_thresholds
    settings["own_thresholds"] = None if own is None else {name: float(value) for name, value in own._asdict().items()}
    return settings


def key_of_job(drive_sha256: str, map_sha256: str, settings: dict[str, object]) -> str:
    """SHA-256 of the inputs of a job's result, independent of the order of the settings."""
    inputs = {"drive": drive_sha256, "map": map_sha256, "settings": settings, "version": __version__}
    return hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()


# The record of a job: one small JSON file a drive, from which every table of an archive is made.

CELL_M = 5.0
"""Side of the square cells of the map's plane in which a drive's scans are counted."""


class CellTally(NamedTuple):
    """Results of one drive in one cell.

    Attributes:
        east, north: index of the cell: its south-west corner in cells from the map's anchor.
        tried, ok, judged: number of scans with a match, their own or a propagated one; of these, with an ok fix; of
            these, with a known truth.
        square_m2: sum of the squared errors.
        largest_m: largest error; 0 without judged scans.
        largest_s: time of that scan in the drive.
        declined_s: time of the first scan without an ok fix; ``None`` if all have one.
    """

    east: int
    north: int
    tried: int
    ok: int
    judged: int
    square_m2: float
    largest_m: float
    largest_s: float
    declined_s: float | None


class _Kept(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class DriveFigures(_Kept):
    """Figures of a registered drive; ``None`` if unknown.

    Attributes:
        scans, tried: number of scans, and of scans with a match, their own or a propagated one.
        counts: number of scans by code.
        way_m: distance driven.
        correlation_ok, correlation_at_truth: median correlation of the ok fixes, and of all scans at their true pose.
        judged, wrong: number of ok fixes with a known truth, and of those with an error above 0.3 m.
        rms_along_m, rms_cross_m, largest_m: errors of the judged fixes, in the map's frame.
        milliseconds_per_scan: wall time of the search per scan.
    """

    scans: int
    tried: int
    counts: dict[str, int]
    way_m: float
    correlation_ok: float | None
    correlation_at_truth: float | None
    judged: int
    wrong: int | None
    rms_along_m: float | None
    rms_cross_m: float | None
    largest_m: float | None
    milliseconds_per_scan: float

    @property
    def ok(self) -> int:
        """Number of scans with a position."""
        return self.counts.get("ok", 0)

    @property
    def ok_share(self) -> float:
        """Availability: share of the searched scans with a position; 0 without searched scans."""
        return self.ok / self.tried if self.tried else 0.0


class JobCost(_Kept):
    """Cost of a job.

    Attributes:
        seconds: time from opening the log to its outputs.
        search_s: part of this time for registration itself, including reading and preparing tiles.
        compiled: number of programs that the worker compiled, or loaded from the compilation cache, since the previous
            job.
        peak_rss_mb: peak memory of the worker's process so far.
        worker: host and process of the worker.
    """

    seconds: float
    search_s: float
    compiled: int
    peak_rss_mb: float
    worker: str


class JobRecord(_Kept):
    """A finished job.

    Attributes:
        name: name of the drive.
        state: done, or failed permanently.
        key: key of the job.
        drive, drive_sha256, map, map_sha256: inputs of the job.
        settings: settings of the search.
        version: version of the program.
        attempts: number of workers that tried.
        error: error message of a failed job, one line; for a done job, the error of a later failed run.
        outputs: SHA-256 of each output, by file name.
        figures, cells, cost: results of a done job.
    """

    name: str
    state: Literal["done", "failed"]
    key: str
    drive: str
    drive_sha256: str
    map: str
    map_sha256: str
    settings: dict[str, object]
    version: str
    attempts: int = 1
    error: str = ""
    outputs: dict[str, str] = {}
    figures: DriveFigures | None = None
    cells: tuple[CellTally, ...] = ()
    cost: JobCost | None = None


def jobs_folder(folder: Path) -> Path:
    """Folder of the records of an archive."""
    return folder / "jobs"


def write_record(folder: Path, record: JobRecord) -> None:
    """Keep a record, in place of an older one. Raises ``InputError`` where it cannot be written."""
    with atomic_output(jobs_folder(folder) / f"{record.name}.json", force=True) as temporary:
        temporary.write_text(record.model_dump_json() + "\n", encoding="utf-8")


def read_record(path: Path) -> JobRecord | None:
    """A record; ``None`` without one of this format, so that its job is done again."""
    try:
        return JobRecord.model_validate_json(path.read_bytes())
    except (FileNotFoundError, ValidationError):
        return None


def read_records(folder: Path) -> dict[str, JobRecord]:
    """All records of an archive by drive name, sorted by name."""
    found = [read_record(path) for path in sorted(jobs_folder(folder).glob("*.json"))]
    return {record.name: record for record in found if record is not None}


# The folder of an archive: its map and drives, the jobs already done, and a lock for one run at a time.

_MARK = "archive.json"
_DERIVED = ("archive.csv", "archive.html")
_READERS = 4


class JobPlan(NamedTuple):
    """The work of a run.

    Attributes:
        todo: jobs that are missing, or whose drive, settings, program or outputs changed.
        done: names of the drives whose results are up to date.
        unreadable: drives that could not be opened.
    """

    todo: list[Job]
    done: list[str]
    unreadable: list[InputError]


class _Mark(NamedTuple):
    """Owner of a folder: the map, and the drives whose outputs belong to the archive."""

    map: str
    map_sha256: str
    drives: list[str]


def outputs_of(name: str) -> tuple[str, str]:
    """File names of a drive's outputs."""
    return f"{name}.fixes.csv", f"{name}.fixes.h5"


def drive_name(path: Path) -> str:
    """Name of a drive by its file."""
    return path.name.removesuffix(".drive.h5")


@contextmanager
def claimed(run: ArchiveRun, names: Sequence[str], *, force: bool) -> Iterator[None]:
    """Lock a folder for a run and remove partial files of killed workers.

    The folder records its map and the drives whose outputs belong to the archive and may be replaced.

    Args:
        run: settings of the run.
        names: names of its drives.
        force: whether to replace results of another map, and outputs of other origin.

    Raises:
        InputError: the folder holds results of another map or files of other origin (without ``force``), it is not a
            folder, or another run has locked it.
    """
    folder = run.folder
    _ours(run, names, force)
    make_folder(jobs_folder(folder))
    with lock_file(jobs_folder(folder) / ".lock") as holder:
        if holder is not None:
            raise InputError(folder, "output", "a folder not in use by another run", f"in use by {holder}")
        mark = _Mark(run.map_path.name, run.map_sha256, sorted(_ours(run, names, force).union(names)))
        with atomic_output(folder / _MARK, force=True) as temporary:
            temporary.write_text(json.dumps(mark._asdict(), indent=0) + "\n", encoding="utf-8")
        _clean(folder, mark.drives)
        try:
            yield
        finally:
            _clean(folder, mark.drives)


def plan_jobs(
    run: ArchiveRun, drives: Sequence[Path], *, force: bool, progress: Callable[[int], None] = lambda _: None
) -> JobPlan:
    """Hash every drive and find the jobs to do; in a claimed folder.

    Args:
        run: the run.
        drives: logs of different names.
        force: whether to do all of them again.
        progress: called with the number of drives checked.
    """
    settings = settings_of(run.options)

    def look(drive: Path) -> Job | InputError:
        try:
            sha256 = file_hash(drive)
        except OSError as error:
            return InputError(drive, "file", "a readable file", error.strerror or str(error))
        return Job(drive_name(drive), drive.absolute(), sha256, key_of_job(sha256, run.map_sha256, settings))

    plan = JobPlan([], [], [])
    with ThreadPoolExecutor(max_workers=_READERS) as readers:
        for found in readers.map(look, drives):
            if isinstance(found, InputError):
                plan.unreadable.append(found)
                drive = Path(found.file)
                note_failure(run, Job(drive_name(drive), drive.absolute(), "", ""), found, attempts=1)
            elif force or not _is_done(run.folder, found):
                plan.todo.append(found._replace(scans=_scans_of(found.drive)))
            else:
                plan.done.append(found.name)
                _forget_failure(run.folder, found.name)
            progress(1)
    return plan


def _scans_of(drive: Path) -> int:
    try:
        with DriveLog.open(drive) as log:
            return log.scans
    except InputError:
        return 0


def note_failure(run: ArchiveRun, job: Job, error: InputError, attempts: int) -> None:
    """Write the record of a permanently failed job; a later run tries it again.

    A result of the drive from an earlier run is kept, with the failure added to its record.
    """
    earlier = read_record(jobs_folder(run.folder) / f"{job.name}.json")
    if (
        earlier is not None
        and earlier.state == "done"
        and earlier.map_sha256 == run.map_sha256
        and _outputs_unchanged(run.folder, earlier)
    ):
        write_record(run.folder, earlier.model_copy(update={"error": str(error)}))
        return
    write_record(
        run.folder,
        JobRecord(
            name=job.name,
            state="failed",
            key=job.key,
            drive=job.drive.name,
            drive_sha256=job.drive_sha256,
            map=run.map_path.name,
            map_sha256=run.map_sha256,
            settings=settings_of(run.options),
            version=__version__,
            attempts=attempts,
            error=str(error),
        ),
    )


def _ours(run: ArchiveRun, names: Sequence[str], force: bool) -> set[str]:
    """Drives whose outputs in the folder belong to the archive. Raises ``InputError`` for others."""
    folder = run.folder
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, "output", "a folder", "a file")
    mark = _read_mark(folder / _MARK)
    ours = set() if mark is None else set(mark.drives)
    if force:
        return ours
    if mark is not None and mark.map_sha256 != run.map_sha256:
        expected = f"results of the current {run.map_path.name}, another folder, or --force"
        raise InputError(folder, "output", expected, f"results of another map, {mark.map}")
    foreign = [output for name in names if name not in ours for output in outputs_of(name)]
    for output in [*foreign, *(_DERIVED if mark is None else ())]:
        if (folder / output).exists():
            raise InputError(folder / output, "output", "a new file, or --force", "an existing file")
    return ours


def _is_done(folder: Path, job: Job) -> bool:
    """Whether a record is of this very job and its outputs are unchanged."""
    record = read_record(jobs_folder(folder) / f"{job.name}.json")
    if record is None or record.state != "done" or record.key != job.key:
        return False
    return _outputs_unchanged(folder, record)


def _outputs_unchanged(folder: Path, record: JobRecord) -> bool:
    try:
        return all(file_hash(folder / name) == sha256 for name, sha256 in record.outputs.items())
    except OSError:
        return False


def _forget_failure(folder: Path, name: str) -> None:
    """Remove the failure from a result's record, because its drive matches the result again."""
    record = read_record(jobs_folder(folder) / f"{name}.json")
    if record is not None and record.error:
        write_record(folder, record.model_copy(update={"error": ""}))


def _read_mark(path: Path) -> _Mark | None:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        return _Mark(str(found["map"]), str(found["map_sha256"]), [str(name) for name in found["drives"]])
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(path, "file", "a valid archive marker file", str(error)) from None


def _clean(folder: Path, names: Sequence[str]) -> None:
    """Remove temporary files of killed workers."""
    own = {f".{output}" for name in names for output in (*outputs_of(name), f"{name}.json")}
    for place in (folder, jobs_folder(folder)):
        for left in place.glob(".*.partial-*"):
            if left.name.rpartition(".partial-")[0] in own:
                left.unlink(missing_ok=True)


# Figures of a registered drive, as a whole and by cell of the map's plane.


def figures_of(drive: RegisteredDrive) -> DriveFigures:
    """Counts, accuracy where the truth is known, time per scan."""
    code, correlation = np.asarray(drive.fix.code), np.asarray(drive.fix.correlation)
    errors = true_errors(drive)
    along, cross = errors[np.isfinite(errors[:, 0])].T
    apart = np.hypot(along, cross)
    return DriveFigures(
        scans=len(code),
        tried=int(np.sum(code != Code.NO_WINDOW)),
        counts={each.label: int(np.sum(code == each)) for each in Code if np.any(code == each)},
        way_m=float(np.abs(np.diff(drive.track.travel_m)).sum()),
        correlation_ok=_median(correlation[code == Code.OK]),
        correlation_at_truth=_median(drive.correlation_at_truth),
        judged=len(apart),
        wrong=int(np.sum(apart > WRONG_M)) if len(apart) else None,
        rms_along_m=_rms(along),
        rms_cross_m=_rms(cross),
        largest_m=float(apart.max()) if len(apart) else None,
        milliseconds_per_scan=drive.milliseconds_per_scan,
    )


def cells_of(drive: RegisteredDrive) -> tuple[CellTally, ...]:
    """Results by cell of the drive's searched scans.

    The place of a scan is its truth, else its ok fix, else its prior.
    """
    code = np.asarray(drive.fix.code)
    tried = np.flatnonzero(code != Code.NO_WINDOW)
    place = _places(drive)[tried]
    ok, error_m = code[tried] == Code.OK, np.hypot(*true_errors(drive)[tried].T)
    time_s = drive.table["time_s"].to_numpy()[tried]
    cell, member = np.unique(np.floor(place / CELL_M).astype(np.int64), axis=0, return_inverse=True)
    tallies = []
    for number, (east, north) in enumerate(cell):
        own = np.flatnonzero(member.reshape(-1) == number)
        judged = own[np.isfinite(error_m[own])]
        worst = judged[np.argmax(error_m[judged])] if len(judged) else None
        declined = own[~ok[own]]
        tallies.append(
            CellTally(
                east=int(east),
                north=int(north),
                tried=len(own),
                ok=int(ok[own].sum()),
                judged=len(judged),
                square_m2=float(np.sum(error_m[judged] ** 2)),
                largest_m=0.0 if worst is None else float(error_m[worst]),
                largest_s=0.0 if worst is None else float(time_s[worst]),
                declined_s=float(time_s[declined[0]]) if len(declined) else None,
            )
        )
    return tuple(tallies)


def _places(drive: RegisteredDrive) -> Float[np.ndarray, "scan 2"]:
    found = np.where((np.asarray(drive.fix.code) == Code.OK)[:, None], np.asarray(drive.fix.pose)[:, :2], np.nan)
    place = np.where(np.isfinite(found), found, drive.track.pose[:, :2])
    return place if drive.truth is None else np.where(np.isfinite(drive.truth[:, :2]), drive.truth[:, :2], place)


def _median(values: Float[np.ndarray, " any"]) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else None


def _rms(values: Float[np.ndarray, " any"]) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if len(values) else None


# The work of one process: the map is opened once, programs are compiled once, drives follow one another.

HELD_TILES = 16
"""Tiles, and as many template banks, that a worker caches between drives."""


class DriveJobs:
    """The jobs of a worker; close it when done.

    Args:
        run: the run.

    Raises:
        InputError: the map cannot be opened, or has changed since the run began.
    """

    def __init__(self, run: ArchiveRun) -> None:
        self._run = run
        self._compiled, self._counted = count_compiles(), 0
        self._source = MapFile.open(run.map_path)
        try:
            if stamp_of(run.map_path) != run.map_stamp:
                raise InputError(run.map_path, "file", "the same file as at the start of the run", "a changed file")
            self._held = HeldGround(self._source, run.options, tiles=HELD_TILES)
        except BaseException:
            self._source.close()
            raise

    def close(self) -> None:
        """Close the map."""
        self._source.close()

    def do(self, job: Job, attempt: int = 1, progress: Callable[[int], None] = lambda _: None) -> InputError | None:
        """Register a drive; outputs and record are written, the record last.

        Args:
            job: job of the run.
            attempt: number of this attempt.
            progress: function called with the number of scans done since the last call.

        Returns:
            The error; ``None`` if done. The traceback of a defect is also written to standard error.

        Raises:
            MemoryError: there is too little memory; the next drive would fail too.
        """
        try:
            self._register(job, attempt, progress)
        except InputError as error:
            return error
        except Exception as error:
            if isinstance(error, MemoryError) or "RESOURCE_EXHAUSTED" in str(error):
                raise MemoryError(str(error)) from None
            traceback.print_exc(file=sys.stderr)
            return InputError(
                job.drive,
                "registration",
                "a registration result",
                f"an internal error: {type(error).__name__}: {error}",
            )
        return None

    def _register(self, job: Job, attempt: int, progress: Callable[[int], None]) -> None:
        began, run = time.perf_counter(), self._run
        with DriveLog.open(job.drive) as log:
            # The file read must be the one that the job's key names; an open file stays the same when it is replaced.
            if file_hash(job.drive) != job.drive_sha256:
                raise InputError(job.drive, "file", "the same file as at the start of the run", "a changed file")
            drive = register_log(self._source, log, run.options, progress, held=self._held)
            sha256 = (run.map_sha256, job.drive_sha256)
            write_registered(drive, self._source, log, run.options, run.folder, force=True, sha256=sha256)
        write_record(run.folder, self._record(job, drive, time.perf_counter() - began, attempt))

    def _record(self, job: Job, drive: RegisteredDrive, seconds: float, attempt: int) -> JobRecord:
        run, before = self._run, self._counted
        self._counted = self._compiled()
        return JobRecord(
            name=job.name,
            state="done",
            key=job.key,
            drive=job.drive.name,
            drive_sha256=job.drive_sha256,
            map=run.map_path.name,
            map_sha256=run.map_sha256,
            settings=settings_of(run.options),
            version=__version__,
            attempts=attempt,
            outputs={name: file_hash(run.folder / name) for name in outputs_of(job.name)},
            figures=figures_of(drive),
            cells=cells_of(drive),
            cost=JobCost(
                seconds=seconds,
                search_s=1e-3 * drive.milliseconds_per_scan * len(drive.table),
                compiled=self._counted - before,
                peak_rss_mb=peak_rss_mb(),
                worker=f"{socket.gethostname()}:{os.getpid()}",
            ),
        )
