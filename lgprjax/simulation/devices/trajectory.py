"""The true vehicle over the last moments, at any time of them."""

from collections import deque
from typing import NamedTuple

import numpy as np

_KEPT = 16


class Sample(NamedTuple):
    """The truth at a moment; pose of the rear axle in the map's frame.

    Attributes:
        x_m, y_m, yaw_rad, roll_rad: where it is.
        travel_m, along_m, speed_mps: signed way, place on the terrain, speed.
        front_rad, motor_rad: front wheels, and the servo as an angle of theirs.
        throttle, brake: position and pressure, as commands that would make them.
        supply_v: of the servo.
        odometer_m, odometer_gain: what the wheels count, and shown over true speed.
        rate_bias_radps, heading_slow_rad: slow errors of the INS.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    roll_rad: float
    travel_m: float
    along_m: float
    speed_mps: float
    front_rad: float
    motor_rad: float
    throttle: float
    brake: float
    supply_v: float
    odometer_m: float
    odometer_gain: float
    rate_bias_radps: float
    heading_slow_rad: float


class Trajectory:
    """Samples at the ticks' ends, the newest last; between them everything runs straight."""

    def __init__(self) -> None:
        self._times: deque[int] = deque(maxlen=_KEPT)
        self._rows: deque[np.ndarray] = deque(maxlen=_KEPT)

    def add(self, time_ns: int, sample: Sample) -> None:
        """The next sample."""
        self._rows.append(np.array(sample))
        self._times.append(time_ns)

    @property
    def last(self) -> Sample:
        """The newest sample."""
        return Sample._make(self._rows[-1].tolist())

    @property
    def known_ns(self) -> int:
        """Up to when the truth is known."""
        return self._times[-1]

    def at(self, time_ns: int) -> Sample:
        """The truth at a moment; the oldest, or newest, sample beyond what is known."""
        times = self._times
        at = len(times) - 1
        while at > 0 and times[at] > time_ns:
            at -= 1
        if time_ns <= times[at] or at == len(times) - 1:
            return Sample._make(self._rows[at].tolist())
        share = (time_ns - times[at]) / (times[at + 1] - times[at])
        row = self._rows[at] + share * (self._rows[at + 1] - self._rows[at])
        return Sample._make(row.tolist())
