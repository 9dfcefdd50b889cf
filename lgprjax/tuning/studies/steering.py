"""Studies of sensors, steering, servo and pedals: from a study file and logs to a new vehicle file.

Not imported by ``lgprjax.tuning.studies``, so that registration does not have to import the tuners.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.config import ConfigTable
from lgprjax.errors import InputError
from lgprjax.formats import Found, Study, VehicleFile, VehicleLog, read_vehicle, require_serial_number, with_values
from lgprjax.recordings.vehicles import servo_of
from lgprjax.tuning import DriveSignals, Estimate, NotExcitedError
from lgprjax.tuning.arcs import Arcs, find_stretches, fit_arcs
from lgprjax.tuning.pedals import WHAT, PedalFit, PedalRuns, PedalsFit, cut_runs, fit_pedals, levelled, predict_way
from lgprjax.tuning.robust import student_95
from lgprjax.tuning.sensors import EncoderFit, StraightFit, fit_encoder, fit_straight, fitted_volts
from lgprjax.tuning.servo import ServoFit, fit_servo, servo_log, to_box, wheel_angles
from lgprjax.tuning.steering import (
    RearMapFit,
    RearRatioFit,
    SteeringMap,
    WheelAngleFit,
    YawGainFit,
    fit_rear_map,
    fit_wheel_angle,
    fit_yaw_gain,
    front_angle,
    front_band,
    rear_ratio_by_angles,
    rear_ratio_by_heading,
    wheel_angle_blocks,
)
from lgprjax.tuning.studies.drives import is_run
from lgprjax.tuning.studies.logs import (
    Figure,
    LoggedDrive,
    Outcome,
    Task,
    chassis_without_anchor,
    fitting,
    fixed_records,
    fixes_beside,
    front_angles,
    one_drive,
    options_of,
    potentiometer_of,
    refuse_options,
    rms,
    signal_of,
    signals_of,
)
from lgprjax.tuning.studies.look_ahead import study_look_ahead
from lgprjax.tuning.studies.loop import study_loop
from lgprjax.tuning.studies.navigation import study_fusion
from lgprjax.tuning.studies.needs import (
    NEEDS,
    Contradiction,
    compared,
    judged_residual,
    require_excitation,
    require_precision,
)
from lgprjax.tuning.studies.threshold import study_threshold
from lgprjax.tuning.studies.tracking import study_tracking
from lgprjax.vehicle import Chassis, Servo


def _residuals(
    task: Task, what: str, own: float, judge: Callable[[LoggedDrive], Figure]
) -> tuple[list[Figure], tuple[Contradiction, ...]]:
    """Residual figures of the held-out drives, and contradictions to the fit's residuals ``own``, in their unit."""
    figures = [judge(drive) for drive in task.judges]
    against = [
        one
        for drive, figure in zip(task.judges, figures, strict=True)
        for one in judged_residual(what, drive.path, own, figure.value, figure.unit)
    ]
    return figures, tuple(against)


def _numbers(
    task: Task, place: str, own: Estimate, judge: Callable[[LoggedDrive], Estimate], what: str, unit: str
) -> tuple[list[Figure], tuple[Contradiction, ...]]:
    """Differences of a number from that of each held-out drive, and the contradictions among them."""
    figures, against = [], list[Contradiction]()
    for drive in task.judges:
        held = judge(drive)
        away = (held.value - own.value) * (1e3 if unit == "mV" else 1.0)
        figures.append(Figure(f"held out, {drive.path.name}: its {what} minus this one", away, unit))
        against += compared(place, drive.path, own, held)
    return figures, tuple(against)


# Study of throttle and brake: pre-tension, dead zone, gain and lag of each, and the resistances.


class PedalsStudy(NamedTuple):
    """Data for pictures: the drive, its runs, and the modelled distance in each run, in the odometer's metres."""

    signals: DriveSignals
    runs: PedalRuns
    model_m: Float[np.ndarray, " record"]
    fit: PedalsFit


