"""The vehicle file: what goes in comes out, what is wrong is one line that names the field."""

import math
import tomllib
from pathlib import Path

import pytest
from pydantic import BaseModel, ValidationError

from lgprjax.errors import InputError
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
    assert "k, magnitude of rear over front wheel angle" in path.read_text(encoding="utf-8")
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"expected a new file, or --force"):
        write_vehicle(path, vehicle.model_copy(update={"name": "other"}))
    assert path.read_bytes() == before
    write_vehicle(path, vehicle.model_copy(update={"name": "other"}), force=True)
    assert read_vehicle(path).name == "other"
    assert [entry.name for entry in tmp_path.iterdir()] == ["b.vehicle.toml"]


def test_a_value_out_of_range_is_not_written(tmp_path: Path) -> None:
    wrong = VehicleFile(name="x", steering_kind="counter_steer", chassis=ChassisTable(wheelbase_m=-1.0))
    with pytest.raises(InputError, match=r"chassis.wheelbase_m: expected a number, finite, from 0.1 to 20, found -1"):
        write_vehicle(tmp_path / "c.vehicle.toml", wrong)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("3.3", "-3.3", "chassis.wheelbase_m: expected a number, finite, from 0.1 to 20, found -3.3"),
        ("3.3", '"long"', "chassis.wheelbase_m: expected a number, finite, from 0.1 to 20, found 'long'"),
        ("wheelbase_m", "wheel_base_m", "chassis.wheel_base_m: expected a key of data_schema/vehicle.toml"),
        ("[chassis]", "chassis = 3\n[other]", "chassis: expected a table, found 3"),
        ('serial_number = "A-17"', "serial_number = 17", "serial_number: expected a text, found 17"),
        ("0.52", "30", "found 30, which looks like degrees (30 deg are 0.5236 rad)"),
        ("largest_wheel_rate_radps = 0.5", "largest_wheel_rate_radps = 28.6", "(28.6 deg/s are 0.4992 rad/s)"),
        ("3.3", "3300", "from 0.1 to 20, found 3300, which looks like millimetres (3300 mm are 3.3 m)"),
        ("3.3", "50", "chassis.wheelbase_m: expected a number, finite, from 0.1 to 20, found 50"),
        ("short_m = 4.0", "short_m = 4000", "found 4000, which looks like millimetres (4000 mm are 4 m)"),
        ("0.003", "0.5", "found 0.5, which looks like degrees (0.5 deg are 0.008727 rad)"),
        ("0.003", "-0.5", "steering.dead_band_rad: expected a number, finite, zero or more, from 0 to 0.2, found -0.5"),
        ("[-0.3, 0.0, 0.3]", "[-17.0, 0.0, 0.3]", "rear_map.rear_rad[0]: expected a number"),
        ("[-0.3, 0.0, 0.3]", "0.3", "rear_map.rear_rad: expected a list, each a number"),
        ("[-0.3, 0.0, 0.3]", "[0.3]", "rear_map.rear_rad: expected a list of 2 or more"),
        ("first_rad = -0.5\n", "", "rear_map.first_rad: expected a value, found none"),
        ("[-0.5, 0.0, 0.5]", "[-0.5, 0.6, 0.5]", "wheel_map.front_rad: expected angles that only rise or only fall"),
        ("stall_v = 10", "stall_v = 25", "steering.stall_v: expected a voltage below nominal_v, 24, found 25"),
        ("long_m = 8.0", "long_m = 3.0", "pursuit.long_m: expected short_m, 4, or more, found 3"),
        ("fast_mps = 5.0", "fast_mps = 0.5", "pursuit.fast_mps: expected slow_mps, 1, or more, found 0.5"),
        ("low = 0.62", "low = 0.635", "found.steering.rear_ratio: expected an interval that holds"),
        ('"steering.rear_ratio"]', '"steering.lag_s"]', "expected the path of a number of this file, found none there"),
        ("low = 0.62", "lower = 0.62", "found.steering.rear_ratio.lower: expected a key of data_schema"),
        ("low = 0.62", "low = [0.62, 0.62]", "found.steering.rear_ratio: expected 1 low and high, found 2 and 1"),
        ('"1.1"', '"2.0"', "@schema_version: expected version 1.x or older (update lgprjax), found 2.0"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in _TEXT
    path = _write(tmp_path, _TEXT.replace(old, new, 1))
    with pytest.raises(InputError) as error:
        read_vehicle(path)
    line = str(error.value)
    assert words in line
    assert line.startswith(f"{path}: ")
    assert "\n" not in line
    assert line in [str(finding.error()) for finding in check_file(path)]


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a readable file, found No such file"):
        read_vehicle(tmp_path / "none.vehicle.toml")


def test_degrees_hint_is_the_conversion(tmp_path: Path) -> None:
    path = _write(tmp_path, _TEXT.replace("0.52", "12.25"))
    with pytest.raises(InputError) as error:
        read_vehicle(path)
    assert f"{math.radians(12.25):.4g} rad" in str(error.value)


def test_another_vehicle_is_refused() -> None:
    own = VehicleFile(name="x", steering_kind="counter_steer", serial_number="A-17")
    require_serial_number(own, "a.vehicle.toml", "A-17", "b.drive.h5", "/vehicle@serial_number")
    require_serial_number(own, "a.vehicle.toml", None, "b.drive.h5", "/vehicle@serial_number")
    with pytest.raises(InputError) as error:
        require_serial_number(own, "a.vehicle.toml", "B-1", "b.drive.h5", "/vehicle@serial_number")
    assert str(error.value) == (
        "b.drive.h5: /vehicle@serial_number: expected the vehicle of a.vehicle.toml (serial number 'A-17'), "
        "found another vehicle, 'B-1'"
    )
    nameless = own.model_copy(update={"serial_number": None})
    with pytest.raises(InputError, match=r"a.vehicle.toml \(no serial_number\)"):
        require_serial_number(nameless, "a.vehicle.toml", "B-1", "b.drive.h5", "/vehicle@serial_number")


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
