"""What the operator of a skid-steer vehicle sees: field, lines, tool and GNSS as the display takes them."""

import math
from typing import Any

import numpy as np

from lgprjax.navigation import Reaction
from lgprjax.runtime.control.rows import whole
from lgprjax.runtime.control.skid.compiled import SkidResult
from lgprjax.runtime.control.skid.senses import SkidSensed
from lgprjax.runtime.control.skid.setup import SkidLoaded
from lgprjax.runtime.control.skid.watch_tool import ToolReading, depth_right
from lgprjax.runtime.control.skid.watches import SkidSent

_MOST_POINTS = 1500
_PATH_TICKS = 100


class FieldPanel:
    """Keeps what the display needs beside the tick's numbers.

    Args:
        loaded: from ``load_skid``.
    """

    def __init__(self, loaded: SkidLoaded) -> None:
        self._loaded = loaded
        rows = np.asarray(loaded.route.rows, np.float64)[: int(loaded.route.count), :2]
        few = rows[np.unique(np.linspace(0, len(rows) - 1, _MOST_POINTS).astype(int))]
        self._points = [] if loaded.name is None else [[round(float(x), 2), round(float(y), 2)] for x, y in few]
        self._perimeter = [[round(float(x), 2), round(float(y), 2)] for x, y in loaded.perimeter_m]
        self._path_tick: int | None = None

    def state(
        self, tick: int, result: SkidResult, sensed: SkidSensed, sent: SkidSent, reading: ToolReading | None
    ) -> dict[str, Any]:
        """What stands in the state of a tick beside the modes."""
        belief, line = self._loaded.belief, whole(result.line, -1)
        state: dict[str, Any] = {
            "route": self._loaded.name,
            "routes": [],
            "speed_mps": result.speed_mps,
            "cross_track_m": result.cross_m,
            "to_go_m": result.to_go_m,
            "heading_error_deg": math.degrees(result.heading_error_rad),
            "sigma_along_m": result.sigma_m,
            "sigma_cross_m": result.sigma_m,
            "pose": [result.x_m, result.y_m, result.yaw_rad if result.heading_known > 0.5 else math.nan],
            "gnss_pose": [result.x_m, result.y_m, 0.0],
            "reaction": Reaction(int(result.reaction)).name if math.isfinite(result.reaction) else None,
            "field": {
                "perimeter": self._perimeter,
                "line": line + 1 if line >= 0 else None,
                "lines": self._loaded.lines,
                "tool_width_m": self._loaded.setup.tool.width_m,
                "tool_ahead_m": self._loaded.setup.tool.ahead_m,
                "told_on": bool(sent.tool),
                "turns": None if reading is None else reading.turns,
                "depth_m": None if reading is None else reading.depth_m,
                "depth_right": None if reading is None else depth_right(belief, reading.depth_m),
                "depth_asked_m": belief.depth_m,
                "gnss": sensed.quality.name.lower(),
                "gnss_age_s": sensed.gnss_age_s,
                "heading_known": result.heading_known > 0.5,
                "sigma_heading_deg": math.degrees(math.sqrt(max(result.yawyaw, 0.0))),
            },
        }
        if self._path_tick is None or tick - self._path_tick >= _PATH_TICKS:
            self._path_tick = tick
            state["path"] = self._points
        return state
