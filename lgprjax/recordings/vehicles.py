"""Parts of a vehicle file for kinematics, simulation, navigation and the runtime."""

from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lgprjax.coverage import CarrotSettings, Outline, PatternSettings, Tool, default_carrot, outline_of
from lgprjax.coverage.swaths import Order
from lgprjax.errors import InputError
from lgprjax.formats import VehicleFile, flat_keys
from lgprjax.navigation import FilterModel, SkidModel, cautious_skid_model, default_model
from lgprjax.radar import ArrayGeometry, uniform_array
from lgprjax.vehicle import (
    Chassis,
    MeasuredRear,
    Pedal,
    Pedals,
    ProportionalRear,
    Rear,
    Servo,
    SkidSteer,
    zero_slip_point,
)


def chassis_of(vehicle: VehicleFile, path: str | Path = "vehicle file") -> Chassis:
    """The chassis of a vehicle file, scalars in float32.

    Measured rear wheel angles, if the file has them, take precedence over ``steering.rear_ratio``. Without a
    characteristic speed there is no slip.

    Args:
        vehicle: file of a counter-steered vehicle.
        path: path of the file, for error messages.

    Raises:
        InputError: a skid-steered vehicle, or a required number is not in the file.
    """
    if vehicle.steering_kind != "counter_steer":
        raise InputError(path, "steering_kind", "counter_steer", repr(vehicle.steering_kind))
    steering = vehicle.steering
    speed = steering.characteristic_speed_mps
    return Chassis(
        wheelbase_m=jnp.float32(_needed(path, "chassis.wheelbase_m", vehicle.chassis.wheelbase_m)),
        anchor_m=jnp.float32(_needed(path, "pursuit.anchor_m", vehicle.pursuit.anchor_m)),
        rear=_rear_of(vehicle, path),
        largest_angle_rad=jnp.float32(
            _needed(path, "steering.largest_wheel_angle_rad", steering.largest_wheel_angle_rad)
        ),
        characteristic_speed_mps=jnp.float32(float("inf") if speed is None else speed),
    )


def _rear_of(vehicle: VehicleFile, path: str | Path = "vehicle file") -> Rear:
    held = vehicle.rear_map
    if held is None:
        return ProportionalRear(jnp.float32(_needed(path, "steering.rear_ratio", vehicle.steering.rear_ratio)))
    knots = jnp.asarray(held.rear_rad, jnp.float32)
    return MeasuredRear(jnp.float32(held.first_rad), jnp.float32(held.step_rad), knots)


