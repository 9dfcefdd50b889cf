"""Rows that a tick leaves for others: the prior for registration, the plan for the recording."""

import math

import numpy as np

from lgprjax.navigation import PlanCode, Reaction
from lgprjax.runtime.control.compiled import TickResult
from lgprjax.runtime.control.watches import Sent, Watched
from lgprjax.runtime.records import PLAN, PRIOR


def whole(number: float, unknown: int = 0) -> int:
    """A number that is a whole one where it is a number at all."""
    return int(number) if math.isfinite(number) else unknown


def prior_row(result: TickResult, now_ns: int, *, roll_rad: float, yaw_rate_radps: float, travel_m: float) -> bytes:
    """``PRIOR``: where GNSS/INS have the vehicle; without a yaw rate it is taken not to turn."""
    row = np.zeros((), PRIOR)
    row["time_ns"], row["valid"] = now_ns, 1
    row["pose"] = (result.reckoned_x_m, result.reckoned_y_m, result.reckoned_yaw_rad)
    row["roll_rad"], row["sigma_yaw_rad"] = roll_rad, result.reckoned_yaw_sigma_rad
    row["speed_mps"], row["travel_m"] = result.speed_mps, travel_m
    row["yaw_rate_radps"] = yaw_rate_radps if math.isfinite(yaw_rate_radps) else 0.0
    return row.tobytes()


def plan_row(result: TickResult, watched: Watched, sent: Sent, *, mode: int, code: PlanCode) -> bytes:
    """``PLAN``: what a tick decided; before there is a pose navigation asks for a stop."""
    row = np.zeros((), PLAN)
    row["mode"], row["code"] = mode, int(code)
    row["reaction"] = whole(result.reaction, int(Reaction.STOP))
    row["reasons"], row["limited"] = whole(result.reasons), whole(result.limited)
    row["pose"] = (result.x_m, result.y_m, result.yaw_rad)
    row["sigma_cross_m"], row["speed_mps"] = result.sigma_cross_m, result.speed_mps
    row["wanted_mps"], row["cross_track_m"] = result.wanted_mps, result.offset_m
    row["to_go_m"], row["front_rad"] = result.to_go_m, watched.front_rad
    row["command"], row["engage"] = (sent.front_rad, sent.throttle, sent.brake), sent.engage
    row["watch"], row["severity"] = int(watched.bits), int(watched.severity)
    return row.tobytes()
