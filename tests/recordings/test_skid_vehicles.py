"""A skid-steer vehicle's file as parts: each number where it belongs, and what is missing told by its name."""

from pathlib import Path

import pytest

from drawn_field import VEHICLE
from lgprjax.coverage import Tool, default_carrot
from lgprjax.formats import VehicleFile, read_vehicle, with_values, write_vehicle
from lgprjax.recordings import carrot_of, pattern_settings_of, skid_setup_of, tool_of
from refusals import refused


@pytest.fixture
def vehicle(tmp_path: Path) -> VehicleFile:
    path = tmp_path / "v.vehicle.toml"
    path.write_text(VEHICLE)
    return read_vehicle(path)


def test_each_number_is_where_it_belongs(vehicle: VehicleFile) -> None:
    told = with_values(vehicle, {"navigation.gnss_x_m": 0.25, "navigation.gnss_y_m": -0.5, "tool.left_m": 0.1}, {})
    setup = skid_setup_of(told)
    values = [float(each) for each in setup.vehicle]
    assert dict(zip(setup.vehicle._fields, values, strict=True)) == {
        "track_m": 1.0,
        "largest_wheel_mps": 1.0,
        "wheel_rate_mps2": 1.0,
        "smallest_radius_m": 1.0,
    }
    assert (float(setup.model.gnss_x_m), float(setup.model.gnss_y_m), float(setup.model.track_m)) == (0.25, -0.5, 1.0)
    assert setup.tool == Tool(1.0, 0.4, 0.8, 0.1)
    assert tool_of(vehicle) == Tool(1.0, 0.4, 0.8, 0.0)


def test_the_carrot_is_what_the_file_tells_and_else_the_default(vehicle: VehicleFile) -> None:
    assert carrot_of(vehicle) == default_carrot(smallest_radius_m=1.0)
    told = carrot_of(with_values(vehicle, {"carrot.distance_m": 2.5, "carrot.derivative": 0.75}, {}))
    assert (float(told.distance_m), float(told.derivative)) == (2.5, 0.75)
    assert told.proportional_per_m == default_carrot(smallest_radius_m=1.0).proportional_per_m


def test_a_pattern_is_of_the_vehicle(vehicle: VehicleFile) -> None:
    settings = pattern_settings_of(vehicle, overlap=0.2, order="zamboni", turning_room_m=6.0, heading_rad=None)
    assert (settings.tool_width_m, settings.tool_ahead_m, settings.tool_left_m) == (1.0, 0.8, 0.0)
    assert (settings.smallest_radius_m, settings.turning_room_m) == (1.0, 6.0)


def test_what_is_missing_and_another_kind_of_vehicle_are_told_by_name(vehicle: VehicleFile) -> None:
    needed = {
        "skid_steer": ("track_m", "largest_wheel_mps", "wheel_rate_mps2"),
        "tool": ("width_m", "ahead_m"),
    }
    for table, names in needed.items():
        for name in names:
            place = f"{table}.{name}"
            with refused(place, file="f.toml"):
                skid_setup_of(with_values(vehicle, {place: None}, {}), "f.toml")
    other = vehicle.model_copy(update={"steering_kind": "counter_steer"})
    for parts in (skid_setup_of, tool_of, carrot_of):
        with refused("steering_kind", "skid_steer", found="counter_steer"):
            parts(other)


def test_the_made_up_flail_is_whole(tmp_path: Path) -> None:
    path = Path(__file__).parents[2] / "onboard" / "made_up_flail.vehicle.toml"
    flail = read_vehicle(path)
    assert skid_setup_of(flail, path).tool.width_m == 1.2
    carrot_of(flail, path)
    write_vehicle(tmp_path / "again.vehicle.toml", flail)
    assert read_vehicle(tmp_path / "again.vehicle.toml") == flail
