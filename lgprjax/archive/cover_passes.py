"""Passes, ways of the tool and stops of recorded runs: stretches of moments that belong together."""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.archive.cover_runs import CoverRun
from lgprjax.coverage import Tool
from lgprjax.formats.worked_record import CoverPasses, CoverStops, CoverSwaths
from lgprjax.frames import body_to_local

_COUNTS = 8
_POINT_M = 0.2
# Reasons that come and go within this time are one stop.
_SAME_STOP_S = 1.0


def passes_of_runs(runs: Sequence[CoverRun], tool: Tool, t0_ns: int) -> tuple[CoverPasses, CoverSwaths]:
    """Stretches of one line over which cells counted, and the way of the tool's centre on each.

    Args:
        runs: in order.
        tool: that worked.
        t0_ns: UTC that times count from.
    """
    found: list[tuple[float, ...]] = []
    points: list[Float[np.ndarray, "point 3"]] = [np.zeros((0, 3))]
    for number, run in enumerate(runs):
        rows, time_s = run.rows, 1e-9 * (run.utc_ns - t0_ns).astype(np.float64)
        east, north = body_to_local(rows["x_m"], rows["y_m"], rows["yaw_rad"], tool.ahead_m, tool.left_m)
        counts = ((rows["tool"] & _COUNTS) != 0) & np.isfinite(east) & np.isfinite(north)
        changes = np.flatnonzero(np.diff(rows["line"])) + 1
        for first, last in _stretches(counts, changes):
            of = slice(first, last + 1)
            way = np.stack([east[of], north[of]], axis=1)
            step_m = np.hypot(*np.diff(way, axis=0).T)
            depth, speed = rows["depth_m"][of].astype(np.float64), rows["speed_mps"][of].astype(np.float64)
            figures = (step_m.sum(), tool.width_m, depth.mean(), depth.min(), speed.mean(), speed.max())
            kept = _thinned(step_m)
            points.append(np.column_stack([np.full(np.count_nonzero(kept), len(found)), way[kept]]))
            found.append((number, rows["line"][first], time_s[first], time_s[last], *figures))
    table = np.array(found, np.float64).reshape(len(found), len(CoverPasses._fields))
    run_of, line, *others = table.T
    swath = np.concatenate(points)
    return (
        CoverPasses(run_of.astype(np.uint16), line.astype(np.int32), *others),
        CoverSwaths(swath[:, 0].astype(np.uint32), swath[:, 1], swath[:, 2]),
    )


def stops_of_runs(runs: Sequence[CoverRun], t0_ns: int) -> CoverStops:
    """Stretches of time with a reason to stop; those less than a second apart are one.

    Args:
        runs: in order.
        t0_ns: UTC that times count from.
    """
    found: list[tuple[float, ...]] = []
    for number, run in enumerate(runs):
        time_s = 1e-9 * (run.utc_ns - t0_ns).astype(np.float64)
        bits = run.rows["stop"]
        last_end = -np.inf
        for first, last in _stretches(bits != 0, np.zeros(0, np.int64)):
            reasons = int(np.bitwise_or.reduce(bits[first : last + 1]))
            if time_s[first] - last_end <= _SAME_STOP_S:
                begin = found.pop()
                found.append((*begin[:2], time_s[last], *begin[3:5], int(begin[5]) | reasons))
            else:
                place = run.rows["x_m"][first], run.rows["y_m"][first]
                found.append((number, time_s[first], time_s[last], *place, reasons))
            last_end = time_s[last]
    run_of, begin_s, end_s, east_m, north_m, reason = np.array(found, np.float64).reshape(len(found), 6).T
    return CoverStops(run_of.astype(np.uint16), begin_s, end_s, east_m, north_m, reason.astype(np.uint16))


def _stretches(held: Bool[np.ndarray, " moment"], changes: np.ndarray) -> Iterator[tuple[int, int]]:
    """First and last moment of each stretch that holds throughout, cut where something changes."""
    begins = held & ~np.concatenate([[False], held[:-1]])
    begins[changes] |= held[changes]
    starts = np.flatnonzero(begins)
    ends = np.concatenate([starts[1:], [len(held)]]) if len(starts) else starts
    for start, end in zip(starts, ends, strict=True):
        yield int(start), int(start + np.flatnonzero(held[start:end])[-1])


def _thinned(step_m: Float[np.ndarray, " step"]) -> Bool[np.ndarray, " moment"]:
    """Moments about ``_POINT_M`` of way apart, the first and the last among them."""
    way_m = np.concatenate([[0.0], np.cumsum(step_m)])
    kept = np.concatenate([[True], np.diff(np.floor(way_m / _POINT_M)) > 0.0])
    kept[-1] = True
    return kept
