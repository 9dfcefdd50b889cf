"""Study of the navigation filter: its noises, found on logged drives with fixes and judged on others."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lgprjax.archive.navigation_drives import TickedDrive, stack_drives, tick_drive
from lgprjax.archive.study_parts import Figure, LoggedDrive, Outcome, Task, fitting, refuse_options, rms
from lgprjax.archive.vehicles import filter_model_of
from lgprjax.errors import InputError
from lgprjax.formats import VehicleLog
from lgprjax.navigation import (
    SOURCES,
    FilterInfo,
    FilterModel,
    NavEstimate,
    SwitchSettings,
    SwitchState,
    default_rules,
    init_switch,
    smooth_estimates,
    step_switch,
)
from lgprjax.tuning.fusion_fit import FusionFit, filter_drives, fit_fusion, mean_nis
from lgprjax.tuning.innovations_likelihood import NavigationDrives
from lgprjax.vehicle import VehiclePose

_OPTIONS = ("tick_s", "odometer_sigma_m", "enter_strength", "stay_strength", "hold_s")
_DEFAULTS = (0.1, 0.002, 0.6, 0.5, 1.0)


class Judged(NamedTuple):
    """A drive by the model found; poses in metres and radians, one row a tick.

    Attributes:
        name: of its file.
        time_s: of the ticks.
        info: what became of the observations.
        filtered, smoothed: estimates.
        switched: x, y and yaw of the threshold switch.
        truth: x, y and yaw, where the log knows them.
    """

    name: str
    time_s: Float[np.ndarray, " tick"]
    info: FilterInfo
    filtered: NavEstimate
    smoothed: NavEstimate
    switched: Float[np.ndarray, "tick 3"]
    truth: Float[np.ndarray, "tick 3"] | None


class FusionStudy(NamedTuple):
    """For pictures: the fit, and the drives by it; those held out, or those fitted where none are."""

    fit: FusionFit
    judged: tuple[Judged, ...]


def study_fusion(task: Task) -> Outcome:
    """Find the noises of ``navigation``. Beside ``X.drive.h5`` stand the fixes of its scans, ``X.fixes.h5``."""
    refuse_options(task, _OPTIONS)
    numbers = [_option(task, name, default) for name, default in zip(_OPTIONS, _DEFAULTS, strict=True)]
    tick_s, odometer_m = numbers[:2]
    # A log's positions are those of the rear axle.
    zero = jnp.float32(0.0)
    model = filter_model_of(task.vehicle, task.study.vehicle)._replace(gnss_x_m=zero, gnss_y_m=zero)
    drives = [_ticked(drive, tick_s, odometer_m) for drive in task.drives]
    rules = default_rules()
    with fitting(task.drives[0].path):
        fit = fit_fusion(model, rules, stack_drives(drives))
    figures = [Figure("log-likelihood gained", fit.gained, "")]
    notes = [f"left open by the drives: {', '.join(fit.left_open)}"] if fit.left_open else []
    judges = [(judge, _ticked(judge, tick_s, odometer_m)) for judge in task.judges]
    judged = []
    enter, stay, hold = (jnp.float32(number) for number in numbers[2:])
    settings = SwitchSettings(enter, stay, hold, model.zero_slip_m, model.array_x_m, model.array_y_m)
    for drive, ticked in judges or list(zip(task.drives, drives, strict=True)):
        role = "held out" if judges else "fitted"
        one = _judge(fit.model, settings, drive, ticked)
        judged.append(one)
        figures += _figures(f"{role}, {one.name}", one)
        before = mean_nis(filter_drives(model, rules, stack_drives([ticked]))[1])
        figures += [Figure(f"{role}, {one.name}: NIS of {s}, before", value, "") for s, value in before.items()]
    found = {f"navigation.{name}": estimate for name, estimate in fit.found.items()}
    return Outcome({**found}, {}, tuple(figures), tuple(notes), FusionStudy(fit, tuple(judged)))


def _option(task: Task, name: str, default: float) -> float:
    value = task.study.options.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < 100.0:
        raise InputError(task.study.file, f"options.{name}", "a number above 0 and below 100", repr(value))
    return float(value)


def _ticked(drive: LoggedDrive, tick_s: float, odometer_m: float) -> TickedDrive:
    fixes = drive.path.with_name(drive.path.name.removesuffix(".drive.h5") + ".fixes.h5")
    if not fixes.is_file():
        raise InputError(fixes, "file", f"the fixes of {drive.path.name} (lgprjax register writes them)", "none")
    log = VehicleLog.open(drive.path)
    return tick_drive(log, drive.path, fixes, tick_s=tick_s, odometer_sigma_m=odometer_m)


def _judge(model: FilterModel, settings: SwitchSettings, drive: LoggedDrive, ticked: TickedDrive) -> Judged:
    padded = stack_drives([ticked])
    estimates, info = jax.tree.map(lambda leaf: leaf[0], filter_drives(model, default_rules(), padded))
    lane = jax.tree.map(lambda leaf: leaf[0], padded)
    smoothed = jax.jit(smooth_estimates)(model, estimates, lane.motions, info.reacquired.any(axis=-1))
    missing = lane.motions.step_s.size - len(ticked.time_s)
    strength = np.pad(ticked.strength, (0, missing), constant_values=np.nan)
    switched = _switch(settings, lane, jnp.asarray(strength, jnp.float32))
    driven = slice(len(ticked.time_s))
    estimates, smoothed, info = jax.tree.map(lambda leaf: leaf[driven], (estimates, smoothed, info))
    poses = np.stack([np.asarray(part, np.float64)[driven] for part in switched], axis=1)
    return Judged(drive.path.name, ticked.time_s, info, estimates, smoothed, poses, ticked.truth)


@jax.jit
def _switch(settings: SwitchSettings, drive: NavigationDrives, strength: jax.Array) -> VehiclePose:
    """Poses by the threshold switch; between positions GNSS/INS stays where the last one was."""

    def step(
        carry: tuple[SwitchState, VehiclePose], tick: tuple[NavigationDrives, jax.Array]
    ) -> tuple[tuple[SwitchState, VehiclePose], VehiclePose]:
        (state, last), (now, strong) = carry, tick
        gnss, heading = now.observations.gnss, now.observations.heading
        told = VehiclePose(gnss.x_m, gnss.y_m, heading.yaw_rad)
        last = VehiclePose(*(jnp.where(gnss.valid, new, old) for new, old in zip(told, last, strict=True)))
        speed = now.observations.odometer.speed_mps
        state = step_switch(settings, state, now.motions, speed, last, now.observations.lgpr, strong)
        return (state, last), state.pose

    ticks = drive._replace(
        start=VehiclePose(*(jnp.broadcast_to(v, strength.shape) for v in drive.start)),
        speed_mps=jnp.broadcast_to(drive.speed_mps, strength.shape),
    )
    poses: VehiclePose = jax.lax.scan(step, (init_switch(drive.start), drive.start), (ticks, strength))[1]
    return poses


def _figures(name: str, judged: Judged) -> list[Figure]:
    nis = mean_nis(jax.tree.map(lambda leaf: leaf[None], judged.info))
    figures = [Figure(f"{name}: NIS of {source}", value, "") for source, value in nis.items()]
    shut_out = np.asarray(judged.info.offered & ~judged.info.accepted).sum(axis=0)
    figures += [
        Figure(f"{name}: {source}, rejected", float(n), "") for source, n in zip(SOURCES, shut_out, strict=True)
    ]
    if judged.truth is None:
        return figures
    for what, poses in (
        ("filter", np.asarray(judged.filtered.mean, np.float64)[:, :3]),
        ("smoother", np.asarray(judged.smoothed.mean, np.float64)[:, :3]),
        ("threshold switch", judged.switched),
    ):
        away = np.hypot(*(poses - judged.truth)[:, :2].T)
        figures.append(Figure(f"{name}: {what}, position, rms", rms(away), "m"))
    for what, estimate in (("filter", judged.filtered), ("smoother", judged.smoothed)):
        figures.append(Figure(f"{name}: {what}, NEES of the pose over 3", _nees(estimate, judged.truth), ""))
    return figures


def _nees(estimate: NavEstimate, truth: Float[np.ndarray, "tick 3"]) -> float:
    away = np.asarray(estimate.mean, np.float64)[:, :3] - truth
    away[:, 2] = np.mod(away[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    covariance = np.asarray(estimate.covariance, np.float64)[:, :3, :3]
    solved = np.linalg.solve(covariance, away[..., None])[..., 0]
    return float(np.mean(np.sum(away * solved, axis=1))) / 3.0
