"""Where GNSS/INS have the vehicle at each scan: between the control loop's priors, or a little beyond the last."""

import math
from collections import deque

import numpy as np
from jaxtyping import Float, Int

from lgprjax.registration import Track
from lgprjax.runtime.records import PRIOR

_KEPT = 256
_BEYOND_S = 0.1
_LEAST_YAW_SIGMA_RAD = math.radians(0.1)


class PriorTrack:
    """The last seconds of priors.

    Args:
        array_x_m: centre of the array ahead of the rear axle.
        height_m: of the array.
    """

    def __init__(self, array_x_m: float, height_m: float) -> None:
        self._array_x_m, self._height_m = array_x_m, height_m
        self._held: deque[np.void] = deque(maxlen=_KEPT)

    def take(self, payload: bytes) -> None:
        """A prior; one that is not valid ends what is known."""
        prior = np.frombuffer(payload, PRIOR)[0]
        if not prior["valid"]:
            self._held.clear()
        elif not self._held or prior["time_ns"] > self._held[-1]["time_ns"]:
            self._held.append(prior)

    def covers(self, scan_ns: int) -> bool | None:
        """Whether there is a prior for a moment; ``None`` where one may still come."""
        if not self._held:
            return None
        if scan_ns < self._held[0]["time_ns"]:
            return False
        return True if scan_ns <= self._held[-1]["time_ns"] + int(_BEYOND_S * 1e9) else None

    def track(self, scan_ns: Int[np.ndarray, " scan"]) -> Track:
        """Priors of scans that are covered."""
        held = np.array(list(self._held), PRIOR)
        at, time = (scan_ns - held["time_ns"][0]) / 1e9, (held["time_ns"] - held["time_ns"][0]) / 1e9
        last = held[-1]
        beyond = np.maximum(at - time[-1], 0.0)
        yaw_held = np.unwrap(held["pose"][:, 2])
        yaw = np.interp(at, time, yaw_held) + beyond * last["yaw_rate_radps"]
        # What the last prior is carried on by stays small: a tick of the control loop.
        way = beyond * last["speed_mps"]
        turned = yaw_held[-1] + 0.5 * beyond * last["yaw_rate_radps"]
        x = np.interp(at, time, held["pose"][:, 0]) + way * np.cos(turned) + self._array_x_m * np.cos(yaw)
        y = np.interp(at, time, held["pose"][:, 1]) + way * np.sin(turned) + self._array_x_m * np.sin(yaw)
        roll = np.interp(at, time, held["roll_rad"])
        pose = np.stack([x, y, np.full(len(at), self._height_m), yaw, roll], axis=1)
        travel = np.interp(at, time, held["travel_m"]) + way
        speed = np.interp(at, time, held["speed_mps"])
        sigma = np.maximum(np.interp(at, time, held["sigma_yaw_rad"]), _LEAST_YAW_SIGMA_RAD)
        # A prior's record states no covariance of its position.
        unstated = np.full(len(at), np.nan)
        return Track(pose, travel, speed, sigma, unstated, np.zeros(len(at), np.int64))

    def ahead(self, way_m: float) -> Float[np.ndarray, "5"] | None:
        """Where the array will be so much farther on, the way that the vehicle moves now; ``None`` where it stands."""
        if not self._held or abs(self._held[-1]["speed_mps"]) < 0.1:
            return None
        last = self._held[-1]
        way = math.copysign(way_m, last["speed_mps"])
        turn = float(last["yaw_rate_radps"] / last["speed_mps"]) * way
        x, y, yaw = last["pose"]
        x += way * math.cos(yaw + 0.5 * turn) + self._array_x_m * math.cos(yaw + turn)
        y += way * math.sin(yaw + 0.5 * turn) + self._array_x_m * math.sin(yaw + turn)
        return np.array([x, y, self._height_m, yaw + turn, last["roll_rad"]])

    @property
    def speed_mps(self) -> float:
        """Of the last prior."""
        return float(self._held[-1]["speed_mps"]) if self._held else 0.0
