"""Studies of the steering's sensors: the straight potentiometer value, and the encoder against the potentiometer."""

from typing import NamedTuple

import numpy as np

from lgprjax.archive.study_parts import (
    Figure,
    LoggedDrive,
    Outcome,
    Task,
    fitting,
    fixed_records,
    one_drive,
    refuse_options,
    rms,
)
from lgprjax.formats import Found
from lgprjax.tuning import DriveSignals, Estimate
from lgprjax.tuning.encoder import EncoderFit, fit_encoder, fitted_volts
from lgprjax.tuning.straight import StraightFit, fit_straight


class EncoderStudy(NamedTuple):
    """For pictures: the drive, the fit, and the change of the potentiometer with the wheels where it is known."""

    signals: DriveSignals
    fit: EncoderFit
    v_per_rad: float | None


def study_straight(task: Task) -> Outcome:
    """Find ``steering.straight_potentiometer_v``."""
    refuse_options(task)
    drive = one_drive(task)
    with fitting(drive.path):
        fit = fit_straight(fixed_records(drive.signals))
    figures = [Figure("windows about the fit, rms", _straight_rms_mv(fit), "mV")]
    for judge in task.judges:
        with fitting(judge.path):
            held = fit_straight(fixed_records(judge.signals))
        away_mv = 1e3 * (held.potentiometer_v.value - fit.potentiometer_v.value)
        figures.append(Figure(f"held out, {judge.path.name}: its value less this one", away_mv, "mV"))
    notes = (f"{fit.turning} windows left out because they turned",) if fit.turning else ()
    return Outcome({"steering.straight_potentiometer_v": fit.potentiometer_v}, {}, tuple(figures), notes, fit)


def study_encoder(task: Task) -> Outcome:
    """Find counts a volt and, where the vehicle file says volts a radian, counts a radian and the play."""
    refuse_options(task)
    drive, steering = one_drive(task), task.vehicle.steering
    with fitting(drive.path):
        fit = fit_encoder(drive.signals, steering.straight_potentiometer_v)
    v_per_rad = steering.potentiometer_v_per_rad
    found: dict[str, Estimate | list[Estimate]] = {"steering.encoder_counts_per_v": fit.counts_per_v}
    notes = [fit.why]
    if v_per_rad is None:
        play = f"play {fit.hysteresis_counts.value:.1f} counts"
        notes.append(f"{play}; counts a radian want steering.potentiometer_v_per_rad, from a study of wheel_angle")
    else:
        half = _half_width(task.vehicle.found.get("steering.potentiometer_v_per_rad"))
        found["steering.encoder_counts_per_rad"] = _times(fit.counts_per_v, v_per_rad, half)
        found["steering.backlash_rad"] = _play_rad(fit, v_per_rad)
    figures = [Figure("pauses about the fit, rms", fit.rms_counts, "count")]
    if v_per_rad is not None:
        per_count = float(np.degrees(abs(1.0 / (fit.counts_per_v.value * v_per_rad))))
        figures.append(Figure("the same at the road wheel", fit.rms_counts * per_count, "deg"))
    figures += [_judge(judge, fit, v_per_rad) for judge in task.judges]
    return Outcome(found, {}, tuple(figures), tuple(notes), EncoderStudy(drive.signals, fit, v_per_rad))


def _straight_rms_mv(fit: StraightFit) -> float:
    line = fit.potentiometer_v.value + fit.slope_vm.value * fit.curvature_radpm
    return 1e3 * rms((fit.window_v - line)[fit.weight > 0.0])


def _judge(judge: LoggedDrive, fit: EncoderFit, v_per_rad: float | None) -> Figure:
    """Pauses of another start about this fit, its own zero taken first: that is what a start does."""
    with fitting(judge.path):
        held = fit_encoder(judge.signals, fit.reference_v)
    moved = fit._replace(reference_counts=held.reference_counts)
    left_v = held.pauses.potentiometer_v - fitted_volts(moved, held.pauses.counts, held.pauses.direction)
    name = f"held out, {judge.path.name}: pauses about this fit, rms"
    if v_per_rad is None:
        return Figure(name, 1e3 * rms(left_v), "mV")
    return Figure(name, float(np.degrees(rms(left_v) / abs(v_per_rad))), "deg")


def _half_width(found: Found | None) -> float:
    """Half of the 95 % interval of a number of the vehicle file; none where it was not found by a study."""
    if found is None or isinstance(found.low, list) or isinstance(found.high, list):
        return 0.0
    return 0.5 * (found.high - found.low)


def _times(number: Estimate, factor: float, factor_half: float = 0.0) -> Estimate:
    """An estimate times a factor whose own interval is so wide to either side; their errors are independent."""
    value = number.value * factor
    half = float(np.hypot(0.5 * (number.high - number.low) * factor, number.value * factor_half))
    return Estimate(value, half / 1.96, value - half, value + half)


def _play_rad(fit: EncoderFit, v_per_rad: float) -> Estimate:
    """The play as an angle of the wheels; none is less than none."""
    turned = _times(fit.hysteresis_counts, 1.0 / abs(fit.counts_per_v.value * v_per_rad))
    return Estimate(max(turned.value, 0.0), turned.sigma, max(turned.low, 0.0), max(turned.high, 0.0))
