"""What the operator sees: the control loop's state as the display takes it."""

import math
from typing import Any

from lgprjax.navigation import Reaction, Reason
from lgprjax.registration import Code
from lgprjax.runtime.control.compiled import TickResult
from lgprjax.runtime.control.setup import LaidRoute


class Panel:
    """Keeps what the display needs beside the tick's numbers.

    Args:
        routes: of the configuration.
    """

    def __init__(self, routes: list[LaidRoute]) -> None:
        self._routes = routes
        self._listed = [
            {"name": route.name, "length_m": round(route.length_m, 1), "problem": route.problem or None}
            for route in routes
        ]
        self._codes: list[tuple[int, bool]] = []
        self._shown = -1
        self._path_tick = 0
        self.code = ""
        self.correlation = math.nan

    def take_fix(self, tick: int, code: int, correlation: float) -> None:
        """A scan that was searched."""
        self.code, self.correlation = Code(code).name.lower(), correlation
        self._codes.append((tick, code == Code.OK))

    def state(self, tick: int, route: int, result: TickResult) -> dict[str, Any]:
        """What stands in the state of a tick beside the modes.

        Args:
            tick: its number.
            route: number of the chosen one.
            result: numbers of the step.
        """
        self._codes = [known for known in self._codes if known[0] > tick - 500]
        share = sum(good for _, good in self._codes) / len(self._codes) if self._codes else None
        state: dict[str, Any] = {
            "route": self._routes[route].name,
            "routes": self._listed,
            "speed_mps": result.speed_mps,
            "cap_mps": result.cap_mps,
            "cross_track_m": result.offset_m,
            "to_go_m": result.to_go_m,
            "heading_error_deg": math.degrees(result.heading_error_rad),
            "correlation": self.correlation,
            "code": self.code,
            "ok_share": share,
            "sigma_along_m": result.sigma_along_m,
            "sigma_cross_m": result.sigma_cross_m,
            "pose": [result.x_m, result.y_m, result.yaw_rad],
            "gnss_pose": [result.reckoned_x_m, result.reckoned_y_m, result.reckoned_yaw_rad],
            "reaction": Reaction(int(result.reaction)).name if math.isfinite(result.reaction) else None,
            "reasons": words_of(result),
            "front_rad": result.front_rad,
            "throttle": result.throttle,
            "brake": result.brake,
        }
        if route != self._shown or tick - self._path_tick >= 100:
            self._shown, self._path_tick = route, tick
            state["path"] = self._routes[route].points
        return state


def words_of(result: TickResult) -> list[str]:
    """Reasons of navigation's health, as words."""
    if not math.isfinite(result.reasons):
        return []
    return [str(reason.name).lower().replace("_", " ") for reason in Reason(int(result.reasons))]
