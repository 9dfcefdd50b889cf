"""The manoeuvres that a drives file may name: how each is made of its numbers, and what these may be."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from lgprjax.scene.manoeuvres import (
    Manoeuvre,
    drive_palm_tree,
    drive_straight,
    drive_turns,
    step_pedals,
    step_steering,
    turn_standing,
)
from lgprjax.scene.vehicle_drive import TrueVehicle

Range = tuple[float, float]

_SPEED_MPS, _ANGLE_RAD, _HOLD_S, _SHARE = (0.2, 15.0), (-1.2, 1.2), (0.5, 120.0), (0.0, 1.0)


class Kind(NamedTuple):
    """A manoeuvre: how it is made of the vehicle and its numbers, and the range of each; lists have plural names."""

    make: Callable[[TrueVehicle, Mapping[str, Any]], Manoeuvre]
    ranges: dict[str, Range]
    needed: tuple[str, ...] = ()


def _palm_tree(vehicle: TrueVehicle, numbers: Mapping[str, Any]) -> Manoeuvre:
    # The ratio only says how long an arc is to be.
    ratio = vehicle.rear if isinstance(vehicle.rear, float) else 0.5
    limits = (vehicle.largest_angle_rad, vehicle.lock_to_lock_turns)
    return drive_palm_tree(vehicle.wheelbase_m, ratio, *limits, **numbers)


MANOEUVRES = {
    "straight": Kind(
        lambda _, numbers: drive_straight(**numbers),
        {"length_m": (5.0, 5e3), "speed_mps": _SPEED_MPS, "weave_rad": (0.0, 0.2), "weave_m": (2.0, 500.0)},
        ("length_m", "speed_mps"),
    ),
    "standing": Kind(
        lambda vehicle, numbers: turn_standing(vehicle.largest_angle_rad, vehicle.lock_to_lock_turns, **numbers),
        {"pause_s": _HOLD_S},
    ),
    "palm_tree": Kind(
        _palm_tree,
        {"speed_mps": _SPEED_MPS, "arc_turns": (0.05, 1.0), "longest_m": (2.0, 200.0), "pause_s": _HOLD_S},
    ),
    "turns": Kind(
        lambda _, numbers: drive_turns(**numbers),
        {"speeds_mps": _SPEED_MPS, "angles_rad": _ANGLE_RAD, "hold_s": _HOLD_S},
        ("speeds_mps", "angles_rad"),
    ),
    "steering_steps": Kind(
        lambda _, numbers: step_steering(**numbers),
        {
            "sizes_rad": _ANGLE_RAD,
            "speed_mps": (0.0, 15.0),
            "hold_s": _HOLD_S,
            "sweep_rad": (0.0, 1.2),
            "sweep_s": (5.0, 600.0),
        },
        ("sizes_rad",),
    ),
    "pedal_steps": Kind(
        lambda _, numbers: step_pedals(**numbers),
        {"throttles": _SHARE, "brakes": _SHARE, "back": _SHARE, "hold_s": _HOLD_S},
        ("throttles", "brakes"),
    ),
}
"""By the word that a drives file has for them."""
LISTS = frozenset({"speeds_mps", "angles_rad", "angles_deg", "sizes_rad", "sizes_deg", "throttles", "brakes"})
"""Keys that hold a list of numbers."""
