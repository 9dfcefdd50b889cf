"""The tool against what it was told: off, or at a wrong depth, while the vehicle moves. Fault 37."""

import math
from typing import NamedTuple

from lgprjax.autopilot.watch_dwell import Dwell, counted_step_s, step_dwell
from lgprjax.runtime.control.skid.findings import Found

RISES_S = 1.5
"""That a tool may take from being told on until it turns at its depth; nothing counts as worked meanwhile."""
WRONG_S = 0.1
_MOVES_MPS = 0.02


class ToolReading(NamedTuple):
    """Of the newest status of the box: whether the tool turns, and how deep it is."""

    turns: bool
    depth_m: float


class ToolBelief(NamedTuple):
    """Depth that is asked of the tool, and how far from it still counts."""

    depth_m: float
    tolerance_m: float


class ToolWatchState(NamedTuple):
    """What is carried from tick to tick: how long the tool has been told on, and the findings in the making."""

    told_s: float = 0.0
    off: Dwell = Dwell()
    depth: Dwell = Dwell()


def depth_right(belief: ToolBelief, depth_m: float) -> bool:
    """Whether a depth is the one that is asked for; no number is not."""
    return abs(depth_m - belief.depth_m) <= belief.tolerance_m


def step_tool_watch(
    belief: ToolBelief,
    state: ToolWatchState,
    reading: ToolReading | None,
    *,
    told_on: bool,
    speed_mps: float,
    step_s: float,
) -> tuple[ToolWatchState, Found]:
    """State and findings of a tick.

    Args:
        belief: what is asked of the tool.
        state: of the last tick.
        reading: ``None`` where the box has said nothing.
        told_on: by the last command.
        speed_mps: of the vehicle; no number counts as moving.
        step_s: since the last tick.
    """
    step_s = counted_step_s(step_s)
    told_s = state.told_s + step_s if told_on else 0.0
    # Once it has been right it has no more time to become so.
    risen = reading is not None and reading.turns and depth_right(belief, reading.depth_m)
    told_s = max(told_s, RISES_S) if told_on and risen else told_s
    matters = told_on and told_s >= RISES_S and not abs(speed_mps) <= _MOVES_MPS
    off = step_dwell(
        state.off, matters and not (reading is not None and reading.turns), step_s, on_s=WRONG_S, off_s=0.0
    )
    deep = reading is not None and math.isfinite(reading.depth_m) and depth_right(belief, reading.depth_m)
    depth = step_dwell(state.depth, matters and not deep, step_s, on_s=WRONG_S, off_s=0.0)
    found = (Found.TOOL_OFF if off.on else Found(0)) | (Found.TOOL_DEPTH if depth.on else Found(0))
    return ToolWatchState(told_s, off, depth), found
