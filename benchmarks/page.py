"""``python -m benchmarks.page``: write the tables of docs/performance.md from docs/records."""

import re
from pathlib import Path

from benchmarks.records import markdown_table, read_records

_PLACE = re.compile(r"(<!-- (\S+\.json) -->\n).*?(<!-- end -->)", re.DOTALL)


def filled_page(page: str, folder: Path) -> str:
    """A page with machine and table of every record that it names, from ``<!-- FILE.json -->`` to ``<!-- end -->``."""

    def filled(place: re.Match[str]) -> str:
        told, records = read_records(folder / place[2])
        return f"{place[1]}\n{told['machine']}:\n\n{markdown_table(records)}\n{place[3]}"

    return _PLACE.sub(filled, page)


if __name__ == "__main__":
    page = Path(__file__).resolve().parents[1] / "docs" / "performance.md"
    page.write_text(filled_page(page.read_text(encoding="utf-8"), page.parent / "records"), encoding="utf-8")
