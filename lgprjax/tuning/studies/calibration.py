"""Calibration of a new vehicle, step by step: manoeuvres, fits to their logs, and the steps that remain.

A step is a manoeuvre, driven by hand or commanded; studies turn its drive log into numbers of the vehicle file. The
file itself records the progress of a calibration: a step is due while a number that it finds is open or assumed.
"""

from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from lgprjax.errors import InputError
from lgprjax.formats import Study, VehicleFile, VehicleLog, flat_keys, with_values, write_vehicle
from lgprjax.formats.settings_files import Kind
from lgprjax.tuning.studies.steering import FinishedStudy, run_study


class StepStudy(NamedTuple):
    """Kind of a study, and name of the step whose drive it fits (empty for a study without a drive)."""

    kind: Kind
    drive: str


class CalibrationStep(NamedTuple):
    """A step of a calibration.

    Attributes:
        name: name of the step and of its drive log.
        title: title shown to the crew.
        prompt: instructions to the crew, one line each.
        commands: actuators that the software moves.
        finds: paths of the vehicle file's numbers that the step determines.
        needs: paths of numbers that must be known or assumed beforehand.
        studies: studies in the order in which they run.
    """

    name: str
    title: str
    prompt: tuple[str, ...]
    commands: Literal["none", "steering", "pedals"]
    finds: tuple[str, ...]
    needs: tuple[str, ...]
    studies: tuple[StepStudy, ...]


_PEDAL_KEYS = ("pre_tension", "dead_zone", "gain_mps2", "lag_s")
STEPS = (
    CalibrationStep(
        name="straight",
        title="Straight line",
        prompt=(
            "Drive straight ahead by hand for 100 m at 2 to 3 m/s, the steering wheel hardly turned.",
            "Then stop.",
        ),
        commands="none",
        finds=("steering.straight_potentiometer_v",),
        needs=("navigation.gnss_x_m",),
        studies=(StepStudy("straight", "straight"),),
    ),
    CalibrationStep(
        name="palm_tree",
        title="Palm tree",
        prompt=(
            "Turn the steering wheel fully to the left. Wait 2 s.",
            "Drive a quarter of a circle (at most 25 m) at 1.5 m/s, wait 2 s, drive back to the start, wait 2 s.",
            "Turn the wheel half a turn to the right (a quarter, if it has fewer than three turns) and repeat,",
            "until it is fully at the right.",
        ),
        commands="none",
        finds=("steering.rear_ratio", "steering.potentiometer_v_per_rad", "wheel_map.front_rad"),
        needs=("chassis.wheelbase_m", "navigation.gnss_x_m"),
        studies=(StepStudy("rear_ratio", "palm_tree"), StepStudy("wheel_angle", "palm_tree")),
    ),
    CalibrationStep(
        name="turns",
        title="Turning tests",
        prompt=(
            "Hold the wheels some 6 degrees to the left for 12 s at 1 m/s, then as much to the right for 12 s.",
            "Repeat at 2, 3.5, 5 and 6.5 m/s, or as fast as is safe: the fastest at least twice the slowest.",
            "Then stop.",
        ),
        commands="none",
        finds=("steering.characteristic_speed_mps",),
        needs=("wheel_map.front_rad",),
        # The palm tree is fitted again, because the slip is known now.
        studies=(StepStudy("yaw_gain", "turns"), StepStudy("wheel_angle", "palm_tree")),
    ),
    CalibrationStep(
        name="half_turns",
        title="Half turns of the steering wheel",
        prompt=(
            "Stand still. Turn the steering wheel fully to the right. Wait 3 s.",
            "Turn it to the left in half turns, each with a pause of 3 s, to the stop.",
            "Turn it back to the right in the same way.",
        ),
        commands="none",
        finds=("steering.encoder_counts_per_v", "steering.encoder_counts_per_rad"),
        needs=("steering.potentiometer_v_per_rad",),
        studies=(StepStudy("encoder", "half_turns"),),
    ),
    CalibrationStep(
        name="steering",
        title="Steering steps",
        prompt=(
            "Stand still on level ground. Keep people away from the wheels.",
            "Press the steering button: the wheels turn by themselves for 70 s.",
            "Override, or a hand on the steering wheel, ends it.",
        ),
        commands="steering",
        finds=("steering.lag_s", "steering.largest_wheel_rate_radps", "steering.dead_band_rad"),
        needs=("steering.encoder_counts_per_rad",),
        studies=(StepStudy("servo", "steering"),),
    ),
    CalibrationStep(
        name="pedals",
        title="Pedal steps",
        prompt=(
            "Stand at the beginning of a level, straight and empty stretch. Nobody is ahead of the vehicle.",
            "Press the steering button, then plus: the vehicle drives 14 times from standstill to standstill.",
            "At the end of the stretch it stops: press override, turn round by hand, and engage again.",
        ),
        commands="pedals",
        finds=(
            *(f"{pedal}.{key}" for pedal in ("throttle", "brake") for key in _PEDAL_KEYS),
            "resistance.rolling_mps2",
            "resistance.drag_per_s",
        ),
        needs=("steering.lag_s",),
        studies=(StepStudy("pedals", "pedals"),),
    ),
    CalibrationStep(
        name="look_ahead",
        title="Look-ahead",
        prompt=("Nothing is driven: the look-ahead is fitted to the numbers found.",),
        commands="none",
        finds=tuple(f"pursuit.{key}" for key in ("short_m", "long_m", "slow_mps", "fast_mps")),
        needs=("steering.lag_s",),
        studies=(StepStudy("look_ahead", ""),),
    ),
)
"""Calibration steps in the order in which they are driven."""

