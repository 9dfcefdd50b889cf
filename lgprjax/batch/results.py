"""The results of an archive as one table and its sums, always derived from the records of its jobs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from lgprjax.batch.jobs import CELL_M, CellTally, JobRecord, read_records
from lgprjax.formats import atomic_output
from lgprjax.registration import WRONG_M, Code

_FEW_SCANS = 10  # of a cell: fewer say more about chance than about the ground


class ArchiveSums(NamedTuple):
    """Figures of an archive; ``None`` if unknown.

    Attributes:
        drives, failed: number of registered and of failed drives.
        scans, tried, counts: number of scans of all drives, of searched scans, and of scans by code.
        way_m: distance driven.
        judged, wrong: number of ok fixes with a known truth, and of those more than 0.3 m off.
        rms_along_m, rms_cross_m, largest_m: errors of the judged fixes, in the map's frame.
        milliseconds_per_scan: median over the drives.
    """

    drives: int
    failed: int
    scans: int
    tried: int
    counts: dict[str, int]
    way_m: float
    judged: int
    wrong: int | None
    rms_along_m: float | None
    rms_cross_m: float | None
    largest_m: float | None
    milliseconds_per_scan: float | None


class WorkerShare(NamedTuple):
    """Work of one process: drives, programs compiled in all, drives after its first that compiled any."""

    worker: str
    drives: int
    compiled: int
    late: int
    peak_rss_mb: float
    seconds: float


class BadPlace(NamedTuple):
    """A cell of the map's plane, and the drive with the worst result there.

    Attributes:
        cell: sums over all drives, with times of the drive.
        drive: name of the drive.
        time_s: time in that drive of the largest error if it was wrong, else of its first scan without a fix.
        east_m, north_m: middle of the cell.
    """

    cell: CellTally
    drive: str
    time_s: float
    east_m: float
    north_m: float


def records_of(folder: Path, map_sha256: str) -> list[JobRecord]:
    """Records of an archive's jobs on this map, by name; those of other maps are left out."""
    return [record for record in read_records(folder).values() if record.map_sha256 == map_sha256]


def write_table(folder: Path, records: Sequence[JobRecord]) -> Path:
    """Write ``archive.csv``, one row a job, in place of an older one. Raises ``InputError`` where it cannot."""
    path = folder / "archive.csv"
    with atomic_output(path, force=True) as temporary:
        table_of(records).to_csv(temporary, index=False, float_format="%.6g")
    return path


def table_of(records: Sequence[JobRecord]) -> pd.DataFrame:
    """One row a job; fields that a failed job lacks stay empty."""
    codes = [code.label for code in Code]
    columns = [
        *("drive", "state", "scans", "tried", "ok_share", *codes, "way_m", "judged", "wrong", "rms_along_m"),
        *("rms_cross_m", "largest_m", "correlation_ok", "correlation_at_truth", "milliseconds_per_scan", "seconds"),
        *("compiled", "peak_rss_mb", "worker", "attempts", "drive_sha256", "key", "error"),
    ]
    rows = []
    for record in records:
        row: dict[str, object] = {"drive": record.name, **record.model_dump(include=set(columns))}
        if record.figures is not None and record.cost is not None:
            row |= record.figures.model_dump(exclude={"counts"}) | record.cost.model_dump(exclude={"search_s"})
            row |= {code: record.figures.counts.get(code, 0) for code in codes}
            row["ok_share"] = record.figures.ok_share
        rows.append(row | {"drive": record.name})
    return pd.DataFrame(rows, columns=columns)


