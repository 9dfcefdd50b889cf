"""Hidden vehicles: loop, prediction, look-ahead and verdicts from their logs, against the plant that drove them."""

from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from lgprjax.tuning.logged_look_ahead import DrawnTuning, drawn_vehicles, judge_drawn, tune_on_draws
from lgprjax.tuning.look_ahead import TrialCourses
from lgprjax.tuning.loop import NAMES, ODOMETER_SHARE, PADDING, STEP_S, WIDTH, LoopLogs, LoopPrior, draw_loops, identify
from lgprjax.tuning.loop_fit import LoopFit, fit_loop, summarise, torque_verdict
from lgprjax.tuning.robust import Estimate
from lgprjax.vehicle import (
    Chassis,
    LookAhead,
    ProportionalRear,
    RolloutLane,
    RolloutSpec,
    Servo,
    anchor_lead_m,
    arc_course,
    line_course,
    look_ahead_m,
    path_from_points,
    phase_margin_rad,
    roll_out_logged,
    start_rollout,
    stretched_look_ahead,
)
from validation.vehicles.drawn import (
    STEP_S as PLANT_S,
)
from validation.vehicles.drawn import (
    Believed,
    Course,
    Driven,
    Hidden,
    draw_course,
    draw_vehicles,
    drive,
    lay_courses,
    noise_of,
)

COUNT, DRIVES, SECONDS = 20, 4, 70.0
SPEEDS, OFFSETS = np.array([2.5, 4.0, 6.0, 3.5]), np.array([2.5, -2.0, 1.0, 2.0])
LOOK_AHEAD = (1.5, 1.0)


def ahead(speed: np.ndarray) -> np.ndarray:
    return LOOK_AHEAD[0] + LOOK_AHEAD[1] * speed


def single(values: Any) -> jax.Array:
    return jnp.asarray(values, jnp.float32)


@cache
def world() -> tuple[Hidden, Believed, list[str]]:
    return draw_vehicles(COUNT, 2024)


@cache
def logs(which: tuple[int, ...], torque: float = 1.0) -> tuple[Driven, Course, np.ndarray]:
    """Four drives of each vehicle: slow, middling, fast, and one that is held out."""
    true, told, laws = world()
    lane = np.repeat(np.array(which), DRIVES)
    number = np.tile(np.arange(DRIVES), len(which))
    speed = SPEEDS[number]
    course = lay_courses(
        [
            draw_course(1000 + i * DRIVES + j, length_m=560.0, least_radius_m=max(9.0, 0.35 * v**2 + 6.0))
            for i, j, v in zip(lane, number, speed, strict=True)
        ]
    )
    time_s = PLANT_S * np.arange(int(SECONDS / PLANT_S))[:, None]
    varied = speed * (1.0 + 0.12 * np.sin(2.0 * np.pi * time_s / 23.0))
    driven = drive(
        true.take(lane),
        told.take(lane),
        course,
        [laws[i] for i in lane],
        ahead_m=ahead,
        speed_mps=varied,
        offset_m=OFFSETS[number],
        seconds=SECONDS,
        seed=5,
        torque=torque,
    )
    return driven, course, varied


def loop_logs(driven: Driven, lanes: list[int]) -> LoopLogs:
    count = len(driven.time_s)
    missing = -count % PADDING

    def padded(values: np.ndarray) -> jax.Array:
        return single(np.pad(values[:, lanes].T, ((0, 0), (0, missing)), mode="edge"))

    # Each begins as the autopilot does, at rest: nothing is under way that is not in the log.
    at = np.arange(count + missing)[None] + np.zeros((len(lanes), 1), int)
    used = jnp.asarray(at < count)
    return LoopLogs(
        padded(driven.command_rad),
        jnp.ones(used.shape, jnp.float32),
        padded(driven.speed_mps),
        padded(driven.front_rad),
        padded(driven.yaw_rate_radps),
        used,
        used,
        jnp.asarray(at == 0),
    )


def prior_of(number: int, backlash_rad: float = 0.0035) -> LoopPrior:
    true, told, _ = world()
    value = [told.lag_s, told.delay_s, told.rate_radps, None, None, told.ratio, told.v_char_mps**-2.0, None, None]
    held = [0.0026 if n == 3 else 0.0 if field is None else field[number] for n, field in enumerate(value)]
    return LoopPrior(single(held), single(WIDTH), single(true.wheelbase_m[number]), single(backlash_rad))


