"""The operator of a skid-steer vehicle: drives it by remote control from place to place, and plays a script."""

import math
from collections.abc import Iterable
from typing import NamedTuple

from lgprjax.simulation.devices.schedule import Item
from lgprjax.simulation.devices.skid_box import SkidActing

FIELD_SCRIPT: dict[str, tuple[str, ...]] = {
    "drive_to": ("x_m", "y_m", "speed_mps"),
    "stand": (),
    "press": ("button",),
    "brake_tap": (),
}
"""What a script may say, and what each must say with it."""
SCRIPT_LASTS_S = {"press": 0.3, "brake_tap": 0.3}
FIELD_BUTTONS = ("steering", "plus", "minus", "override", "estop", "corner")

_THERE_M = 0.05
_WAITS_S = 2.0
_TURN_RADPS = 0.5
_AIMED_RAD = 0.1
_PER_RAD = 1.0
_TRACK_M = 1.1


class RemoteHands(NamedTuple):
    """What the operator does: the remote control, and the buttons that are pressed."""

    remote: SkidActing
    buttons: frozenset[str]


class Teleoperator:
    """Drives by true pose: turns on the spot towards a place, then straight to it.

    Attributes:
        arrivals: places that were reached; the operator waits two seconds at each.
    """

    def __init__(self) -> None:
        self.arrivals = 0
        self._told: list[Item] = []
        self._waiting: list[Item] = []
        self._rest_s = 0.0

    def step(self, running: Iterable[Item], x_m: float, y_m: float, yaw_rad: float, step_s: float) -> RemoteHands:
        """What the operator does at a true pose of the reference point."""
        items = list(running)
        for item in items:
            if item.name == "stand" and item not in self._told:
                self._waiting = []
            if item.name in ("drive_to", "stand") and item not in self._told:
                self._told.append(item)
                self._waiting += [item] if item.name == "drive_to" else []
        self._rest_s = max(self._rest_s - step_s, 0.0)
        pressed = frozenset(str(item.numbers["button"]) for item in items if item.name == "press")
        pressed |= {"brake_tap"} if any(item.name == "brake_tap" for item in items) else set()
        return RemoteHands(self._drive(x_m, y_m, yaw_rad), pressed)

    def _drive(self, x_m: float, y_m: float, yaw_rad: float) -> SkidActing:
        stands = SkidActing(0.0, 0.0, None)
        if not self._waiting or self._rest_s > 0.0:
            return stands
        goal = self._waiting[0].numbers
        east, north = float(goal["x_m"]) - x_m, float(goal["y_m"]) - y_m
        distance = math.hypot(east, north)
        off = math.remainder(math.atan2(north, east) - yaw_rad, math.tau)
        # At its end a place that is abreast is passed.
        if distance < _THERE_M or (distance < 0.5 and abs(off) > 1.0):
            self._waiting.pop(0)
            self.arrivals += 1
            self._rest_s = _WAITS_S
            return stands
        aimed = abs(off) <= _AIMED_RAD or distance < 0.5
        speed = min(float(goal["speed_mps"]), 0.1 + distance) if aimed else 0.0
        turn = min(max(_PER_RAD * off, -_TURN_RADPS), _TURN_RADPS)
        return SkidActing(speed - 0.5 * _TRACK_M * turn, speed + 0.5 * _TRACK_M * turn, None)
