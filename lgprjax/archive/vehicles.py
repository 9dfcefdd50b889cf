"""A vehicle file as the parts that kinematics, simulation, navigation and the runtime take."""

from pathlib import Path

import jax.numpy as jnp

from lgprjax.errors import InputError
from lgprjax.formats import VehicleFile, with_values
from lgprjax.navigation import FilterModel, default_model
from lgprjax.vehicle import (
    Chassis,
    MeasuredRear,
    Pedal,
    Pedals,
    ProportionalRear,
    Rear,
    Servo,
    zero_slip_point,
)


def chassis_of(vehicle: VehicleFile, path: str | Path = "vehicle file") -> Chassis:
    """The chassis that a file describes, scalars in float32.

    Measured rear wheel angles, where the file has them, come before ``steering.rear_ratio``. Without a characteristic
    speed nothing is lost to slip.

    Args:
        vehicle: a counter-steered one.
        path: its file, for errors.

    Raises:
        InputError: a skid-steered vehicle, or a number that is needed is not in the file.
    """
    if vehicle.steering_kind != "counter_steer":
        raise InputError(path, "steering_kind", "counter_steer", repr(vehicle.steering_kind))
    steering = vehicle.steering
    if vehicle.rear_map is not None:
        held = vehicle.rear_map
        knots = jnp.asarray(held.rear_rad, jnp.float32)
        rear: Rear = MeasuredRear(jnp.float32(held.first_rad), jnp.float32(held.step_rad), knots)
    else:
        rear = ProportionalRear(jnp.float32(_needed(path, "steering.rear_ratio", steering.rear_ratio)))
    speed = steering.characteristic_speed_mps
    return Chassis(
        wheelbase_m=jnp.float32(_needed(path, "chassis.wheelbase_m", vehicle.chassis.wheelbase_m)),
        anchor_m=jnp.float32(_needed(path, "pursuit.anchor_m", vehicle.pursuit.anchor_m)),
        rear=rear,
        largest_angle_rad=jnp.float32(
            _needed(path, "steering.largest_wheel_angle_rad", steering.largest_wheel_angle_rad)
        ),
        characteristic_speed_mps=jnp.float32(float("inf") if speed is None else speed),
    )


def servo_of(vehicle: VehicleFile, path: str | Path = "vehicle file") -> Servo:
    """The servo that a file describes, scalars in float32: each part that the file does not tell is off.

    Lag and rate must be told. Without voltages the torque is full at any supply from 1 V.

    Args:
        vehicle: the vehicle.
        path: its file, for errors.

    Raises:
        InputError: a number that is needed is not in the file, or one voltage without the other.
    """
    steering = vehicle.steering
    if (steering.nominal_v is None) != (steering.stall_v is None):
        absent = "nominal_v" if steering.nominal_v is None else "stall_v"
        raise InputError(path, f"steering.{absent}", "nominal_v and stall_v, or neither", "none")
    return Servo(
        lag_s=jnp.float32(_needed(path, "steering.lag_s", steering.lag_s)),
        rate_radps=jnp.float32(_needed(path, "steering.largest_wheel_rate_radps", steering.largest_wheel_rate_radps)),
        delay_s=jnp.float32(steering.delay_s or 0.0),
        dead_band_rad=jnp.float32(steering.dead_band_rad or 0.0),
        backlash_rad=jnp.float32(steering.backlash_rad or 0.0),
        asymmetry=jnp.float32(steering.asymmetry or 0.0),
        nominal_v=jnp.float32(1.0 if steering.nominal_v is None else steering.nominal_v),
        stall_v=jnp.float32(0.0 if steering.stall_v is None else steering.stall_v),
    )


def pedals_of(vehicle: VehicleFile, path: str | Path = "vehicle file") -> Pedals:
    """Both pedals that a file describes, scalars in float32.

    Args:
        vehicle: the vehicle.
        path: its file, for errors.

    Raises:
        InputError: a number that is needed is not in the file.
    """
    throttle, brake = (
        Pedal(
            *(
                jnp.float32(_needed(path, f"{name}.{key}", getattr(table, key)))
                for key in ("pre_tension", "dead_zone", "gain_mps2", "lag_s")
            )
        )
        for name, table in (("throttle", vehicle.throttle), ("brake", vehicle.brake))
    )
    slows = vehicle.resistance
    return Pedals(
        throttle,
        brake,
        jnp.float32(_needed(path, "resistance.rolling_mps2", slows.rolling_mps2)),
        jnp.float32(_needed(path, "resistance.drag_per_s", slows.drag_per_s)),
    )


def filter_model_of(vehicle: VehicleFile, path: str | Path = "vehicle file") -> FilterModel:
    """The navigation filter's model that a file describes: noises that it does not tell are the defaults.

    Without an antenna in the file GNSS positions are taken for those of the rear axle, as drive logs hold them. The
    point without slip is that of small wheel angles.

    Args:
        vehicle: a counter-steered one.
        path: its file, for errors.

    Raises:
        InputError: a skid-steered vehicle, or a number that is needed is not in the file.
    """
    anchor_m = 0.0 if vehicle.pursuit.anchor_m is None else vehicle.pursuit.anchor_m
    chassis = chassis_of(with_values(vehicle, {"pursuit.anchor_m": anchor_m}, {}), path)
    told = vehicle.navigation.model_dump(exclude_none=True)
    model = default_model(
        zero_slip_m=float(zero_slip_point(chassis, jnp.float32(0.0))),
        gnss_x_m=told.pop("gnss_x_m", 0.0),
        gnss_y_m=told.pop("gnss_y_m", 0.0),
        array_x_m=_needed(path, "array.x_m", vehicle.array.x_m),
        array_y_m=0.0,
    )
    return model._replace(**{name: jnp.float32(value) for name, value in told.items()})


def _needed(path: str | Path, place: str, value: float | None) -> float:
    if value is None:
        raise InputError(path, place, "a number (the study that finds it comes first)", "none")
    return value
