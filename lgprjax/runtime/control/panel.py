"""What the operator sees: the control loop's state as the display takes it."""

import json
import math
from typing import Any

from lgprjax.autopilot import Refusal
from lgprjax.navigation import Reaction, Reason
from lgprjax.registration import Code
from lgprjax.runtime.control.compiled import TickResult
from lgprjax.runtime.control.setup import LaidRoute

REFUSALS = {
    Refusal.NONE: "",
    Refusal.ESTOP: "emergency stop is pressed: release it, then press override",
    Refusal.CHECKS: "system checks have not passed",
    Refusal.OVERRIDE_STUCK: "override button is stuck",
    Refusal.OVERRIDE_PRESSED: "override button is pressed",
    Refusal.NOT_READY: "not ready: press and release override",
    Refusal.NOT_STEERING: "engage steering first",
    Refusal.STOPPING: "a controlled stop is under way",
    Refusal.BRAKE_PRESSED: "brake is pressed",
    Refusal.SOURCE_MISSING: "a sensor or the heading is missing",
    Refusal.TOO_FAST: "too fast to engage",
    Refusal.HEALTH: "navigation is not good enough",
    Refusal.NO_PATH: "no route, or no position yet",
    Refusal.OFF_ROUTE: "more than 10 m from the route",
    Refusal.WRONG_HEADING: "heading does not fit the route, or is not confirmed yet",
    Refusal.AMBIGUOUS: "the route passes here more than once",
}
"""Why nothing is engaged, in plain words."""


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

    def state(self, tick: int, route: int, told: dict[str, Any], result: TickResult) -> bytes:
        """JSON of a tick.

        Args:
            tick: its number.
            route: number of the chosen one.
            told: what stands in the state beside the numbers of the step.
            result: numbers of the step.
        """
        self._codes = [known for known in self._codes if known[0] > tick - 500]
        share = sum(good for _, good in self._codes) / len(self._codes) if self._codes else None
        state = {
            "tick": tick,
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
            **told,
        }
        if route != self._shown or tick - self._path_tick >= 100:
            self._shown, self._path_tick = route, tick
            state["path"] = self._routes[route].points
        return json.dumps(_finite(state)).encode()


def words_of(result: TickResult) -> list[str]:
    """Reasons of navigation's health, as words."""
    if not math.isfinite(result.reasons):
        return []
    return [str(reason.name).lower().replace("_", " ") for reason in Reason(int(result.reasons))]


def _finite(value: Any) -> Any:
    """JSON knows no NaN: what is no number is null."""
    if isinstance(value, float):
        return round(value, 4) if math.isfinite(value) else None
    if isinstance(value, dict):
        return {name: _finite(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [_finite(inner) for inner in value]
    return value