def study_pedals(task: Task) -> Outcome:
    """Find ``throttle``, ``brake`` and ``resistance``."""
    refuse_options(task)
    if not task.vehicle.speed_control:
        raise InputError(task.study.vehicle, "speed_control", "true, for a study of throttle and brake", "false")
    drive = one_drive(task)
    with fitting(drive.path):
        fit = fit_pedals(drive.signals)
        runs = cut_runs(drive.signals, WHAT)
    found = {
        f"{pedal}.{name}": estimate
        for pedal, one in (("throttle", fit.throttle), ("brake", fit.brake))
        for name, estimate in zip(PedalFit._fields, one, strict=True)
    }
    found |= {"resistance.rolling_mps2": fit.rolling_mps2, "resistance.drag_per_s": fit.drag_per_s}
    figures = [Figure("distance in a run, measured minus model, rms", fit.rms_m, "m")]
    judged, against = _residuals(task, "distance in a run", max(fit.rms_m, 0.01), lambda drive: _judge(drive, fit))
    scale = fit.metres_per_odometer_metre
    notes = [f"{fit.runs} runs from standstill to standstill"]
    if scale is None:
        notes.append("no fixes: accelerations are in the odometer's metres")
    else:
        notes.append(f"a metre of the odometer is {scale.value:.4f} m by the fixes")
    model_m = levelled(runs, _way(runs, fit))
    detail = PedalsStudy(drive.signals, runs, model_m, fit)
    return Outcome({**found}, {}, (*figures, *judged), tuple(notes), detail, against)


def _way(runs: PedalRuns, fit: PedalsFit) -> Float[np.ndarray, " record"]:
    scale = 1.0 if fit.metres_per_odometer_metre is None else fit.metres_per_odometer_metre.value
    values = []
    for pedal in (fit.throttle, fit.brake):
        values += [pedal.pre_tension.value, pedal.dead_zone.value, pedal.gain_mps2.value / scale, pedal.lag_s.value]
    values += [fit.rolling_mps2.value / scale, fit.drag_per_s.value]
    return np.asarray(predict_way(runs, np.array([values]))[0][0])


def _judge(judge: LoggedDrive, fit: PedalsFit) -> Figure:
    """Distances of another drive relative to this fit's model."""
    with fitting(judge.path):
        runs = cut_runs(judge.signals, WHAT)
    left = levelled(runs, judge.signals.travel_m[runs.record]) - levelled(runs, _way(runs, fit))
    return Figure(f"held out, {judge.path.name}: distance minus model, rms", rms(left), "m")


# Study of k, the rear wheels' share of the front angle: by INS heading on turns, or by two measured wheel angles.


class RearRatioOptions(ConfigTable):
    """Method by which k is found; ``rear_map`` finds a map of rear angles instead."""

    method: Literal["heading", "wheel_angles", "rear_map"] = "heading"


class HeadingStudy(NamedTuple):
    """For pictures: arcs, the chassis that they were fitted with, and k."""

    arcs: Arcs
    chassis: Chassis
    fit: RearRatioFit


class WheelAnglesStudy(NamedTuple):
    """For pictures: measured angles, means over a second each, and k."""

    front_rad: Float[np.ndarray, " block"]
    rear_rad: Float[np.ndarray, " block"]
    fit: RearRatioFit


def study_rear_ratio(task: Task) -> Outcome:
    """Find ``steering.rear_ratio``, or ``rear_map``; ``options.method`` selects the method, by default the heading."""
    method = options_of(task, RearRatioOptions).method
    drive = one_drive(task)
    if method == "rear_map":
        return _rear_map(task, drive)
    chassis = chassis_without_anchor(task)
    fit, detail = _fit(method, drive, chassis)
    figures, against = _numbers(
        task, "steering.rear_ratio", fit.ratio, lambda judge: _fit(method, judge, chassis)[0].ratio, "k", ""
    )
    offset = np.degrees([fit.offset_rad.value, fit.offset_rad.low, fit.offset_rad.high])
    what = "INS heading against the body" if method == "heading" else "rear angle where the front one is 0"
    notes = [f"{what}: {offset[0]:.3f}° ({offset[1]:.3f} to {offset[2]:.3f})", f"{fit.numbers} numbers in the fit"]
    if method == "heading":
        notes.append(f"drift of the headings in addition to their noise: {np.degrees(fit.drift_rad):.3f}°")
    return Outcome({"steering.rear_ratio": fit.ratio}, {}, tuple(figures), tuple(notes), detail, against)


