"""Study of the navigation filter: its noises, fitted on logged drives with fixes and tested on others."""

from pathlib import Path
from typing import Annotated, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from pydantic import Field

from lgprjax.config import ConfigTable
from lgprjax.errors import InputError
from lgprjax.formats import NavigationTrack, VehicleLog
from lgprjax.frames import LocalFrame
from lgprjax.navigation import (
    SOURCES,
    FilterInfo,
    FilterModel,
    GnssObservation,
    HeadingObservation,
    LgprObservation,
    MotionInput,
    NavEstimate,
    Observations,
    OdometerObservation,
    SwitchSettings,
    SwitchState,
    default_rules,
    init_switch,
    smooth_estimates,
    step_switch,
    switch_settings,
)
from lgprjax.recordings.vehicles import filter_model_of
from lgprjax.tuning.navigation import FusionFit, NavigationDrives, filter_drives, fit_fusion, mean_nis
from lgprjax.tuning.studies.logs import (
    Figure,
    LoggedDrive,
    Outcome,
    Task,
    fitting,
    options_of,
    read_causal_fixes,
    require_fixes,
    rms,
)
from lgprjax.tuning.studies.needs import Contradiction
from lgprjax.vehicle import VehiclePose

# Drive logs and their fixes on the ticks of the navigation filter.

_LEAST_TICKS = 20
# Drives are padded to a multiple of this many ticks: few lengths are compiled.
_BLOCK_TICKS = 256
# Times that differ by less are equal: a record at a tick's end belongs to it despite rounding.
_CLOCK_S = 1e-6
_NIS_TIMES = 3.0


class TickedDrive(NamedTuple):
    """A drive on ticks, in level metres relative to its first position.

    Attributes:
        time_s: end of each tick on the log's clock, s.
        drive: observations of a single drive, without a batch axis.
        p_false: probability that the match of the tick's scan is false, see ``Fix``; NaN without a match.
        truth: true x, m, y, m, and yaw, rad, at the ends of the ticks; ``None`` if the log has no truth.
    """

    time_s: Float[np.ndarray, " tick"]
    drive: NavigationDrives
    p_false: Float[np.ndarray, " tick"]
    truth: Float[np.ndarray, "tick 3"] | None


def tick_drive(
    log: VehicleLog, path: Path, fixes: Path | None, *, tick_s: float = 0.1, odometer_sigma_m: float = 0.002
) -> TickedDrive:
    """A logged drive on ticks. Of several observations of a source in one tick the last counts.

    Positions of the log are those of the rear axle. The axes of the fixes' map differ from these by the convergence of
    meridians, which is ignored in their covariance.

    Args:
        log: drive log with a gyro and with sigmas of its navigation.
        path: path of the log, for error messages.
        fixes: path of the ``.fixes.h5`` of its scans; ``None`` without fixes.
        tick_s: length of a tick.
        odometer_sigma_m: standard deviation of one reading of the distance.

    Raises:
        InputError: the log has no gyro, its signals have no two seconds in common, or the fixes have no covariance.
    """
    track, vehicle = log.navigation, log.vehicle or {}
    if "yaw_rate_radps" not in vehicle:
        raise InputError(path, "/vehicle/yaw_rate_radps", "a gyro yaw rate", "none")
    clocks = (track.time_s, log.odometry.time_s, vehicle["time_s"])
    first_s, last_s = max(float(clock[0]) for clock in clocks), min(float(clock[-1]) for clock in clocks)
    begin = int(np.searchsorted(track.time_s, first_s))
    count = int(np.floor((last_s - float(track.time_s[min(begin, len(track.time_s) - 1)])) / tick_s))
    if count < _LEAST_TICKS:
        raise InputError(
            path, "time_s", f"{_LEAST_TICKS * tick_s:g} s covered by all sensors", f"{last_s - first_s:g} s"
        )
    start_s = float(track.time_s[begin])
    edges_s = start_s + tick_s * np.arange(count + 1)
    frame = LocalFrame(*(float(v[begin]) for v in (track.latitude_deg, track.longitude_deg, track.height_m)))
    place = _poses(frame, track)
    rate = _mean_rate(vehicle["time_s"], vehicle["yaw_rate_radps"], edges_s)
    speed = np.diff(np.interp(edges_s, log.odometry.time_s, log.odometry.distance_m)) / tick_s
    gnss, heading = _navigation(path, track, place, edges_s)
    lgpr, p_false = _fixes(fixes, frame, edges_s)
    variance = np.full(count, 2.0 * (odometer_sigma_m / tick_s) ** 2)
    odometer = OdometerObservation(_single(speed), _single(variance), jnp.ones(count, bool))
    start = VehiclePose(*(jnp.float32(value) for value in place[begin]))
    motions = MotionInput(_single(rate), _single(np.full(count, tick_s)))
    drive = NavigationDrives(start, jnp.float32(speed[0]), motions, Observations(gnss, heading, odometer, lgpr))
    truth = None
    if log.truth is not None:
        true = _poses(frame, log.truth)
        truth = np.stack([np.interp(edges_s[1:], log.truth.time_s, column) for column in true.T], axis=1)
    return TickedDrive(edges_s[1:], drive, p_false, truth)


