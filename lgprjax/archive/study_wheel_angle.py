"""Study of the palm tree: potentiometer to front wheel angle."""

from typing import NamedTuple

import numpy as np

from lgprjax.archive.study_parts import (
    Figure,
    LoggedDrive,
    Outcome,
    Task,
    chassis_without_anchor,
    fitting,
    one_drive,
    potentiometer_of,
    refuse_options,
    rms,
)
from lgprjax.tuning import DriveSignals, Estimate
from lgprjax.tuning.arcs import Arcs, fit_arcs
from lgprjax.tuning.robust import student_95
from lgprjax.tuning.stretches import find_stretches
from lgprjax.tuning.wheel_angle import SteeringMap, WheelAngleFit, fit_wheel_angle, front_angle, front_band
from lgprjax.vehicle import Chassis

# The map is a cubic: linear between so many knots it is met within a hundredth of a degree.
_KNOTS = 17


class WheelAngleStudy(NamedTuple):
    """For pictures: the drive, its arcs and the map."""

    signals: DriveSignals
    arcs: Arcs
    fit: WheelAngleFit


def study_wheel_angle(task: Task) -> Outcome:
    """Find ``wheel_map``; the value of straight driving and the slope there come out of it."""
    refuse_options(task)
    drive, chassis = one_drive(task), chassis_without_anchor(task)
    with fitting(drive.path):
        arcs = _arcs(drive)
        fit = fit_wheel_angle(arcs, chassis)
    steering_map = fit.map
    knots = np.linspace(-1.0, 1.0, _KNOTS) * steering_map.half_span + steering_map.middle
    front, (low, high) = front_angle(steering_map, knots), front_band(steering_map, knots)
    sigma = 0.5 * (high - low) / student_95(steering_map.degrees)
    figures = [Figure("residuals of the fit, rms", rms(np.degrees(fit.residual_rad)), "deg")]
    figures += [_judge(judge, chassis, fit) for judge in task.judges]
    return Outcome(
        found={
            "wheel_map.front_rad": [
                Estimate(*(float(number) for number in knot)) for knot in zip(front, sigma, low, high, strict=True)
            ],
            "steering.potentiometer_v_per_rad": _slope_at_straight(steering_map),
        },
        fixed={"wheel_map.first_v": float(knots[0]), "wheel_map.step_v": float(knots[1] - knots[0])},
        figures=tuple(figures),
        notes=tuple(f"{count} stretches left out: {why}" for why, count in fit.dropped.items()),
        detail=WheelAngleStudy(drive.signals, arcs, fit),
    )


def _slope_at_straight(steering_map: SteeringMap) -> Estimate:
    """Volts a radian where the map crosses straight ahead; the interval is that of radians a volt, turned over."""
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


def _judge(judge: LoggedDrive, chassis: Chassis, fit: WheelAngleFit) -> Figure:
    """Angles that the arcs of another drive give, against the map."""
    with fitting(judge.path):
        held = fit_wheel_angle(_arcs(judge), chassis)
    inside = np.abs(held.steering - fit.map.middle) <= fit.map.half_span
    left = held.front_rad[inside] - front_angle(fit.map, held.steering[inside])
    return Figure(f"held out, {judge.path.name}: angle less map, rms", rms(np.degrees(left)), "deg")
