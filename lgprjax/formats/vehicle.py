"""The vehicle file ``X.vehicle.toml``: read, written, and validated against ``data_schema/vehicle.toml``."""

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError, model_validator

from lgprjax.config import BrokenRuleError, ConfigTable, say, violations
from lgprjax.errors import InputError
from lgprjax.files import load_toml
from lgprjax.formats.schema import Entry, Finding, check_scalar, check_version, expected_scalar, load_schema
from lgprjax.formats.store import atomic_output

# A vehicle file as one level of keys.


def flat_keys(table: dict[str, Any]) -> dict[str, Any]:
    """Keys by their dotted path. In ``found`` each number's table has a separate path: ``found.PATH.low``."""
    flat: dict[str, Any] = {}
    for name, value in table.items():
        if not isinstance(value, dict):
            flat[name] = value
            continue
        for key, inner in value.items():
            if name == "found" and isinstance(inner, dict):
                flat |= {f"{name}.{key}.{last}": deepest for last, deepest in inner.items()}
            else:
                flat[f"{name}.{key}"] = inner
    return flat


def as_list(value: Any) -> list[Any]:
    """The value as a list; other values as a list of one."""
    return value if isinstance(value, list) else [value]


# Tables of a vehicle file for skid-steer vehicles with a tool.


class SkidSteerTable(ConfigTable):
    """A vehicle that turns by the speeds of its two sides; the body's origin is the midpoint of the track."""

    track_m: float | None = None
    smallest_radius_m: float | None = None
    largest_wheel_mps: float | None = None
    wheel_rate_mps2: float | None = None
    threshold_mps: float | None = None


class ToolTable(ConfigTable):
    """The working rectangle of a tool, metres, and its depth."""

    width_m: float | None = None
    length_m: float | None = None
    ahead_m: float | None = None
    left_m: float | None = None
    depth_m: float | None = None
    depth_tolerance_m: float | None = None


class BodyTable(ConfigTable):
    """Extent of the body from the reference point in each direction, metres, including the tool's housing."""

    front_m: float | None = None
    rear_m: float | None = None
    left_m: float | None = None
    right_m: float | None = None


class CarrotTable(ConfigTable):
    """The lookahead point along a route, and its PID; gains are per distance, not per time."""

    distance_m: float | None = None
    proportional_per_m: float | None = None
    integral_per_m2: float | None = None
    derivative: float | None = None
    largest_curvature_radpm: float | None = None
    slow_mps2: float | None = None


# Contents of a vehicle file: calibrated numbers, absent until measured.
#
# Range, sign and unit of each number are in ``data_schema/vehicle.toml`` and validated by ``read_vehicle``; here are
# the structure and the rules between numbers.

# Least number of knots of a map.
_KNOTS = 2


class ChassisTable(ConfigTable):
    """Lengths of the body, metres."""

    wheelbase_m: float | None = None
    front_overhang_m: float | None = None
    track_width_m: float | None = None


class SteeringTable(ConfigTable):
    """Angles are those of the front wheels; volts and counts those of their sensors."""

    rear_ratio: float | None = None
    largest_wheel_angle_rad: float | None = None
    largest_wheel_rate_radps: float | None = None
    lag_s: float | None = None
    delay_s: float | None = None
    dead_band_rad: float | None = None
    backlash_rad: float | None = None
    asymmetry: float | None = None
    nominal_v: float | None = None
    stall_v: float | None = None
    characteristic_speed_mps: float | None = None
    straight_potentiometer_v: float | None = None
    potentiometer_v_per_rad: float | None = None
    encoder_counts_per_v: float | None = None
    encoder_counts_per_rad: float | None = None

    @model_validator(mode="after")
    def _voltages_in_order(self) -> "SteeringTable":
        if self.nominal_v is not None and self.stall_v is not None and self.stall_v >= self.nominal_v:
            raise BrokenRuleError("stall_v", f"a voltage below nominal_v, {self.nominal_v:g}", f"{self.stall_v:g}")
        return self


class RearMap(ConfigTable):
    """Measured rear wheel angles at evenly spaced front wheel angles, radians."""

    first_rad: float
    step_rad: float
    rear_rad: list[float] = Field(min_length=_KNOTS)


