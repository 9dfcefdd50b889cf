"""Study of the characteristic speed: what is lost of the yaw rate in turns at rising speed."""

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
    front_angles,
    one_drive,
    refuse_options,
)
from lgprjax.tuning import NotExcitedError
from lgprjax.tuning.arcs import Arcs, fit_arcs
from lgprjax.tuning.stretches import find_stretches
from lgprjax.tuning.yaw_gain_fit import YawGainFit, fit_yaw_gain


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
    fit, origin = _fit(task, drive)
    figures = [Figure("scatter of 1/G beyond what the arcs explain", fit.extra, "")]
    for judge in task.judges:
        held = _fit(task, judge)[0]
        away = held.characteristic_speed_mps.value - fit.characteristic_speed_mps.value
        figures.append(Figure(f"held out, {judge.path.name}: its speed less this one", away, "m/s"))
    scale = fit.scale
    notes = (
        f"front angles by {origin}",
        f"{len(fit.speed_mps)} turns, {fit.speed_mps.min():.1f} to {fit.speed_mps.max():.1f} m/s",
        f"curvature by the wheel angles over the true one, at no speed: {scale.value:.4f} "
        f"({scale.low:.4f} to {scale.high:.4f})",
        f"front angles read {np.degrees(fit.offset_rad):.3f}° too far to the left",
    )
    found = {"steering.characteristic_speed_mps": fit.characteristic_speed_mps}
    return Outcome({**found}, {}, tuple(figures), notes, YawGainStudy(fit))


def _fit(task: Task, drive: LoggedDrive) -> tuple[YawGainFit, str]:
    chassis = chassis_without_anchor(task)
    front, origin = front_angles(task, drive)
    with fitting(drive.path):
        arcs = fit_arcs(drive.signals, find_stretches(drive.signals, front))
        fit = fit_yaw_gain(arcs, chassis, *_means(front, arcs))
        if not np.isfinite(fit.characteristic_speed_mps.high):
            low = fit.characteristic_speed_mps.low
            found = f"a characteristic speed of {low:.0f} m/s or any above"
            raise NotExcitedError("yaw gain", "turns fast enough to lose yaw beyond doubt", found)
    return fit, origin


def _means(
    front_rad: Float[np.ndarray, " record"], arcs: Arcs
) -> tuple[Float[np.ndarray, " stretch"], Float[np.ndarray, " stretch"]]:
    """Mean over each stretch, and its standard error; what all angles are wrong by alike the fit takes out itself."""
    spans = list(zip(arcs.stretches.start, arcs.stretches.stop, strict=True))
    held = [front_rad[start:stop][np.isfinite(front_rad[start:stop])] for start, stop in spans]
    mean = np.array([float(np.mean(values)) for values in held])
    return mean, np.array([float(np.std(values)) / np.sqrt(len(values)) for values in held])
