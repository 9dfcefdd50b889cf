"""The report that goes with a worked field: what may be said of the ground, what may not, and who signs for it."""

from dataclasses import dataclass
from pathlib import Path

from lgprjax.report.html import ReportFigure, ReportTable, Section, write_report

_LINE = "_" * 24
_LIMITS = """This is the record of a machine, not a clearance certificate. It says where the tool was, told on,
turning and at its depth. It does not say that the ground holds no hazard: that takes a search after the machine and the
decision of the authority in charge.

Probabilities follow from the position's uncertainty as the filter on board had it. They hold if its receiver, its
reference station and the measures in the vehicle file were right: an error that all positions share, such as a
reference station that was set up wrongly, is not in them. A cell has the probability of its best pass; passes are
never multiplied, since their errors are related.

Depth is that of the tool against the ground as the machine measured it. Ground with stones, roots, slopes or soil that
the tool was not proven on is to be judged by whoever knows the ground."""


@dataclass(frozen=True, kw_only=True)
class CoveragePage:
    """The texts and tables of a report; rows are texts as they are to be read.

    Attributes:
        name, organisation, period: of the field and the work.
        sentences: one a level, what may be said.
        facts: quantity and value.
        layers: level, processed, uncertain, not processed, share.
        passes: the passes with their figures; passes_header names the columns.
        stops: run, begin, duration, reasons.
        turning_points: point, latitude, longitude.
        hashes: file and SHA-256.
        figures: map first.
    """

    name: str
    organisation: str
    period: str
    sentences: tuple[str, ...]
    facts: tuple[tuple[str, str], ...]
    layers: tuple[tuple[str, ...], ...]
    passes_header: tuple[str, ...]
    passes: tuple[tuple[str, ...], ...]
    stops: tuple[tuple[str, ...], ...]
    turning_points: tuple[tuple[str, ...], ...]
    hashes: tuple[tuple[str, str], ...]
    figures: tuple[ReportFigure, ...]


def write_coverage_page(path: str | Path, page: CoveragePage, *, force: bool = False) -> None:
    """Write the report as one page that needs nothing from outside.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    layers = ReportTable(
        ("confidence", "processed", "uncertain", "not processed", "processed, of the field"),
        page.layers,
        "Areas of the cells whose centre lies inside the perimeter.",
    )
    facts = ReportTable(("quantity", "value"), page.facts)
    stops = ReportTable(("run", "begin (UTC)", "lasted", "why"), page.stops)
    passes = ReportTable(page.passes_header, page.passes, "Depth and speed as measured while cells counted.")
    points = ReportTable(("point", "latitude deg", "longitude deg"), page.turning_points, "WGS 84.")
    hashes = ReportTable(("file", "SHA-256"), page.hashes, "Whoever has the files can compute these again.")
    signatures = ReportTable(
        ("for", "name", "date", "signature"),
        tuple((role, _LINE, _LINE, _LINE) for role in ("operator", "team leader", "quality control")),
        "By signing, the record is accepted as that of the machine's work, no more.",
    )
    sections = (
        Section("What was processed", "\n\n".join(page.sentences), (layers,), page.figures[:1]),
        Section("What this record does not say", _LIMITS),
        Section("The work", "", (facts,), page.figures[1:]),
        Section("Stops", "" if page.stops else "None.", (stops,) if page.stops else ()),
        Section("Perimeter", "", (points,)),
        Section("Passes", "" if page.passes else "None.", (passes,) if page.passes else ()),
        Section("Files behind it", "", (hashes,)),
        Section("Signatures", "", (signatures,)),
    )
    intro = (
        f"Worked by {page.organisation}, {page.period}.\n\nStatus: processed by machine; not searched, not released."
    )
    write_report(path, f"{page.name}: record of machine processing", intro, sections, force)