class WheelMap(ConfigTable):
    """Measured front wheel angles, radians, at evenly spaced potentiometer values, volts."""

    first_v: float
    step_v: float
    front_rad: list[float] = Field(min_length=_KNOTS)

    @model_validator(mode="after")
    def _one_angle_one_value(self) -> "WheelMap":
        steps = [after - before for before, after in zip(self.front_rad, self.front_rad[1:], strict=False)]
        if min(steps) <= 0.0 <= max(steps):
            raise BrokenRuleError("front_rad", "angles that only rise or only fall", "both")
        return self


class PedalTable(ConfigTable):
    """A pedal, its commands from 0 to 1."""

    pre_tension: float | None = None
    dead_zone: float | None = None
    gain_mps2: float | None = None
    lag_s: float | None = None


class ResistanceTable(ConfigTable):
    """Resistances without pedals."""

    rolling_mps2: float | None = None
    drag_per_s: float | None = None


class PursuitTable(ConfigTable):
    """The point that follows the path, and the look-ahead over speed."""

    anchor_m: float | None = None
    short_m: float | None = None
    long_m: float | None = None
    slow_mps: float | None = None
    fast_mps: float | None = None
    weak_exponent: float | None = None
    least_torque_share: float | None = None

    @model_validator(mode="after")
    def _in_order(self) -> "PursuitTable":
        for low, high in (("short_m", "long_m"), ("slow_mps", "fast_mps")):
            first, last = getattr(self, low), getattr(self, high)
            if first is not None and last is not None and last < first:
                raise BrokenRuleError(high, f"{low}, {first:g}, or more", f"{last:g}")
        if (self.weak_exponent is None) != (self.least_torque_share is None):
            absent = "weak_exponent" if self.weak_exponent is None else "least_torque_share"
            raise BrokenRuleError(absent, "weak_exponent and least_torque_share, or neither", "none")
        return self


class ArrayTable(ConfigTable):
    """Position of the radar array, metres; lists for channels, from the left, that are not evenly spaced and alike.

    Attributes:
        channel_x_m, channel_y_m: phase centre in the body frame.
        channel_time_s: delay of the channel after the scan's own time.
        channel_gain, channel_delay_ns: gain and delay of a stepped-frequency array's channels, relative to their mean.
    """

    x_m: float | None = None
    height_m: float | None = None
    channel_x_m: list[float] | None = None
    channel_y_m: list[float] | None = None
    channel_time_s: list[float] | None = None
    channel_gain: list[float] | None = None
    channel_delay_ns: list[float] | None = None


class NavigationTable(ConfigTable):
    """Place of the GNSS antenna, metres, and the noises of the filter, as in ``navigation.FilterModel``."""

    gnss_x_m: float | None = None
    gnss_y_m: float | None = None
    yaw_rate_noise: float | None = None
    acceleration_noise: float | None = None
    side_noise: float | None = None
    rate_bias_walk: float | None = None
    odometer_scale_walk: float | None = None
    clock_walk: float | None = None
    lever_walk: float | None = None
    gnss_error_sigma_m: float | None = None
    gnss_error_s: float | None = None
    lgpr_error_sigma_m: float | None = None
    lgpr_error_m: float | None = None


class Found(ConfigTable):
    """Origin of a number: standard error and 95 % interval in the number's unit, study, and logs.

    ``low``, ``high`` and ``sigma`` are lists for a key that holds a list.
    """

    low: float | list[float]
    high: float | list[float]
    sigma: float | list[float] | None = None
    study: str
    log: str


