"""Records of the programs that measure latency, map length and tiles."""

from collections.abc import Sequence
from typing import Any

from benchmarks.records import SCANS_A_TILE, Record, TileCost

PERIOD_MS = 8.0
"""From scan to scan at 126 scans a second."""


def latency_records(figures: dict[str, Any]) -> list[Record]:
    """p50, p99 and maximum of consecutive scans.

    Args:
        figures: of ``benchmarks.latency``.
    """
    threads, scans = figures["threads"], figures["scans"]
    box = f"box ±{figures['box_m']:g} m, {scans} consecutive scans, {figures['successes']} found"
    # The goal holds where a vehicle has two cores for it.
    goal = PERIOD_MS if threads == 2 else None
    name = f"tracking, {threads} core{'s' if threads > 1 else ''}"
    ahead = f"tiles prepared ahead, {figures['preparation_ms']:.3g} ms of columns each"
    return [
        Record(f"{name}, p50", figures["p50_ms"], "ms", "lower", None, box),
        Record(f"{name}, p99", figures["p99_ms"], "ms", "lower", goal, ahead),
        Record(f"{name}, maximum", figures["max_ms"], "ms", "lower"),
    ]


def length_records(short: Sequence[dict[str, Any]], long: Sequence[dict[str, Any]]) -> list[Record]:
    """Time a scan on a long map against that on a short one, the best of the runs of each.

    Args:
        short, long: figures of ``benchmarks.map_length``, one entry a run.
    """
    times = [min(figures["scan_ms"] for figures in runs) for runs in (short, long)]
    lengths = [runs[0]["length_m"] / 1e3 for runs in (short, long)]
    what = f"drive of {short[0]['scans']} scans, box ±{short[0]['search_m']:g} m, gridding and columns in the time"
    key = f"scan on {lengths[1]:g} km / on {lengths[0]:g} km"
    records = [
        Record(key, times[1] / times[0], "×", "lower", 1.1, what),
        Record("scans that a tile serves", short[0]["scans_a_tile"], "", "higher", None, f"amortised: {SCANS_A_TILE}"),
    ]
    for runs, length, time in zip((short, long), lengths, times, strict=True):
        opened = f"opening the map, not in the time: {runs[0]['open_s']:.2g} s"
        first = f"{runs[0]['block_rss_mb']:.0f} MB after the first block"
        records.append(Record(f"scan on {length:g} km of map", time, "ms", "lower", None, opened))
        records.append(Record(f"memory on {length:g} km of map", runs[0]["peak_rss_mb"], "MB", "lower", None, first))
    return records


def tile_records(figures: dict[str, Any]) -> list[Record]:
    """What a tile costs before its first scan."""
    cells = f"{figures['cells']} cells, ground over the whole box of ±{figures['search_m']:g} m"
    return [
        Record("tile, reading and gridding", figures["gridding_ms"], "ms", "lower", None, cells),
        Record("tile, columns", figures["columns_ms"], "ms", "lower", None, cells),
    ]


def tile_cost(figures: dict[str, Any]) -> TileCost:
    """The same for the ratios."""
    return TileCost(figures["gridding_ms"], figures["columns_ms"])