def _rear_map(task: Task, drive: LoggedDrive) -> Outcome:
    """Fit ``rear_map``, which takes precedence over k wherever the vehicle file is used."""
    with fitting(drive.path):
        fit, ratio = fit_rear_map(drive.signals), rear_ratio_by_angles(drive.signals)
    own_deg = float(np.degrees(fit.scale_rad))
    judged, against = _residuals(task, "rear_map", max(own_deg, 0.1), lambda judge: _judge_rear_map(judge, fit))
    knots = (fit.rear.rear_rad, (fit.high_rad - fit.low_rad) / 3.92, fit.low_rad, fit.high_rad)
    first, second = (float(angle) for angle in fit.front_rad[:2])
    return Outcome(
        {"rear_map.rear_rad": _knots(*knots)},
        {"rear_map.first_rad": first, "rear_map.step_rad": second - first},
        (Figure("records' means about the map", own_deg, "deg"), *judged),
        (f"a constant k would be {ratio.ratio.value:.4f} ({ratio.ratio.low:.4f} to {ratio.ratio.high:.4f})",),
        WheelAnglesStudy(*wheel_angle_blocks(drive.signals), ratio),
        against,
    )


def _judge_rear_map(judge: LoggedDrive, fit: RearMapFit) -> Figure:
    """The map of another drive minus this one, over their common angles."""
    with fitting(judge.path):
        held = fit_rear_map(judge.signals)
    low, high = max(fit.front_rad[0], held.front_rad[0]), min(fit.front_rad[-1], held.front_rad[-1])
    if low >= high:
        first, last = np.degrees(fit.front_rad[[0, -1]])
        found = f"{np.degrees(held.front_rad[0]):.1f} to {np.degrees(held.front_rad[-1]):.1f}°"
        raise InputError(judge.path, "front_rad", f"angles between {first:.1f} and {last:.1f}°", found)
    front = np.linspace(low, high, len(fit.rear.rear_rad))
    theirs, ours = (np.interp(front, one.front_rad, np.asarray(one.rear.rear_rad, np.float64)) for one in (held, fit))
    name = f"held out, {judge.path.name}: its map less this one, rms"
    return Figure(name, float(np.degrees(rms(theirs - ours))), "deg")


def _knots(*columns: Float[np.ndarray, " knot"] | Float[Array, " knot"]) -> list[Estimate]:
    """Numbers of a map from columns of their values, standard errors and bounds."""
    return [Estimate(*(float(number) for number in knot)) for knot in zip(*columns, strict=True)]


def _fit(method: str, drive: LoggedDrive, chassis: Chassis) -> tuple[RearRatioFit, HeadingStudy | WheelAnglesStudy]:
    with fitting(drive.path):
        if method == "wheel_angles":
            fit = rear_ratio_by_angles(drive.signals)
            return fit, WheelAnglesStudy(*wheel_angle_blocks(drive.signals), fit)
        # Any steering signal can cut the stretches: the wheels are still where it is constant.
        volts = drive.signals.potentiometer_v
        steering = signal_of(drive, "front_rad") if volts is None else volts
        arcs = fit_arcs(drive.signals, find_stretches(drive.signals, steering))
        fit = rear_ratio_by_heading(arcs, chassis)
        return fit, HeadingStudy(arcs, chassis, fit)


# Studies of the steering's sensors: the straight potentiometer value, and the encoder against the potentiometer.


class EncoderStudy(NamedTuple):
    """For pictures: the drive, the fit, and the change of the potentiometer with the wheels where it is known."""

    signals: DriveSignals
    fit: EncoderFit
    v_per_rad: float | None


def study_straight(task: Task) -> Outcome:
    """Find ``steering.straight_potentiometer_v``."""
    refuse_options(task)
    fit, place = _fit_straight(one_drive(task)), "steering.straight_potentiometer_v"
    line = fit.potentiometer_v.value + fit.slope_vm.value * fit.curvature_radpm
    own = Figure("windows relative to the fit, rms", 1e3 * rms((fit.window_v - line)[fit.weight > 0.0]), "mV")
    value = fit.potentiometer_v
    figures, against = _numbers(task, place, value, lambda judge: _fit_straight(judge).potentiometer_v, "value", "mV")
    notes = (f"{fit.turning} windows left out because they turned",) if fit.turning else ()
    return Outcome({place: value}, {}, (own, *figures), notes, fit, against)


def _fit_straight(drive: LoggedDrive) -> StraightFit:
    with fitting(drive.path):
        return fit_straight(fixed_records(drive.signals))


