"""Study of the steering loop on ordinary drives: servo, rear ratio, slip, and the numbers that stay undetermined."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from pydantic import Field

from lgprjax.config import ConfigTable
from lgprjax.errors import InputError
from lgprjax.formats import with_values
from lgprjax.recordings.vehicles import chassis_of, servo_of
from lgprjax.tuning import Estimate
from lgprjax.tuning.loop import NAMES, RATE, RATIO, REACHED_SHARE, WIDTH, LoopLogs, LoopPrior, residual_scale
from lgprjax.tuning.loop_fit import LoopFit, fit_loop, torque_verdict
from lgprjax.tuning.studies.drives import LoopDrive, loop_drive, loop_logs, smoothed
from lgprjax.tuning.studies.logs import Figure, Outcome, Task, fitting, options_of, rms
from lgprjax.tuning.studies.needs import Contradiction, judged_residual
from lgprjax.tuning.studies.tracking import plan_path, tracked
from lgprjax.vehicle import (
    Chassis,
    LookAhead,
    ProportionalRear,
    RolloutLane,
    RolloutSpec,
    Servo,
    rear_angle,
    roll_out_logged,
    start_rollout,
    torque_share,
)

_KEYS = {
    "lag_s": "steering.lag_s",
    "delay_s": "steering.delay_s",
    "rate_radps": "steering.largest_wheel_rate_radps",
    "rear_ratio": "steering.rear_ratio",
}
_SLIP_KEY = "steering.characteristic_speed_mps"
_USUAL = {"lag_s": 0.15, "delay_s": 0.06, "rate_radps": 0.5, "rear_ratio": 0.4, "slip_s2pm2": 1.0 / 25.0**2}
_ROLL_S = 0.02
_LONGEST_DELAY_S = 0.3
_WRONG_SHARE, _WRONG_M = 0.4, 0.03
_WORDS = {
    "lag_s": "lag of the servo",
    "delay_s": "delay of the servo",
    "rate_radps": "largest rate of the servo",
    "rear_ratio": "rear ratio k",
    "slip_s2pm2": "characteristic speed",
}


class LoopOptions(ConfigTable):
    """Options of the study: width of the prior.

    Attributes:
        widths: factor on the usual widths of the prior from the vehicle file.
    """

    widths: float = Field(default=1.0, ge=0.2, le=3.0)


class Predicted(NamedTuple):
    """A logged stretch and its rollout by the fitted vehicle.

    Attributes:
        name: name of the log.
        time_s: time from the start of the stretch, s.
        driven_m, rolled_m: logged and simulated lateral offset from the path.
        front_rad, rolled_front_rad: logged and simulated front wheel angle.
    """

    name: str
    time_s: Float[np.ndarray, " step"]
    driven_m: Float[np.ndarray, " step"]
    rolled_m: Float[np.ndarray, " step"]
    front_rad: Float[np.ndarray, " step"]
    rolled_front_rad: Float[np.ndarray, " step"]


class LoopStudy(NamedTuple):
    """Data for pictures: the fit, and logged stretches with their rollouts."""

    fit: LoopFit
    predicted: tuple[Predicted, ...]


def study_loop(task: Task) -> Outcome:
    """Fit the numbers of ``steering`` that the drives determine; the others keep their values and are listed in notes.

    Raises:
        InputError: a log lacks commands, wheel angles, or motion; the vehicle file lacks its wheelbase.
    """
    options = options_of(task, LoopOptions)
    drives = [loop_drive(task, path, fixes=False) for path in task.study.logs]
    fit = fit_of(task, drives, options.widths)
    found, notes = _found(task, fit)
    figures = [
        Figure("wheel angle, measured minus model, robust scale", float(np.degrees(np.median(fit.scale[:, 0]))), "deg"),
        Figure("yaw rate, measured minus model, robust scale", float(np.degrees(np.median(fit.scale[:, 1]))), "deg/s"),
    ]
    for drive, share in zip(drives, fit.limit_share, strict=True):
        figures.append(Figure(f"{drive.path.name}: highest share of the servo's rate", float(share), ""))
    verdict = torque_verdict(fit)
    notes.append(f"torque of the servo against the vehicle file: {verdict}" + _of_rate(fit, verdict))
    predicted, against = [], list[Contradiction]()
    for path in task.study.held_out:
        judge = loop_drive(task, path, fixes=False)
        scale = np.asarray(residual_scale(fit.prior, _logs(task, [judge]), fit.place), np.float64)[0]
        figures.append(Figure(f"held out, {path.name}: wheel angle, robust scale", float(np.degrees(scale[0])), "deg"))
        own = float(np.degrees(np.median(fit.scale[:, 0])))
        against += judged_residual("wheel angle", path, max(own, 0.05), float(np.degrees(scale[0])), "deg")
        figures.append(Figure(f"held out, {path.name}: yaw rate, robust scale", float(np.degrees(scale[1])), "deg/s"))
        own = float(np.degrees(np.median(fit.scale[:, 1])))
        against += judged_residual("yaw rate", path, max(own, 0.1), float(np.degrees(scale[1])), "deg/s")
        one = predict(task, fit, judge)
        if one is None:
            notes.append(f"held out, {path.name}: no fixes or no path: no rollout to compare")
            continue
        predicted.append(one)
        driven, rolled = rms(one.driven_m), rms(one.rolled_m)
        figures += [
            Figure(f"held out, {path.name}: offset as driven, rms", driven, "m"),
            Figure(f"held out, {path.name}: offset by rollout, rms", rolled, "m"),
            Figure(f"held out, {path.name}: driven minus rollout, rms", rms(one.driven_m - one.rolled_m), "m"),
        ]
        if abs(rolled - driven) > max(_WRONG_SHARE * driven, _WRONG_M):
            expected = f"{driven:.3f} m rms, as driven, to within {max(_WRONG_SHARE * driven, _WRONG_M):.3f} m"
            against.append(Contradiction(path, "offset by rollout", expected, f"{rolled:.3f} m"))
    for drive in drives:
        one = predict(task, fit, drive)
        if one is not None:
            predicted.append(one)
    return Outcome({**found}, {}, tuple(figures), tuple(notes), LoopStudy(fit, tuple(predicted)), tuple(against))


def _of_rate(fit: LoopFit, verdict: str) -> str:
    rate, before = fit.numbers["rate_radps"], float(fit.prior.value[RATE])
    if float(np.max(fit.limit_share)) < REACHED_SHARE:
        return f" (no drive turns the wheels near their rate: {rate.low:.3g} rad/s or more; file {before:.3g})"
    open_ = ": neither full torque nor 30 % less is excluded" if verdict == "not observable" else ""
    return f" ({rate.value:.3g} rad/s, {rate.low:.3g} to {rate.high:.3g}; file {before:.3g}{open_})"


def fit_of(task: Task, drives: list[LoopDrive], widths: float = 1.0) -> LoopFit:
    """Fit the steering loop of the task's vehicle to drives.

    Raises:
        InputError: as ``study_loop``.
    """
    for drive in drives:
        for name, place in (("command_rad", "steering_command_rad"), ("front_rad", "wheel_angle_rad")):
            if not np.isfinite(getattr(drive, name)).any():
                raise InputError(drive.path, f"/vehicle/{place}", "a vehicle signal", "none")
        seconds = float(np.sum(np.diff(drive.time_s)[drive.commanded[1:]]))
        if seconds < 10.0:
            expected = "at least 10 s of commands to the servo"
            raise InputError(drive.path, "/vehicle/steering_command_rad", expected, f"{seconds:.1f} s")
        live = drive.commanded & (np.abs(drive.speed_mps) > 0.3)
        spread = float(np.degrees(np.std(drive.front_rad[live & np.isfinite(drive.front_rad)]))) if live.any() else 0.0
        if spread < 0.2:
            expected = "wheel angles of 0.2° rms or more while driving"
            raise InputError(drive.path, "/vehicle/wheel_angle_rad", expected, f"{spread:.2f}°")
    with fitting(task.study.logs[0]):
        fit = fit_loop(prior_of(task, widths), _logs(task, drives))
    count = len(drives)
    return fit._replace(limit_share=fit.limit_share[:count], scale=fit.scale[:count])


def _logs(task: Task, drives: list[LoopDrive]) -> LoopLogs:
    return loop_logs(drives, _servo(task))


def _servo(task: Task) -> Servo:
    """The file's servo, with usual values for missing numbers."""
    missing = {key: _USUAL[name] for name, key in _KEYS.items() if name != "rear_ratio" and _value(task, key) is None}
    return servo_of(with_values(task.vehicle, missing, {}), task.study.vehicle)