def true_numbers(number: int, law: str = "") -> np.ndarray:
    """In the order of ``NAMES``; ``law``: of the noise, if it is not the vehicle's own."""
    true, _, laws = world()
    # The plant turns wheels and body in one step, of whose beginning it logs the wheels.
    late = (true.late_s[number] if (law or laws[number]) == "skewed" else 0.0) - 0.5 * PLANT_S
    fields = (true.lag_s, true.delay_s, true.rate_radps, true.dead_band_rad, true.asymmetry, true.ratio)
    return np.array([*(field[number] for field in fields), true.v_char_mps[number] ** -2.0, 0.0, late])


def believed(number: int) -> Chassis:
    true, told, _ = world()
    ratio = ProportionalRear(single(told.ratio[number]))
    base, anchor, largest = (single(v[number]) for v in (true.wheelbase_m, true.anchor_m, true.largest_rad))
    return Chassis(base, anchor, ratio, largest, single(told.v_char_mps[number]))


@cache
def fitted(number: int, which: tuple[int, ...], torque: float = 1.0, drives: tuple[int, ...] = (0, 1, 2)) -> LoopFit:
    driven, _, _ = logs(which, torque)
    first = DRIVES * which.index(number)
    return fit_loop(prior_of(number), loop_logs(driven, [first + drive for drive in drives]))


def predicted_rms(number: int, which: tuple[int, ...], numbers: dict[str, Estimate]) -> tuple[float, float]:
    """RMS of the held-out drive, by rollout of what was identified, and as it was."""
    driven, course, speed = logs(which)
    lane = DRIVES * which.index(number) + 3
    every = round(0.25 / 0.05)
    path = path_from_points(np.stack([course.x[lane, ::every], course.y[lane, ::every]], axis=1))
    found = {name: single(one.value) for name, one in numbers.items()}
    own = believed(number)
    true = own._replace(
        rear=ProportionalRear(jnp.maximum(found["rear_ratio"], 0.0)),
        characteristic_speed_mps=jnp.maximum(found["slip_s2pm2"], 1e-6) ** -0.5,
    )
    one, zero = single(1.0), single(0.0)
    servo = Servo(
        found["lag_s"],
        found["rate_radps"],
        found["delay_s"],
        jnp.maximum(found["dead_band_rad"], 0.0),
        single(0.0035),
        zero,
        one,
        zero,
    )
    law = LookAhead(single(LOOK_AHEAD[0]), single(LOOK_AHEAD[0] + 20.0 * LOOK_AHEAD[1]), zero, single(20.0))
    lane_of = RolloutLane(true, own, servo, one, single(SPEEDS[3]), law)
    spec = RolloutSpec(steps=len(driven.time_s), step_s=STEP_S, delay_slots=12)
    start = start_rollout(path, lane_of, zero, single(OFFSETS[3]), zero, delay_slots=12)
    trace = roll_out_logged(spec, path, lane_of, start, single(speed[::2, lane]), jnp.ones(spec.steps))
    rms = [float(np.sqrt(np.mean(np.asarray(v, np.float64) ** 2))) for v in (trace.offset_m, driven.offset_m[:, lane])]
    return rms[0], rms[1]


def check_loops(which: tuple[int, ...], drives: tuple[int, ...] = (0, 1, 2)) -> dict[str, float]:
    """Intervals hold what they should, a held-out run's RMS is predicted, and torque is told where it can be.

    Args:
        which: numbers of the vehicles.
        drives: that are fitted.

    Returns:
        Figures by name.
    """
    inside, apart = [], []
    for number in which:
        fit, true = fitted(number, which, drives=drives), true_numbers(number)
        row = [
            fit.numbers[name].low <= value <= fit.numbers[name].high for name, value in zip(NAMES, true, strict=True)
        ]
        inside.append(
            [row[NAMES.index(name)] for name in ("lag_s", "delay_s", "rate_radps", "rear_ratio", "slip_s2pm2")]
        )
        rolled, driven = predicted_rms(number, which, fit.numbers)
        apart.append(rolled / driven - 1.0)
    share = float(np.mean(inside))
    assert share >= 0.9
    assert np.max(np.abs(apart)) <= 0.2
    for torque in (1.0, 0.7):
        for number in which:
            fit = fitted(number, which, torque, drives)
            wrong = "weak" if torque == 1.0 else "full"
            verdict, reached = torque_verdict(fit), float(np.max(fit.limit_share))
            assert verdict != wrong
            if reached >= 0.75 and torque < 1.0:
                assert verdict == "weak"
            if reached < 0.65:
                assert verdict == "not observable"
    return {"inside their intervals": share, "RMS predicted within": float(np.max(np.abs(apart)))}


