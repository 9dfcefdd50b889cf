"""A vehicle as its file tells it: one value a calibrated number, absent where nobody has found it yet.

What a number may be (range, sign, unit) stands in ``data_schema/vehicle.toml`` and is held against it by
``vehicle_file``; here stand the structure and what numbers must be to each other.
"""

from typing import Any, Literal

from pydantic import Field, model_validator

from lgprjax.formats.skid_tables import CarrotTable, SkidSteerTable, ToolTable
from lgprjax.formats.vehicle_rules import BrokenRuleError, FileTable, as_list, flat_keys

# Fewer knots are no map.
_KNOTS = 2


class ChassisTable(FileTable):
    """Lengths of the body, metres."""

    wheelbase_m: float | None = None
    front_overhang_m: float | None = None
    track_width_m: float | None = None


class SteeringTable(FileTable):
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


class RearMap(FileTable):
    """Measured rear wheel angles at evenly spaced front wheel angles, radians."""

    first_rad: float
    step_rad: float
    rear_rad: list[float] = Field(min_length=_KNOTS)


class WheelMap(FileTable):
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


class PedalTable(FileTable):
    """A pedal, its commands from 0 to 1."""

    pre_tension: float | None = None
    dead_zone: float | None = None
    gain_mps2: float | None = None
    lag_s: float | None = None


class ResistanceTable(FileTable):
    """What slows the vehicle without pedals."""

    rolling_mps2: float | None = None
    drag_per_s: float | None = None


class PursuitTable(FileTable):
    """The point that follows the path, and the look-ahead over speed."""

    anchor_m: float | None = None
    short_m: float | None = None
    long_m: float | None = None
    slow_mps: float | None = None
    fast_mps: float | None = None

    @model_validator(mode="after")
    def _in_order(self) -> "PursuitTable":
        for low, high in (("short_m", "long_m"), ("slow_mps", "fast_mps")):
            first, last = getattr(self, low), getattr(self, high)
            if first is not None and last is not None and last < first:
                raise BrokenRuleError(high, f"{low}, {first:g}, or more", f"{last:g}")
        return self


class ArrayTable(FileTable):
    """Where the radar array stands, metres."""

    x_m: float | None = None
    height_m: float | None = None


class NavigationTable(FileTable):
    """Where the GNSS antenna stands, metres, and the noises of the filter, as in ``navigation.FilterModel``."""

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


class Found(FileTable):
    """How a number was found: standard error and 95 % interval in the number's unit, by which study, on which logs.

    ``low``, ``high`` and ``sigma`` are lists for a key that is one.
    """

    low: float | list[float]
    high: float | list[float]
    sigma: float | list[float] | None = None
    study: str
    log: str


class VehicleFile(FileTable):
    """Everything of an ``X.vehicle.toml``."""

    name: str
    steering_kind: Literal["counter_steer", "skid_steer"]
    serial_number: str | None = None
    chassis: ChassisTable = ChassisTable()
    steering: SteeringTable = SteeringTable()
    skid_steer: SkidSteerTable = SkidSteerTable()
    tool: ToolTable = ToolTable()
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
                    raise BrokenRuleError(place, f"an interval that holds {path} = {number:g}", f"{low:g} to {high:g}")
        return self


def with_values(vehicle: VehicleFile, values: dict[str, Any], found: dict[str, Found]) -> VehicleFile:
    """A vehicle with other numbers.

    Args:
        vehicle: stays as it is.
        values: by dotted path, such as ``steering.lag_s``.
        found: how some of them were found. What was known of the others' finding is no longer true, and goes.

    Raises:
        ValidationError: a path or value that the model has no place for, or numbers that contradict each other.
    """
    table = vehicle.model_dump(exclude_none=True)
    kept = {path: entry for path, entry in table.pop("found", {}).items() if path not in values}
    for path, value in values.items():
        name, _, key = path.partition(".")
        if key:
            table.setdefault(name, {})[key] = value
        else:
            table[name] = value
    return VehicleFile.model_validate({**table, "found": {**kept, **{p: f.model_dump() for p, f in found.items()}}})
