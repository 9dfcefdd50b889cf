"""The vehicle file: what goes in comes out, what is wrong is one line that names the field."""

import math
import tomllib
from pathlib import Path

import pytest
from pydantic import BaseModel, ValidationError

from lgprjax.formats import (
    Found,
    RearMap,
    VehicleFile,
    WheelMap,
    check_file,
    load_schema,
    read_vehicle,
    require_serial_number,
    write_vehicle,
)
from lgprjax.formats.vehicle import ChassisTable, PursuitTable, SteeringTable
from refusals import refused

_FOUND = "found.steering.rear_ratio"
_TEXT = """
schema = "lgprjax.vehicle"
schema_version = "1.1"
name = "test vehicle"
steering_kind = "counter_steer"
serial_number = "A-17"
[chassis]
wheelbase_m = 3.3
[steering]
rear_ratio = 0.63
largest_wheel_angle_rad = 0.52
largest_wheel_rate_radps = 0.5
dead_band_rad = 0.003
nominal_v = 24
stall_v = 10
[rear_map]
first_rad = -0.5
step_rad = 0.5
rear_rad = [-0.3, 0.0, 0.3]
[wheel_map]
first_v = 1.0
step_v = 1.0
front_rad = [-0.5, 0.0, 0.5]
[pursuit]
short_m = 4.0
long_m = 8.0
slow_mps = 1.0
fast_mps = 5.0
[found."steering.rear_ratio"]
low = 0.62
high = 0.64
study = "k"
log = "a.drive.h5"
"""


def _write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "a.vehicle.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_file_is_read_and_good(tmp_path: Path) -> None:
    path = _write(tmp_path, _TEXT)
    assert check_file(path) == []
    vehicle = read_vehicle(path)
    assert vehicle.serial_number == "A-17"
    assert vehicle.chassis == ChassisTable(wheelbase_m=3.3)
    assert vehicle.steering.nominal_v == 24.0
    assert vehicle.rear_map is not None
    assert vehicle.rear_map.rear_rad == [-0.3, 0.0, 0.3]
    assert vehicle.found["steering.rear_ratio"].high == 0.64


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    vehicle = VehicleFile(
        name='the "yellow" one, Ä',
        steering_kind="counter_steer",
        chassis=ChassisTable(wheelbase_m=1.0 / 3.0),
        steering=SteeringTable(rear_ratio=0.1 + 0.2, lag_s=1e-17, straight_potentiometer_v=-2.5),
        rear_map=RearMap(first_rad=-0.5, step_rad=0.5, rear_rad=[-0.3, 0.01, 0.3]),
        wheel_map=WheelMap(first_v=1.0, step_v=0.5, front_rad=[0.5, 0.1, -0.5]),
        pursuit=PursuitTable(anchor_m=6.5),
        found={
            "steering.rear_ratio": Found(low=0.2, high=0.4, sigma=0.01, study="k", log="a, b"),
            "wheel_map.front_rad": Found(low=[0.4, 0.0, -0.6], high=[0.6, 0.2, -0.4], study="palm", log="a"),
        },
    )
    path = tmp_path / "b.vehicle.toml"
    write_vehicle(path, vehicle)
    assert read_vehicle(path) == vehicle
    assert check_file(path) == []
    # An outside reader of TOML finds the same numbers at the paths of the schema.
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    assert table["steering"]["rear_ratio"] == 0.1 + 0.2
    assert table["found"]["steering.rear_ratio"] == {
        "low": 0.2,
        "high": 0.4,
        "sigma": 0.01,
        "study": "k",
        "log": "a, b",
    }
    before = path.read_bytes()
    with refused("output", "--force"):
        write_vehicle(path, vehicle.model_copy(update={"name": "other"}))
    assert path.read_bytes() == before
    write_vehicle(path, vehicle.model_copy(update={"name": "other"}), force=True)
    assert read_vehicle(path).name == "other"
    assert [entry.name for entry in tmp_path.iterdir()] == ["b.vehicle.toml"]


