"""A vehicle with throttle and brake on a slope, for the tests: textbook laws in steps of five milliseconds."""

import math
from dataclasses import dataclass

GRAVITY_MPS2, _STEP_S = 9.81, 0.005


@dataclass(frozen=True)
class PlantNumbers:
    """Its numbers: both pedals push above a threshold, with a lag; rolling and drag slow it; slope is rise over run.

    ``kerb_mps2``: thrust below which it does not leave where it stands first.
    """

    throttle_from: float = 0.12
    throttle_mps2: float = 3.0
    throttle_lag_s: float = 0.6
    brake_from: float = 0.18
    brake_mps2: float = 6.0
    brake_lag_s: float = 0.25
    rolling_mps2: float = 0.15
    drag_per_s: float = 0.03
    slope: float = 0.0
    kerb_mps2: float = 0.0


class PedalledPlant:
    """It stands at first.

    Attributes:
        speed_mps, way_m: signed, forward.
        brake: pressure as a command.
    """

    def __init__(self, numbers: PlantNumbers) -> None:
        self.numbers = numbers
        self.speed_mps = self.way_m = self.brake = 0.0
        self._thrust = self._held = 0.0

    def step(self, throttle: float, brake: float, step_s: float) -> None:
        """Hold the pedals for a while."""
        told = self.numbers
        thrust = told.throttle_mps2 * max(min(throttle, 1.0) - told.throttle_from, 0.0)
        held = told.brake_mps2 * max(min(brake, 1.0) - told.brake_from, 0.0)
        gained = 1.0 - math.exp(-_STEP_S / told.throttle_lag_s)
        pressed = 1.0 - math.exp(-_STEP_S / told.brake_lag_s)
        for _ in range(round(step_s / _STEP_S)):
            self._thrust += (thrust - self._thrust) * gained
            self.brake += (min(brake, 1.0) - self.brake) * pressed
            self._held += (held - self._held) * pressed
            self._move(self._thrust - GRAVITY_MPS2 * told.slope)

    def _move(self, pushes_mps2: float) -> None:
        told, speed = self.numbers, self.speed_mps
        slows = self._held + told.rolling_mps2 + told.drag_per_s * abs(speed)
        if speed == 0.0 and abs(pushes_mps2) <= slows + (told.kerb_mps2 if self.way_m == 0.0 else 0.0):
            return
        direction = math.copysign(1.0, speed or pushes_mps2)
        after = speed + _STEP_S * (pushes_mps2 - direction * slows)
        # Friction stops a vehicle; it does not turn it round.
        self.speed_mps = 0.0 if speed * after < 0.0 else after
        self.way_m += 0.5 * (speed + self.speed_mps) * _STEP_S
