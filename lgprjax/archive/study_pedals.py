"""Study of throttle and brake: pre-tension, dead zone, gain and lag of each, and what slows the vehicle beside."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.archive.study_parts import Figure, LoggedDrive, Outcome, Task, fitting, one_drive, refuse_options, rms
from lgprjax.tuning import DriveSignals
from lgprjax.tuning.pedal_fit import WHAT, PedalFit, PedalsFit, fit_pedals
from lgprjax.tuning.pedal_runs import PedalRuns, cut_runs, levelled, predict_way


class PedalsStudy(NamedTuple):
    """For pictures: the drive, its runs, and the way in each by the model, in the odometer's metres."""

    signals: DriveSignals
    runs: PedalRuns
    model_m: Float[np.ndarray, " record"]
    fit: PedalsFit


def study_pedals(task: Task) -> Outcome:
    """Find ``throttle``, ``brake`` and ``resistance``."""
    refuse_options(task)
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
    figures = [Figure("way in a run, measured less model, rms", fit.rms_m, "m")]
    figures += [_judge(judge, fit) for judge in task.judges]
    scale = fit.metres_per_odometer_metre
    notes = [f"{fit.runs} runs from standstill to standstill"]
    if scale is None:
        notes.append("no fixes: accelerations are in the odometer's metres")
    else:
        notes.append(f"a metre of the odometer is {scale.value:.4f} m by the fixes")
    model_m = levelled(runs, _way(runs, fit))
    return Outcome({**found}, {}, tuple(figures), tuple(notes), PedalsStudy(drive.signals, runs, model_m, fit))


def _way(runs: PedalRuns, fit: PedalsFit) -> Float[np.ndarray, " record"]:
    scale = 1.0 if fit.metres_per_odometer_metre is None else fit.metres_per_odometer_metre.value
    values = []
    for pedal in (fit.throttle, fit.brake):
        values += [pedal.pre_tension.value, pedal.dead_zone.value, pedal.gain_mps2.value / scale, pedal.lag_s.value]
    values += [fit.rolling_mps2.value / scale, fit.drag_per_s.value]
    return np.asarray(predict_way(runs, np.array([values]))[0][0])


def _judge(judge: LoggedDrive, fit: PedalsFit) -> Figure:
    """Ways of another drive about this fit's model."""
    with fitting(judge.path):
        runs = cut_runs(judge.signals, WHAT)
    left = levelled(runs, judge.signals.travel_m[runs.record]) - levelled(runs, _way(runs, fit))
    return Figure(f"held out, {judge.path.name}: way less model, rms", rms(left), "m")