def sums_of(records: Sequence[JobRecord]) -> ArchiveSums:
    """Sums over an archive; errors are weighted by the fixes judged."""
    figures = [record.figures for record in records if record.figures is not None]
    judged = np.array([each.judged for each in figures], np.int64)
    known = [each.wrong for each in figures if each.wrong is not None]
    largest = [each.largest_m for each in figures if each.largest_m is not None]

    def rms(values: list[float | None]) -> float | None:
        squares = np.array([0.0 if value is None else value**2 for value in values])
        return float(np.sqrt(np.sum(judged * squares) / judged.sum())) if judged.sum() else None

    labels = [code.label for code in Code]
    return ArchiveSums(
        drives=len(figures),
        failed=sum(record.state == "failed" for record in records),
        scans=sum(each.scans for each in figures),
        tried=sum(each.tried for each in figures),
        counts={label: sum(each.counts.get(label, 0) for each in figures) for label in labels},
        way_m=sum(each.way_m for each in figures),
        judged=int(judged.sum()),
        wrong=sum(known) if known else None,
        rms_along_m=rms([each.rms_along_m for each in figures]),
        rms_cross_m=rms([each.rms_cross_m for each in figures]),
        largest_m=max(largest, default=None),
        milliseconds_per_scan=float(np.median([each.milliseconds_per_scan for each in figures])) if figures else None,
    )


def shares_of(records: Sequence[JobRecord]) -> list[WorkerShare]:
    """Work of each process, the busiest first, from the records of the jobs."""
    found: dict[str, list[JobRecord]] = {}
    for record in records:
        if record.cost is not None:
            found.setdefault(record.cost.worker, []).append(record)
    shares = []
    for worker, own in found.items():
        costs = [record.cost for record in own if record.cost is not None]
        compiled = sorted((cost.compiled for cost in costs), reverse=True)
        shares.append(
            WorkerShare(
                worker=worker,
                drives=len(costs),
                compiled=sum(compiled),
                late=sum(count > 0 for count in compiled[1:]),
                peak_rss_mb=max(cost.peak_rss_mb for cost in costs),
                seconds=sum(cost.seconds for cost in costs),
            )
        )
    return sorted(shares, key=lambda share: -share.drives)


def cell_sums(records: Sequence[JobRecord]) -> dict[tuple[int, int], list[tuple[str, CellTally]]]:
    """Results of every drive in each cell, by the cell's index east and north."""
    found: dict[tuple[int, int], list[tuple[str, CellTally]]] = {}
    for record in records:
        for cell in record.cells:
            found.setdefault((cell.east, cell.north), []).append((record.name, cell))
    return found


def summed(cells: Sequence[CellTally]) -> CellTally:
    """One cell over several drives; times are those of the first."""
    first = cells[0]
    return first._replace(
        tried=sum(cell.tried for cell in cells),
        ok=sum(cell.ok for cell in cells),
        judged=sum(cell.judged for cell in cells),
        square_m2=sum(cell.square_m2 for cell in cells),
        largest_m=max(cell.largest_m for cell in cells),
    )


def worst_places(cells: Mapping[tuple[int, int], Sequence[tuple[str, CellTally]]], count: int = 10) -> list[BadPlace]:
    """The worst cells: first those with wrong ok fixes by their largest error, then those with the fewest fixes.

    Cells in which every scan has a correct fix are not listed, and cells of few scans only if a fix is wrong.
    """
    places = []
    for (east, north), found in cells.items():
        drive, worst = max(found, key=lambda each: (_wrong_m(each[1]), each[1].tried - each[1].ok))
        whole = summed([worst, *(cell for name, cell in found if name != drive)])
        wrong = _wrong_m(whole) > 0.0
        if not wrong and (whole.ok == whole.tried or whole.tried < _FEW_SCANS):
            continue
        time_s = worst.largest_s if wrong else worst.declined_s
        assert time_s is not None
        places.append(BadPlace(whole, drive, time_s, CELL_M * (east + 0.5), CELL_M * (north + 0.5)))
    places.sort(key=lambda place: (-_wrong_m(place.cell), place.cell.ok / place.cell.tried, -place.cell.tried))
    return places[:count]


def _wrong_m(cell: CellTally) -> float:
    """Largest error of a cell if that makes a fix wrong, else 0."""
    return cell.largest_m if cell.largest_m > WRONG_M else 0.0
