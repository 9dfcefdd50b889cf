"""Study of tracking: errors of logged drives against their path, by smoothed fixes."""

from pathlib import Path as FilePath
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from pydantic import Field

from lgprjax.config import ConfigTable
from lgprjax.errors import InputError
from lgprjax.formats import VehicleLog
from lgprjax.recordings.vehicles import chassis_of
from lgprjax.tuning.studies.drives import LoopDrive, SmoothedDrive, is_run, local_track, loop_drive, origin_of, smoothed
from lgprjax.tuning.studies.logs import Figure, Outcome, Task, fitting, options_of, rms
from lgprjax.tuning.tracking import (
    STEPS_M,
    Engagement,
    SpeedBand,
    TrackedDrive,
    Tracking,
    beside_path,
    path_of_drive,
    path_of_feet,
    speed_bands,
    track,
)
from lgprjax.vehicle import Path, turn_of, yaw_gain

_LEAST_FIXES = 20


class TrackingOptions(ConfigTable):
    """Options of the study: the reference path.

    Attributes:
        path: drive log whose positions are the path; empty: the path of each log's own plan.
    """

    path: str = Field(default="")


class TrackingStudy(NamedTuple):
    """Data for pictures: names, drives with their paths and figures, and RMS errors of all drives by speed."""

    names: tuple[str, ...]
    drives: tuple[TrackedDrive, ...]
    figures: tuple[Tracking, ...]
    bands: tuple[SpeedBand, ...]


def study_tracking(task: Task) -> Outcome:
    """Measure tracking errors, without a change of the vehicle file.

    Raises:
        InputError: a log has no fixes, no path, or does not follow the path.
    """
    options = options_of(task, TrackingOptions)
    anchor = task.vehicle.pursuit.anchor_m
    if anchor is None:
        raise InputError(task.study.vehicle, "pursuit.anchor_m", "the position of the tracked point", "none")
    names, drives = [], []
    for path in (*task.study.logs, *task.study.held_out):
        drive = loop_drive(task, path, fixes=True)
        names.append(path.name)
        with fitting(path):
            drives.append(tracked(task, drive, smoothed(task, drive), options.path, anchor))
    figures, notes = [], []
    each = track(drives)
    bands = speed_bands(drives)
    for band in bands:
        who = "autopilot" if band.engaged else "driver"
        name = f"{who}, {band.low_mps:g} to {band.high_mps:g} m/s, offset, rms"
        figures.append(Figure(name, band.rms_m.value, "m", band.rms_m.low, band.rms_m.high))
    figures += _of_engagements([one for found in each for one in found.engagements])
    for name, one, found in zip(names, drives, each, strict=True):
        figures.append(Figure(f"{name}: offset, rms", rms(one.offset_m), "m"))
        figures.append(Figure(f"{name}: sigma of a smoothed place across", rms(one.sigma_m), "m"))
        share = float(np.mean(one.engaged))
        notes.append(f"{name}: {share:.0%} of {one.time_s[-1] - one.time_s[0]:.0f} s steered by the autopilot")
        if found.cycle is not None and found.cycle.found:
            figures.append(Figure(f"{name}: limit cycle, amplitude", 0.5 * found.cycle.peak_to_peak_m, "m"))
            figures.append(Figure(f"{name}: limit cycle, period", found.cycle.period_s, "s"))
        elif found.cycle is not None:
            notes.append(f"{name}: no limit cycle")
        if found.gains is not None:
            offset, heading = found.gains.offset_per_m2, found.gains.heading_per_m
            figures.append(Figure(f"{name}: curvature per offset", offset.value, "1/m^2", offset.low, offset.high))
            figures.append(
                Figure(f"{name}: curvature per heading error", heading.value, "1/m", heading.low, heading.high)
            )
    return Outcome({}, {}, tuple(figures), tuple(notes), TrackingStudy(tuple(names), tuple(drives), tuple(each), bands))


