"""The report: one self-contained HTML page with embedded pictures."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

from rich import markup
from rich.table import Table

from lgprjax.formats.store import atomic_output
from lgprjax.report.summary import DriveSummary, overview, overview_caption


@dataclass(frozen=True)
class ReportTable:
    """Rows of text under a header; the first cell of a row is its name."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""


@dataclass(frozen=True)
class ReportFigure:
    """A PNG on disk, its caption, and its alternative text."""

    path: Path
    caption: str
    alt: str


@dataclass(frozen=True)
class Section:
    """A heading, its text (blank lines separate paragraphs), a link to another page, then tables and figures."""

    heading: str
    text: str = ""
    tables: tuple[ReportTable, ...] = ()
    figures: tuple[ReportFigure, ...] = ()
    beside: tuple[str, str] | None = None


def write_report(path: str | Path, title: str, intro: str, sections: Sequence[Section], force: bool = False) -> None:
    """Write one self-contained page: for light and dark screens, telephones and paper.

    Args:
        path: path of the HTML file.
        title, intro: texts; blank lines separate the paragraphs of ``intro``.
        sections: sections in reading order.
        force: whether to replace an existing file.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    links = "".join(f'<li><a href="#s{i}">{escape(s.heading)}</a></li>' for i, s in enumerate(sections))
    with atomic_output(path, force) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as page:
        page.write(
            '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n<main>\n"
            f"<h1>{escape(title)}</h1>\n{_paragraphs(intro)}<nav><ol>{links}</ol></nav>\n"
        )
        for number, section in enumerate(sections):
            page.write(f'<section id="s{number}">\n<h2>{escape(section.heading)}</h2>\n{_paragraphs(section.text)}')
            if section.beside is not None:
                name, words = section.beside
                page.write(f'<p><a href="{escape(quote(name))}">{escape(words)}</a></p>\n')
            page.writelines(_table(table) for table in section.tables)
            page.writelines(_figure(figure) for figure in section.figures)
            page.write("</section>\n")
        page.write("</main>\n</body>\n</html>\n")


PAGE = "-scans.html"
"""End of the name of a drive's page of scans, in the folder of the report."""
_AT_TRUTH = (
    "Correlation at the truth: correlation of the scan at its true pose, without a search. Fixes reach it, and a "
    "little more, because they also fit the noise. A fix far below it missed the true pose. A low value means that the "
    "ground or the radar has changed since the map, or that map labels are wrong."
)


def drive_section(summary: DriveSummary, figures: Sequence[ReportFigure]) -> Section:
    """The section of one drive: result in words, figures, pictures."""
    if summary.impostor:
        text = (
            "This drive was recorded over different ground from the map. Every ok fix is wrong; "
            f"{summary.ok} of {summary.tried} tried scans have one."
        )
    elif not summary.ok:
        text = f"None of {summary.tried} tried scans has an ok fix: this drive has no position from the map."
    elif summary.wrong_ok is None:
        text = (
            f"{summary.ok} of {summary.tried} tried scans have an ok fix. The true poses are unknown, so no error is "
            "stated."
        )
    else:
        text = (
            f"{summary.ok} of {summary.tried} tried scans have an ok fix; {summary.judged} of these have a known "
            f"truth, and {summary.wrong_ok} are more than 0.3 m from it."
        )
    table = ReportTable(("quantity", "value"), tuple(summary.as_rows()), _AT_TRUTH if summary.judged else "")
    text = "\n\n".join([text, *(f"{remark[:1].upper()}{remark[1:].rstrip('.')}." for remark in summary.remarks)])
    beside = f"{summary.name}{PAGE}", "Zoomable page with the values of every scan"
    return Section(f"{summary.name} on {summary.map_name}", text, (table,), tuple(figures), beside)


def overview_table(summaries: Sequence[DriveSummary]) -> ReportTable:
    """All drives, a row each."""
    header, rows = overview(summaries)
    return ReportTable(header, tuple(rows), overview_caption(summaries))


def _paragraphs(text: str) -> str:
    return "".join(f"<p>{escape(part.strip())}</p>\n" for part in text.split("\n\n") if part.strip())


