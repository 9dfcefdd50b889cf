"""``python -m benchmarks.page``: write the tables of docs/performance.md from docs/records."""

import re
from collections.abc import Sequence
from pathlib import Path

from benchmarks.records import Record, markdown_table, read_records

_PLACE = re.compile(r"(<!-- (\S+\.json)( across)? -->\n).*?(<!-- end -->)", re.DOTALL)


def filled_page(page: str, folder: Path) -> str:
    """A page with machine and table of every record that it names, from ``<!-- FILE.json -->`` to ``<!-- end -->``.

    ``<!-- FILE.json across -->`` asks for a row a condition.
    """

    def filled(place: re.Match[str]) -> str:
        told, records = read_records(folder / place[2])
        table = condition_table(records) if place[3] else markdown_table(records)
        return f"{place[1]}\n{told['machine']}:\n\n{table}\n{place[4]}"

    return _PLACE.sub(filled, page)


def condition_table(records: Sequence[Record]) -> str:
    """Records whose keys are ``CONDITION: FIGURE``, a row a condition; what misses its goal is bold.

    Conditions that lack the first record's figure are of another kind, and left out; what is no number is left empty.
    """
    cells: dict[str, dict[str, str]] = {}
    heads: dict[str, str] = {}
    first = records[0].key.rpartition(": ")[2]
    shown = {record.key.rpartition(": ")[0] for record in records if record.key.endswith(f": {first}")}
    for record in records:
        condition, _, figure = record.key.rpartition(": ")
        if condition not in shown:
            continue
        unit = f", {record.unit}" if record.unit else ""
        heads.setdefault(figure, f"{figure}{unit}")
        text = f"{record.value:.3g}" if abs(record.value) < 99.0 else f"{record.value:.1f}".removesuffix(".0")
        if record.value != record.value:
            text = ""
        cells.setdefault(condition, {})[figure] = f"**{text}**" if record.met is False else text
    rows = [["", *heads.values()], ["---"] * (1 + len(heads))]
    rows += [[condition, *(own.get(figure, "") for figure in heads)] for condition, own in cells.items()]
    return "".join("| " + " | ".join(row) + " |\n" for row in rows)


if __name__ == "__main__":
    page = Path(__file__).resolve().parents[1] / "docs" / "performance.md"
    page.write_text(filled_page(page.read_text(encoding="utf-8"), page.parent / "records"), encoding="utf-8")
