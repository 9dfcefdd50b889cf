"""The page of an archive: all drives together, the worst places of the map, the worst drives, what failed."""

from dataclasses import dataclass
from pathlib import Path

from lgprjax.report.html import ReportFigure, ReportTable, Section, write_report

_PLACES = ("place", "east, north (m)", "latitude, longitude", "scans", "ok", "largest error", "worst drive", "at (s)")
_DRIVES = ("drive", "scans searched", "ok", "ok but wrong", "RMS across", "RMS along", "largest error", "ms a scan")
_WORKERS = ("worker", "drives", "programs compiled", "drives that compiled later", "peak memory", "busy")


@dataclass(frozen=True, kw_only=True)
class ArchivePage:
    """Texts and tables of an archive's page; rows are texts as they are to be read.

    Attributes:
        title, intro: of the page.
        facts: quantity and value over all drives.
        places: number, place, latitude and longitude, scans, ok, largest error, drive, time.
        drives: the worst: name, scans searched, ok, wrong, RMS across and along, largest error, time a scan.
        failed: drive and why.
        workers: worker, drives, programs compiled, drives after the first that compiled, peak memory, busy.
        spread, plan: pictures of all drives and of all places.
    """

    title: str
    intro: str
    facts: tuple[tuple[str, str], ...]
    places: tuple[tuple[str, ...], ...]
    drives: tuple[tuple[str, ...], ...]
    failed: tuple[tuple[str, str], ...]
    workers: tuple[tuple[str, ...], ...]
    spread: ReportFigure | None
    plan: ReportFigure | None


def write_archive_page(path: str | Path, page: ArchivePage, *, force: bool = False) -> None:
    """Write it as one page that needs nothing from outside.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    places = ReportTable(
        _PLACES, page.places, "The drive is the one that fared worst there, at that time_s of its fixes."
    )
    drives = ReportTable(_DRIVES, page.drives, "Wrong: more than 0.3 m off. All drives are in archive.csv.")
    workers = ReportTable(_WORKERS, page.workers, "Of the processes that made the results kept here.")
    failed = ReportTable(("drive", "why"), page.failed)
    none = "No place where a scan went without a right fix."
    sections = [
        Section("All drives", "", (ReportTable(("quantity", "value"), page.facts),), _figures(page.spread)),
        Section("Worst places", "" if page.places else none, (places,) if page.places else (), _figures(page.plan)),
        Section("Worst drives", "", (drives,)),
    ]
    if page.failed:
        sections.insert(0, Section("Drives that failed", "A later run tries them again.", (failed,)))
    sections.append(Section("Workers", "", (workers,)))
    write_report(path, page.title, page.intro, sections, force)


def _figures(figure: ReportFigure | None) -> tuple[ReportFigure, ...]:
    return () if figure is None else (figure,)
