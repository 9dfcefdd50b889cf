"""Rows that a tick of a skid-steer vehicle leaves: what it decided, and ten times a second what its tool does."""

import math

import numpy as np

from lgprjax.autopilot import Mode
from lgprjax.autopilot.watch_findings import Severity, Watch
from lgprjax.navigation import Reaction
from lgprjax.runtime.control.rows import whole
from lgprjax.runtime.control.skid.compiled import SkidResult
from lgprjax.runtime.control.skid.findings import Found, stops_of
from lgprjax.runtime.control.skid.senses import SkidSensed
from lgprjax.runtime.control.skid.watch_tool import ToolBelief, ToolReading, depth_right
from lgprjax.runtime.control.skid.watches import DRIVE, SkidSent
from lgprjax.runtime.records import COVER, SKID_PLAN, StopBits, ToolBits


def skid_plan_row(
    result: SkidResult, sent: SkidSent, *, mode: int, bits: Watch, found: Found, severity: Severity
) -> bytes:
    """``SKID_PLAN``; before there is a position navigation asks for a stop."""
    row = np.zeros((), SKID_PLAN)
    row["mode"], row["reaction"] = mode, whole(result.reaction, int(Reaction.STOP))
    row["known"] = int(math.isfinite(result.x_m)) + 2 * int(result.heading_known > 0.5)
    row["reasons"], row["limited"] = whole(result.reasons), whole(result.limited)
    row["pose"] = (result.x_m, result.y_m, result.yaw_rad)
    row["sigma"] = [math.sqrt(max(number, 0.0)) for number in (result.xx, result.yy, result.yawyaw)]
    row["speed_mps"], row["cross_m"] = result.speed_mps, result.cross_m
    row["heading_error_rad"], row["to_go_m"] = result.heading_error_rad, result.to_go_m
    row["line"] = whole(result.line, -1)
    row["command"], row["tool"], row["depth_m"] = (sent.left_mps, sent.right_mps), sent.tool, sent.depth_m
    row["engage"], row["watch"], row["found"], row["severity"] = sent.engage, int(bits), int(found), int(severity)
    return row.tobytes()


def tool_bits(belief: ToolBelief, sent: SkidSent, reading: ToolReading | None, *, heading_known: bool) -> ToolBits:
    """What of the tool holds; that the computer drives belongs to its being told on."""
    bits = ToolBits(0)
    if sent.tool and sent.engage & DRIVE:
        bits |= ToolBits.TOLD_ON
    if reading is not None and reading.turns:
        bits |= ToolBits.TURNS
    if reading is not None and depth_right(belief, reading.depth_m):
        bits |= ToolBits.DEPTH_RIGHT
    right = ToolBits.TOLD_ON | ToolBits.TURNS | ToolBits.DEPTH_RIGHT
    return bits | ToolBits.COUNTS if bits == right and heading_known else bits


def cover_row(
    result: SkidResult,
    sensed: SkidSensed,
    reading: ToolReading | None,
    tool: ToolBits,
    *,
    mode: int,
    bits: Watch,
    found: Found,
) -> bytes:
    """``COVER``."""
    row = np.zeros((), COVER)
    row["x_m"], row["y_m"], row["yaw_rad"] = result.x_m, result.y_m, result.yaw_rad
    row["covariance"] = [
        [result.xx, result.xy, result.xyaw],
        [result.xy, result.yy, result.yyaw],
        [result.xyaw, result.yyaw, result.yawyaw],
    ]
    row["speed_mps"], row["left_mps"], row["right_mps"] = result.speed_mps, sensed.left_mps, sensed.right_mps
    row["tool"], row["depth_m"] = int(tool), math.nan if reading is None else reading.depth_m
    row["mode"], row["line"] = mode, whole(result.line, -1)
    row["stop"] = int(_stops(Mode(mode), bits, found))
    row["gnss_quality"] = int(sensed.quality)
    return row.tobytes()


def _stops(mode: Mode, bits: Watch, found: Found) -> StopBits:
    stops = stops_of(found, bits)
    if mode in (Mode.MANUAL, Mode.EMERGENCY_STOP):
        return stops | StopBits.OPERATOR
    return stops | StopBits.COMPUTER if mode is Mode.ERROR else stops
