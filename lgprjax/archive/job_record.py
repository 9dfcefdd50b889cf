"""What is kept of a job: one small JSON file a drive, from which every table of an archive is made."""

from pathlib import Path
from typing import Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, ValidationError

from lgprjax.formats import atomic_output

CELL_M = 5.0
"""Side of the square cells of the map's plane in which a drive's scans are counted."""


class CellTally(NamedTuple):
    """What one drive found in one cell.

    Attributes:
        east, north: number of the cell, its south-west corner in cells from the map's anchor.
        tried, ok, judged: scans searched, of these with an ok fix, of these with a known truth.
        square_m2: sum of their squared errors.
        largest_m: of the errors; 0 where nothing was judged.
        largest_s: time of that scan in the drive.
        declined_s: time of the first scan without an ok fix; None where all have one.
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
    """A registered drive in numbers; ``None`` stands for what cannot be told.

    Attributes:
        scans, tried: of the drive; those that were searched.
        counts: scans by code.
        way_m: driven.
        correlation_ok, correlation_at_truth: medians, of the ok fixes and of all scans at their true pose.
        judged, wrong: ok fixes whose truth is known, and those of them more than 0.3 m off.
        rms_along_m, rms_cross_m, largest_m: errors of the judged, in the map's frame.
        milliseconds_per_scan: wall time of the search.
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
        """Scans with a position."""
        return self.counts.get("ok", 0)

    @property
    def ok_share(self) -> float:
        """Availability: of the scans searched, those with a position; 0 where none was."""
        return self.ok / self.tried if self.tried else 0.0


class JobCost(_Kept):
    """What a job took.

    Attributes:
        seconds: from opening the log to its outputs.
        search_s: of these, registration itself, reading and preparing tiles included.
        compiled: programs that the worker compiled, or fetched from a cache of compiled programs, since the job before.
        peak_rss_mb: largest memory of the worker's process up to then.
        worker: host and process.
    """

    seconds: float
    search_s: float
    compiled: int
    peak_rss_mb: float
    worker: str


class JobRecord(_Kept):
    """A job that is over.

    Attributes:
        name: of the drive.
        state: done, or failed for good.
        key: of the job.
        drive, drive_sha256, map, map_sha256: what it was made from.
        settings: of the search.
        version: of the program.
        attempts: workers that tried.
        error: why it failed, one line.
        outputs: SHA-256 of each, by file name.
        figures, cells, cost: of a job that is done.
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
    """Where the records of an archive are."""
    return folder / "jobs"


def write_record(folder: Path, record: JobRecord) -> None:
    """Keep a record, in place of an older one. Raises ``InputError`` where it cannot be written."""
    with atomic_output(jobs_folder(folder) / f"{record.name}.json", force=True) as temporary:
        temporary.write_text(record.model_dump_json() + "\n", encoding="utf-8")


def read_record(path: Path) -> JobRecord | None:
    """A record; None where there is none, or none of this format: its job is to be done again."""
    try:
        return JobRecord.model_validate_json(path.read_bytes())
    except (FileNotFoundError, ValidationError):
        return None


def read_records(folder: Path) -> dict[str, JobRecord]:
    """All records of an archive by the drives' names, in the order of these."""
    found = [read_record(path) for path in sorted(jobs_folder(folder).glob("*.json"))]
    return {record.name: record for record in found if record is not None}
