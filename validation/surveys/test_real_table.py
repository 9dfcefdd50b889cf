"""Every real recording against the table of its folder's README: traces, samples, type, window, interval, spacing."""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from lgprjax.formats import read_profile
from lgprjax.formats.surveys import READERS

_HEAD = "| file | traces | samples | dtype | time window ns | dt ns | dx | notes |"


class _Row(NamedTuple):
    fewest: int
    most: int
    samples: int
    dtype: str
    window_ns: float
    interval_ns: float
    spacing_m: float


def _number(cell: str) -> float:
    found = re.search(r"\d+(?:\.\d+)?", cell)
    assert found is not None, f"the table holds no number in {cell!r}"
    return float(found[0])


def _metres(cell: str) -> float:
    return _number(cell) * (0.3048 if "ft" in cell else 1.0)


def _names(cell: str) -> list[str]:
    """File names of a cell; ``A/X00.DT1 … X24.DT1`` stands for all numbers between."""
    first, _, last = (part.strip() for part in cell.partition("…"))
    if not last:
        return [first]
    low, high = (int(re.findall(r"\d+", name.rpartition("/")[2])[0]) for name in (first, last))
    digits = re.findall(r"\d+", first.rpartition("/")[2])[0]
    return [first.replace(digits, f"{n:0{len(digits)}}", 1) for n in range(low, high + 1)]


def _table(readme: Path) -> dict[str, _Row]:
    """Rows by file name; ``same`` repeats the cell above."""
    lines = iter(readme.read_text().splitlines())
    assert _HEAD in lines, "the README has no such table"
    next(lines)
    rows: dict[str, _Row] = {}
    above: list[str] = []
    for line in lines:
        if not line.startswith("|"):
            break
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        cells = [old if cell == "same" else cell for cell, old in zip(cells, above or cells, strict=True)]
        above = cells
        counts = [int(text) for text in re.findall(r"\d+", cells[1])]
        row = _Row(
            fewest=counts[0],
            most=counts[-1],
            samples=int(cells[2]),
            dtype=cells[3].split()[0],
            window_ns=_number(cells[4]),
            interval_ns=_number(cells[5]),
            spacing_m=_metres(cells[6]),
        )
        rows |= dict.fromkeys(_names(cells[0]), row)
    return rows


@pytest.mark.real
def test_every_recording_is_as_the_table_says(real_data: Path) -> None:
    table = _table(real_data / "README.md")
    recordings = {str(path.relative_to(real_data)) for path in real_data.rglob("*") if path.suffix.lower() in READERS}
    assert recordings == set(table)
    assert len(recordings) >= 32
    seen: dict[_Row, list[int]] = {}
    for name, row in table.items():
        profile = read_profile(real_data / name)
        traces, channels, samples = profile.channels.shape
        assert (channels, samples) == (1, row.samples), name
        # Offset binary comes back signed, with the same bits.
        assert profile.channels.dtype == np.dtype(row.dtype.removeprefix("u")), name
        assert profile.sample_interval_ns == pytest.approx(row.interval_ns, rel=1e-4), name
        assert samples * profile.sample_interval_ns == pytest.approx(row.window_ns, rel=1e-4), name
        assert profile.spacing_m == pytest.approx(row.spacing_m, rel=1e-4), name
        assert profile.positions_m is not None, name
        length_m = profile.positions_m[-1] - profile.positions_m[0]
        assert length_m == pytest.approx((traces - 1) * row.spacing_m, rel=1e-4), name
        seen.setdefault(row, []).append(traces)
    # A row of one file says its traces, a row of many the range that they fill.
    for row, traces_seen in seen.items():
        assert (min(traces_seen), max(traces_seen)) == (row.fewest, row.most)
