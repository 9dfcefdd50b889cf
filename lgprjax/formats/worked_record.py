"""What was worked of a field, as its record holds it: cells, what was measured over time, passes, stops, events."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int32, UInt8, UInt16, UInt32

from lgprjax.coverage import Tool
from lgprjax.frames import LocalFrame

FULL = 65535
"""The number that stands for probability 1."""


class WorkedCells(NamedTuple):
    """Ground cells, row 0 southmost.

    Attributes:
        east_m, north_m: of the grid's south-west corner.
        cell_m: side of a cell.
        probability: that a cell was worked in its best pass, rounded down to 1/``FULL``.
        level: confidences, rising.
        state: at each level, a ``coverage.CellState``.
    """

    east_m: float
    north_m: float
    cell_m: float
    probability: UInt16[np.ndarray, "north east"]
    level: Float[np.ndarray, " level"]
    state: UInt8[np.ndarray, "level north east"]


class CoverChannels(NamedTuple):
    """Moments, ten a second, run after run; names and units as in ``cover`` of ``data_schema/run_log.toml``.

    Attributes:
        time_s: since the record's ``t0_utc``; rises within a run.
        run: which of the runs.
    """

    time_s: Float[np.ndarray, " moment"]
    run: UInt16[np.ndarray, " moment"]
    x_m: Float[np.ndarray, " moment"]
    y_m: Float[np.ndarray, " moment"]
    yaw_rad: Float[np.ndarray, " moment"]
    covariance: Float32[np.ndarray, "moment 3 3"]
    speed_mps: Float32[np.ndarray, " moment"]
    left_mps: Float32[np.ndarray, " moment"]
    right_mps: Float32[np.ndarray, " moment"]
    tool: UInt8[np.ndarray, " moment"]
    depth_m: Float32[np.ndarray, " moment"]
    mode: UInt8[np.ndarray, " moment"]
    line: Int32[np.ndarray, " moment"]
    stop: UInt16[np.ndarray, " moment"]
    gnss_quality: UInt8[np.ndarray, " moment"]


class CoverPasses(NamedTuple):
    """Stretches of one line over which cells counted. Times since ``t0_utc``; depth and speed as measured."""

    run: UInt16[np.ndarray, " pass"]
    line: Int32[np.ndarray, " pass"]
    begin_s: Float[np.ndarray, " pass"]
    end_s: Float[np.ndarray, " pass"]
    length_m: Float[np.ndarray, " pass"]
    width_m: Float[np.ndarray, " pass"]
    depth_mean_m: Float[np.ndarray, " pass"]
    depth_least_m: Float[np.ndarray, " pass"]
    speed_mean_mps: Float[np.ndarray, " pass"]
    speed_largest_mps: Float[np.ndarray, " pass"]


class CoverSwaths(NamedTuple):
    """Ways of the tool's centre, pass after pass: ``number`` is that of the pass."""

    number: UInt32[np.ndarray, " point"]
    east_m: Float[np.ndarray, " point"]
    north_m: Float[np.ndarray, " point"]


class CoverStops(NamedTuple):
    """Stretches of time with a reason to stop; the place is where it began, NaN where that was not known."""

    run: UInt16[np.ndarray, " stop"]
    begin_s: Float[np.ndarray, " stop"]
    end_s: Float[np.ndarray, " stop"]
    east_m: Float[np.ndarray, " stop"]
    north_m: Float[np.ndarray, " stop"]
    reasons: UInt16[np.ndarray, " stop"]


class CoverEvents(NamedTuple):
    """What the programs on board told, each as one line of JSON."""

    run: UInt16[np.ndarray, " event"]
    time_s: Float[np.ndarray, " event"]
    east_m: Float[np.ndarray, " event"]
    north_m: Float[np.ndarray, " event"]
    text: tuple[str, ...]


class WorkedRecord(NamedTuple):
    """The record of a worked field.

    Attributes:
        name: of the field.
        frame: local metres about the plan's anchor.
        perimeter_m: corners, counter-clockwise.
        tool: that worked.
        t0_utc: ISO 8601; times count from it.
        cells, channels, passes, swaths, stops, events: what was found.
        provenance: program and inputs with their SHA-256.
    """

    name: str
    frame: LocalFrame
    perimeter_m: Float[np.ndarray, "corner 2"]
    tool: Tool
    t0_utc: str
    cells: WorkedCells
    channels: CoverChannels
    passes: CoverPasses
    swaths: CoverSwaths
    stops: CoverStops
    events: CoverEvents
    provenance: dict[str, Any]


_STOPS = {
    1: "operator or remote link",
    2: "edge of the field predicted crossed",
    4: "tool off or at a wrong depth",
    8: "position too uncertain",
    16: "heading not known",
    32: "wheels or their sensors",
    64: "box or its line",
    128: "computer",
    256: "recording",
    512: "off the line",
}


def stop_words(reasons: int) -> str:
    """Why a vehicle stopped, in words, from the bits of ``data_schema/run_log.toml``."""
    known = [words for bit, words in _STOPS.items() if reasons & bit]
    rest = reasons & ~sum(_STOPS)
    return ", ".join([*known, *([f"reason {rest:#x}"] if rest else [])]) or "none"