def _table(table: ReportTable) -> str:
    head = "".join(f'<th scope="col">{escape(cell)}</th>' for cell in table.header)
    body = "".join(
        f'<tr><th scope="row">{escape(first)}</th>{"".join(_column(cell) for cell in rest)}</tr>\n'
        for first, *rest in table.rows
    )
    caption = f"<caption>{escape(table.caption)}</caption>" if table.caption else ""
    return f'<div class="wide"><table>{caption}<thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table></div>\n'


def _column(cell: str) -> str:
    # A sentence keeps some width on a telephone, where the table is scrolled.
    opening = '<td class="long">' if len(cell) > _SENTENCE else "<td>"
    return f"{opening}{_cell(cell)}</td>"


def _cell(text: str) -> str:
    """A number stays next to its unit; longer texts may break."""
    return escape(text).replace(" ", "&nbsp;") if len(text) <= _UNBROKEN else escape(text)


def _figure(figure: ReportFigure) -> str:
    data = base64.b64encode(figure.path.read_bytes()).decode("ascii")
    # A click, or the space bar, shows the picture twice as wide, scrollable, without a script.
    return (
        '<figure><label class="wide"><input type="checkbox" aria-label="larger">'
        f'<img src="data:image/png;base64,{data}" alt="{escape(figure.alt)}"></label>'
        f"<figcaption>{escape(figure.caption)}</figcaption></figure>\n"
    )


_UNBROKEN = 10
_SENTENCE = 40
_STYLE = """
:root { color-scheme: light dark; --ink: #222; --soft: #595959; --ground: #fff; --line: #d0d0d0; --link: #0057a3; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e6e6; --soft: #b0b0b0; --ground: #16181b; --line: #44484d; --link: #7fbfff; }
}
body { margin: 0; background: var(--ground); color: var(--ink);
  font: 1.05rem/1.55 system-ui, -apple-system, "Segoe UI", "DejaVu Sans", sans-serif; }
main { max-width: 62rem; margin: 0 auto; padding: 1.5rem 1rem 4rem; }
p, nav { max-width: 44rem; }
h1 { font-size: 1.8rem; line-height: 1.2; }
h2 { font-size: 1.35rem; line-height: 1.3; margin-top: 2.8rem; padding-top: 0.6rem; border-top: 1px solid var(--line); }
a { color: var(--link); }
.wide { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-size: 0.92rem; font-variant-numeric: tabular-nums; }
.long { min-width: 14rem; }
th, td { padding: 0.3rem 0.8rem 0.3rem 0; border-bottom: 1px solid var(--line); text-align: left; vertical-align: top; }
th[scope="row"] { font-weight: 500; }
thead th { color: var(--soft); font-weight: 600; vertical-align: bottom; }
caption { caption-side: bottom; text-align: left; color: var(--soft); padding-top: 0.4rem; }
figure { margin: 1.5rem 0; }
label { display: block; position: relative; }
label input { position: absolute; opacity: 0; }
label input + img { cursor: zoom-in; }
label input:checked + img { width: 200%; min-width: 80rem; cursor: zoom-out; }
label input:focus-visible + img { outline: 3px solid var(--link); }
img { width: 100%; height: auto; display: block; background: #fff; border-radius: 4px; }
figcaption { color: var(--soft); font-size: 0.92rem; max-width: 48rem; padding-top: 0.4rem; }
@media (max-width: 45rem) {
  main { padding: 1rem 0.7rem 3rem; }
  h1 { font-size: 1.4rem; }
  h2 { font-size: 1.15rem; margin-top: 2rem; }
  label input:checked + img { width: auto; min-width: 56rem; }
  caption { max-width: calc(100vw - 1.4rem); }
  figcaption::after { content: " Tap the picture to enlarge it."; }
}
@media print {
  :root { --ink: #000; --soft: #333; --ground: #fff; --line: #999; --link: #000; }
  body { font-size: 10pt; }
  main { max-width: none; padding: 0; }
  img, label input:checked + img { width: 100%; min-width: 0; }
  nav { display: none; }
  figure, tr { break-inside: avoid; }
  h2 { break-after: avoid; }
}
"""


# Drives in one table for the terminal.