State = Literal["known", "assumed", "open"]
_LARGEST_ASSUMED_RAD, _LARGEST_SHARE = 0.7, 0.98
_STALL_SHARE = 0.5


def state_of(vehicle: VehicleFile, path: str) -> State:
    """Whether a number of a vehicle file is known, assumed or open."""
    if path not in flat_keys(vehicle.model_dump(exclude_none=True, exclude={"found"})):
        return "open"
    return "assumed" if path in vehicle.assumed else "known"


def steps_of(vehicle: VehicleFile) -> list[CalibrationStep]:
    """The steps of a vehicle: a kit without speed control has no pedals to calibrate."""
    return [step for step in STEPS if vehicle.speed_control or step.commands != "pedals"]


def is_due(vehicle: VehicleFile, step: CalibrationStep) -> bool:
    """Whether a step has something left to find."""
    return any(state_of(vehicle, path) != "known" for path in step.finds)


def require_measured(vehicle: VehicleFile, path: Path, step: CalibrationStep) -> None:
    """Refuse a step that needs a number which is still open.

    Raises:
        InputError: a needed number is open; the first one is named.
    """
    for needed in step.needs:
        if state_of(vehicle, needed) == "open":
            finder = next((each.name for each in STEPS if needed in each.finds), None)
            how = "a number, measured with a tape" if finder is None else f"a number, found by step {finder}"
            raise InputError(path, needed, f"{how}, before step {step.name}", "open")


class FittedStep(NamedTuple):
    """A fitted step: the vehicle with the numbers found, and the finished studies in order."""

    vehicle: VehicleFile
    studies: tuple[FinishedStudy, ...]


def fit_step(step: CalibrationStep, vehicle: VehicleFile, logs: dict[str, Path], scratch: Path) -> FittedStep:
    """Fit a step's studies to drive logs.

    Args:
        step: calibration step to fit.
        vehicle: vehicle file with the numbers known so far.
        logs: path of each drive log, by name of its step.
        scratch: path of the vehicle file that is written between the studies.

    Raises:
        InputError: a log is missing, or does not hold what a fit needs.
    """
    finished = []
    for kind, drive in step.studies:
        if kind == "rear_ratio" and _is_stated(vehicle, "steering.rear_ratio"):
            continue
        log = None
        if drive:
            log = logs.get(drive)
            if log is None:
                raise InputError(scratch, drive, f"the drive log of step {drive}", "none: drive that step again")
        vehicle = _prepared(vehicle, kind, log)
        write_vehicle(scratch, vehicle, force=True)
        options: dict[str, Any] = {}
        study = Study(
            file=scratch,
            name=kind,
            kind=kind,
            vehicle=scratch,
            serial_number=vehicle.serial_number,
            logs=() if log is None else (log,),
            held_out=(),
            options=options,
        )
        done = run_study(study)
        vehicle = _completed(done.vehicle, kind)
        finished.append(done)
    return FittedStep(vehicle, tuple(finished))


def _is_stated(vehicle: VehicleFile, path: str) -> bool:
    """Whether the crew knows a number without a study, such as the ratio 0 of rear wheels that do not steer."""
    return state_of(vehicle, path) == "known" and path not in vehicle.found


def _prepared(vehicle: VehicleFile, kind: str, log: Path | None) -> VehicleFile:
    """The vehicle with assumed values for numbers that a study requires but does not depend on."""
    if state_of(vehicle, "steering.largest_wheel_angle_rad") == "open":
        vehicle = with_values(vehicle, {"steering.largest_wheel_angle_rad": _LARGEST_ASSUMED_RAD}, {}, assumed=True)
    if kind == "servo" and log is not None and state_of(vehicle, "steering.nominal_v") == "open":
        nominal_v = _supply_v(log)
        vehicle = with_values(vehicle, {"steering.nominal_v": nominal_v}, {})
        vehicle = with_values(vehicle, {"steering.stall_v": _STALL_SHARE * nominal_v}, {}, assumed=True)
    if kind == "look_ahead" and state_of(vehicle, "pursuit.anchor_m") == "open":
        ahead_m = vehicle.array.x_m if vehicle.array.x_m is not None else vehicle.chassis.wheelbase_m
        vehicle = with_values(vehicle, {"pursuit.anchor_m": ahead_m}, {}, assumed=True)
    return vehicle


def _completed(vehicle: VehicleFile, kind: str) -> VehicleFile:
    """The vehicle with its command limit: the smaller angle of the two steering stops, which the palm tree reaches."""
    if (
        kind == "wheel_angle"
        and vehicle.wheel_map is not None
        and (state_of(vehicle, "steering.largest_wheel_angle_rad") == "assumed")
    ):
        ends = vehicle.wheel_map.front_rad[0], vehicle.wheel_map.front_rad[-1]
        largest = _LARGEST_SHARE * min(abs(end) for end in ends)
        vehicle = with_values(vehicle, {"steering.largest_wheel_angle_rad": largest}, {})
    return vehicle


def _supply_v(log: Path) -> float:
    """Median supply voltage while the servo was commanded, V."""
    signals = VehicleLog.open(log).vehicle or {}
    volts = np.asarray(signals.get("supply_v", []), np.float64)
    if not np.isfinite(volts).any():
        raise InputError(log, "/vehicle/supply_v", "the supply voltage of the servo", "none")
    return round(float(np.nanmedian(volts)), 2)