def stack_drives(drives: list[TickedDrive]) -> NavigationDrives:
    """Drives stacked; shorter ones are padded with ticks of no length without observations, which change nothing."""
    longest = max(len(one.time_s) for one in drives)
    ticks = -(-longest // _BLOCK_TICKS) * _BLOCK_TICKS

    def padded(one: TickedDrive) -> NavigationDrives:
        missing = ticks - len(one.time_s)

        def pad(leaf: Array) -> np.ndarray:
            return np.pad(np.asarray(leaf), ((0, missing),) + ((0, 0),) * (leaf.ndim - 1))

        motions, observations = jax.tree.map(pad, (one.drive.motions, one.drive.observations))
        return one.drive._replace(motions=motions, observations=observations)

    # NumPy arrays, which need no compilation.
    many: NavigationDrives = jax.tree.map(
        lambda *leaves: jnp.asarray(np.stack(leaves)), *[padded(one) for one in drives]
    )
    return many


def _poses(frame: LocalFrame, track: NavigationTrack) -> Float[np.ndarray, "navigation 3"]:
    east, north, _ = frame.to_local(track.latitude_deg, track.longitude_deg, track.height_m)
    return np.stack([east, north, np.unwrap(frame.yaw_of_heading(track.heading_deg, track.longitude_deg))], axis=1)


def _mean_rate(
    time_s: Float[np.ndarray, " record"], rate: Float[np.ndarray, " record"], edges_s: Float[np.ndarray, " edge"]
) -> Float[np.ndarray, " tick"]:
    """Mean rate over each tick, integrated by trapezoids."""
    turned = np.append(0.0, np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time_s)))
    return np.asarray(np.diff(np.interp(edges_s, time_s, turned)) / np.diff(edges_s))


def _last_in_tick(
    time_s: Float[np.ndarray, " record"], edges_s: Float[np.ndarray, " edge"]
) -> tuple[np.ndarray, np.ndarray]:
    """Ticks with a record, and the last record of each: a tick includes its end and not its start."""
    tick = np.searchsorted(edges_s + _CLOCK_S, time_s, side="left") - 1
    inside = np.flatnonzero((tick >= 0) & (tick < len(edges_s) - 1))
    ticks, first_of_reversed = np.unique(tick[inside][::-1], return_index=True)
    return ticks, inside[::-1][first_of_reversed]


def _navigation(
    path: Path, track: NavigationTrack, place: Float[np.ndarray, "navigation 3"], edges_s: Float[np.ndarray, " edge"]
) -> tuple[GnssObservation, HeadingObservation]:
    sigmas = (track.sigma_east_m, track.sigma_north_m, track.sigma_heading_deg)
    if sigmas[0] is None or sigmas[1] is None or sigmas[2] is None:
        raise InputError(path, "/gnss_ins/sigma_east_m", "stated uncertainties of the navigation", "none")
    ticks, record = _last_in_tick(track.time_s, edges_s)
    size = len(edges_s) - 1
    valid = np.zeros(size, bool)
    valid[ticks] = True
    values, variances, age = np.zeros((size, 3)), np.ones((size, 3)), np.zeros(size)
    values[ticks] = place[record]
    variances[ticks] = np.stack([sigmas[0][record], sigmas[1][record], np.radians(sigmas[2][record])], axis=1) ** 2
    age[ticks] = np.maximum(edges_s[1:][ticks] - track.time_s[record], 0.0)
    covariance = np.zeros((size, 2, 2))
    covariance[:, 0, 0], covariance[:, 1, 1] = variances[:, 0], variances[:, 1]
    x, y, yaw = (_single(column) for column in values.T)
    known = jnp.asarray(valid)
    return (
        GnssObservation(x, y, _single(covariance), _single(age), known),
        HeadingObservation(yaw, _single(variances[:, 2]), _single(age), known),
    )


