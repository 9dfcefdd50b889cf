"""Drives in one table for the terminal."""

from collections.abc import Sequence

from rich.table import Table

from lgprjax.report.summary import OVERVIEW_HEADER, DriveSummary, overview_rows


def summary_table(summaries: Sequence[DriveSummary]) -> Table:
    """One column a drive, so that a terminal of 80 columns holds it; a drive with wrong ok fixes stands out."""
    table = Table(
        title="Registration", caption="Errors of the ok fixes, map frame; wrong: more than 0.3 m off.", min_width=66
    )
    rows = overview_rows(summaries)
    table.add_column(OVERVIEW_HEADER[0])
    for summary, row in zip(summaries, rows, strict=True):
        table.add_column(row[0], justify="right", style="bold red" if summary.wrong_ok else None)
    for number, title in enumerate(OVERVIEW_HEADER[1:], start=1):
        table.add_row(title, *(row[number] for row in rows))
    return table
