"""Table ``archive.csv`` and page ``archive.html`` of a folder of registered drives."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from jaxtyping import Float

from lgprjax.batch import (
    CELL_M,
    ArchiveRun,
    ArchiveSums,
    BadPlace,
    CellTally,
    JobRecord,
    WorkerShare,
    cell_sums,
    records_of,
    shares_of,
    summed,
    sums_of,
    worst_places,
    write_table,
)
from lgprjax.formats import MapFile
from lgprjax.frames import LocalFrame
from lgprjax.report.archive import (
    ArchiveDrives,
    ArchivePage,
    ArchivePlaces,
    draw_archive_drives,
    draw_archive_places,
    write_archive_page,
)
from lgprjax.report.html import ReportFigure
from lgprjax.report.registered import search_in_words

_FEW = 10

Cells = Mapping[tuple[int, int], Sequence[tuple[str, CellTally]]]


def write_views(run: ArchiveRun) -> ArchiveSums:
    """Write table and page of all results in a folder on the run's map; returns their sums."""
    records = records_of(run.folder, run.map_sha256)
    write_table(run.folder, records)
    sums, cells = sums_of(records), cell_sums(records)
    worst = worst_places(cells, _FEW)
    with MapFile.open(run.map_path) as source, TemporaryDirectory() as pictures:
        name, frame = source.description.name, source.description.frame
        spread, plan = _draw(Path(pictures), _drives(records, sums, name), _places(cells, worst, source))
        page = ArchivePage(
            title=f"Drives on {name}",
            intro=_intro(records),
            facts=tuple(facts_of(sums)),
            places=tuple(_place_row(number, place, frame) for number, place in enumerate(worst, start=1)),
            drives=tuple(_drive_row(record) for record in _worst_drives(records)),
            failed=tuple(_failed_row(record) for record in records if record.error),
            workers=tuple(_worker_row(share) for share in shares_of(records)[:_FEW]),
            spread=spread,
            plan=plan,
        )
        write_archive_page(run.folder / "archive.html", page, force=True)
    return sums


def facts_of(sums: ArchiveSums) -> list[tuple[str, str]]:
    """Quantity and value of an archive's sums; of errors only where a truth is known."""
    declined = ", ".join(f"{n} {c}" for c, n in sums.counts.items() if n and c not in ("ok", "no_window"))
    errors = [
        ("ok but wrong (more than 0.3 m off)", f"{sums.wrong} of {sums.judged} judged"),
        ("RMS error across, along", f"{_number(sums.rms_cross_m, 3, ' m')}, {_number(sums.rms_along_m, 3, ' m')}"),
        ("largest error of an ok fix", _number(sums.largest_m, 3, " m")),
    ]
    return [
        ("drives registered, failed", f"{sums.drives}, {sums.failed}"),
        ("way driven", f"{1e-3 * sums.way_m:.2f} km"),
        ("scans, of these searched", f"{sums.scans}, {sums.tried}"),
        ("ok", f"{sums.counts['ok']} ({_percent(sums.counts['ok'], sums.tried)} of the searched)"),
        ("declined", declined or "none"),
        *(errors if sums.judged else ()),
        ("time per scan, median drive", _number(sums.milliseconds_per_scan, 2, " ms")),
    ]


def _intro(records: Sequence[JobRecord]) -> str:
    told = {search_in_words(record.settings) for record in records if record.state == "done"}
    if not told:
        return "No drive could be registered."
    how = told.pop() if len(told) == 1 else f"Registered with {len(told)} different searches: see archive.csv."
    return f"NAME.fixes.csv has one line per fix; archive.csv has one line per drive.\n\n{how}"


def _draw(
    folder: Path, drives: ArchiveDrives, places: ArchivePlaces
) -> tuple[ReportFigure | None, ReportFigure | None]:

    if not len(drives.ok_share) or not len(places.cell):
        return None, None
    draw_archive_drives(drives, folder / "spread.png")
    draw_archive_places(places, folder / "plan.png")
    alt = "histograms of availability, error and time, bars of the codes"
    spread = ReportFigure(folder / "spread.png", "Results of the drives.", alt)
    alt = "plan of the map in coloured cells, the worst places numbered"
    return spread, ReportFigure(folder / "plan.png", "Located share of scans by position.", alt)