def _fixes(
    path: Path | None, frame: LocalFrame, edges_s: Float[np.ndarray, " edge"]
) -> tuple[LgprObservation, Float[np.ndarray, " tick"]]:
    size = len(edges_s) - 1
    values, age, p_false = np.zeros((size, 3)), np.zeros(size), np.full(size, np.nan)
    covariance, valid = np.tile(np.eye(3), (size, 1, 1)), np.zeros(size, bool)
    if path is not None:
        table, spread = read_causal_fixes(path)
        ticks, row = _last_in_tick(table["time_s"].to_numpy(), edges_s)
        ok = table["code"].to_numpy()[row] == "ok"
        # Older files lack the column and say only which matches were accepted.
        p_false[ticks] = table["p_false"].to_numpy()[row] if "p_false" in table else np.where(ok, 0.0, 1.0)
        good = ok & np.isfinite(spread[row]).all(axis=(1, 2))
        ticks, row = ticks[good], row[good]
        chosen = table.iloc[row]
        longitude = chosen["longitude_deg"].to_numpy()
        east, north, _ = frame.to_local(chosen["latitude_deg"].to_numpy(), longitude, chosen["height_m"].to_numpy())
        yaw = frame.yaw_of_heading(chosen["heading_deg"].to_numpy(), longitude)
        values[ticks] = np.stack([east, north, yaw], axis=1)
        pose = np.array([0, 1, 3])
        covariance[ticks] = spread[row][:, pose[:, None], pose]
        age[ticks] = np.maximum(edges_s[1:][ticks] - chosen["time_s"].to_numpy(), 0.0)
        valid[ticks] = True
    x, y, heading = (_single(column) for column in values.T)
    return LgprObservation(x, y, heading, _single(covariance), _single(age), jnp.asarray(valid)), p_false


def _single(values: Float[np.ndarray, "..."]) -> Float[Array, "..."]:
    return jnp.asarray(values, jnp.float32)


_Number = Annotated[float, Field(gt=0.0, lt=100.0)]


class FusionOptions(ConfigTable):
    """Tick length and odometer noise of the filter, and parameters of the threshold switch that it is compared with."""

    tick_s: _Number = 0.1
    odometer_sigma_m: _Number = 0.002
    risk: _Number = 1e-4
    hold_s: _Number = 1.0


class JudgedDrive(NamedTuple):
    """Estimates of a drive by the fitted model; poses in metres and radians, one row per tick.

    Attributes:
        name: name of the file.
        time_s: tick times, s.
        info: innovations and acceptance of the observations.
        filtered, smoothed: estimates of the filter and of the smoother.
        switched: x, y and yaw of the threshold switch.
        truth: true x, y and yaw; ``None`` if the log has none.
    """

    name: str
    time_s: Float[np.ndarray, " tick"]
    info: FilterInfo
    filtered: NavEstimate
    smoothed: NavEstimate
    switched: Float[np.ndarray, "tick 3"]
    truth: Float[np.ndarray, "tick 3"] | None


class FusionStudy(NamedTuple):
    """Data for pictures: the fit, and its estimates of the held-out drives (of the fitted drives without any)."""

    fit: FusionFit
    judged: tuple[JudgedDrive, ...]


def study_fusion(task: Task) -> Outcome:
    """Fit the noises of ``navigation``. The fixes of ``X.drive.h5`` are in ``X.fixes.h5`` in the same folder."""
    options = options_of(task, FusionOptions)
    tick_s, odometer_m = options.tick_s, options.odometer_sigma_m
    # A log's positions are those of the rear axle.
    zero = jnp.float32(0.0)
    model = filter_model_of(task.vehicle, task.study.vehicle)._replace(gnss_x_m=zero, gnss_y_m=zero)
    drives = [_ticked(drive, tick_s, odometer_m) for drive in task.drives]
    rules = default_rules()
    with fitting(task.drives[0].path):
        fit = fit_fusion(model, rules, stack_drives(drives))
    figures = [Figure("log-likelihood gained", fit.gained, "")]
    notes = [f"not determined by the drives: {', '.join(fit.left_open)}"] if fit.left_open else []
    judges = [(judge, _ticked(judge, tick_s, odometer_m)) for judge in task.judges]
    judged, against = [], list[Contradiction]()
    own_nis = mean_nis(filter_drives(fit.model, rules, stack_drives(drives))[1])
    settings = switch_settings(
        options.risk, zero_slip_m=model.zero_slip_m, array_x_m=model.array_x_m, array_y_m=model.array_y_m
    )._replace(hold_s=jnp.float32(options.hold_s))
    for drive, ticked in judges or list(zip(task.drives, drives, strict=True)):
        role = "held out" if judges else "fitted"
        one = _judge(fit.model, settings, drive, ticked)
        judged.append(one)
        figures += _figures(f"{role}, {one.name}", one)
        if judges:
            against += _against(drive.path, one, own_nis)
        before = mean_nis(filter_drives(model, rules, stack_drives([ticked]))[1])
        figures += [Figure(f"{role}, {one.name}: NIS of {s}, before", value, "") for s, value in before.items()]
    found = {f"navigation.{name}": estimate for name, estimate in fit.found.items()}
    detail = FusionStudy(fit, tuple(judged))
    return Outcome({**found}, {}, tuple(figures), tuple(notes), detail, tuple(against))


