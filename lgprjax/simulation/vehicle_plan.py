"""The drives file: a made-up vehicle, its sensors and the calibration drives that it does, as TOML."""

import math
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from lgprjax.files import load_toml
from lgprjax.frames import LocalFrame
from lgprjax.scene.calibrated_fixes import calibrated_fixes
from lgprjax.scene.fix_errors import FixErrors
from lgprjax.scene.manoeuvres import Manoeuvre
from lgprjax.scene.vehicle_drive import TrueVehicle
from lgprjax.scene.vehicle_sensors import VehicleSensors
from lgprjax.simulation.drives import SITE_FRAME
from lgprjax.simulation.site_file import derive_seed
from lgprjax.simulation.site_table import Place, as_table, fill_config, nearest, refuse_unknown
from lgprjax.simulation.vehicle_manoeuvres import LISTS, MANOEUVRES, Range

KIND = "vehicle_drives"
"""What a drives file calls itself, so that it is not taken for a site file."""

Config = TypeVar("Config")


class PlannedVehicleDrive(NamedTuple):
    """One drive.

    Attributes:
        name: of its log.
        manoeuvre: what it does.
        sensors: that record it.
        seed: of their noise.
        fixes: the day on which its fixes are to be as good as; ``None`` for none.
        fix_errors: of that day.
    """

    name: str
    manoeuvre: Manoeuvre
    sensors: VehicleSensors
    seed: int
    fixes: str | None = None
    fix_errors: FixErrors | None = None


class VehiclePlan(NamedTuple):
    """A drives file read: whose drives, where, which."""

    file: Path
    vehicle: TrueVehicle
    serial_number: str | None
    frame: LocalFrame
    drives: tuple[PlannedVehicleDrive, ...]


_VEHICLE: dict[str, Range] = {
    "wheelbase_m": (0.3, 20.0),
    "largest_angle_rad": (0.01, 1.2),
    "characteristic_speed_mps": (1.0, 1e6),
    "rear": (0.0, 1.0),
    "lag_s": (0.0, 5.0),
    "rate_radps": (1e-3, 10.0),
    "delay_s": (0.0, 1.0),
    "dead_band_rad": (0.0, 0.2),
    "backlash_rad": (0.0, 0.2),
    "asymmetry": (-0.9, 0.9),
    "nominal_v": (0.1, 1e3),
    "stall_v": (0.0, 1e3),
    "potentiometer_per_rad_v": (-1e3, 1e3),
    "encoder_counts_per_rad": (-1e7, 1e7),
    "lock_to_lock_turns": (0.5, 20.0),
    "array_x_m": (-5.0, 20.0),
}
_SENSORS: dict[str, Range] = {
    "record_hz": (1.0, 100.0),
    "gnss_hz": (0.1, 100.0),
    "outlier_share": (0.0, 1.0),
    "spike_share": (0.0, 1.0),
    "position_wander_s": (0.1, 1e5),
    "heading_wander_s": (0.1, 1e5),
    "odometer_scale_error": (-0.5, 0.5),
    "heading_bias_rad": (-0.2, 0.2),
    "yaw_rate_noise": (0.0, 1.0),
    "yaw_rate_bias_radps": (-1.0, 1.0),
    "yaw_rate_bias_walk": (0.0, 1.0),
    "fix_hz": (0.1, 100.0),
}
_NON_NEGATIVE: Range = (0.0, 1e3)


def read_vehicle_plan(path: str | Path) -> VehiclePlan:
    """A drives file; nothing is driven yet.

    Raises:
        InputError: the file is missing or no TOML; a key is unknown, missing, of a wrong type or out of its range; a
            name is used twice or stands for nothing.
    """
    root = Place(Path(path))
    table = load_toml(root.file)
    header = ("kind", "seed", "serial_number", "latitude_deg", "longitude_deg", "height_m")
    refuse_unknown(root, table, [*header, "vehicle", "sensors", "drive"])
    if table.get("kind") != KIND:
        raise root.at("kind").refuse(repr(KIND), repr(table.get("kind")))
    seed = table.get("seed", 0)
    if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed < 2**31:
        raise root.at("seed").refuse("a whole number from 0", repr(seed))
    serial_number = table.get("serial_number")
    if serial_number is not None and not isinstance(serial_number, str):
        raise root.at("serial_number").refuse("a text", repr(serial_number))
    frame = LocalFrame(
        _number(root, table, "latitude_deg", (-85.0, 85.0), SITE_FRAME.latitude_deg),
        _number(root, table, "longitude_deg", (-180.0, 180.0), SITE_FRAME.longitude_deg),
        _number(root, table, "height_m", (-500.0, 9000.0), SITE_FRAME.height_m),
    )
    place, withheld = root.at("vehicle"), {"linkage": "rear (a drives file knows no linkages)"}
    vehicle = fill_config(TrueVehicle, place, table.get("vehicle", {}), base=TrueVehicle(), withheld=withheld)
    _hold(place, vehicle, _VEHICLE)
    sensors = _sensors(root.at("sensors"), table.get("sensors", {}), VehicleSensors())
    entries = table.get("drive")
    if not isinstance(entries, list) or not entries:
        raise root.at("drive").refuse("one [[drive]] or more", "none" if entries is None else "no such list")
    drives: dict[str, PlannedVehicleDrive] = {}
    for number, entry in enumerate(entries, 1):
        where = Place(root.file, f"drive[{number}]")
        drive = _drive(where, as_table(where, entry), vehicle, sensors, seed)
        if drive.name in drives:
            raise where.at("name").refuse("a name that no other drive has", repr(drive.name))
        drives[drive.name] = drive
    return VehiclePlan(root.file, vehicle, serial_number, frame, tuple(drives.values()))


