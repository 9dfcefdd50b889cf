"""A vehicle file as the watches believe it."""

import math
from pathlib import Path

from lgprjax.autopilot.watch_belief import (
    ChassisBelief,
    Knots,
    PedalBelief,
    PedalsBelief,
    WheelBelief,
    linear_wheel_map,
    proportional_rear,
)
from lgprjax.errors import InputError
from lgprjax.formats import VehicleFile


def wheel_belief(vehicle: VehicleFile, path: Path) -> WheelBelief:
    """Steering.

    Raises:
        InputError: a number that the watches need is not in the file.
    """
    told = vehicle.steering
    largest = _needed(path, "steering.largest_wheel_angle_rad", told.largest_wheel_angle_rad)
    if vehicle.wheel_map is not None:
        held = vehicle.wheel_map
        angles = Knots(held.first_v, held.step_v, tuple(held.front_rad))
    else:
        angles = linear_wheel_map(
            _needed(path, "steering.straight_potentiometer_v", told.straight_potentiometer_v),
            _needed(path, "steering.potentiometer_v_per_rad", told.potentiometer_v_per_rad),
            largest,
        )
    return WheelBelief(
        angles,
        _needed(path, "steering.encoder_counts_per_rad", told.encoder_counts_per_rad),
        largest,
        _needed(path, "steering.lag_s", told.lag_s),
        _needed(path, "steering.largest_wheel_rate_radps", told.largest_wheel_rate_radps),
        told.delay_s or 0.0,
        told.dead_band_rad or 0.0,
        told.backlash_rad or 0.0,
        _needed(path, "steering.nominal_v", told.nominal_v),
        _needed(path, "steering.stall_v", told.stall_v),
    )


def chassis_belief(vehicle: VehicleFile, path: Path) -> ChassisBelief:
    """Steering geometry.

    Raises:
        InputError: a number that the watches need is not in the file.
    """
    if vehicle.rear_map is not None:
        held = vehicle.rear_map
        # The file has rear angles, counter-clockwise positive; what counts here is how far they counter-steer.
        rear = Knots(held.first_rad, held.step_rad, tuple(-angle for angle in held.rear_rad))
    else:
        rear = proportional_rear(_needed(path, "steering.rear_ratio", vehicle.steering.rear_ratio))
    speed = vehicle.steering.characteristic_speed_mps
    return ChassisBelief(
        _needed(path, "chassis.wheelbase_m", vehicle.chassis.wheelbase_m), rear, math.inf if speed is None else speed
    )


def pedals_belief(vehicle: VehicleFile, path: Path) -> PedalsBelief:
    """Both pedals.

    Raises:
        InputError: a number that the watches need is not in the file.
    """
    throttle, brake = (
        PedalBelief(
            *(
                _needed(path, f"{name}.{key}", getattr(table, key))
                for key in ("pre_tension", "dead_zone", "gain_mps2", "lag_s")
            )
        )
        for name, table in (("throttle", vehicle.throttle), ("brake", vehicle.brake))
    )
    slows = vehicle.resistance
    return PedalsBelief(
        throttle,
        brake,
        _needed(path, "resistance.rolling_mps2", slows.rolling_mps2),
        _needed(path, "resistance.drag_per_s", slows.drag_per_s),
    )


def _needed(path: Path, place: str, value: float | None) -> float:
    if value is None:
        raise InputError(path, place, "a number (the study that finds it comes first)", "none")
    return value
