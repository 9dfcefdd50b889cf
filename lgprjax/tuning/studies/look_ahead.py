"""Study of the look-ahead distance over speed, by simulated drives of the file's vehicle or of one fitted to logs."""

from dataclasses import replace
from typing import Annotated, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from pydantic import AfterValidator, Field

from lgprjax.config import BrokenRuleError, ConfigTable
from lgprjax.errors import InputError
from lgprjax.recordings.vehicles import chassis_of, servo_of
from lgprjax.tuning.logged_look_ahead import (
    SETTLED_M,
    DrawnTuning,
    Experiment,
    TunedOnDraws,
    drawn_vehicles,
    next_experiments,
    tune_on_draws,
)
from lgprjax.tuning.look_ahead import (
    GradientConfig,
    LookAheadCosts,
    TrialCourses,
    TunedLookAhead,
    TunedVehicle,
    sweep_look_ahead,
    tune_look_ahead,
)
from lgprjax.tuning.loop import draw_loops
from lgprjax.tuning.loop_fit import LoopFit
from lgprjax.tuning.studies.drives import loop_drive
from lgprjax.tuning.studies.logs import Figure, Outcome, Task, options_of
from lgprjax.tuning.studies.loop import fit_of
from lgprjax.vehicle import arc_course, clothoid_course, line_course, look_ahead_m

_Speed = Annotated[float, Field(ge=0.2, le=20.0)]
_Metres = Annotated[float, Field(ge=0.3, le=100.0)]


def _two_speeds(value: list[float]) -> list[float]:
    if len(set(value)) < 2:
        raise BrokenRuleError("", "two speeds or more")
    return value


def _from_to(value: list[float]) -> list[float]:
    if not value[0] < value[1]:
        raise BrokenRuleError("", "[from, to] with from before to")
    return value


class LookAheadOptions(ConfigTable):
    """Simulated courses and speeds, weights of the cost, and look-aheads of the picture.

    Attributes:
        courses: kinds of course; ``curve`` is a straight, a quarter turn and a straight.
        speeds_mps: driven speeds, two or more; 5 and 10 mph by default.
        effort_m2: weight of the wheels' movement in the cost, m².
        least_margin_deg: smallest phase margin.
        sweep_m: first and last look-ahead of the picture.
        supply_v: supply voltage of the servo; ``None``: the servo's nominal voltage.
        steps: number of gradient steps.
        draws: number of vehicles drawn from the posterior of the logs; used only with logs.
        torque_shares: shares of the servo's torque for which the schedule is tuned; used only with logs. The least
            share is the least that the schedule follows on board.
    """

    courses: list[Literal["line", "arc", "curve"]] = Field(default=["line", "arc"], min_length=1)
    speeds_mps: Annotated[list[_Speed], AfterValidator(_two_speeds)] = Field(default=[2.235, 4.47])
    offsets_m: list[Annotated[float, Field(ge=-10.0, le=10.0)]] = Field(default=[0.0, 3.0, -3.0], min_length=1)
    arc_radius_m: float = Field(default=25.0, ge=3.0, le=1e3)
    duration_s: float = Field(default=30.0, ge=5.0, le=120.0)
    effort_m2: float = Field(default=2.0, ge=0.0, le=100.0)
    least_margin_deg: float = Field(default=30.0, ge=0.0, le=80.0)
    sweep_m: Annotated[list[_Metres], Field(min_length=2, max_length=2), AfterValidator(_from_to)] = Field(
        default=[1.0, 14.0]
    )
    supply_v: float | None = Field(default=None, ge=0.0, le=1e3)
    steps: float = Field(default=150.0, ge=1.0, le=5000.0)
    draws: float = Field(default=1024.0, ge=32.0, le=16384.0)
    torque_shares: list[Annotated[float, Field(gt=0.05, lt=1.0)]] = Field(default=[0.7, 0.43], min_length=1)


# As many look-aheads as the tuner begins with, and as many speeds at a time, so that nothing is recompiled.
_SWEEP_STEPS, _SWEEPS = 24, 6