def _drives(records: Sequence[JobRecord], sums: ArchiveSums, name: str) -> ArchiveDrives:
    figures = [record.figures for record in records if record.figures is not None]

    def each(values: list[float | None]) -> Float[np.ndarray, " drive"]:
        return np.array([np.nan if value is None else value for value in values], dtype=np.float64)

    return ArchiveDrives(
        name=name,
        ok_share=each([figure.ok_share for figure in figures]),
        rms_cross_m=each([figure.rms_cross_m for figure in figures]),
        rms_along_m=each([figure.rms_along_m for figure in figures]),
        milliseconds_per_scan=each([figure.milliseconds_per_scan for figure in figures]),
        counts=sums.counts,
    )


def _places(cells: Cells, worst: Sequence[BadPlace], source: MapFile) -> ArchivePlaces:
    sums = [summed([cell for _, cell in found]) for found in cells.values()]
    return ArchivePlaces(
        name=source.description.name,
        cell_m=CELL_M,
        cell=np.array([(cell.east, cell.north) for cell in sums], dtype=np.int64).reshape(-1, 2),
        tried=np.array([cell.tried for cell in sums], dtype=np.int64),
        ok=np.array([cell.ok for cell in sums], dtype=np.int64),
        judged=np.array([cell.judged for cell in sums], dtype=np.int64),
        square_m2=np.array([cell.square_m2 for cell in sums], dtype=np.float64),
        worst_m=np.array([(place.east_m, place.north_m) for place in worst], dtype=np.float64).reshape(-1, 2),
        chords_m=source.places.stretches.chord_m,
    )


def _worst_drives(records: Sequence[JobRecord]) -> list[JobRecord]:
    """Worst drives: those with wrong ok fixes first, then those with the fewest fixes."""

    def how_bad(record: JobRecord) -> tuple[int, float]:
        assert record.figures is not None
        return -(record.figures.wrong or 0), record.figures.ok_share

    return sorted((record for record in records if record.figures is not None), key=how_bad)[:_FEW]


def _place_row(number: int, place: BadPlace, frame: LocalFrame) -> tuple[str, ...]:
    cell = place.cell
    latitude, longitude, _ = frame.to_geodetic(np.array([place.east_m]), np.array([place.north_m]), np.zeros(1))
    return (
        str(number),
        f"{place.east_m:.1f}, {place.north_m:.1f}",
        f"{latitude[0]:.6f}°, {longitude[0]:.6f}°",
        str(cell.tried),
        _percent(cell.ok, cell.tried),
        f"{cell.largest_m:.3f} m" if cell.judged else "–",
        place.drive,
        f"{place.time_s:.2f}",
    )


def _drive_row(record: JobRecord) -> tuple[str, ...]:
    figures = record.figures
    assert figures is not None
    return (
        record.name,
        str(figures.tried),
        _percent(figures.ok, figures.tried),
        str(figures.wrong) if figures.judged else "–",
        *(_number(value, 3, " m") for value in (figures.rms_cross_m, figures.rms_along_m, figures.largest_m)),
        f"{figures.milliseconds_per_scan:.2f}",
    )


def _failed_row(record: JobRecord) -> tuple[str, str]:
    kept = "; the result of an earlier run is kept" if record.state == "done" else ""
    return record.name, f"{record.error}{kept}"


def _worker_row(share: WorkerShare) -> tuple[str, ...]:
    own = (str(number) for number in (share.drives, share.compiled, share.late))
    return (share.worker, *own, f"{share.peak_rss_mb:.0f} MB", f"{share.seconds:.1f} s")


def _percent(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.1f} %" if whole else "–"


def _number(value: float | None, decimals: int, unit: str) -> str:
    return "–" if value is None else f"{value:.{decimals}f}{unit}"