def study_encoder(task: Task) -> Outcome:
    """Find counts per volt and, if the vehicle file has volts per radian, counts per radian and the play."""
    refuse_options(task)
    drive, steering = one_drive(task), task.vehicle.steering
    with fitting(drive.path):
        fit = fit_encoder(drive.signals, steering.straight_potentiometer_v)
    v_per_rad = steering.potentiometer_v_per_rad
    found: dict[str, Estimate | list[Estimate]] = {"steering.encoder_counts_per_v": fit.counts_per_v}
    notes = [fit.why]
    if v_per_rad is None:
        play = f"play {fit.hysteresis_counts.value:.1f} counts"
        notes.append(f"{play}; counts per radian need steering.potentiometer_v_per_rad, from a study of wheel_angle")
    else:
        half = _half_width(task.vehicle.found.get("steering.potentiometer_v_per_rad"))
        found["steering.encoder_counts_per_rad"] = per_rad = _times(fit.counts_per_v, v_per_rad, half)
        share = 0.5 * (per_rad.high - per_rad.low) / per_rad.value
        play_rad = _times(fit.hysteresis_counts, 1.0 / abs(per_rad.value), share / per_rad.value)
        found["steering.backlash_rad"] = Estimate(*(max(number, 0.0) for number in play_rad))
    figures = [Figure("pauses relative to the fit, rms", fit.rms_counts, "count")]
    if v_per_rad is not None:
        per_count = float(np.degrees(abs(1.0 / (fit.counts_per_v.value * v_per_rad))))
        figures.append(Figure("the same at the road wheel", fit.rms_counts * per_count, "deg"))
    own = 1e3 * fit.rms_counts / abs(fit.counts_per_v.value) if v_per_rad is None else figures[1].value
    judged, against = _residuals(task, "pauses", own, lambda judge: _judge_sensor(judge, fit, v_per_rad))
    detail = EncoderStudy(drive.signals, fit, v_per_rad)
    return Outcome(found, {}, (*figures, *judged), tuple(notes), detail, against)


def _judge_sensor(judge: LoggedDrive, fit: EncoderFit, v_per_rad: float | None) -> Figure:
    """Residuals of another drive's pauses from this fit; the encoder's zero, set at each start, is fitted anew."""
    with fitting(judge.path):
        held = fit_encoder(judge.signals, fit.reference_v)
    moved = fit._replace(reference_counts=held.reference_counts)
    left_v = held.pauses.potentiometer_v - fitted_volts(moved, held.pauses.counts, held.pauses.direction)
    name = f"held out, {judge.path.name}: pauses relative to this fit, rms"
    if v_per_rad is None:
        return Figure(name, 1e3 * rms(left_v), "mV")
    return Figure(name, float(np.degrees(rms(left_v) / abs(v_per_rad))), "deg")


def _half_width(found: Found | None) -> float:
    """Half of the 95 % interval of a number of the vehicle file; none if it was not found by a study."""
    if found is None or isinstance(found.low, list) or isinstance(found.high, list):
        return 0.0
    return 0.5 * (found.high - found.low)


def _times(number: Estimate, factor: float, factor_half: float = 0.0) -> Estimate:
    """An estimate times a factor with its own half interval; their errors are independent."""
    value = number.value * factor
    half = float(np.hypot(0.5 * (number.high - number.low) * factor, number.value * factor_half))
    return Estimate(value, half / 1.96, value - half, value + half)


# Study of the steering servo: lag, delay, dead band and rate from its commands and the measured wheel angles.

_KEYS = ("lag_s", "delay_s", "dead_band_rad", "largest_wheel_rate_radps", "asymmetry")


class ServoStudy(NamedTuple):
    """For pictures: the drive, the wheel angles that were fitted, and the fit."""

    signals: DriveSignals
    measured_rad: Float[np.ndarray, " record"]
    fit: ServoFit