def servo_of(vehicle: VehicleFile, path: str | Path = "vehicle file") -> Servo:
    """The servo of a vehicle file, scalars in float32; parts that the file does not describe are off.

    Lag and rate are required. Without voltages the torque is full at any supply from 1 V.

    Args:
        vehicle: vehicle file.
        path: path of the file, for error messages.

    Raises:
        InputError: a required number is not in the file, or one voltage without the other.
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


def pedals_of(vehicle: VehicleFile, path: str | Path = "vehicle file") -> Pedals | None:
    """Both pedals of a vehicle file, scalars in float32; ``None`` if the kit only steers.

    Args:
        vehicle: vehicle file.
        path: path of the file, for error messages.

    Raises:
        InputError: a required number is not in the file.
    """
    if not vehicle.speed_control:
        return None
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
    """The navigation filter's model of a vehicle file; missing noises take their defaults.

    Without an antenna in the file GNSS positions are taken as those of the rear axle, as in drive logs. The point
    without slip is that of small wheel angles.

    Args:
        vehicle: file of a counter-steered vehicle.
        path: path of the file, for error messages.

    Raises:
        InputError: a skid-steered vehicle, or a required number is not in the file.
    """
    # All that it needs of the chassis: what else there is may be open when a first drive is recorded.
    if vehicle.steering_kind != "counter_steer":
        raise InputError(path, "steering_kind", "counter_steer", repr(vehicle.steering_kind))
    _needed(path, "chassis.wheelbase_m", vehicle.chassis.wheelbase_m)
    _rear_of(vehicle, path)
    stated = vehicle.navigation.model_dump(exclude_none=True)
    model = default_model(
        zero_slip_m=_zero_slip_of(vehicle),
        gnss_x_m=stated.pop("gnss_x_m", 0.0),
        gnss_y_m=stated.pop("gnss_y_m", 0.0),
        array_x_m=_needed(path, "array.x_m", vehicle.array.x_m),
        array_y_m=0.0,
    )
    return model._replace(**{name: jnp.float32(value) for name, value in stated.items()})


def _needed(path: str | Path, place: str, value: float | None) -> float:
    if value is None:
        raise InputError(path, place, "a number (run the study that estimates it first)", "none")
    return value


# Numbers of a counter-steered vehicle that a run needs, and those that are still open.


class NeededNumber(NamedTuple):
    """A number of the vehicle file that driving needs.

    Attributes:
        path: path in the file; alternatives are separated by a bar.
        why: use of the number.
        step: step of ``lgprjax calibrate`` that finds it; "tape" or "data sheet" for numbers stated by the crew.
    """

    path: str
    why: str
    step: str


_PEDAL_KEYS = ("pre_tension", "dead_zone", "gain_mps2", "lag_s")
NEEDED_TO_DRIVE = (
    NeededNumber("chassis.wheelbase_m", "curvature of every command", "tape"),
    NeededNumber("array.x_m", "place of the antennas", "tape"),
    NeededNumber("array.height_m", "place of the antennas", "tape"),
    NeededNumber("pursuit.anchor_m", "the point that follows the path", "tape"),
    NeededNumber("steering.rear_ratio|rear_map.rear_rad", "curvature of every command", "palm_tree"),
    NeededNumber("steering.largest_wheel_angle_rad", "limit of every command", "palm_tree"),
    NeededNumber("wheel_map.front_rad|steering.straight_potentiometer_v", "measured wheel angle", "palm_tree"),
    NeededNumber("wheel_map.front_rad|steering.potentiometer_v_per_rad", "measured wheel angle", "palm_tree"),
    NeededNumber("steering.encoder_counts_per_rad", "comparison of the wheel sensors", "half_turns"),
    NeededNumber("steering.lag_s", "monitor of the servo", "steering"),
    NeededNumber("steering.largest_wheel_rate_radps", "limit of every command", "steering"),
    NeededNumber("steering.nominal_v", "torque of the servo", "steering"),
    NeededNumber("steering.stall_v", "torque of the servo", "steering"),
    *(
        NeededNumber(f"{pedal}.{key}", "control of the speed", "pedals")
        for pedal in ("throttle", "brake")
        for key in _PEDAL_KEYS
    ),
    NeededNumber("resistance.rolling_mps2", "control of the speed", "pedals"),
    NeededNumber("resistance.drag_per_s", "control of the speed", "pedals"),
    *(
        NeededNumber(f"pursuit.{key}", "look-ahead over the speed", "look_ahead")
        for key in ("short_m", "long_m", "slow_mps", "fast_mps")
    ),
)
"""Numbers in the order in which a new vehicle gets them."""


def open_numbers(vehicle: VehicleFile, *, radar: bool = True) -> list[NeededNumber]:
    """Numbers that driving needs and the file does not have: neither known nor assumed. ``radar``: with its array."""
    held = flat_keys(vehicle.model_dump(exclude_none=True, exclude={"found"}))
    absent: list[str] = [] if vehicle.speed_control else ["throttle.", "brake.", "resistance."]
    absent += [] if radar else ["array."]
    return [
        each
        for each in NEEDED_TO_DRIVE
        if not each.path.startswith(tuple(absent)) and not any(path in held for path in each.path.split("|"))
    ]


def require_drivable(vehicle: VehicleFile, path: str | Path, *, radar: bool) -> None:
    """Refuse a vehicle file of which a number that driving needs is open. ``radar``: with its array.

    Raises:
        InputError: the first of them; it names the others.
    """
    missing = open_numbers(vehicle, radar=radar)
    if missing:
        first, others = missing[0], ", ".join(each.path for each in missing[1:])
        expected = f"a number for the {first.why} (lgprjax calibrate {Path(path).name}, step {first.step})"
        raise InputError(path, first.path, expected, "open" + (f", as {others}" if others else ""))


# Where the channels of the radar array are.


def array_of_vehicle(
    vehicle: VehicleFile, path: str | Path, *, channels: int, pitch_m: float, scan_period_s: float
) -> ArrayGeometry:
    """Position of each channel from the vehicle file, else evenly spaced as the map's.

    Raises:
        InputError: the position of the array is missing, or a list has another number of channels.
    """
    place = vehicle.array
    if place.x_m is None or place.height_m is None:
        raise InputError(path, "array", "x_m and height_m", "none")
    even = uniform_array(channels, pitch_m, x_m=place.x_m, height_m=place.height_m, scan_period_s=scan_period_s)
    return ArrayGeometry(
        of_channels(place.channel_x_m, even.x_m, channels, path, "array.channel_x_m"),
        of_channels(place.channel_y_m, even.y_m, channels, path, "array.channel_y_m"),
        of_channels(place.channel_time_s, even.time_offset_s, channels, path, "array.channel_time_s"),
        place.height_m,
        _zero_slip_of(vehicle),
    )


def _zero_slip_of(vehicle: VehicleFile) -> float:
    """Distance ahead of the rear axle, in metres, of the point that moves along the body's axis, at small wheel angles.

    0 if the rear wheels do not steer, or the file does not describe them.
    """
    wheelbase_m, known = vehicle.chassis.wheelbase_m, vehicle.rear_map or vehicle.steering.rear_ratio
    if vehicle.steering_kind != "counter_steer" or known is None or wheelbase_m is None:
        return 0.0
    nothing = jnp.float32(0.0)
    return float(
        zero_slip_point(Chassis(jnp.float32(wheelbase_m), nothing, _rear_of(vehicle), nothing, nothing), nothing)
    )


def of_channels(
    stated: list[float] | None,
    otherwise: float | Float[np.ndarray, " channel"],
    channels: int,
    path: str | Path,
    key: str,
) -> Float[np.ndarray, " channel"]:
    """A list of the vehicle file, or the default ``otherwise``.

    Raises:
        InputError: the list has another number of channels.
    """
    if stated is None:
        return np.broadcast_to(np.asarray(otherwise, np.float64), (channels,)).copy()
    if len(stated) != channels:
        raise InputError(path, key, f"{channels} numbers, one for each channel of the radar", str(len(stated)))
    return np.asarray(stated, np.float64)


# Parts of a skid-steer vehicle's file for navigation, guidance, coverage and its plans.


class SkidVehicle(NamedTuple):
    """A skid-steer vehicle: kinematics, navigation model, tool, and the outline of vehicle and tool."""

    vehicle: SkidSteer
    model: SkidModel
    tool: Tool
    outline: Outline


def skid_setup_of(vehicle: VehicleFile, path: str | Path = "vehicle file") -> SkidVehicle:
    """Kinematics, navigation model and tool of a vehicle file.

    Without an antenna in the file GNSS positions are taken as those of the reference point.

    Args:
        vehicle: file of a skid-steer vehicle.
        path: path of the file, for error messages.

    Raises:
        InputError: another kind of vehicle, or a required number is not in the file.
    """
    tool = tool_of(vehicle, path)
    table = vehicle.skid_steer
    track_m = _skid_needed(path, "skid_steer.track_m", table.track_m)
    steer = SkidSteer(
        track_m=jnp.float32(track_m),
        largest_wheel_mps=jnp.float32(_skid_needed(path, "skid_steer.largest_wheel_mps", table.largest_wheel_mps)),
        wheel_rate_mps2=jnp.float32(_skid_needed(path, "skid_steer.wheel_rate_mps2", table.wheel_rate_mps2)),
        smallest_radius_m=jnp.float32(_skid_needed(path, "skid_steer.smallest_radius_m", table.smallest_radius_m)),
    )
    model = cautious_skid_model(
        track_m=track_m,
        gnss_x_m=vehicle.navigation.gnss_x_m or 0.0,
        gnss_y_m=vehicle.navigation.gnss_y_m or 0.0,
    )
    return SkidVehicle(steer, model, tool, outline_of_vehicle(vehicle, path))


def machine_of(vehicle: VehicleFile) -> str:
    """Name and serial number, which distinguishes machines of one make."""
    return f"{vehicle.name} {vehicle.serial_number or ''}".strip()


def outline_of_vehicle(vehicle: VehicleFile, path: str | Path = "vehicle file") -> Outline:
    """The rectangle around track, tool and, where the file has one, the body.

    Raises:
        InputError: another kind of vehicle, or a required number is not in the file.
    """
    body = vehicle.body
    stated = [body.front_m, body.rear_m, body.left_m, body.right_m]
    track_m = _skid_needed(path, "skid_steer.track_m", vehicle.skid_steer.track_m)
    if all(each is None for each in stated):
        return outline_of(tool_of(vehicle, path), track_m=track_m)
    front, rear, left, right = (
        _skid_needed(path, f"body.{name}_m", value)
        for name, value in zip(("front", "rear", "left", "right"), stated, strict=True)
    )
    return outline_of(tool_of(vehicle, path), Outline(front, -rear, left, -right), track_m=track_m)


def tool_of(vehicle: VehicleFile, path: str | Path = "vehicle file") -> Tool:
    """The tool of a vehicle file; centred on the vehicle by default.

    Raises:
        InputError: another kind of vehicle, or a required number is not in the file.
    """
    _require_skid_steer(vehicle, path)
    table = vehicle.tool
    return Tool(
        width_m=_skid_needed(path, "tool.width_m", table.width_m),
        length_m=_skid_needed(path, "tool.length_m", table.length_m),
        ahead_m=_skid_needed(path, "tool.ahead_m", table.ahead_m),
        left_m=table.left_m or 0.0,
    )


def carrot_of(vehicle: VehicleFile, path: str | Path = "vehicle file") -> CarrotSettings:
    """Settings of the lookahead point: the defaults for the vehicle's smallest radius, and values from the file.

    Raises:
        InputError: another kind of vehicle, or the smallest radius is not in the file.
    """
    _require_skid_steer(vehicle, path)
    radius_m = _skid_needed(path, "skid_steer.smallest_radius_m", vehicle.skid_steer.smallest_radius_m)
    stated = vehicle.carrot.model_dump(exclude_none=True)
    settings = default_carrot(smallest_radius_m=radius_m)
    return settings._replace(**{name: jnp.float32(value) for name, value in stated.items()})


def pattern_settings_of(
    vehicle: VehicleFile,
    path: str | Path = "vehicle file",
    *,
    overlap: float,
    order: Order,
    turning_room_m: float,
    heading_rad: float | None,
) -> PatternSettings:
    """Settings of a pattern for a vehicle.

    Args:
        vehicle: file of a skid-steer vehicle.
        path: path of the file, for error messages.
        overlap, order, turning_room_m, heading_rad: as in ``PatternSettings``.

    Raises:
        InputError: the vehicle is of another kind, a required number is not in the file, or a setting is out of range.
    """
    tool = tool_of(vehicle, path)
    return PatternSettings(
        tool_width_m=tool.width_m,
        overlap=overlap,
        order=order,
        smallest_radius_m=_skid_needed(path, "skid_steer.smallest_radius_m", vehicle.skid_steer.smallest_radius_m),
        turning_room_m=turning_room_m,
        tool_ahead_m=tool.ahead_m,
        tool_left_m=tool.left_m,
        heading_rad=heading_rad,
    )


def _require_skid_steer(vehicle: VehicleFile, path: str | Path) -> None:
    if vehicle.steering_kind != "skid_steer":
        raise InputError(path, "steering_kind", "skid_steer", repr(vehicle.steering_kind))


def _skid_needed(path: str | Path, place: str, value: float | None) -> float:
    if value is None:
        raise InputError(path, place, "a number, measured for the vehicle", "none")
    return value