class VehicleFile(ConfigTable):
    """Everything of an ``X.vehicle.toml``; without ``speed_control`` the operator has throttle and brake."""

    name: str
    steering_kind: Literal["counter_steer", "skid_steer"]
    serial_number: str | None = None
    speed_control: bool = True
    assumed: list[str] = Field(default_factory=list)
    chassis: ChassisTable = ChassisTable()
    steering: SteeringTable = SteeringTable()
    skid_steer: SkidSteerTable = SkidSteerTable()
    tool: ToolTable = ToolTable()
    body: BodyTable = BodyTable()
    carrot: CarrotTable = CarrotTable()
    rear_map: RearMap | None = None
    wheel_map: WheelMap | None = None
    throttle: PedalTable = PedalTable()
    brake: PedalTable = PedalTable()
    resistance: ResistanceTable = ResistanceTable()
    pursuit: PursuitTable = PursuitTable()
    array: ArrayTable = ArrayTable()
    navigation: NavigationTable = NavigationTable()
    found: dict[str, Found] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _steers_at_least(self) -> "VehicleFile":
        if self.speed_control:
            return self
        if self.steering_kind != "counter_steer":
            raise BrokenRuleError("speed_control", "true: a skid-steer vehicle turns by its speeds", "false")
        for name in ("throttle", "brake", "resistance"):
            if getattr(self, name).model_dump(exclude_none=True):
                raise BrokenRuleError(name, "no such table where speed_control is false", "one")
        return self

    @model_validator(mode="after")
    def _assumed_is_there(self) -> "VehicleFile":
        values = flat_keys(self.model_dump(exclude_none=True, exclude={"found", "assumed"}))
        for number, path in enumerate(self.assumed):
            if path not in values:
                raise BrokenRuleError(f"assumed[{number}]", "the path of a number of this file", repr(path))
            if path in self.found:
                raise BrokenRuleError(f"assumed[{number}]", f"a number that no study has found, unlike {path}", "found")
        return self

    @model_validator(mode="after")
    def _found_is_there(self) -> "VehicleFile":
        values = flat_keys(self.model_dump(exclude_none=True, exclude={"found"}))
        for path, found in self.found.items():
            place = f"found.{path}"
            if path not in values:
                raise BrokenRuleError(place, "the path of a number of this file", "none there")
            lows, highs, numbers = as_list(found.low), as_list(found.high), as_list(values[path])
            if not len(lows) == len(highs) == len(numbers):
                raise BrokenRuleError(place, f"{len(numbers)} low and high", f"{len(lows)} and {len(highs)}")
            for low, number, high in zip(lows, numbers, highs, strict=True):
                if not low <= number <= high:
                    raise BrokenRuleError(
                        place, f"an interval that contains {path} = {number:g}", f"{low:g} to {high:g}"
                    )
        return self


def with_values(
    vehicle: VehicleFile, values: dict[str, Any], found: dict[str, Found], *, assumed: bool = False
) -> VehicleFile:
    """A vehicle with other numbers.

    Args:
        vehicle: original vehicle, not modified.
        values: new values by dotted path, such as ``steering.lag_s``.
        found: origins of some of them. Such records of the other changed numbers are removed, because they no longer
            hold.
        assumed: whether the values are assumed, not measured.

        Raises:
        ValidationError: a path is unknown, a value is invalid, or numbers contradict each other.
    """
    table = vehicle.model_dump(exclude_none=True)
    kept = {path: entry for path, entry in table.pop("found", {}).items() if path not in values}
    for path, value in values.items():
        name, _, key = path.partition(".")
        if key:
            table.setdefault(name, {})[key] = value
        else:
            table[name] = value
    guessed = [path for path in table.pop("assumed", []) if path not in values] + (list(values) if assumed else [])
    table |= {"assumed": guessed} if guessed else {}
    return VehicleFile.model_validate({**table, "found": {**kept, **{p: f.model_dump() for p, f in found.items()}}})


_SCHEMA = load_schema("vehicle")


def read_vehicle(path: str | Path) -> VehicleFile:
    """A vehicle from its file.

    Raises:
        InputError: the file is missing, not TOML or of a newer major version; a key is unknown, missing, of a wrong
            type or out of its range; numbers contradict each other.
    """
    table = load_toml(path)
    for finding in table_problems(path, table):
        raise finding.error()
    return VehicleFile.model_validate(_tables(table))


def write_vehicle(path: str | Path, vehicle: VehicleFile, *, force: bool = False) -> None:
    """Write a vehicle to its file, each key with its description; defaults are left out.

    Raises:
        InputError: a value does not match the schema, or the output exists (without ``force``) or cannot be written.
    """
    table = vehicle.model_dump(exclude_defaults=True)
    header = {"schema": _SCHEMA.name, "schema_version": _SCHEMA.version}
    for finding in table_problems(path, {**header, **table}):
        raise finding.error()
    lines = [_line(name, value) for name, value in header.items()]
    lines += [_line(name, value) for name, value in table.items() if not isinstance(value, dict)]
    for name, value in table.items():
        if isinstance(value, dict) and name != "found" and value:
            lines += ["", f"[{name}]", *(_line(key, inner, f"{name}.{key}") for key, inner in value.items())]
    for found, value in table.get("found", {}).items():
        lines += ["", f"[found.{json.dumps(found)}]", *(_line(key, inner) for key, inner in value.items())]
    with atomic_output(path, force) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def require_serial_number(
    vehicle: VehicleFile, vehicle_path: str | Path, named: str | None, file: str | Path, place: str
) -> None:
    """Refuse a file that names another vehicle. A file without a name is accepted.

    Args:
        vehicle, vehicle_path: vehicle and path of its file.
        named: serial number in a study or a drive log.
        file, place: file and place of that serial number.

    Raises:
        InputError: the serial number differs, or the vehicle file has none.
    """
    if named is None or named == vehicle.serial_number:
        return
    own = "no serial_number" if vehicle.serial_number is None else f"serial number {vehicle.serial_number!r}"
    raise InputError(file, place, f"the vehicle of {vehicle_path} ({own})", f"another vehicle, {named!r}")