_TRIALS = TrialCourses((line_course(200.0), arc_course(25.0, 2.0 * np.pi)), (2.235, 4.47, 6.5), duration_s=25.0)


WEAK = 0.43


def left_weak(number: int, ahead_m: np.ndarray, speed_mps: np.ndarray) -> np.ndarray:
    """How far off a straight line the plain plant still is after 35 s, begun 2 m beside it at 43 % of its torque."""
    true, told, _ = world()
    lanes = np.full(len(speed_mps), number)
    run = drive(
        true.take(lanes),
        told.take(lanes),
        lay_courses([np.zeros(10_000)] * len(lanes)),
        ["white"] * len(lanes),
        ahead_m=lambda _: ahead_m,
        speed_mps=speed_mps,
        offset_m=np.full(len(lanes), 2.0),
        seconds=40.0,
        seed=3,
        torque=WEAK,
        quiet=True,
    )
    return np.asarray(np.max(np.abs(run.offset_m[-500:]), axis=0))


def least_left(number: int, speeds: np.ndarray) -> np.ndarray:
    """The same by the best constant look-ahead that leaves the phase margin, which play and dead band bound."""
    true, _, _ = world()
    lengths = np.geomspace(1.0, 25.0, 28)
    left = left_weak(number, np.tile(lengths, len(speeds)), np.repeat(speeds, len(lengths)))
    ratio = ProportionalRear(single(true.ratio[number]))
    base, anchor, largest, slip = (
        single(v[number]) for v in (true.wheelbase_m, true.anchor_m, true.largest_rad, true.v_char_mps)
    )
    lead = anchor_lead_m(Chassis(base, anchor, ratio, largest, slip))
    grid, speed = single(lengths)[None, :], single(speeds)[:, None]
    margin = phase_margin_rad(grid, lead, speed, single(true.lag_s[number] / WEAK), single(true.delay_s[number]))
    return np.asarray(np.where(margin >= _TRIALS.least_margin_rad, left.reshape(margin.shape), np.inf).min(axis=1))


def check_look_ahead(which: tuple[int, ...], draws: int, steps: int) -> dict[str, float]:
    """Within a tenth of the true vehicle's own best; at 43 % of the torque it settles as far as any length lets it."""
    config = DrawnTuning(steps=steps)
    shares, speeds = single(config.shares), np.array(_TRIALS.speeds_mps)
    worst, left, bound = 0.0, [], []
    for number in which:
        fit = fitted(number, which)
        drawn = draw_loops(fit.prior, fit.posterior, jax.random.key(1), count=draws)
        tuned = tune_on_draws(drawn_vehicles(believed(number), fit.prior, drawn), _TRIALS, config)
        # Alike: as many as a step of the tuner takes.
        alike = single(np.tile(true_numbers(number), (config.batch, 1)))
        exact = drawn_vehicles(believed(number), fit.prior, alike)
        best = tune_on_draws(exact, _TRIALS, config)
        costs = [
            float(jnp.mean(judge_drawn(exact, _TRIALS, s, shares).cost_m)) for s in (tuned.schedule, best.schedule)
        ]
        worst = max(worst, costs[0] / costs[1] - 1.0)
        stretched = stretched_look_ahead(
            tuned.schedule.look_ahead, tuned.schedule.exponent, single(WEAK), single(tuned.least_share)
        )
        left.append(left_weak(number, np.asarray(look_ahead_m(stretched, single(speeds)), np.float64), speeds))
        bound.append(least_left(number, speeds))
    assert worst <= 0.10
    assert np.all(np.array(left) <= np.maximum(0.10, 1.25 * np.array(bound)))
    settles, settled = np.sum(np.array(bound) < 0.10), np.sum(np.array(left) < 0.10)
    return {"most above the optimum": worst, "of": np.size(left), "settled": int(settled), "could settle": int(settles)}


