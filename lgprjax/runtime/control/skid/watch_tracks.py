"""Tracks against their command: one that does not move, or whose sensor does not. Fault 14."""

import math
from typing import NamedTuple

from lgprjax.autopilot.watch_dwell import Dwell, counted_step_s, step_dwell
from lgprjax.runtime.control.skid.findings import Found

DEAD_S = 0.5
_ASKED_MPS = 0.08
_SHARE = 0.25


class TrackWatchState(NamedTuple):
    """What is carried from tick to tick: findings in the making, left and right."""

    left: Dwell = Dwell()
    right: Dwell = Dwell()


def step_track_watch(
    state: TrackWatchState,
    *,
    told_mps: tuple[float, float],
    measured_mps: tuple[float, float],
    drives: bool,
    step_s: float,
) -> tuple[TrackWatchState, Found]:
    """State and findings of a tick.

    Args:
        state: of the last tick.
        told_mps: left and right by the last command.
        measured_mps: left and right; no number counts as standing.
        drives: the box was told to drive, and holds it.
        step_s: since the last tick.
    """
    step_s = counted_step_s(step_s)
    dwells: list[Dwell] = []
    for dwell, told, measured in zip(state, told_mps, measured_mps, strict=True):
        moves = math.isfinite(measured) and measured * math.copysign(1.0, told) >= _SHARE * abs(told)
        dead = drives and abs(told) >= _ASKED_MPS and not moves
        dwells.append(step_dwell(dwell, dead, step_s, on_s=DEAD_S, off_s=0.0))
    found = (Found.LEFT_DEAD if dwells[0].on else Found(0)) | (Found.RIGHT_DEAD if dwells[1].on else Found(0))
    return TrackWatchState(*dwells), found