def vehicle_findings(path: Path) -> Iterator[Finding]:
    """Every problem of a vehicle file.

    Raises:
        InputError: the file cannot be read, or is not TOML.
    """
    return table_problems(path, load_toml(path))


def table_problems(path: str | Path, table: dict[str, Any]) -> Iterator[Finding]:
    """Every problem of a vehicle's table, header included; rules between numbers only where the numbers are valid."""
    refusal = check_version(_SCHEMA, table.get("schema"), table.get("schema_version"))
    if refusal is not None:
        yield Finding(str(path), *refusal)
        return
    values = flat_keys(_tables(table))
    sound = True
    for place, expected, found in _key_problems(values):
        sound = False
        yield Finding(str(path), place, expected, found)
    if sound:
        try:
            VehicleFile.model_validate(_tables(table))
        except ValidationError as error:
            for violation in violations(VehicleFile, error):
                yield Finding(str(path), *violation)


def _tables(table: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in table.items() if name not in ("schema", "schema_version")}


def _key_problems(values: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Place, expected and found of each key that is missing, wrong or unknown, in the schema's order."""
    left = dict(values)
    for entry in _SCHEMA.keys:
        prefix, star, suffix = entry.path.partition("*")
        if not star:
            if entry.path in left:
                yield from _value_problems(entry, entry.path, left.pop(entry.path), many=bool(entry.dims))
            elif entry.required:
                yield entry.path, expected_scalar(entry), "none"
            continue
        for path in [path for path in left if path.startswith(prefix) and path.endswith(suffix)]:
            value = left.pop(path)
            yield from _value_problems(entry, path, value, many=isinstance(value, list))
    for path, value in left.items():
        if any(entry.path.startswith(f"{path}.") for entry in _SCHEMA.keys):
            yield path, "a table", say(value)
        else:
            yield path, "a key of data_schema/vehicle.toml", "an unknown key"


def _value_problems(entry: Entry, path: str, value: object, *, many: bool) -> Iterator[tuple[str, str, str]]:
    if not many:
        problem = check_scalar(entry, value)
        if problem is not None:
            yield path, expected_scalar(entry), problem + _unit_hint(entry, value)
        return
    if not isinstance(value, list):
        yield path, f"a list, each {expected_scalar(entry)}", repr(value)
        return
    for index, item in enumerate(value):
        problem = check_scalar(entry, item)
        if problem is not None:
            yield f"{path}[{index}]", expected_scalar(entry), problem + _unit_hint(entry, item)


def _unit_hint(entry: Entry, value: object) -> str:
    """A hint if the number would be valid in degrees, or in millimetres."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return ""
    # A number with the wrong sign is of no other unit either.
    if check_scalar(replace(entry, bounds=None), value) is not None:
        return ""
    if entry.unit == "m" and check_scalar(entry, 1e-3 * value) is None:
        return f", which looks like millimetres ({value:g} mm are {1e-3 * value:.4g} m)"
    radians = math.radians(value)
    if not entry.unit.startswith("rad") or check_scalar(entry, radians) is not None:
        return ""
    per = entry.unit.removeprefix("rad")
    return f", which looks like degrees ({value:g} deg{per} are {radians:.4g} {entry.unit})"


def _line(name: str, value: object, path: str = "") -> str:
    # A JSON string is a TOML string, and a JSON number of Python's a TOML number.
    text = f"{name} = {json.dumps(value, ensure_ascii=False)}"
    described = [f"{entry.description}" for entry in _SCHEMA.keys if entry.path == path]
    return f"{text}  # {described[0]}" if described else text