def test_a_kit_that_only_steers_says_so_and_no_other_file_does(tmp_path: Path) -> None:
    path = _write(tmp_path, _TEXT.replace("[chassis]", "speed_control = false\n[chassis]"))
    only = read_vehicle(path)
    assert not only.speed_control
    assert read_vehicle(_write(tmp_path, _TEXT)).speed_control
    write_vehicle(tmp_path / "only.vehicle.toml", only)
    assert read_vehicle(tmp_path / "only.vehicle.toml") == only
    write_vehicle(tmp_path / "both.vehicle.toml", only.model_copy(update={"speed_control": True}))
    assert "speed_control" not in (tmp_path / "both.vehicle.toml").read_text(encoding="utf-8")


def test_a_value_out_of_range_is_not_written(tmp_path: Path) -> None:
    wrong = VehicleFile(name="x", steering_kind="counter_steer", chassis=ChassisTable(wheelbase_m=-1.0))
    with refused("chassis.wheelbase_m", 0.1, 20, found=-1):
        write_vehicle(tmp_path / "c.vehicle.toml", wrong)
    assert list(tmp_path.iterdir()) == []


_WRONG: list[tuple[str, str, str, tuple[object, ...]]] = [
    ("3.3", "-3.3", "chassis.wheelbase_m", (0.1, 20, -3.3)),
    ("3.3", '"long"', "chassis.wheelbase_m", ("'long'",)),
    ("3.3", "nan", "chassis.wheelbase_m", ("nan",)),
    ("3.3", "50", "chassis.wheelbase_m", (20, 50)),
    ("wheelbase_m", "wheel_base_m", "chassis.wheel_base_m", ("data_schema/vehicle.toml",)),
    ("[chassis]", "chassis = 3\n[other]", "chassis", (3,)),
    ("counter_steer", "crab", "steering_kind", ("counter_steer", "skid_steer", "'crab'")),
    ("0.63", "1.63", "steering.rear_ratio", (0, 1, 1.63)),
    ('serial_number = "A-17"', "serial_number = 17", "serial_number", (17,)),
    ('name = "test vehicle"', "", "name", ("none",)),
    # Numbers that look like another unit are told in the right one.
    ("0.52", "12.25", "steering.largest_wheel_angle_rad", (12.25, f"{math.radians(12.25):.4g}")),
    ("rate_radps = 0.5", "rate_radps = 28.6", "steering.largest_wheel_rate_radps", (0.4992,)),
    ("3.3", "3300", "chassis.wheelbase_m", (3300, 3.3)),
    ("short_m = 4.0", "short_m = 4000", "pursuit.short_m", ("4 m",)),
    ("0.003", "0.5", "steering.dead_band_rad", (0.008727,)),
    ("0.003", "-0.5", "steering.dead_band_rad", (0, 0.2, -0.5)),
    ("[-0.3, 0.0, 0.3]", "[-17.0, 0.0, 0.3]", "rear_map.rear_rad[0]", (-17,)),
    ("[-0.3, 0.0, 0.3]", "0.3", "rear_map.rear_rad", (0.3,)),
    ("[-0.3, 0.0, 0.3]", "[0.3]", "rear_map.rear_rad", (2,)),
    ("first_rad = -0.5\n", "", "rear_map.first_rad", ("none",)),
    ("[-0.5, 0.0, 0.5]", "[-0.5, 0.6, 0.5]", "wheel_map.front_rad", ()),
    ("stall_v = 10", "stall_v = 25", "steering.stall_v", ("nominal_v", 24, 25)),
    ("fast_mps = 5.0", "fast_mps = 0.5", "pursuit.fast_mps", ("slow_mps", 1, 0.5)),
    ("low = 0.62", "low = 0.635", _FOUND, (0.63,)),
    ('"steering.rear_ratio"]', '"steering.lag_s"]', "found.steering.lag_s", ("none",)),
    ("low = 0.62", "lower = 0.62", f"{_FOUND}.lower", ("data_schema",)),
    ("low = 0.62", "low = [0.62, 0.62]", _FOUND, (1, "2 and 1")),
    ("lgprjax.vehicle", "lgprjax.drive", "@schema", ("lgprjax.vehicle", "lgprjax.drive")),
    ("[steering]", "[steering", "file", ("TOML",)),
    ("[chassis]", "speed_control = 0\n[chassis]", "speed_control", (0,)),
    ('"counter_steer"', '"skid_steer"\nspeed_control = false', "speed_control", ("true",)),
    ("[chassis]", "speed_control = false\n[brake]\nlag_s = 0.2\n[chassis]", "brake", ("speed_control",)),
    ("[chassis]", "speed_control = false\n[resistance]\nrolling_mps2 = 0.1\n[chassis]", "resistance", ()),
]