def _value(task: Task, key: str) -> float | None:
    value: float | None = getattr(task.vehicle.steering, key.partition(".")[2])
    return value


def prior_of(task: Task, widths: float = 1.0) -> LoopPrior:
    """Prior from the vehicle file, with usual values for missing numbers.

    A measured map of the rear wheels is kept: k is fixed at its slope.

    Raises:
        InputError: the file has no wheelbase.
    """
    base = task.vehicle.chassis.wheelbase_m
    if base is None:
        raise InputError(task.study.vehicle, "chassis.wheelbase_m", "a number", "none")
    width = WIDTH * widths
    stated = {name: _value(task, key) for name, key in _KEYS.items()}
    speed = _value(task, _SLIP_KEY)
    stated["slip_s2pm2"] = None if speed is None else speed**-2.0
    if task.vehicle.rear_map is not None:
        chassis = chassis_of(with_values(task.vehicle, {"pursuit.anchor_m": 0.0}, {}), task.study.vehicle)
        stated["rear_ratio"] = float(rear_angle(chassis.rear, jnp.zeros(()))[1])
        width[RATIO] = 0.005
    steering = task.vehicle.steering
    stated |= {"dead_band_rad": steering.dead_band_rad or 0.002, "asymmetry": steering.asymmetry or 0.0}
    value = [stated.get(name) if stated.get(name) is not None else _USUAL.get(name, 0.0) for name in NAMES]
    return LoopPrior(
        jnp.asarray(value, jnp.float32),
        jnp.asarray(width, jnp.float32),
        jnp.float32(base),
        jnp.float32(steering.backlash_rad or 0.0),
    )


