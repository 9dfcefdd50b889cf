"""One measured figure beside its goal, and tables of them."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Literal

HEADER = ("key", "value", "unit", "goal", "met", "note")


@dataclass(frozen=True)
class Record:
    """A figure.

    Attributes:
        key: names it, stable between runs.
        value: measured.
        unit: of value and goal; empty for counts.
        direction: where better lies.
        goal: to be reached, or None where a figure is only told.
        note: on what and how it was measured.
    """

    key: str
    value: float
    unit: str
    direction: Literal["higher", "lower"]
    goal: float | None = None
    note: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the goal is reached; None without one. A value that is no number meets nothing."""
        if self.goal is None:
            return None
        return self.value >= self.goal if self.direction == "higher" else self.value <= self.goal


def text_table(records: Sequence[Record]) -> str:
    """Columns of equal width, one record a line, for the terminal."""
    rows = [HEADER, *(_row(record) for record in records)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(HEADER))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join(lines) + "\n"


def markdown_table(records: Sequence[Record]) -> str:
    """The same as a markdown table."""
    rows = [HEADER, ("---",) * len(HEADER), *(_row(record) for record in records)]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |\n" for row in rows)


def records_as_json(records: Sequence[Record]) -> str:
    """A JSON list of the records with ``met``; values that are no numbers become null."""
    rows = [{**asdict(record), "value": _plain(record.value), "met": record.met} for record in records]
    return json.dumps(rows, indent=2, allow_nan=False) + "\n"


def _row(record: Record) -> tuple[str, ...]:
    sign = "≥" if record.direction == "higher" else "≤"
    goal = "" if record.goal is None else f"{sign} {record.goal:.4g}"
    met = {None: "", True: "yes", False: "no"}[record.met]
    return (record.key, f"{record.value:.4g}", record.unit, goal, met, record.note)


def _plain(value: float) -> float | None:
    return value if abs(value) < float("inf") else None