def test_what_is_wrong_is_refused(tmp_path: Path) -> None:
    for old, new, place, values in _WRONG:
        assert old in _TEXT
        path = _write(tmp_path, _TEXT.replace(old, new, 1))
        with refused(place, *values, file=path):
            read_vehicle(path)
        assert place in [finding.place for finding in check_file(path)]


def test_a_missing_file_and_another_vehicle_are_refused(tmp_path: Path) -> None:
    with refused("file", file="none.vehicle.toml"):
        read_vehicle(tmp_path / "none.vehicle.toml")
    place = "/vehicle@serial_number"
    own = VehicleFile(name="x", steering_kind="counter_steer", serial_number="A-17")
    require_serial_number(own, "a.vehicle.toml", "A-17", "b.drive.h5", place)
    require_serial_number(own, "a.vehicle.toml", None, "b.drive.h5", place)
    with refused(place, "a.vehicle.toml", "'A-17'", file="b.drive.h5", found="'B-1'"):
        require_serial_number(own, "a.vehicle.toml", "B-1", "b.drive.h5", place)
    with refused(place, "a.vehicle.toml", "serial_number", found="'B-1'"):
        nameless = own.model_copy(update={"serial_number": None})
        require_serial_number(nameless, "a.vehicle.toml", "B-1", "b.drive.h5", place)


def test_model_is_strict() -> None:
    with pytest.raises(ValidationError):
        ChassisTable.model_validate({"wheelbase_m": "3.3"})
    with pytest.raises(ValidationError):
        ChassisTable.model_validate({"wheelbase": 3.3})


def _paths(model: type[BaseModel], prefix: str = "") -> set[str]:
    """Paths of the numbers and texts of a model, found in its annotations."""
    found: set[str] = set()
    for name, field in model.model_fields.items():
        parts = [field.annotation, *getattr(field.annotation, "__args__", ())]
        inner = [part for part in parts if isinstance(part, type) and issubclass(part, BaseModel)]
        between = "*." if "dict" in str(field.annotation) else ""
        found |= _paths(inner[0], f"{prefix}{name}.{between}") if inner else {f"{prefix}{name}"}
    return found


def test_model_and_schema_know_the_same_keys() -> None:
    assert _paths(VehicleFile) == {entry.path for entry in load_schema("vehicle").keys}


def test_keys_that_carry_a_unit_have_it() -> None:
    units = {"m": "m", "rad": "rad", "s": "s", "v": "V", "mps": "m/s", "radps": "rad/s", "mps2": "m/s2"}
    for entry in load_schema("vehicle").keys:
        last = entry.path.rpartition("_")[2]
        if last in units and entry.dtype == ("number",) and "_per_" not in entry.path:
            assert entry.unit == units[last], entry.path
        if entry.unit == "rad":
            assert entry.path.endswith("_rad"), entry.path
            # What has no range cannot be told from degrees.
            assert entry.bounds is not None, entry.path