def tracked(task: Task, drive: LoopDrive, places: SmoothedDrive, reference: str, anchor_m: float) -> TrackedDrive:
    """Errors of a smoothed drive against its path.

    Raises:
        InputError: there are too few fixes, or the path is unknown.
    """
    if places.fixes < _LEAST_FIXES:
        assert drive.ticked is not None
        offered = int(np.asarray(drive.ticked.drive.observations.lgpr.valid).sum())
        expected = f"{_LEAST_FIXES} or more that agree with GNSS (navigation.gnss_error_sigma_m of the vehicle file)"
        raise InputError(drive.path, "fixes", expected, f"{places.fixes} of {offered}")
    engaged = drive.engaged[np.clip(np.searchsorted(drive.time_s, places.time_s), 0, len(drive.time_s) - 1)]
    path = _reference(task, drive, reference) if reference else plan_path(drive, places, anchor_m)
    return beside_path(
        path,
        time_s=places.time_s,
        x_m=places.x_m,
        y_m=places.y_m,
        yaw_rad=places.yaw_rad,
        sigma_m=places.sigma_m,
        anchor_m=anchor_m,
        speed_mps=places.speed_mps,
        answer_radpm=_answer(task, drive, places),
        engaged=engaged,
    )


def _answer(task: Task, drive: LoopDrive, places: SmoothedDrive) -> Float[np.ndarray, " tick"]:
    """Curvature of the commanded wheel angles by the vehicle file, or of the driven path, 1/m."""
    moving = np.where(np.abs(places.speed_mps) > 0.3, places.speed_mps, np.nan)
    if not np.isfinite(drive.command_rad).any():
        return np.asarray(places.yaw_rate_radps / moving)
    chassis = chassis_of(task.vehicle, task.study.vehicle)
    commanded = np.interp(places.time_s, drive.time_s, np.where(drive.commanded, drive.command_rad, 0.0))
    gain = yaw_gain(chassis.characteristic_speed_mps, jnp.asarray(places.speed_mps, jnp.float32))
    curvature = turn_of(chassis, jnp.asarray(commanded, jnp.float32)).curvature_radpm
    return np.asarray(gain * curvature, np.float64)


def plan_path(drive: LoopDrive, places: SmoothedDrive, anchor_m: float) -> Path:
    """The path from which the log's own offsets were measured; under autopilot, position and offset share errors."""
    offset = np.interp(places.time_s, drive.time_s, drive.offset_m, left=np.nan, right=np.nan)
    known = np.isfinite(offset)
    if np.count_nonzero(known) < 50:
        expected = "offsets from a path, or options.path (a drive log along the path)"
        raise InputError(drive.path, "/plan/cross_track_m", expected, f"{np.count_nonzero(known)} ticks with an offset")
    yaw = places.yaw_rad[known]
    ahead_x = places.x_m[known] + anchor_m * np.cos(yaw)
    return path_of_feet(ahead_x, places.y_m[known] + anchor_m * np.sin(yaw), yaw, offset[known])


def _reference(task: Task, drive: LoopDrive, name: str) -> Path:
    """The path along another log's positions, in the frame of this log."""
    file = task.study.file.parent / name
    if is_run(drive.path):
        raise InputError(drive.path, "options.path", "drive logs (options.path is a drive log)", "a recorded run")
    log = VehicleLog.open(FilePath(file))
    return path_of_drive(*local_track(log, origin_of(drive.path)))


def _of_engagements(found: list[Engagement]) -> list[Figure]:
    figures = []
    for step in STEPS_M:
        these = [one for one in found if one.step_m == step]
        if not these:
            continue
        name = f"engaged at {step:+g} m" if step else "engaged on the path"
        figures.append(Figure(f"{name}: how often", float(len(these)), ""))
        settled = [one for one in these if one.settled]
        figures.append(Figure(f"{name}: share that settled within 0.1 m", len(settled) / len(these), ""))
        if settled:
            times, ways = ([getattr(one, key) for one in settled] for key in ("settling_s", "settling_m"))
            figures.append(Figure(f"{name}: settled after, median", float(np.median(times)), "s"))
            figures.append(Figure(f"{name}: settled after, median", float(np.median(ways)), "m"))
        if step:
            over = float(np.median([one.overshoot_m for one in these]))
            figures.append(Figure(f"{name}: overshoot, median", over, "m"))
    return figures
