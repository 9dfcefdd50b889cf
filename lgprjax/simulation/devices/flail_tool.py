"""The tool of the simulated flail: it takes a moment to come up to speed and to go down."""

import math
from typing import NamedTuple

from lgprjax.simulation.devices.faults import Faults

_RPM, _TURNS_RPM = 400.0, 360.0
_SPINS_UP_S = 0.15
_SINKS_MPS = 0.6
_RAISED_M = -0.1


class ToolState(NamedTuple):
    """Speed and depth of the tool; it is raised where the depth is negative."""

    rpm: float = 0.0
    depth_m: float = _RAISED_M

    @property
    def turns(self) -> bool:
        """At its working speed."""
        return self.rpm >= _TURNS_RPM


def step_tool(state: ToolState, asked_m: float | None, faults: Faults, step_s: float) -> ToolState:
    """The tool a step later; ``asked_m``: depth to turn at, ``None`` for off and raised."""
    rpm = 0.0 if asked_m is None or faults.has("tool_stops") else _RPM
    depth = _RAISED_M if asked_m is None else asked_m + faults.number("tool_depth", "m", 0.0)
    keep = math.exp(-step_s / _SPINS_UP_S)
    sunk = min(max(depth - state.depth_m, -_SINKS_MPS * step_s), _SINKS_MPS * step_s)
    return ToolState(rpm + keep * (state.rpm - rpm), state.depth_m + sunk)
