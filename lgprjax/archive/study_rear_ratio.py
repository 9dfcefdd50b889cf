"""Study of k, the rear wheels' share of the front angle: by INS heading on turns, or by two measured wheel angles."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

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
)
from lgprjax.errors import InputError
from lgprjax.tuning.arcs import Arcs, fit_arcs
from lgprjax.tuning.rear_ratio import RearRatioFit, rear_ratio_by_angles, rear_ratio_by_heading, wheel_angle_blocks
from lgprjax.tuning.stretches import find_stretches
from lgprjax.vehicle import Chassis

_METHODS = ("heading", "wheel_angles")


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
    """Find ``steering.rear_ratio``; ``options.method`` says by what, the heading unless told."""
    refuse_options(task, ("method",))
    method = task.study.options.get("method", "heading")
    if method not in _METHODS:
        raise InputError(task.study.file, "options.method", f"one of {', '.join(_METHODS)}", repr(method))
    drive = one_drive(task)
    chassis = chassis_without_anchor(task)
    fit, detail = _fit(method, drive, chassis)
    figures = []
    for judge in task.judges:
        away = _fit(method, judge, chassis)[0].ratio.value - fit.ratio.value
        figures.append(Figure(f"held out, {judge.path.name}: its k less this one", away, ""))
    offset = np.degrees([fit.offset_rad.value, fit.offset_rad.low, fit.offset_rad.high])
    what = "INS heading against the body" if method == "heading" else "rear angle where the front one is 0"
    notes = [f"{what}: {offset[0]:.3f}° ({offset[1]:.3f} to {offset[2]:.3f})", f"{fit.numbers} numbers in the fit"]
    if method == "heading":
        notes.append(f"drift of the headings beside their noise: {np.degrees(fit.drift_rad):.3f}°")
    return Outcome({"steering.rear_ratio": fit.ratio}, {}, tuple(figures), tuple(notes), detail)


def _fit(method: str, drive: LoggedDrive, chassis: Chassis) -> tuple[RearRatioFit, HeadingStudy | WheelAnglesStudy]:
    with fitting(drive.path):
        if method == "wheel_angles":
            fit = rear_ratio_by_angles(drive.signals)
            return fit, WheelAnglesStudy(*wheel_angle_blocks(drive.signals), fit)
        arcs = fit_arcs(drive.signals, find_stretches(drive.signals, potentiometer_of(drive)))
        fit = rear_ratio_by_heading(arcs, chassis)
        return fit, HeadingStudy(arcs, chassis, fit)