class LookAheadStudy(NamedTuple):
    """Data for pictures: the tuned look-ahead, and the cost surfaces of the sweep with their axes.

    Attributes:
        trials: courses and speeds of the tuning.
        tuned: tuned look-ahead.
        look_ahead_m, speed_mps: axes of the sweep.
        swept: error, oscillation and phase margin over both axes.
    """

    trials: TrialCourses
    tuned: TunedLookAhead
    look_ahead_m: np.ndarray
    speed_mps: np.ndarray
    swept: LookAheadCosts


def study_look_ahead(task: Task) -> Outcome:
    """Choose ``pursuit.short_m``, ``long_m``, ``slow_mps`` and ``fast_mps``.

    Raises:
        InputError: an option is wrong, the vehicle file lacks a number, or no look-ahead leaves the required margin.
    """
    options = options_of(task, LookAheadOptions)
    if task.study.logs:
        return _from_logs(task, options)
    vehicle = _vehicle(task, options.supply_v)
    trials = _trials(options)
    try:
        tuned = tune_look_ahead(vehicle, trials, GradientConfig(steps=round(options.steps)))
    except ValueError as error:
        raise InputError(task.study.file, "options", "a look-ahead that the steering can track", str(error)) from None
    look = np.linspace(options.sweep_m[0], options.sweep_m[1], _SWEEP_STEPS)
    speeds = np.linspace(min(trials.speeds_mps), max(trials.speeds_mps), _SWEEPS * len(trials.speeds_mps))
    swept = _sweep(vehicle, trials, look, speeds)
    chosen = {f"pursuit.{name}": float(value) for name, value in tuned.schedule._asdict().items()}
    judged = tuned.judged
    figures = []
    for number, speed in enumerate(trials.speeds_mps):
        figures += [
            Figure(f"error at {speed:g} m/s, rms over courses and offsets", float(judged.error_m[number]), "m"),
            Figure(f"oscillation left at {speed:g} m/s, amplitude", float(judged.cycle_m[number]), "m"),
            Figure(f"phase margin at {speed:g} m/s", float(np.degrees(judged.margin_rad[number])), "deg"),
        ]
    volts = float(vehicle.supply_v)
    notes = (f"cost {tuned.cost_m:.3f} m at a supply of {volts:g} V; a chosen look-ahead has no confidence interval",)
    return Outcome({}, chosen, tuple(figures), notes, LookAheadStudy(trials, tuned, look, speeds, swept))


class LoggedLookAheadStudy(NamedTuple):
    """Data for pictures: the schedule, the fit to the logs, and the experiments that would reduce its uncertainty."""

    trials: TrialCourses
    tuned: TunedOnDraws
    fit: LoopFit
    experiments: tuple[Experiment, ...]