def _found(task: Task, fit: LoopFit) -> tuple[dict[str, Estimate], list[str]]:
    """Estimates of the numbers that the drives determine, and notes on the others."""
    found, notes = {}, []
    for name, words in _WORDS.items():
        one = fit.numbers[name]
        if name not in fit.told or (name == "rear_ratio" and task.vehicle.rear_map is not None):
            why = " (the file has a rear map)" if name == "rear_ratio" and name in fit.told else ""
            notes.append(f"{words}: not determined{why}, interval {fit.narrowed[name]:.0%} of the prior's width")
        elif name == "slip_s2pm2":
            if one.low <= 0.0:
                notes.append(f"{words}: {max(one.high, 1e-9) ** -0.5:.3g} m/s or any above: the drives are too slow")
                continue
            low, high = one.high**-0.5, one.low**-0.5
            found[_SLIP_KEY] = Estimate(one.value**-0.5, 0.25 * (high - low), low, high)
        else:
            found[_KEYS[name]] = one._replace(
                value=max(one.value, 0.0), low=max(min(one.low, one.value), 0.0), high=max(one.high, 0.0)
            )
    return found, notes


def predict(task: Task, fit: LoopFit, drive: LoopDrive) -> Predicted | None:
    """The longest stretch under autopilot, and a rollout from its start; ``None`` without a path."""
    pursuit = task.vehicle.pursuit
    schedule = [getattr(pursuit, name) for name in LookAhead._fields]
    if drive.ticked is None or pursuit.anchor_m is None or any(v is None for v in schedule):
        return None
    if not np.isfinite(drive.offset_m).any() or not drive.engaged.any():
        return None
    places = smoothed(task, drive)
    with fitting(drive.path):
        beside = tracked(task, drive, places, "", pursuit.anchor_m)
    cuts = np.flatnonzero((np.diff(beside.engaged.astype(int)) != 0) | (np.diff(beside.time_s) > 0.5)) + 1
    steered = [part for part in np.split(np.arange(len(beside.time_s)), cuts) if beside.engaged[part[0]]]
    if not steered or len(longest := max(steered, key=len)) < 50:
        return None
    path = plan_path(drive, places, pursuit.anchor_m)
    believed = chassis_of(task.vehicle, task.study.vehicle)
    first = longest[0]
    at_s = np.arange(beside.time_s[first], beside.time_s[longest[-1]], _ROLL_S)
    steps = -(-len(at_s) // 1024) * 1024
    at = np.append(at_s, np.full(steps - len(at_s), at_s[-1]))
    place = int(np.searchsorted(places.time_s, beside.time_s[first]))
    yaw = places.yaw_rad[place]
    ahead = (places.x_m[place] + pursuit.anchor_m * np.cos(yaw), places.y_m[place] + pursuit.anchor_m * np.sin(yaw))
    rows = np.asarray(path.rows, np.float64)[1:-1]
    arc = float(np.argmin(np.hypot(rows[:, 0] - ahead[0], rows[:, 1] - ahead[1])) * float(path.spacing_m))
    servo = _servo(task)
    volts = np.where(np.isfinite(drive.supply_v), drive.supply_v, float(servo.nominal_v))
    share = np.asarray(torque_share(servo, jnp.asarray(np.interp(at, drive.time_s, volts), jnp.float32)))
    slots = int(np.ceil(_LONGEST_DELAY_S / _ROLL_S))
    spec = RolloutSpec(steps=steps, step_s=_ROLL_S, delay_slots=slots)
    law = LookAhead(*(jnp.float32(v) for v in schedule if v is not None))
    true, own = fitted_vehicle(believed, fit)
    lane = RolloutLane(true, believed, own, jnp.float32(1.0), jnp.float32(1.0), law)
    start = start_rollout(
        path,
        lane,
        jnp.float32(arc),
        jnp.float32(beside.offset_m[first]),
        jnp.float32(beside.heading_error_rad[first]),
        delay_slots=slots,
    )
    speed = jnp.asarray(np.interp(at, drive.time_s, drive.speed_mps), jnp.float32)
    trace = roll_out_logged(spec, path, lane, start, speed, jnp.asarray(share, jnp.float32))
    count = len(at_s)
    return Predicted(
        drive.path.name,
        at_s - at_s[0],
        np.interp(at_s, beside.time_s, beside.offset_m),
        np.asarray(trace.offset_m, np.float64)[:count],
        np.interp(at_s, drive.time_s, drive.front_rad),
        np.asarray(trace.front_rad, np.float64)[:count],
    )


def fitted_vehicle(believed: Chassis, fit: LoopFit) -> tuple[Chassis, Servo]:
    """Chassis and servo with the fit's numbers; the servo's nominal supply is 1."""
    value = {name: jnp.float32(one.value) for name, one in fit.numbers.items()}
    rear = (
        ProportionalRear(jnp.maximum(value["rear_ratio"], 0.0))
        if isinstance(believed.rear, ProportionalRear)
        else believed.rear
    )
    speed = jnp.maximum(value["slip_s2pm2"], 1e-6) ** -0.5
    one, zero = jnp.float32(1.0), jnp.float32(0.0)
    servo = Servo(
        lag_s=value["lag_s"],
        rate_radps=value["rate_radps"],
        delay_s=jnp.maximum(value["delay_s"], 0.0),
        dead_band_rad=jnp.maximum(value["dead_band_rad"], 0.0),
        backlash_rad=fit.prior.backlash_rad,
        asymmetry=value["asymmetry"],
        nominal_v=one,
        stall_v=zero,
    )
    return believed._replace(rear=rear, characteristic_speed_mps=speed), servo