def _against(path: Path, judged: JudgedDrive, own_nis: dict[str, float]) -> list[Contradiction]:
    """Sources whose innovations disagree with the fitted noises, or that the filter mostly rejects.

    Sigmas of positions come with the logs: if they are wrong in the fitted drives too, there is no contradiction.
    """
    found = []
    for source, value in mean_nis(_one_lane(judged.info)).items():
        own = own_nis.get(source, 1.0)
        low, high = min(own, 1.0) / _NIS_TIMES, max(own, 1.0) * _NIS_TIMES
        if not low <= value <= high:
            found.append(Contradiction(path, f"NIS of {source}", f"{low:.2g} to {high:.2g}", f"{value:.2g}"))
    offered, accepted = (np.asarray(each).sum(axis=0) for each in (judged.info.offered, judged.info.accepted))
    for source, of, kept in zip(SOURCES, offered, accepted, strict=True):
        if 2 * kept < of:
            expected = f"at least half of {of} accepted with the fitted noise"
            found.append(Contradiction(path, f"observations of {source}", expected, str(kept)))
    return found


def _one_lane(info: FilterInfo) -> FilterInfo:
    lane: FilterInfo = jax.tree.map(lambda leaf: leaf[None], info)
    return lane


def _ticked(drive: LoggedDrive, tick_s: float, odometer_m: float) -> TickedDrive:
    fixes, log = require_fixes(drive.path), VehicleLog.open(drive.path)
    return tick_drive(log, drive.path, fixes, tick_s=tick_s, odometer_sigma_m=odometer_m)


def _judge(model: FilterModel, settings: SwitchSettings, drive: LoggedDrive, ticked: TickedDrive) -> JudgedDrive:
    padded = stack_drives([ticked])
    estimates, info = jax.tree.map(lambda leaf: leaf[0], filter_drives(model, default_rules(), padded))
    lane = jax.tree.map(lambda leaf: leaf[0], padded)
    smoothed = jax.jit(smooth_estimates)(model, estimates, lane.motions, info.reacquired.any(axis=-1))
    missing = lane.motions.step_s.size - len(ticked.time_s)
    p_false = np.pad(ticked.p_false, (0, missing), constant_values=np.nan)
    switched = _switch(settings, lane, jnp.asarray(p_false, jnp.float32))
    driven = slice(len(ticked.time_s))
    estimates, smoothed, info = jax.tree.map(lambda leaf: leaf[driven], (estimates, smoothed, info))
    poses = np.stack([np.asarray(part, np.float64)[driven] for part in switched], axis=1)
    return JudgedDrive(
        name=drive.path.name,
        time_s=ticked.time_s,
        info=info,
        filtered=estimates,
        smoothed=smoothed,
        switched=poses,
        truth=ticked.truth,
    )


@jax.jit
def _switch(settings: SwitchSettings, drive: NavigationDrives, p_false: jax.Array) -> VehiclePose:
    """Poses by the threshold switch; between positions GNSS/INS keeps the last one."""

    def step(
        carry: tuple[SwitchState, VehiclePose], tick: tuple[NavigationDrives, jax.Array]
    ) -> tuple[tuple[SwitchState, VehiclePose], VehiclePose]:
        (state, last), (now, false) = carry, tick
        gnss, heading = now.observations.gnss, now.observations.heading
        gnss_ins = VehiclePose(gnss.x_m, gnss.y_m, heading.yaw_rad)
        last = VehiclePose(*(jnp.where(gnss.valid, new, old) for new, old in zip(gnss_ins, last, strict=True)))
        speed = now.observations.odometer.speed_mps
        state = step_switch(settings, state, now.motions, speed, last, now.observations.lgpr, false)
        return (state, last), state.pose

    ticks = drive._replace(
        start=VehiclePose(*(jnp.broadcast_to(v, p_false.shape) for v in drive.start)),
        speed_mps=jnp.broadcast_to(drive.speed_mps, p_false.shape),
    )
    poses: VehiclePose = jax.lax.scan(step, (init_switch(drive.start), drive.start), (ticks, p_false))[1]
    return poses


def _figures(name: str, judged: JudgedDrive) -> list[Figure]:
    nis = mean_nis(_one_lane(judged.info))
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