def is_vehicle_plan(path: str | Path) -> bool:
    """Whether a TOML file calls itself a drives file.

    Raises:
        InputError: the file is missing or no TOML.
    """
    return load_toml(path).get("kind") == KIND


def _drive(
    place: Place, table: dict[str, Any], vehicle: TrueVehicle, sensors: VehicleSensors, seed: int
) -> PlannedVehicleDrive:
    name, word = table.get("name"), table.get("manoeuvre")
    if not isinstance(name, str) or not name or not all(c.isalnum() or c in "._-" for c in name):
        raise place.at("name").refuse("a name fit for a file", repr(name))
    if not isinstance(word, str) or word not in MANOEUVRES:
        raise place.at("manoeuvre").refuse(nearest(str(word), MANOEUVRES, "a manoeuvre"), repr(word))
    kind = MANOEUVRES[word]
    degrees = [f"{key.removesuffix('_rad')}_deg" for key in kind.ranges if key.endswith("_rad")]
    refuse_unknown(place, table, ["name", "manoeuvre", "sensors", "fixes", *kind.ranges, *degrees])
    numbers = {key: _numbers(place, table, key, limits) for key, limits in kind.ranges.items()}
    for key in kind.needed:
        if numbers[key] is None:
            raise place.at(key).refuse("a value", "none")
    given = {key: value for key, value in numbers.items() if value is not None}
    if word == "pedal_steps" and len(given["throttles"]) != len(given["brakes"]):
        raise place.at("brakes").refuse(f"{len(given['throttles'])}, as many as throttles", str(len(given["brakes"])))
    own = _sensors(place.at("sensors"), table.get("sensors", {}), sensors)
    fixes, errors = _fixes(place.at("fixes"), table.get("fixes"))
    return PlannedVehicleDrive(name, kind.make(vehicle, given), own, derive_seed(seed, name), fixes, errors)


def _fixes(place: Place, day: object) -> tuple[str | None, FixErrors | None]:
    """A day and the error model of its fixes; neither where a drive asks for none."""
    if day is None:
        return None, None
    try:
        return str(day), calibrated_fixes(str(day))
    except KeyError:
        raise place.refuse("a day whose fixes were measured", repr(day)) from None


def _numbers(place: Place, table: dict[str, Any], key: str, limits: Range) -> Any:
    """A number or list of numbers, ``None`` where there is none; angles also in degrees."""
    in_degrees = f"{key.removesuffix('_rad')}_deg"
    if key.endswith("_rad") and in_degrees in table:
        low, high = limits
        asked = _numbers(place, table, in_degrees, (math.degrees(low), math.degrees(high)))
        return [math.radians(v) for v in asked] if isinstance(asked, list) else math.radians(asked)
    if key not in table:
        return None
    if key not in LISTS:
        return _number(place, table, key, limits, 0.0)
    items = table[key]
    if not isinstance(items, list) or not items:
        raise place.at(key).refuse("a list of numbers", repr(items)[:60])
    return [_number(place, {f"{key}[{n}]": item}, f"{key}[{n}]", limits, 0.0) for n, item in enumerate(items, 1)]


def _number(place: Place, table: dict[str, Any], key: str, limits: Range, absent: float) -> float:
    value, (low, high) = table.get(key, absent), limits
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise place.at(key).refuse(f"a number from {low:g} to {high:g}", repr(value)[:60])
    return float(value)


def _sensors(place: Place, table: object, base: VehicleSensors) -> VehicleSensors:
    sensors = fill_config(VehicleSensors, place, table, base=base)
    _hold(place, sensors, _SENSORS)
    if sensors.gnss_hz > sensors.record_hz or abs(100.0 / sensors.record_hz % 1.0) > 1e-9:
        expected = "a record_hz of 100 or a whole part of it, no less than gnss_hz"
        raise place.at("record_hz").refuse(expected, f"{sensors.record_hz:g}")
    return sensors


def _hold(place: Place, config: object, ranges: dict[str, Range]) -> None:
    """Hold every number of a dataclass to its range, those without one to be no less than 0."""
    for name, value in vars(config).items():
        low, high = ranges.get(name, _NON_NEGATIVE)
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, float) and not low <= number <= high:
                raise place.at(name).refuse(f"a number from {low:g} to {high:g}", f"{number:g}")
