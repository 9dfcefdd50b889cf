"""A drives file: a made-up vehicle, its sensors, and the manoeuvres and courses that it drives."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from lgprjax.autopilot.modes import Mode
from lgprjax.config import TableKey, as_table, nearest, refuse_unknown
from lgprjax.files import load_toml
from lgprjax.frames import LocalFrame
from lgprjax.scene.day import WEATHER
from lgprjax.scene.motion import (
    STEP_S as MOTION_STEP_S,
)
from lgprjax.scene.motion import (
    Manoeuvre,
    drive_palm_tree,
    drive_straight,
    drive_turns,
    step_pedals,
    step_steering,
    turn_standing,
)
from lgprjax.scene.sensors import FixErrors, calibrated_fixes
from lgprjax.scene.vehicle_drive import (
    TrueVehicle,
    VehicleSensors,
    chassis_of,
    servo_of,
)
from lgprjax.simulation.drives import SITE_FRAME
from lgprjax.simulation.site_tables import fill_config
from lgprjax.simulation.sites import derive_seed
from lgprjax.vehicle import (
    Path as CoursePath,
)
from lgprjax.vehicle import (
    RolloutLane,
    RolloutSpec,
    constant_look_ahead,
    ideal_servo,
    path_from_curvature,
    roll_out_logged,
    start_rollout,
    torque_share,
)
from lgprjax.vehicle.path import SPACING_M

# The manoeuvres of a drives file: construction from their numbers, and valid ranges.

Range = tuple[float, float]

_SPEED_MPS, _ANGLE_RAD, _HOLD_S, _SHARE = (0.2, 15.0), (-1.2, 1.2), (0.5, 120.0), (0.0, 1.0)


class ManoeuvreKind(NamedTuple):
    """A manoeuvre: how it is made of the vehicle and its numbers, and the range of each; lists have plural names."""

    make: Callable[[TrueVehicle, Mapping[str, Any]], Manoeuvre]
    ranges: dict[str, Range]
    needed: tuple[str, ...] = ()


def _palm_tree(vehicle: TrueVehicle, numbers: Mapping[str, Any]) -> Manoeuvre:
    # The ratio only sets the length of an arc.
    ratio = vehicle.rear if isinstance(vehicle.rear, float) else 0.5
    limits = (vehicle.largest_angle_rad, vehicle.lock_to_lock_turns)
    return drive_palm_tree(vehicle.wheelbase_m, ratio, *limits, **numbers)


MANOEUVRES = {
    "straight": ManoeuvreKind(
        lambda _, numbers: drive_straight(**numbers),
        {"length_m": (5.0, 5e3), "speed_mps": _SPEED_MPS, "weave_rad": (0.0, 0.2), "weave_m": (2.0, 500.0)},
        ("length_m", "speed_mps"),
    ),
    "standing": ManoeuvreKind(
        lambda vehicle, numbers: turn_standing(vehicle.largest_angle_rad, vehicle.lock_to_lock_turns, **numbers),
        {"pause_s": _HOLD_S},
    ),
    "palm_tree": ManoeuvreKind(
        _palm_tree,
        {"speed_mps": _SPEED_MPS, "arc_turns": (0.05, 1.0), "longest_m": (2.0, 200.0), "pause_s": _HOLD_S},
    ),
    "turns": ManoeuvreKind(
        lambda _, numbers: drive_turns(**numbers),
        {"speeds_mps": _SPEED_MPS, "angles_rad": _ANGLE_RAD, "hold_s": _HOLD_S},
        ("speeds_mps", "angles_rad"),
    ),
    "steering_steps": ManoeuvreKind(
        lambda _, numbers: step_steering(**numbers),
        {
            "sizes_rad": _ANGLE_RAD,
            "speed_mps": (0.0, 15.0),
            "hold_s": _HOLD_S,
            "sweep_rad": (0.0, 1.2),
            "sweep_s": (5.0, 600.0),
        },
        ("sizes_rad",),
    ),
    "tracking": ManoeuvreKind(
        lambda vehicle, numbers: drive_course(vehicle, **numbers)[0],
        {
            "speed_mps": _SPEED_MPS,
            "radii_m": (-500.0, 500.0),
            "offset_m": (-5.0, 5.0),
            "look_ahead_m": (0.5, 60.0),
            "lead_in_s": (0.0, 60.0),
            "supply_v": (0.0, 1e3),
        },
        ("speed_mps", "radii_m", "look_ahead_m"),
    ),
    "course": ManoeuvreKind(
        lambda vehicle, numbers: drive_course(vehicle, **numbers, by_hand=True)[0],
        {"speed_mps": _SPEED_MPS, "radii_m": (-500.0, 500.0)},
        ("speed_mps", "radii_m"),
    ),
    "pedal_steps": ManoeuvreKind(
        lambda _, numbers: step_pedals(**numbers),
        {"throttles": _SHARE, "brakes": _SHARE, "back": _SHARE, "hold_s": _HOLD_S},
        ("throttles", "brakes"),
    ),
}
"""Manoeuvres by their name in a drives file."""


def stand_still() -> Manoeuvre:
    """Standstill without commands."""
    nothing = np.zeros(1)
    return Manoeuvre(time_s=nothing, wanted_rad=nothing, speed_mps=nothing, supply_v=nothing, by_hand=True)


_ALONG_COURSES = ("tracking", "course")
LISTS = frozenset(
    {"radii_m", "speeds_mps", "angles_rad", "angles_deg", "sizes_rad", "sizes_deg", "throttles", "brakes"}
)
"""Keys that hold a list of numbers."""


# A course that the autopilot drives, with what its plan would have recorded.

_RAMP_M, _STRAIGHT_M, _BEND_RAD, _LEAST_RADIUS_M = 8.0, 12.0, 1.0, 3.0
_VARIES, _VARIES_S = 0.1, 17.0
_HAND_LOOK_AHEAD_M = 2.5
"""Of a driver who steers by eye."""


class DrivenCourse(NamedTuple):
    """Course and commands of a drive under autopilot, at the simulation's steps.

    Attributes:
        path: path of the course.
        anchor_m: distance ahead of the rear axle of the point that follows the path.
        curvature_radpm: curvature of the path's arcs, each ``SPACING_M`` long.
        offset_m: offset of the drive's start, to the left of the path.
        mode: mode of the autopilot.
        wanted_mps: commanded speed.
    """

    path: CoursePath
    anchor_m: float
    curvature_radpm: Float[np.ndarray, " arc"]
    offset_m: float
    mode: Int[np.ndarray, " step"]
    wanted_mps: Float[np.ndarray, " step"]


def drive_course(
    vehicle: TrueVehicle,
    *,
    speed_mps: float,
    radii_m: Sequence[float],
    look_ahead_m: float = _HAND_LOOK_AHEAD_M,
    offset_m: float = 0.0,
    lead_in_s: float = 0.0,
    supply_v: float | None = None,
    by_hand: bool = False,
) -> tuple[Manoeuvre, DrivenCourse]:
    """A drive along bends, steered by the pursuit law from an offset.

    Args:
        vehicle: true vehicle; the centre of its array follows the course.
        speed_mps: mean speed; it varies by a tenth.
        radii_m: radii of the bends, to the left positive, each of a radian with clothoids, between straights.
        look_ahead_m: look-ahead along the course.
        offset_m: offset to the left of the course at which steering is engaged.
        lead_in_s: time of straight driving by hand before that, parallel to the course.
        supply_v: supply voltage at the servo; ``None``: the vehicle's nominal voltage.
        by_hand: a driver steers, without the servo.
    """
    volts = vehicle.nominal_v if supply_v is None else supply_v
    parts = [np.zeros(round((_STRAIGHT_M + 1.1 * lead_in_s * speed_mps + max(vehicle.array_x_m, 0.0)) / SPACING_M))]
    ramp = np.linspace(0.0, 1.0, round(_RAMP_M / SPACING_M))
    for radius in radii_m:
        hold = np.ones(max(round((abs(radius) * _BEND_RAD - _RAMP_M) / SPACING_M), 1))
        bend = np.concatenate([ramp, hold, ramp[::-1]]) / radius
        parts += [bend, np.zeros(round(_STRAIGHT_M / SPACING_M))]
    curvature = np.concatenate(parts)
    # The drive begins at the origin; the course starts next to the array.
    path = path_from_curvature(curvature, start=(vehicle.array_x_m, -offset_m, 0.0))
    seconds = lead_in_s + (len(curvature) * SPACING_M - lead_in_s * speed_mps - 1.2 * look_ahead_m) / speed_mps
    steps = round(max(seconds, 5.0) / MOTION_STEP_S)
    time_s = MOTION_STEP_S * np.arange(steps)
    speed = speed_mps * (1.0 + _VARIES * np.sin(2.0 * np.pi * time_s / _VARIES_S))
    # At least a step: the simulated servo begins at the first command, the rollout with straight wheels.
    led = max(round(lead_in_s / MOTION_STEP_S), 1)
    chassis, servo = chassis_of(vehicle, vehicle.array_x_m), ideal_servo() if by_hand else servo_of(vehicle)
    lane = RolloutLane(
        chassis,
        chassis,
        servo,
        jnp.float32(volts),
        jnp.float32(speed_mps),
        constant_look_ahead(jnp.float32(look_ahead_m)),
    )
    zero, slots = jnp.float32(0.0), max(int(np.ceil(float(servo.delay_s) / MOTION_STEP_S)), 1)
    arc = jnp.float32(np.sum(speed[:led]) * MOTION_STEP_S)
    start = start_rollout(path, lane, arc, jnp.float32(offset_m), zero, delay_slots=slots)
    size = -(-(steps - led) // 2048) * 2048
    driven = np.append(speed[led:], np.full(size - (steps - led), speed[-1]))
    share = jnp.full(size, torque_share(servo, jnp.float32(volts)), jnp.float32)
    spec = RolloutSpec(steps=size, step_s=MOTION_STEP_S, delay_slots=slots)
    trace = roll_out_logged(spec, path, lane, start, jnp.asarray(driven, jnp.float32), share)
    # Sharp bends and the varying speed may take the array to the end of its course sooner: there the drive ends.
    beyond = np.asarray(trace.arc_m, np.float64)[: steps - led] > float(path.length_m) - SPACING_M
    steps = led + int(np.argmax(beyond)) if beyond.any() else steps
    time_s, speed = time_s[:steps], speed[:steps]
    command = np.concatenate([np.zeros(led), np.asarray(trace.command_rad, np.float64)[: steps - led]])
    mode = np.where(by_hand | (np.arange(steps) < led), int(Mode.MANUAL), int(Mode.SPEED))
    manoeuvre = Manoeuvre(
        time_s=time_s, wanted_rad=command, speed_mps=speed, supply_v=np.full(steps, volts), by_hand=by_hand
    )
    course = DrivenCourse(path, vehicle.array_x_m, curvature, offset_m, mode, np.full(steps, speed_mps))
    return manoeuvre, course


# The drives file: a made-up vehicle, its sensors and the calibration drives that it does, as TOML.

KIND = "vehicle_drives"
"""Kind of a drives file, to distinguish it from a site file."""

Config = TypeVar("Config")


class PlannedVehicleDrive(NamedTuple):
    """One drive.

    Attributes:
        name: name of the log.
        manoeuvre: commands of the drive.
        sensors: sensors that record the drive.
        seed: seed of the sensors' noise.
        fixes: name of the day whose fix errors apply; ``None``: no fixes.
        fix_errors: fix errors of that day.
        course: course that the autopilot follows; ``None`` in the other manoeuvres.
        radar: name of the day of the radar scans, see ``WEATHER``; ``None``: no scans.
    """

    name: str
    manoeuvre: Manoeuvre
    sensors: VehicleSensors
    seed: int
    fixes: str | None = None
    fix_errors: FixErrors | None = None
    course: DrivenCourse | None = None
    radar: str | None = None


class VehiclePlan(NamedTuple):
    """A drives file read: whose drives, where, which.

    Attributes:
        file: the drives file.
        seed: of the file, and of the ground under drives with radar.
        vehicle: as it is; stated: path of the vehicle file that logs with radar take the array from, as on board.
        serial_number: of the vehicle.
        frame: of the drives.
        drives: in the order of the file.
    """

    file: Path
    seed: int
    stated: Path | None
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
    """Read a drives file, without simulating.

    Raises:
        InputError: the file is missing or not TOML; a key is unknown, missing, of a wrong type or out of its range; a
            name is used twice or refers to nothing.
    """
    root = TableKey(Path(path))
    table = load_toml(root.file)
    header = ("kind", "seed", "serial_number", "vehicle_file", "latitude_deg", "longitude_deg", "height_m")
    refuse_unknown(root, table, [*header, "vehicle", "sensors", "drive"])
    if table.get("kind") != KIND:
        raise root.at("kind").refuse(repr(KIND), repr(table.get("kind")))
    seed = table.get("seed", 0)
    if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed < 2**31:
        raise root.at("seed").refuse("a whole number from 0", repr(seed))
    serial_number = table.get("serial_number")
    if serial_number is not None and not isinstance(serial_number, str):
        raise root.at("serial_number").refuse("a text", repr(serial_number))
    named = table.get("vehicle_file")
    if named is not None and not isinstance(named, str):
        raise root.at("vehicle_file").refuse("the path of a vehicle file", repr(named)[:60])
    stated = None if named is None else root.file.parent / named
    frame = LocalFrame(
        _number(root, table, "latitude_deg", (-85.0, 85.0), SITE_FRAME.latitude_deg),
        _number(root, table, "longitude_deg", (-180.0, 180.0), SITE_FRAME.longitude_deg),
        _number(root, table, "height_m", (-500.0, 9000.0), SITE_FRAME.height_m),
    )
    vehicle = true_vehicle(table.get("vehicle", {}), root.at("vehicle"), TrueVehicle().array_x_m)
    sensors = _sensors(root.at("sensors"), table.get("sensors", {}), VehicleSensors())
    entries = table.get("drive")
    if not isinstance(entries, list) or not entries:
        raise root.at("drive").refuse("one [[drive]] or more", "none" if entries is None else "not a list of tables")
    drives: dict[str, PlannedVehicleDrive] = {}
    for number, entry in enumerate(entries, 1):
        where = TableKey(root.file, f"drive[{number}]")
        drive = _drive(where, as_table(where, entry), vehicle, sensors, seed)
        if drive.name in drives:
            raise where.at("name").refuse("a unique drive name", repr(drive.name))
        if drive.radar is not None and stated is None:
            raise root.at("vehicle_file").refuse("a vehicle file with [array], for drives with radar", "none")
        drives[drive.name] = drive
    return VehiclePlan(
        file=root.file,
        seed=seed,
        stated=stated,
        vehicle=vehicle,
        serial_number=serial_number,
        frame=frame,
        drives=tuple(drives.values()),
    )


def true_vehicle(table: dict[str, Any], place: TableKey, array_x_m: float) -> TrueVehicle:
    """A simulated vehicle from a table of its numbers.

    Args:
        table: numbers that differ from the defaults of ``TrueVehicle``.
        place: file and place of the table.
        array_x_m: distance of the array ahead of the rear axle, unless the table states it.

    Raises:
        InputError: a number is unknown, of a wrong type or out of its range, or numbers contradict each other.
    """
    withheld = {"linkage": "rear (a table of a vehicle knows no linkages)"}
    vehicle = fill_config(TrueVehicle, place, table, base=TrueVehicle(array_x_m=array_x_m), withheld=withheld)
    _hold(place, vehicle, _VEHICLE)
    if vehicle.stall_v >= vehicle.nominal_v:
        expected = f"a voltage below nominal_v, {vehicle.nominal_v:g}"
        raise place.at("stall_v").refuse(expected, f"{vehicle.stall_v:g}")
    for key, (pre_tension, dead_zone, *_) in (("throttle", vehicle.throttle), ("brake", vehicle.brake)):
        if dead_zone > pre_tension:
            expected = f"a dead zone of at most the pre-tension, {pre_tension:g}, so that the pedal releases"
            raise place.at(key).refuse(expected, f"{dead_zone:g}")
    return vehicle


def is_vehicle_plan(path: str | Path) -> bool:
    """Whether a TOML file calls itself a drives file.

    Raises:
        InputError: the file is missing or no TOML.
    """
    return load_toml(path).get("kind") == KIND


def _drive(
    place: TableKey, table: dict[str, Any], vehicle: TrueVehicle, sensors: VehicleSensors, seed: int
) -> PlannedVehicleDrive:
    name, word = table.get("name"), table.get("manoeuvre")
    if not isinstance(name, str) or not name or not all(c.isalnum() or c in "._-" for c in name):
        raise place.at("name").refuse("a name fit for a file", repr(name))
    if not isinstance(word, str) or word not in MANOEUVRES:
        raise place.at("manoeuvre").refuse(nearest(str(word), MANOEUVRES, "a manoeuvre"), repr(word))
    kind = MANOEUVRES[word]
    degrees = [f"{key.removesuffix('_rad')}_deg" for key in kind.ranges if key.endswith("_rad")]
    refuse_unknown(place, table, ["name", "manoeuvre", "sensors", "fixes", "radar", *kind.ranges, *degrees])
    numbers = {key: _numbers(place, table, key, limits) for key, limits in kind.ranges.items()}
    for key in kind.needed:
        if numbers[key] is None:
            raise place.at(key).refuse("a value", "none")
    given = {key: value for key, value in numbers.items() if value is not None}
    if word == "pedal_steps" and len(given["throttles"]) != len(given["brakes"]):
        raise place.at("brakes").refuse(f"{len(given['throttles'])}, as many as throttles", str(len(given["brakes"])))
    own = _sensors(place.at("sensors"), table.get("sensors", {}), sensors)
    fixes, errors = _fixes(place.at("fixes"), table.get("fixes"))
    radar = table.get("radar")
    if radar is not None and radar not in WEATHER:
        raise place.at("radar").refuse(nearest(str(radar), WEATHER, "a day"), repr(radar))
    if radar is not None and word not in _ALONG_COURSES:
        raise place.at("radar").refuse(f"a manoeuvre along a course: {' or '.join(_ALONG_COURSES)}", repr(word))
    if radar is not None and fixes is not None:
        raise place.at("fixes").refuse("no fixes of a drive with radar (lgprjax register makes them)", repr(fixes))
    own_seed = derive_seed(seed, name)
    if word not in _ALONG_COURSES:
        manoeuvre = kind.make(vehicle, given)
        manoeuvre = manoeuvre._replace(supply_v=np.full(manoeuvre.time_s.size, vehicle.nominal_v))
        return PlannedVehicleDrive(
            name=name, manoeuvre=manoeuvre, sensors=own, seed=own_seed, fixes=fixes, fix_errors=errors
        )
    if min(abs(radius) for radius in given["radii_m"]) < _LEAST_RADIUS_M:
        raise place.at("radii_m").refuse(f"bends of {_LEAST_RADIUS_M:g} m or more", f"{given['radii_m']}"[:60])
    manoeuvre, course = drive_course(vehicle, **given, by_hand=word == "course")
    return PlannedVehicleDrive(
        name=name,
        manoeuvre=manoeuvre,
        sensors=own,
        seed=own_seed,
        fixes=fixes,
        fix_errors=errors,
        course=course,
        radar=radar,
    )


def _fixes(place: TableKey, day: object) -> tuple[str | None, FixErrors | None]:
    """A day and the error model of its fixes; neither if a drive has none."""
    if day is None:
        return None, None
    try:
        return str(day), calibrated_fixes(str(day))
    except KeyError:
        raise place.refuse("a day whose fixes were measured", repr(day)) from None


def _numbers(place: TableKey, table: dict[str, Any], key: str, limits: Range) -> Any:
    """A number or list of numbers, ``None`` if missing; angles also in degrees."""
    in_degrees = f"{key.removesuffix('_rad')}_deg"
    if key.endswith("_rad") and in_degrees in table:
        if key in table:
            raise place.at(in_degrees).refuse(f"{key} or {in_degrees}", "both")
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


def _number(place: TableKey, table: dict[str, Any], key: str, limits: Range, absent: float) -> float:
    value, (low, high) = table.get(key, absent), limits
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise place.at(key).refuse(f"a number from {low:g} to {high:g}", repr(value)[:60])
    return float(value)


def _sensors(place: TableKey, table: object, base: VehicleSensors) -> VehicleSensors:
    sensors = fill_config(VehicleSensors, place, table, base=base)
    _hold(place, sensors, _SENSORS)
    if sensors.gnss_hz > sensors.record_hz or abs(100.0 / sensors.record_hz % 1.0) > 1e-9:
        expected = "a record_hz of 100 or a whole part of it, no less than gnss_hz"
        raise place.at("record_hz").refuse(expected, f"{sensors.record_hz:g}")
    if abs(round(100.0 / sensors.fix_hz) * sensors.fix_hz / 100.0 - 1.0) > 1e-9:
        raise place.at("fix_hz").refuse("100 or a whole part of it", f"{sensors.fix_hz:g}")
    return sensors


def _hold(place: TableKey, config: object, ranges: dict[str, Range]) -> None:
    """Check every number of a dataclass against its range, those without one against 0."""
    for name, value in vars(config).items():
        low, high = ranges.get(name, _NON_NEGATIVE)
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, float) and not low <= number <= high:
                raise place.at(name).refuse(f"a number from {low:g} to {high:g}", f"{number:g}")
