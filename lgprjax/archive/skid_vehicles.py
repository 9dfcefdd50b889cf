"""A skid-steer vehicle's file as the parts that navigation, guidance, coverage and its plans take."""

from pathlib import Path
from typing import Literal, NamedTuple

import jax.numpy as jnp

from lgprjax.coverage import CarrotSettings, PatternSettings, Tool, default_carrot
from lgprjax.errors import InputError
from lgprjax.formats import VehicleFile
from lgprjax.navigation import SkidModel, default_skid_model
from lgprjax.vehicle import SkidSteer


class SkidVehicle(NamedTuple):
    """What a skid-steer vehicle is: how it moves, how it is navigated by, what it works with."""

    vehicle: SkidSteer
    model: SkidModel
    tool: Tool


def skid_setup_of(vehicle: VehicleFile, path: str | Path = "vehicle file") -> SkidVehicle:
    """Kinematics, navigation model and tool that a file describes.

    Without an antenna in the file GNSS positions are taken for those of the reference point.

    Args:
        vehicle: a skid-steer one.
        path: its file, for errors.

    Raises:
        InputError: another kind of vehicle, or a number that is needed is not in the file.
    """
    tool = tool_of(vehicle, path)
    table = vehicle.skid_steer
    track_m = _needed(path, "skid_steer.track_m", table.track_m)
    steer = SkidSteer(
        track_m=jnp.float32(track_m),
        largest_wheel_mps=jnp.float32(_needed(path, "skid_steer.largest_wheel_mps", table.largest_wheel_mps)),
        wheel_rate_mps2=jnp.float32(_needed(path, "skid_steer.wheel_rate_mps2", table.wheel_rate_mps2)),
        smallest_radius_m=jnp.float32(_needed(path, "skid_steer.smallest_radius_m", table.smallest_radius_m)),
    )
    model = default_skid_model(
        track_m=track_m,
        gnss_x_m=vehicle.navigation.gnss_x_m or 0.0,
        gnss_y_m=vehicle.navigation.gnss_y_m or 0.0,
    )
    return SkidVehicle(steer, model, tool)


def tool_of(vehicle: VehicleFile, path: str | Path = "vehicle file") -> Tool:
    """The tool that a file describes; in the vehicle's middle unless the file says otherwise.

    Raises:
        InputError: another kind of vehicle, or a number that is needed is not in the file.
    """
    _require_skid_steer(vehicle, path)
    table = vehicle.tool
    return Tool(
        width_m=_needed(path, "tool.width_m", table.width_m),
        length_m=_needed(path, "tool.length_m", table.length_m),
        ahead_m=_needed(path, "tool.ahead_m", table.ahead_m),
        left_m=table.left_m or 0.0,
    )


def carrot_of(vehicle: VehicleFile, path: str | Path = "vehicle file") -> CarrotSettings:
    """Settings of the carrot: the defaults for the vehicle's smallest radius, and whatever the file tells.

    Raises:
        InputError: another kind of vehicle, or the smallest radius is not in the file.
    """
    _require_skid_steer(vehicle, path)
    radius_m = _needed(path, "skid_steer.smallest_radius_m", vehicle.skid_steer.smallest_radius_m)
    told = vehicle.carrot.model_dump(exclude_none=True)
    settings = default_carrot(smallest_radius_m=radius_m)
    return settings._replace(**{name: jnp.float32(value) for name, value in told.items()})


def pattern_settings_of(
    vehicle: VehicleFile,
    path: str | Path = "vehicle file",
    *,
    overlap: float,
    order: Literal["zamboni", "boustrophedon"],
    turning_room_m: float,
    heading_rad: float | None,
) -> PatternSettings:
    """Settings of a pattern for a vehicle.

    Args:
        vehicle: a skid-steer one.
        path: its file, for errors.
        overlap, order, turning_room_m, heading_rad: as in ``PatternSettings``.

    Raises:
        InputError: another kind of vehicle, a number that is needed is not in the file, or a setting out of its range.
    """
    tool = tool_of(vehicle, path)
    return PatternSettings(
        tool_width_m=tool.width_m,
        overlap=overlap,
        order=order,
        smallest_radius_m=_needed(path, "skid_steer.smallest_radius_m", vehicle.skid_steer.smallest_radius_m),
        turning_room_m=turning_room_m,
        tool_ahead_m=tool.ahead_m,
        tool_left_m=tool.left_m,
        heading_rad=heading_rad,
    )


def _require_skid_steer(vehicle: VehicleFile, path: str | Path) -> None:
    if vehicle.steering_kind != "skid_steer":
        raise InputError(path, "steering_kind", "skid_steer", repr(vehicle.steering_kind))


def _needed(path: str | Path, place: str, value: float | None) -> float:
    if value is None:
        raise InputError(path, place, "a number, measured for the vehicle", "none")
    return value
