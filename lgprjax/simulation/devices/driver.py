"""The driver: sees the road, holds the vehicle on the baseline when nobody else does, and plays a script."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.scene.vehicle_drive import TrueVehicle
from lgprjax.simulation.devices.schedule import Item

SCRIPT: dict[str, tuple[str, ...]] = {
    "drive": ("speed_mps",),
    "stand": (),
    "press": ("button",),
    "brake_tap": (),
    "torque": ("nm",),
}
"""What a script may say, and what each must say with it."""

SCRIPT_LASTS_S = {"press": 0.3, "brake_tap": 0.3, "torque": 0.5}
BUTTONS = ("steering", "plus", "minus", "override", "estop")

_CROSS_PER_M = 0.4
_PREVIEW_S = 0.25
_STANDS_MPS = 0.05
_TAP_BRAKE, _HALT_BRAKE, _PARKED_BRAKE = 0.22, 0.45, 0.5
_END_M = 2.0
_BACK, _ON = 10, 200


class Hands(NamedTuple):
    """What the driver does.

    Attributes:
        front_rad: where the front wheels are turned, by hand.
        throttle, brake: pedals, 0 to 1.
        foot_on_brake: the brake is pressed by foot, not by the parking lever.
        torque_nm: on the steering wheel.
        buttons: pressed on the controller.
    """

    front_rad: float
    throttle: float
    brake: float
    foot_on_brake: bool
    torque_nm: float
    buttons: frozenset[str]


class Driver:
    """Drives the array's centre along the baseline by true pose: points the array's own way along it.

    Args:
        vehicle: as it is.
        array_x_m: array ahead of the rear axle.
        line_m: true places of the baseline's anchor, in driving order.
    """

    def __init__(self, vehicle: TrueVehicle, array_x_m: float, line_m: Float[np.ndarray, "point 2"]) -> None:
        assert isinstance(vehicle.rear, float)
        self._vehicle, self._share = vehicle, vehicle.rear
        # From the point that runs along the body's axis to the array.
        self._ahead_m = array_x_m - vehicle.wheelbase_m * self._share / (1.0 + self._share)
        self._array_x_m = array_x_m
        step = np.diff(line_m, axis=0)
        self._line_m, self._yaw = line_m, np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
        self._way_m = np.concatenate([[0.0], np.cumsum(np.hypot(*step.T))])
        self._at = 0
        self._speed_mps: float | None = None
        self._told: Item | None = None

    def step(
        self, running: Iterable[Item], x_m: float, y_m: float, yaw_rad: float, speed_mps: float, *, has_pedals: bool
    ) -> Hands:
        """What the driver does at a true pose of the rear axle.

        Args:
            running: items of the script that run.
            x_m, y_m, yaw_rad, speed_mps: of the rear axle.
            has_pedals: nobody else holds them.
        """
        items = list(running)
        # What was said last holds until something else is said.
        orders = [item for item in items if item.name in ("drive", "stand")]
        if orders and orders[-1] is not self._told:
            self._told = orders[-1]
            self._speed_mps = None if self._told.name == "stand" else float(self._told.numbers["speed_mps"])
        front, to_go_m = self._steer(x_m, y_m, yaw_rad, speed_mps)
        wanted = self._speed_mps if to_go_m > _END_M else None
        throttle, brake, foot = self._pedals(wanted, speed_mps) if has_pedals else (0.0, 0.0, False)
        tapped = any(item.name == "brake_tap" for item in items)
        if tapped:
            brake, foot = max(brake, _TAP_BRAKE), True
        torque = sum(float(item.numbers["nm"]) for item in items if item.name == "torque")
        pressed = frozenset(str(item.numbers["button"]) for item in items if item.name == "press")
        # The pedal's switch is wired to the controller too.
        pressed |= {"brake_tap"} if tapped else set()
        return Hands(front, throttle, brake, foot, torque, pressed)

    def _steer(self, x_m: float, y_m: float, yaw_rad: float, speed_mps: float) -> tuple[float, float]:
        place = np.array([x_m + self._array_x_m * np.cos(yaw_rad), y_m + self._array_x_m * np.sin(yaw_rad)])
        low = max(self._at - _BACK, 0)
        near = self._line_m[low : self._at + _ON]
        self._at = at = min(low + int(np.argmin(np.sum((near - place) ** 2, axis=1))), len(self._yaw) - 1)
        gap, yaw = place - self._line_m[at], self._yaw[at]
        cross_m = float(np.cos(yaw) * gap[1] - np.sin(yaw) * gap[0])
        ahead_m = self._way_m[at] + speed_mps * _PREVIEW_S
        way = float(np.interp(ahead_m, self._way_m[:-1], self._yaw))
        turn = math.remainder(way - yaw_rad, math.tau) - np.clip(_CROSS_PER_M * cross_m, -0.5, 0.5)
        curvature = np.tan(np.clip(turn, -1.2, 1.2)) / self._ahead_m
        front = curvature * self._vehicle.wheelbase_m / (1.0 + self._share)
        largest = 0.95 * self._vehicle.largest_angle_rad
        return float(np.clip(front, -largest, largest)), float(self._way_m[-1] - self._way_m[at])

    def _pedals(self, wanted_mps: float | None, speed_mps: float) -> tuple[float, float, bool]:
        vehicle = self._vehicle
        if wanted_mps is None:
            parked = speed_mps < _STANDS_MPS
            return 0.0, _PARKED_BRAKE if parked else _HALT_BRAKE, not parked
        slow_mps = wanted_mps - speed_mps
        if slow_mps < -0.5:
            pre_tension, _, gain, _ = vehicle.brake
            return 0.0, float(np.clip(pre_tension - (slow_mps + 0.3) / gain, 0.0, 0.6)), True
        pre_tension, _, gain, _ = vehicle.throttle
        asked = 1.5 * slow_mps + vehicle.rolling_mps2 + vehicle.drag_per_s * speed_mps
        return float(np.clip(pre_tension + asked / gain, 0.0, 0.7)), 0.0, False