def study_servo(task: Task) -> Outcome:
    """Find the servo's numbers in ``steering``; its play and voltages come from the vehicle file.

    Wheel angles are those of the vehicle file's ``wheel_map`` at the potentiometer's values; without one, those of the
    wheel angle's own sensor.
    """
    refuse_options(task)
    drive = one_drive(task)
    signal_of(drive, "command_rad")
    measured, origin = front_angles(task, drive)
    with fitting(drive.path):
        fit = fit_servo(drive.signals, measured, _given(task))
    found = {f"steering.{key}": estimate for key, estimate in zip(_KEYS, fit[:5], strict=True)}
    left_deg = np.degrees(measured - fit.model_rad)
    figures = [
        Figure("wheel angle, measured minus model, rms", rms(left_deg[np.isfinite(left_deg)]), "deg"),
        Figure("records per independent residual", fit.memory, ""),
        Figure("largest difference between the swarm's and the gradient's numbers", fit.apart, "standard errors"),
    ]
    own_deg = max(figures[0].value, 0.05)
    judged, against = _residuals(task, "wheel angle", own_deg, lambda judge: _judge_servo(task, judge, fit))
    agree = "agree" if fit.agree else "do NOT agree: the fit may not be the best one"
    notes = (
        f"wheel angles by {origin}; straight ahead they read {np.degrees(fit.zero_rad.value):.3f}°",
        f"play of {np.degrees(float(fit.servo.backlash_rad)):.2f}° taken as given",
        f"search by gradient and by particle swarm {agree}",
    )
    detail = ServoStudy(drive.signals, measured, fit)
    return Outcome({**found}, {}, (*figures, *judged), notes, detail, against)


def _given(task: Task) -> Servo:
    """Play and voltages of the file; the fitted numbers are placeholders."""
    sought = {f"steering.{key}": 0.0 for key in _KEYS} | {"steering.largest_wheel_rate_radps": 1.0}
    return servo_of(with_values(task.vehicle, sought, {}), task.study.vehicle)


def _judge_servo(task: Task, judge: LoggedDrive, fit: ServoFit) -> Figure:
    """Wheel angles of another drive relative to this fit's model."""
    measured, _ = front_angles(task, judge)
    numbers = np.array([estimate.value for estimate in fit[:6]])
    with fitting(judge.path):
        log = servo_log(judge.signals, measured, fit.servo)
    model = np.asarray(wheel_angles(log, jnp.asarray(to_box(numbers), jnp.float32)), np.float64)
    left_deg = np.degrees((measured - model)[np.asarray(log.used)])
    return Figure(f"held out, {judge.path.name}: wheel angle minus model, rms", rms(left_deg), "deg")


# Study of the palm tree: potentiometer to front wheel angle.

# The map is a cubic: linear interpolation between this many knots is within a hundredth of a degree.
_KNOTS = 17


class WheelAngleStudy(NamedTuple):
    """For pictures: the drive, its arcs and the map."""

    signals: DriveSignals
    arcs: Arcs
    fit: WheelAngleFit


def study_wheel_angle(task: Task) -> Outcome:
    """Find ``wheel_map``; it also gives the value of straight driving and the slope there."""
    refuse_options(task)
    drive, chassis = one_drive(task), chassis_without_anchor(task)
    with fitting(drive.path):
        arcs = _arcs(drive)
        fit = fit_wheel_angle(arcs, chassis)
    steering_map = fit.map
    knots = np.linspace(-1.0, 1.0, _KNOTS) * steering_map.half_span + steering_map.middle
    front, (low, high) = front_angle(steering_map, knots), front_band(steering_map, knots)
    # Arcs determine the turn of both axles together: an error of k shifts every angle.
    shared = _ratio_half(task.vehicle)
    half = np.hypot(0.5 * (high - low), shared * np.abs(front))
    low, high = front - half, front + half
    sigma = half / student_95(steering_map.degrees)
    figures = [Figure("residuals of the fit, rms", rms(np.degrees(fit.residual_rad)), "deg")]
    own_deg = max(figures[0].value, 0.1)
    judged, against = _residuals(task, "wheel_map", own_deg, lambda judge: _judge_wheel_angle(judge, chassis, fit))
    return Outcome(
        found={
            "wheel_map.front_rad": _knots(front, sigma, low, high),
            "steering.potentiometer_v_per_rad": _times(_slope_at_straight(steering_map), 1.0, shared),
        },
        fixed={"wheel_map.first_v": float(knots[0]), "wheel_map.step_v": float(knots[1] - knots[0])},
        figures=(*figures, *judged),
        notes=tuple(f"{count} stretches left out: {why}" for why, count in fit.dropped.items()),
        detail=WheelAngleStudy(drive.signals, arcs, fit),
        contradictions=against,
    )


def _ratio_half(vehicle: VehicleFile) -> float:
    """Half of the 95 % interval common to all front angles, relative to the angle, due to the interval of k."""
    half = _half_width(vehicle.found.get("steering.rear_ratio"))
    return half / (1.0 + (vehicle.steering.rear_ratio or 0.0))


