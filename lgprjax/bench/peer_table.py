"""The peers side by side, for the terminal and as data."""

import json
from collections.abc import Sequence
from typing import Any

from lgprjax.bench.process import results_as_json
from lgprjax.bench.ratios import Ran

_HEADER = (
    *("search", "setting", "success", "95 % interval", "n", "median", "single", "batch"),
    *("evaluations", "preparation", "memory"),
)
_INSTALL = 'pip install "lgprjax[bench]"'


def peer_table(runs: Sequence[Ran]) -> str:
    """A line for each peer that ran, then one for each that did not and why."""
    ran = [entry for entry in runs if not entry.result.missing]
    rows = [_HEADER, *(_row(entry) for entry in ran)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(_HEADER))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join([*lines, *missing_lines(runs)]) + "\n"


def missing_lines(runs: Sequence[Ran]) -> list[str]:
    """Which peers have no result, why, and what helps."""
    lines = []
    for _, result in (entry for entry in runs if entry.result.missing):
        helps = f": {_INSTALL}" if result.missing.endswith("is not installed") else ""
        lines.append(f"missing: {result.name} {result.setting}".rstrip() + f": {result.missing}{helps}")
    return lines


def peers_as_data(runs: Sequence[Ran]) -> list[dict[str, Any]]:
    """The results with role and interval, as JSON takes them."""
    rows = json.loads(results_as_json([entry.result for entry in runs]))
    return [
        {"role": entry.role, **row, "interval": list(entry.interval)} for entry, row in zip(runs, rows, strict=True)
    ]


def _row(entry: Ran) -> tuple[str, ...]:
    result, (low, high) = entry.result, entry.interval
    return (
        result.name,
        result.setting,
        f"{100 * result.success_share:.1f} %",
        f"{100 * low:.1f}-{100 * high:.1f} %",
        str(result.problems),
        f"{100 * result.median_error_m:.1f} cm",
        f"{result.single_ms:.3g} ms ({result.single_threads})",
        f"{result.batch_ms:.3g} ms ({result.batch_threads})",
        str(result.evaluations),
        f"{result.preparation_ms:.1f} ms",
        f"{result.peak_rss_mb:.0f} MB",
    )
