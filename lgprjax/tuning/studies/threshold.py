"""Study of the control threshold: the turn command that a skid-steer vehicle ignores, and the limit cycle that it
causes (MF 4).
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from lgprjax.autopilot.modes import Mode
from lgprjax.errors import InputError
from lgprjax.formats.run_log import read_run, read_run_record
from lgprjax.recordings.run_signals import RowGatherer, rising
from lgprjax.run_records import SKID_PLAN, RecordKind
from lgprjax.tuning import LimitCycle, NotExcitedError, ThresholdFit, find_limit_cycle, fit_threshold
from lgprjax.tuning.studies.logs import Figure, Outcome, Task, fitting, refuse_options
from lgprjax.tuning.studies.needs import Contradiction, compared

_KEY = "skid_steer.threshold_mps"
# Every fifth tick: a hundred milliseconds are short against the lag of any vehicle that swings.
_STEP_S = 0.1
# Longest gap between records of one stretch.
_GAP_S = 0.5


class FieldTicks(NamedTuple):
    """Ticks of a run in which the computer drove, resampled to 10 Hz.

    Attributes:
        time_s: tick times, increasing, s.
        yaw_rad: yaw of the body, modulo full turns.
        cross_m: lateral offset from the line, positive to the left.
        line: number of the plan's line; -1 in a turn.
        turn_mps: commanded speed difference of the tracks, right minus left.
    """

    time_s: Float[np.ndarray, " tick"]
    yaw_rad: Float[np.ndarray, " tick"]
    cross_m: Float[np.ndarray, " tick"]
    line: Int[np.ndarray, " tick"]
    turn_mps: Float[np.ndarray, " tick"]


def read_field_ticks(folder: Path) -> FieldTicks:
    """The ticks of a recorded run of a field.

    Raises:
        InputError: there is no run, or the computer did not drive a skid-steer vehicle in it.
    """
    gathered = RowGatherer(SKID_PLAN)
    for _, data in read_run(folder):
        record = read_run_record(data)
        if record is not None and record.kind is RecordKind.SKID_PLAN:
            gathered.add(record.mono_ns, record.payload)
    rows, times_ns = gathered.rows, gathered.times_ns
    told = np.isfinite(rows["pose"][:, 2]) & np.isfinite(rows["cross_m"]) & np.isfinite(rows["command"]).all(axis=1)
    kept = np.flatnonzero(rising(times_ns, told & (rows["mode"] == int(Mode.SPEED))))
    if not len(kept):
        raise InputError(folder, "skid_plan", "control ticks of a skid-steer vehicle under automatic control", "none")
    time_s = 1e-9 * (times_ns[kept] - times_ns[kept[0]]).astype(np.float64)
    # The first tick of each tenth of a second.
    first = np.unique(np.floor(time_s / _STEP_S + 0.5).astype(np.int64), return_index=True)[1]
    chosen = rows[kept[first]]
    command = chosen["command"].astype(np.float64)
    return FieldTicks(
        time_s=time_s[first],
        yaw_rad=chosen["pose"][:, 2].astype(np.float64),
        cross_m=chosen["cross_m"].astype(np.float64),
        line=chosen["line"].astype(np.int64),
        turn_mps=command[:, 1] - command[:, 0],
    )


def swings_of(ticks: FieldTicks) -> tuple[int, tuple[LimitCycle, ...]]:
    """Number of lines long enough for a limit cycle, and the limit cycles found."""
    cuts = np.flatnonzero((np.diff(ticks.line) != 0) | (np.diff(ticks.time_s) > _GAP_S)) + 1
    looked, found = 0, []
    for stretch in np.split(np.arange(len(ticks.line)), cuts):
        if ticks.line[stretch[0]] < 0:
            continue
        try:
            cycle = find_limit_cycle(ticks.time_s[stretch], ticks.cross_m[stretch])
        except NotExcitedError:  # too short a line
            continue
        looked += 1
        found += [cycle] if cycle.found else []
    return looked, tuple(found)


def study_threshold(task: Task) -> Outcome:
    """Find ``skid_steer.threshold_mps``; the logs are folders of recorded runs, each looked through for a swing."""
    refuse_options(task)
    if task.vehicle.steering_kind != "skid_steer":
        raise InputError(task.study.vehicle, "steering_kind", "skid_steer", task.vehicle.steering_kind)
    if len(task.study.logs) != 1:
        raise InputError(task.study.file, "logs", "the folder of one run", str(len(task.study.logs)))
    folder = task.study.logs[0]
    ticks = read_field_ticks(folder)
    fit = _fit(folder, ticks)
    figures = [
        Figure("quick changes of the yaw rate, share that the threshold leaves unexplained", fit.unexplained, ""),
        Figure("the same without a threshold", fit.without, ""),
        Figure("delay from command to turn", fit.delay_s, "s"),
        Figure("lag of the turn", fit.lag_s, "s"),
    ]
    notes = [_note(folder, ticks, figures)]
    against: list[Contradiction] = []
    for judge in task.study.held_out:
        ticks = read_field_ticks(judge)
        held = _fit(judge, ticks)
        away = held.threshold_mps.value - fit.threshold_mps.value
        figures.append(Figure(f"held out, {judge.name}: its threshold less this one", away, "m/s"))
        notes.append(_note(judge, ticks, figures))
        against += _against(judge, fit, held)
    if not fit.found:
        notes.insert(0, "no threshold: the vehicle responds to small commands as to large ones")
    found = {_KEY: fit.threshold_mps} if fit.found else {}
    return Outcome({**found}, {}, tuple(figures), tuple(notes), fit, tuple(against))


def _against(judge: Path, fit: ThresholdFit, held: ThresholdFit) -> tuple[Contradiction, ...]:
    """Contradiction between two thresholds, or between a threshold and a run that excludes it."""
    if fit.found and held.found:
        return compared(_KEY, judge, fit.threshold_mps, held.threshold_mps)
    if fit.found == held.found:
        return ()
    one, none = (fit, held) if fit.found else (held, fit)
    if none.threshold_mps.low <= one.threshold_mps.value <= none.threshold_mps.high:
        return ()
    told = [f"{each.threshold_mps.value:.4g}" if each.found else "none" for each in (fit, held)]
    return (Contradiction(judge, _KEY, f"{told[0]}, as fitted", told[1]),)


def _fit(folder: Path, ticks: FieldTicks) -> ThresholdFit:
    with fitting(folder):
        return fit_threshold(ticks.time_s, ticks.yaw_rad, ticks.turn_mps)


def _note(folder: Path, ticks: FieldTicks, figures: list[Figure]) -> str:
    """Note on the limit cycles found; their size and period are appended to the figures."""
    looked, found = swings_of(ticks)
    if found:
        size, period = (
            float(np.median([getattr(one, name) for one in found])) for name in ("peak_to_peak_m", "period_s")
        )
        figures += [
            Figure(f"{folder.name}: swing about the line, peak to peak", size, "m"),
            Figure(f"{folder.name}: period of the swing", period, "s"),
        ]
    return f"{folder.name}: a limit cycle on {len(found)} of {looked} lines of 16 s or more"