def _slope_at_straight(steering_map: SteeringMap) -> Estimate:
    """Volts per radian where the map crosses straight ahead; the interval is that of radians per volt, inverted."""
    u = np.linspace(-1.0, 1.0, 2001)
    volts = steering_map.middle + u * steering_map.half_span
    at = u[np.argmin(np.abs(front_angle(steering_map, volts)))]
    powers = np.arange(len(steering_map.coefficients_rad))
    row = powers * at ** np.maximum(powers - 1, 0) / steering_map.half_span
    rad_per_v = float(row @ steering_map.coefficients_rad)
    sigma = float(np.sqrt(row @ steering_map.covariance_rad2 @ row))
    half = student_95(steering_map.degrees) * sigma
    low, high = sorted([1.0 / (rad_per_v - half), 1.0 / (rad_per_v + half)])
    return Estimate(1.0 / rad_per_v, sigma / rad_per_v**2, low, high)


def _arcs(drive: LoggedDrive) -> Arcs:
    return fit_arcs(drive.signals, find_stretches(drive.signals, potentiometer_of(drive)))


def _judge_wheel_angle(judge: LoggedDrive, chassis: Chassis, fit: WheelAngleFit) -> Figure:
    """Difference between the angles from another drive's arcs and the map."""
    with fitting(judge.path):
        held = fit_wheel_angle(_arcs(judge), chassis)
    inside = np.abs(held.steering - fit.map.middle) <= fit.map.half_span
    left = held.front_rad[inside] - front_angle(fit.map, held.steering[inside])
    return Figure(f"held out, {judge.path.name}: angle minus map, rms", rms(np.degrees(left)), "deg")


# Study of the characteristic speed: loss of yaw rate in turns with rising speed.


class YawGainStudy(NamedTuple):
    """For pictures: the fit."""

    fit: YawGainFit


def study_yaw_gain(task: Task) -> Outcome:
    """Find ``steering.characteristic_speed_mps``.

    Front angles are those of the vehicle file's ``wheel_map`` at the potentiometer's values; without one, those of the
    wheel angle's own sensor.
    """
    refuse_options(task)
    drive = one_drive(task)
    fit, origin = _fit_yaw_gain(task, drive)
    own = Figure("scatter of 1/G beyond what the arcs explain", fit.extra, "")
    speed, place = fit.characteristic_speed_mps, "steering.characteristic_speed_mps"
    figures, against = _numbers(
        task, place, speed, lambda judge: _fit_yaw_gain(task, judge)[0].characteristic_speed_mps, "speed", "m/s"
    )
    scale = fit.scale
    notes = (
        f"front angles from {origin}",
        f"{len(fit.speed_mps)} turns, {fit.speed_mps.min():.1f} to {fit.speed_mps.max():.1f} m/s",
        f"curvature by the wheel angles over the true one, at no speed: {scale.value:.4f} "
        f"({scale.low:.4f} to {scale.high:.4f})",
        f"front angles read {np.degrees(fit.offset_rad):.3f}° too far to the left",
    )
    return Outcome({place: speed}, {}, (own, *figures), notes, YawGainStudy(fit), against)


def _fit_yaw_gain(task: Task, drive: LoggedDrive) -> tuple[YawGainFit, str]:
    chassis = chassis_without_anchor(task)
    front, origin = front_angles(task, drive)
    with fitting(drive.path):
        arcs = fit_arcs(drive.signals, find_stretches(drive.signals, front))
        fit = fit_yaw_gain(arcs, chassis, *_means(front, arcs))
        if not np.isfinite(fit.characteristic_speed_mps.high):
            low = fit.characteristic_speed_mps.low
            found = f"a characteristic speed of {low:.0f} m/s or any above"
            raise NotExcitedError("yaw gain", "turns fast enough for a significant loss of yaw rate", found)
    return fit, origin


def _means(
    front_rad: Float[np.ndarray, " record"], arcs: Arcs
) -> tuple[Float[np.ndarray, " stretch"], Float[np.ndarray, " stretch"]]:
    """Mean over each stretch, and its standard error; the fit removes a common error of all angles itself."""
    spans = list(zip(arcs.stretches.start, arcs.stretches.stop, strict=True))
    held = [front_rad[start:stop][np.isfinite(front_rad[start:stop])] for start, stop in spans]
    mean = np.array([float(np.mean(values)) for values in held])
    return mean, np.array([float(np.std(values)) / np.sqrt(len(values)) for values in held])