def drawn_files(number: int, random: np.random.Generator, count: int) -> np.ndarray:
    """Numbers of vehicle files that are as wrong as the widths say; a file says nothing of the sensors."""
    truth = true_numbers(number)
    wrong = random.normal(size=(count, len(NAMES))) * WIDTH
    by_factor = np.isin(NAMES, ("lag_s", "rate_radps"))
    files = np.where(by_factor, truth * np.exp(np.where(by_factor, wrong, 0.0)), truth + wrong)
    files[:, NAMES.index("zero_rad") :] = 0.0
    physical = ("delay_s", "dead_band_rad", "rear_ratio", "slip_s2pm2")
    files[:, [NAMES.index(name) for name in physical]] = np.maximum(
        files[:, [NAMES.index(name) for name in physical]], (0.0, 0.0, 0.0, 1e-4)
    )
    return files


DRAWN = 20
"""Draws of a call of ``identify_many``."""
_AXES: Any = (LoopPrior(0, None, None, None), LoopLogs._make([None, None, 0, 0, 0, None, None, None]))  # type: ignore[arg-type]
identify_many = jax.jit(jax.vmap(identify, in_axes=_AXES))


def quiet_drives(number: int, seed: int) -> Driven:
    """Three drives of a vehicle on courses of their own, as sensors without noise would log them."""
    true, told, _ = world()
    drives = DRIVES - 1
    lanes, speed = np.full(drives, number), SPEEDS[:drives]
    least_m = np.maximum(9.0, 0.35 * speed**2 + 6.0)
    course = lay_courses([draw_course(seed + i, length_m=400.0, least_radius_m=r) for i, r in enumerate(least_m)])
    time_s = PLANT_S * np.arange(int(SECONDS / PLANT_S))[:, None]
    return drive(
        true.take(lanes),
        told.take(lanes),
        course,
        ["white"] * drives,
        ahead_m=ahead,
        speed_mps=speed * (1.0 + 0.12 * np.sin(2.0 * np.pi * time_s / 23.0)),
        offset_m=OFFSETS[:drives],
        seconds=SECONDS,
        seed=9,
        quiet=True,
    )


def coverage(law: str, draws: int, seed: int) -> dict[str, float]:
    """Share of draws whose 95 % intervals hold the truth: of vehicle and courses, noise, odometer's scale, and file.

    An interval is made of file and drives together. With one file for all draws it would measure how wrong that file
    happens to be, and with one course how a quantiser's steps happen to fall on it.
    """
    true, _, _ = world()
    random, held = np.random.default_rng(seed), dict.fromkeys(NAMES, 0)
    for batch in range(draws // DRAWN):
        number = batch % COUNT
        run = quiet_drives(number, 100_000 + 10 * (draws // DRAWN * seed + batch))
        drives, count = DRIVES - 1, len(run.time_s)
        base = loop_logs(run, list(range(drives)))
        prior = prior_of(number, float(true.backlash_rad[number]))
        turning = np.asarray(base.yaw_rate_radps, np.float64)
        if law == "skewed":
            # The gyro's clock, as in a drive.
            at_s = STEP_S * np.arange(turning.shape[1])
            late_s = at_s * (1.0 + true.drift[number]) - true.late_s[number]
            turning = np.stack([np.interp(late_s, at_s, one) for one in turning])
        noise = np.zeros((2, DRAWN, drives, base.front_rad.shape[1]))
        for lane, own in np.ndindex(DRAWN, drives):
            for output, sigma in enumerate((true.front_sigma_rad[number], true.yaw_rate_sigma[number])):
                noise[output, lane, own, :count] = sigma * noise_of(law, random, count, true.colour_s[number])
        scale = 1.0 + ODOMETER_SHARE * random.normal(size=(DRAWN, 1, 1))
        front, rate = np.asarray(base.front_rad) + noise[0], turning + noise[1]
        if law == "quantised":
            front, rate = (np.radians(s) * np.round(v / np.radians(s)) for v, s in ((front, 0.35), (rate, 0.5)))
        many = base._replace(
            speed_mps=single(np.asarray(base.speed_mps) * scale), front_rad=single(front), yaw_rate_radps=single(rate)
        )
        files = prior._replace(value=single(drawn_files(number, random, DRAWN)))
        found = identify_many(files, many)
        truth = true_numbers(number, law)
        for lane in range(DRAWN):
            own_file = prior._replace(value=files.value[lane])
            fit = summarise(own_file, jax.tree.map(lambda leaf, lane=lane: leaf[lane], found))
            for name, value in zip(NAMES, truth, strict=True):
                held[name] += fit.numbers[name].low <= value <= fit.numbers[name].high
    return {name: held[name] / (draws // DRAWN * DRAWN) for name in NAMES}
