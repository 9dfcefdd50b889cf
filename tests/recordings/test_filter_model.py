"""The navigation filter's model from a vehicle file."""

import math
from pathlib import Path

import pytest

from lgprjax.formats import VehicleFile, read_vehicle, with_values, write_vehicle
from lgprjax.formats.vehicle import NavigationTable
from lgprjax.navigation import FilterModel, default_model
from lgprjax.recordings import array_of_vehicle, filter_model_of
from refusals import refused

_VEHICLE = VehicleFile.model_validate(
    {
        "name": "test vehicle",
        "steering_kind": "counter_steer",
        "chassis": {"wheelbase_m": 3.8},
        "steering": {"rear_ratio": 0.63, "largest_wheel_angle_rad": 0.5},
        "array": {"x_m": 6.1},
    }
)


def test_what_the_file_tells_comes_before_the_defaults() -> None:
    told = {"navigation.gnss_x_m": 1.2, "navigation.gnss_y_m": -0.3, "navigation.lgpr_error_m": 7.5}
    model = filter_model_of(with_values(_VEHICLE, told, {}))
    usual = default_model(zero_slip_m=0.63 * 3.8 / 1.63, gnss_x_m=1.2, gnss_y_m=-0.3, array_x_m=6.1, array_y_m=0.0)
    for name, wanted in usual._asdict().items():
        assert float(getattr(model, name)) == pytest.approx(7.5 if name == "lgpr_error_m" else float(wanted)), name


def test_every_key_of_the_table_is_a_field_of_the_model_and_changes_it(tmp_path: Path) -> None:
    names = list(NavigationTable.model_fields)
    assert set(names) <= set(FilterModel._fields)
    told = {f"navigation.{name}": 0.25 + 0.125 * i for i, name in enumerate(names)}
    path = tmp_path / "x.vehicle.toml"
    write_vehicle(path, with_values(_VEHICLE, told, {}))
    model = filter_model_of(read_vehicle(path), path)
    for place, value in told.items():
        assert float(getattr(model, place.removeprefix("navigation."))) == value


def test_file_of_the_version_before_is_read(tmp_path: Path) -> None:
    path = tmp_path / "x.vehicle.toml"
    write_vehicle(path, _VEHICLE)
    path.write_text(path.read_text().replace('schema_version = "1.5"', 'schema_version = "1.1"'))
    assert "1.1" in path.read_text()
    assert read_vehicle(path) == _VEHICLE


def test_the_array_has_the_point_without_slip_of_its_filter() -> None:
    placed = with_values(_VEHICLE, {"array.height_m": 0.3}, {})
    array = array_of_vehicle(placed, "x.vehicle.toml", channels=3, pitch_m=0.1, scan_period_s=0.01)
    assert array.zero_slip_m == pytest.approx(0.63 * 3.8 / 1.63)
    assert array.zero_slip_m == pytest.approx(float(filter_model_of(placed).zero_slip_m))
    unsaid = placed.model_copy(update={"steering": placed.steering.model_copy(update={"rear_ratio": None})})
    array = array_of_vehicle(unsaid, "x.vehicle.toml", channels=3, pitch_m=0.1, scan_period_s=0.01)
    assert array.zero_slip_m == 0.0


def test_what_no_filter_can_have_is_refused_by_its_key(tmp_path: Path) -> None:
    nowhere = _VEHICLE.model_copy(update={"array": type(_VEHICLE.array)()})
    with refused("array.x_m"):
        filter_model_of(nowhere)
    for value in (0.0, math.nan):
        wrong = with_values(_VEHICLE, {"navigation.side_noise": value}, {})
        with refused("navigation.side_noise"):
            write_vehicle(tmp_path / "x.vehicle.toml", wrong)


def test_a_vehicle_that_is_not_calibrated_yet_has_a_model() -> None:
    """Rear wheels that do not steer, lengths by tape, and nothing else: a first drive is recorded with it."""
    known = {"name": "kit", "steering_kind": "counter_steer", "chassis": {"wheelbase_m": 3.2}, "array": {"x_m": 6.2}}
    model = filter_model_of(VehicleFile.model_validate({**known, "steering": {"rear_ratio": 0.0}}))
    assert float(model.zero_slip_m) == 0.0
    assert float(model.array_x_m) == pytest.approx(6.2)