class FinishedStudy(NamedTuple):
    """A finished study.

    Attributes:
        study: contents of the study file.
        outcome: result and its quality.
        vehicle: vehicle file with the numbers found, ready to be written.
    """

    study: Study
    outcome: Outcome
    vehicle: VehicleFile


def run_study(study: Study) -> FinishedStudy:
    """Run a study; nothing is written.

    Raises:
        InputError: a file cannot be read, is about another vehicle, or does not hold what the fit needs.
    """
    vehicle = read_vehicle(study.vehicle)
    require_serial_number(vehicle, study.vehicle, study.serial_number, study.file, "serial_number")
    drives = _read_logs(study, vehicle, study.logs, "logs")
    judges = _read_logs(study, vehicle, study.held_out, "held_out")
    outcome = _RUN[study.kind](Task(study, vehicle, drives, judges))
    by_fixes = [drive.path.name for drive in (*drives, *judges) if drive.by_fixes]
    if by_fixes:
        outcome = outcome._replace(notes=(*outcome.notes, f"positions of {', '.join(by_fixes)}: radar fixes"))
    require_precision(study.kind, study.logs[0] if study.logs else study.file, outcome.found)
    for one in outcome.contradictions:
        raise InputError(one.path, f"{one.what}, held out", one.expected, f"{one.found}; no vehicle file is written")
    logs = ", ".join(path.name for path in study.logs) or "simulated"
    values: dict[str, Any] = dict(outcome.fixed)
    found: dict[str, Found] = {}
    for path, estimates in outcome.found.items():
        values[path], found[path] = _as_found(estimates, study.name, logs)
    return FinishedStudy(study, outcome, with_values(vehicle, values, found))


_BY_PLACES = ("straight", "wheel_angle", "rear_ratio", "yaw_gain")
"""Kinds that fit lines and arcs to positions: fixes next to a log come before the positions of its navigation."""


def _read_logs(study: Study, vehicle: VehicleFile, paths: Sequence[Path], key: str) -> tuple[LoggedDrive, ...]:
    if key == "logs" and not paths and study.kind != "look_ahead":
        raise InputError(study.file, key, "at least one drive log", "none")
    if study.kind in ("threshold", "tracking", "loop", "look_ahead"):
        return ()  # their logs may be recorded runs, which they read by themselves
    drives = []
    for path in paths:
        if is_run(path):
            raise InputError(path, study.kind, f"a drive log: {NEEDS[study.kind].drive}", "the folder of a run")
        log = VehicleLog.open(path)
        require_serial_number(vehicle, study.vehicle, log.serial_number, path, "/vehicle@serial_number")
        fixes, array_x_m = None, vehicle.array.x_m
        if study.kind in _BY_PLACES and fixes_beside(path).is_file():
            fixes = fixes_beside(path)
            if array_x_m is None:
                raise InputError(study.vehicle, "array.x_m", f"the place of the array, for {fixes.name}", "none")
        signals = signals_of(log, str(path), fixes=fixes, array_x_m=array_x_m or 0.0)
        # A map of rear angles needs measured angles, not a drive.
        by_map = study.kind == "rear_ratio" and study.options.get("method") == "rear_map"
        require_excitation("rear_map" if by_map else study.kind, path, signals)
        drives.append(LoggedDrive(path, signals, fixes is not None))
    return tuple(drives)


def _as_found(estimates: Estimate | list[Estimate], study: str, logs: str) -> tuple[Any, Found]:
    if isinstance(estimates, Estimate):
        return estimates.value, Found(
            low=estimates.low, high=estimates.high, sigma=estimates.sigma, study=study, log=logs
        )
    low, high, sigma = ([getattr(e, name) for e in estimates] for name in ("low", "high", "sigma"))
    return [e.value for e in estimates], Found(low=low, high=high, sigma=sigma, study=study, log=logs)


_RUN: dict[str, Callable[[Task], Outcome]] = {
    "straight": study_straight,
    "encoder": study_encoder,
    "wheel_angle": study_wheel_angle,
    "rear_ratio": study_rear_ratio,
    "yaw_gain": study_yaw_gain,
    "servo": study_servo,
    "pedals": study_pedals,
    "loop": study_loop,
    "tracking": study_tracking,
    "look_ahead": study_look_ahead,
    "fusion": study_fusion,
    "threshold": study_threshold,
}