def _from_logs(task: Task, options: LookAheadOptions) -> Outcome:
    """Look-ahead schedule over speed and torque, for vehicles drawn from the posterior of the logs."""
    if options.supply_v is not None:
        expected = "no supply voltage together with logs (the schedule is tuned for torque_shares)"
        raise InputError(task.study.file, "options.supply_v", expected, f"{options.supply_v:g}")
    if task.study.held_out:
        raise InputError(task.study.file, "held_out", "no held-out logs (a loop study validates the fit)", "logs")
    fit = fit_of(task, [loop_drive(task, path, fixes=False) for path in task.study.logs])
    chassis = chassis_of(task.vehicle, task.study.vehicle)
    draws = draw_loops(fit.prior, fit.posterior, jax.random.key(0), count=round(options.draws))
    trials = replace(_trials(options), longest_delay_s=0.4)
    shares = (1.0, *sorted(options.torque_shares, reverse=True))
    config = DrawnTuning(shares=shares, steps=min(round(options.steps), 100))
    try:
        tuned = tune_on_draws(drawn_vehicles(chassis, fit.prior, draws), trials, config)
    except ValueError as error:
        raise InputError(task.study.file, "options", "a look-ahead that the steering can track", str(error)) from None
    experiments = next_experiments(fit, tuned, draws)
    chosen = {f"pursuit.{name}": float(value) for name, value in tuned.schedule.look_ahead._asdict().items()}
    chosen |= {
        "pursuit.weak_exponent": float(tuned.schedule.exponent),
        "pursuit.least_torque_share": float(tuned.least_share),
    }
    figures, unsettled = [], []
    ahead = np.asarray(look_ahead_m(tuned.schedule.look_ahead, jnp.asarray(tuned.speeds_mps, jnp.float32)))
    for number, speed in enumerate(tuned.speeds_mps):
        low, high = tuned.low_m[number], tuned.high_m[number]
        figures.append(Figure(f"look-ahead at {speed:g} m/s", float(ahead[number]), "m"))
        middle = float(np.median(tuned.best_m[:, number]))
        figures.append(
            Figure(f"best at {speed:g} m/s, for the vehicles that the logs allow", middle, "m", float(low), float(high))
        )
        for place, share in enumerate(tuned.shares):
            errors = np.asarray(tuned.judged.error_m)[:, number, place]
            name = f"error at {speed:g} m/s and {share:.0%} of the torque, rms over courses and offsets"
            figures.append(
                Figure(name, float(np.mean(errors)), "m", *(float(v) for v in np.percentile(errors, [2.5, 97.5])))
            )
            left = np.asarray(tuned.judged.cycle_m)[:, number, place]
            name = f"oscillation left at {speed:g} m/s and {share:.0%} of the torque, amplitude"
            low, high = (float(value) for value in np.percentile(left, [2.5, 97.5]))
            figures.append(Figure(name, float(np.mean(left)), "m", low, high))
            if high > SETTLED_M:
                unsettled.append(f"{speed:g} m/s and {share:.0%} of the torque ({low:.2f} to {high:.2f} m)")
    open_ = [name for name in ("lag_s", "delay_s", "rate_radps", "rear_ratio", "slip_s2pm2") if name not in fit.told]
    notes = [
        f"tuned over {len(tuned.best_m)} vehicles that {len(task.study.logs)} logs allow, each at "
        f"{', '.join(f'{share:.0%}' for share in tuned.shares)} of the torque",
        f"not determined by the logs: {', '.join(open_) or 'nothing'}",
        *(
            f"may not settle below {SETTLED_M:g} m at {where}: play and dead band of the servo; drive slower there"
            for where in unsettled
        ),
        *(f"next: {one.what} would narrow the look-ahead by {one.narrows:.0%}" for one in experiments),
    ]
    return Outcome({}, chosen, tuple(figures), tuple(notes), LoggedLookAheadStudy(trials, tuned, fit, experiments))


def _vehicle(task: Task, supply_v: float | None) -> TunedVehicle:
    chassis, servo = chassis_of(task.vehicle, task.study.vehicle), servo_of(task.vehicle, task.study.vehicle)
    volts = float(servo.nominal_v) if supply_v is None else supply_v
    if volts <= float(servo.stall_v):
        expected = f"more than the servo's stall_v, {float(servo.stall_v):g}"
        raise InputError(task.study.file, "options.supply_v", expected, f"{volts:g}")
    return TunedVehicle(chassis, servo, jnp.float32(volts))


def _sweep(vehicle: TunedVehicle, trials: TrialCourses, look_m: np.ndarray, speeds_mps: np.ndarray) -> LookAheadCosts:
    """Costs over look-aheads and speeds, computed for a few speeds at a time."""
    parts = [
        sweep_look_ahead(vehicle, replace(trials, speeds_mps=tuple(some.tolist())), look_m.tolist())
        for some in np.split(speeds_mps, _SWEEPS)
    ]
    return LookAheadCosts(*(jnp.concatenate(fields, axis=-1) for fields in zip(*parts, strict=True)))


def _trials(options: LookAheadOptions) -> TrialCourses:
    way_m = 1.2 * options.duration_s * max(options.speeds_mps) + 20.0
    radius_m = options.arc_radius_m
    # One arc suffices: offsets to both sides of it are equivalent to arcs to both sides.
    courses = {
        "line": lambda: line_course(way_m),
        "arc": lambda: arc_course(radius_m, 2.0 * np.pi),
        "curve": lambda: clothoid_course(radius_m, 0.5 * np.pi, 0.5 * radius_m, straight_m=0.5 * way_m),
    }
    return TrialCourses(
        paths=tuple(courses[name]() for name in options.courses),
        speeds_mps=tuple(options.speeds_mps),
        offsets_m=tuple(options.offsets_m),
        duration_s=options.duration_s,
        effort_m2=options.effort_m2,
        least_margin_rad=float(np.radians(options.least_margin_deg)),
    )