def summary_table(summaries: Sequence[DriveSummary]) -> Table:
    """One column per drive, to fit a terminal of 80 columns; a drive with wrong ok fixes is highlighted."""
    table = Table(title="Registration", caption=overview_caption(summaries), min_width=66)
    header, rows = overview(summaries)
    table.add_column(header[0])
    for summary, row in zip(summaries, rows, strict=True):
        # A bracket in a name is no markup.
        table.add_column(markup.escape(row[0]), justify="right", style="bold red" if summary.wrong_ok else None)
    for number, title in enumerate(header[1:], start=1):
        table.add_row(title, *(markup.escape(row[number]) for row in rows))
    return table


# Why scans were declined: the meaning of each code, and advice.


class Decline(NamedTuple):
    """A code in words."""

    meaning: str
    action: str


_PLACE_ASSUMED = (
    "The geographic position of the drive or the map is unknown: import it again with lgprjax import --latitude-deg, "
    "--longitude-deg "
    "and --heading-deg"
)
DECLINES = {
    "low_correlation": Decline(
        "no position in the search region matches better than unrelated ground",
        "recordings of a few metres: no action, they are too short. Otherwise check that the "
        "drive is over the mapped ground and its position error is smaller than --search-m. Leave "
        "--window-m and "
        "--time-scale at their defaults; lgprjax check --health examines the recording",
    ),
    "ambiguous": Decline(
        "another position in the search region matches about as well",
        "repetitive ground: allow longer windows (no --window-m), or a smaller --search-m if the position "
        "allows it; lgprjax map verify shows repetitive parts of the map",
    ),
    "edge": Decline(
        "the best match is at the edge of the search region or of the map",
        "use a larger --search-m if the log's position error exceeds its sigma; at the end of the map, "
        "record more lines there: unmapped ground resembles the outermost line",
    ),
    "off_map": Decline(
        "no mapped ground under the array in the whole search region",
        "the drive has left the map, or its position error exceeds the search region; lgprjax map info shows "
        "the area of the map",
    ),
    "low_overlap": Decline(
        "less than 0.6 of the array is over mapped ground",
        "the drive is next to the mapped track: drive closer to it, or add this track with lgprjax map update",
    ),
    "non_finite": Decline(
        "less than 0.6 of the traces have finite data",
        "lgprjax check --health lists dead channels and lost scans",
    ),
    "no_window": Decline(
        "too little travel for a window (at the start and after lost odometry)",
        "no action for a few scans; otherwise a shorter --window-m, or none",
    ),
}


_BESIDE = ("low_correlation", "low_overlap")
"""Codes of a drive off the lines of the map: other ground, or part of the array without mapped ground."""


def declines_table(summaries: Sequence[DriveSummary]) -> ReportTable | None:
    """Declined scans of all drives by code, the most frequent first; None without any.

    Drives known to be on other ground are left out: theirs must be declined.
    """
    rows = []
    for summary in summaries:
        counts = {code: summary.counts.get(code, 0) for code in DECLINES}
        for code, count in sorted(counts.items(), key=lambda each: -each[1]):
            if count and not summary.impostor:
                share = f"{count}, {100.0 * count / summary.scans:.1f} %"
                rows.append((summary.name, code, share, *_decline(code, summary)))
    header = ("drive", "code", "scans", "meaning", "what to do")
    return ReportTable(header, tuple(rows), "Scans without an ok fix, by code.") if rows else None


def main_decline(summary: DriveSummary) -> tuple[str, Decline] | None:
    """The most frequent code of a drive's declined scans, in words; None if none was declined."""
    code = max(DECLINES, key=lambda each: summary.counts.get(each, 0))
    return (code, _decline(code, summary)) if summary.counts.get(code, 0) else None


def _decline(code: str, summary: DriveSummary) -> Decline:
    """A code in words for one drive."""
    words = DECLINES[code]
    if code in _BESIDE and summary.median_off_line_m is not None:
        away = f"the log places the scans {summary.median_off_line_m:.2f} m (median) from the nearest line"
        return words._replace(action=f"{away} of the map. {words.action[:1].upper()}{words.action[1:]}")
    if code != "off_map" or not summary.place_assumed:
        return words
    return words._replace(action=f"{words.action}. {_PLACE_ASSUMED}")
