"""Shares of drawn drives in which an interval holds what it is of: calibrations, pedals and the filter's noises."""

from functools import cache

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from lgprjax.navigation.counter_steer_model import FilterModel
from lgprjax.navigation.observations import MotionInput, Observations, default_rules
from lgprjax.scene.motion import step_pedals, turn_standing
from lgprjax.scene.vehicle_drive import DriveTruth, TrueVehicle, VehicleSensors, drive_manoeuvre, read_vehicle
from lgprjax.tuning import NOISES, DriveSignals, FusionFit, NavigationDrives, fit_encoder, fit_fusion
from lgprjax.tuning.arcs import find_stretches, fit_arcs
from lgprjax.tuning.pedals import cut_runs, fit_way
from lgprjax.tuning.robust import combine, robust_line, student_95
from lgprjax.tuning.steering import (
    WheelAngleFit,
    YawGainFit,
    fit_wheel_angle,
    fit_yaw_gain,
    front_angle,
    front_band,
    rear_ratio_by_heading,
)
from lgprjax.vehicle import VehiclePose
from model_drives import SPEED_MPS, Drawn, draw_drive, stacked, usual_model
from turning_drives import (
    LARGEST_RAD,
    PER_RAD_V,
    RATIO,
    STRAIGHT_V,
    Leg,
    Noise,
    arcs_of,
    chassis,
    drive,
    measured,
    palm_legs,
)

VEHICLE = TrueVehicle()

# The encoder: a wheel turned at standstill.

STILL = turn_standing(VEHICLE.largest_angle_rad, 5.0, pause_s=2.0)


@cache
def still_truth() -> DriveTruth:
    return drive_manoeuvre(VEHICLE, STILL)


def standing_log(seed: int = 0, sensors: VehicleSensors | None = None) -> DriveSignals:
    return read_vehicle(VEHICLE, STILL, still_truth(), sensors or VehicleSensors(record_hz=25.0), seed)


def encoder_shares(draws: int, spike_share: float) -> tuple[dict[str, float], float]:
    """Share of draws in which each interval holds, and of those in which a straight line was fitted."""
    sensors = VehicleSensors(record_hz=10.0, spike_share=spike_share)
    logs = [standing_log(seed, sensors) for seed in range(draws)]
    fits = [fit_encoder(signals, 2.43) for signals in logs]
    # The zero is another one in every draw: it is what the counts are at straight.
    truths: dict[str, np.ndarray | float] = {
        "counts_per_v": 6000.0,
        "hysteresis_counts": VEHICLE.backlash_rad * VEHICLE.encoder_counts_per_rad,
        "reference_counts": np.array([_zero_counts(signals) for signals in logs]),
    }
    found = {name: np.array([getattr(fit, name) for fit in fits]) for name in truths}
    shares = {
        name: float(np.mean((found[name][:, 2] <= truth) & (found[name][:, 3] >= truth)))
        for name, truth in truths.items()
    }
    return shares, float(np.mean([len(fit.volts) == 2 for fit in fits]))


def _zero_counts(signals: DriveSignals) -> float:
    """The encoder's zero, from what it reads against the truth: within the rounding, the same at all stops."""
    assert signals.encoder_counts is not None
    step = np.rint(signals.time_s * 100.0).astype(int)
    away = signals.encoder_counts - VEHICLE.encoder_counts_per_rad * still_truth().motor_rad[step]
    return float(0.5 * (away.min() + away.max()))


# Pedals.

STEPS = step_pedals([0.3, 0.45, 0.6], [0.35, 0.5, 0.65], hold_s=3.0)
PEDALS = np.array([*VEHICLE.throttle, *VEHICLE.brake, VEHICLE.rolling_mps2, VEHICLE.drag_per_s])


@cache
def _steps_truth() -> DriveTruth:
    return drive_manoeuvre(VEHICLE, STEPS)


def pedal_log(seed: int = 0, sensors: VehicleSensors | None = None) -> DriveSignals:
    return read_vehicle(VEHICLE, STEPS, _steps_truth(), sensors or VehicleSensors(record_hz=20.0), seed)


def pedal_shares(draws: int, outliers: float) -> Float[np.ndarray, " parameter"]:
    """Share of draws in which each interval holds; odometer noise of 2 mm."""
    clean = pedal_log(0, VehicleSensors(record_hz=20.0, odometer_scale_error=0.0, odometer_sigma_m=1e-9))
    runs = cut_runs(clean, "test")
    rng = np.random.default_rng([draws, int(100 * outliers)])
    hits = np.zeros(PEDALS.size)
    lanes = min(draws, 400)
    for _ in range(draws // lanes):
        travel = clean.travel_m[runs.record] + 0.002 * rng.normal(size=(lanes, runs.record.size))
        travel += (rng.random(travel.shape) < outliers) * rng.normal(size=travel.shape) * 0.1
        fit = fit_way(runs, travel)
        half = np.array([student_95(degrees) for degrees in fit.degrees])[:, None] * fit.sigma
        hits += np.sum(np.abs(fit.value - PEDALS) <= half, axis=0)
    return hits / draws


# The map of the steering, k and V_CHAR by palm trees and turns.

AT_RAD = np.linspace(-0.98, 0.98, 9) * LARGEST_RAD


def rms_deg(fit: WheelAngleFit) -> float:
    wrong = front_angle(fit.map, STRAIGHT_V + PER_RAD_V * AT_RAD) - AT_RAD
    return float(np.degrees(np.sqrt(np.mean(wrong**2))))


def band_shares(draws: int) -> tuple[Float[np.ndarray, " angle"], float]:
    """Share of draws in which the band of the map holds at each angle, and the largest RMS in degrees."""
    clean, held, worst = drive(palm_legs()), np.zeros(len(AT_RAD)), 0.0
    for seed in range(draws):
        fit = fit_wheel_angle(arcs_of(measured(clean, Noise(), np.random.default_rng([seed, 1]))), chassis())
        low, high = front_band(fit.map, STRAIGHT_V + PER_RAD_V * AT_RAD)
        held += (low <= AT_RAD) & (high >= AT_RAD)
        worst = max(worst, rms_deg(fit))
    return held / draws, worst


WANDERING = Noise(wander_rad=np.radians(0.1))
ASKEW_RAD = 0.01


def ratio_shares(draws: int, noise: Noise) -> tuple[float, float]:
    """Share of draws in which the interval of k by heading holds, and the standard deviation of k."""
    clean, found = drive(palm_legs()), []
    for seed in range(draws):
        arcs = arcs_of(measured(clean, noise, np.random.default_rng([seed, 2]), ASKEW_RAD))
        found.append(rear_ratio_by_heading(arcs, chassis(0.0)).ratio)
    return float(np.mean([k.low <= RATIO <= k.high for k in found])), float(np.std([k.value for k in found]))


SPEEDS_MPS = (1.0, 2.0, 4.0, 6.0, 8.0)


def turns(speeds: tuple[float, ...] = SPEEDS_MPS, sides: tuple[int, ...] = (1, -1)) -> list[Leg]:
    angles = np.radians([8.0, 14.0])
    return [Leg(side * angle, 12.0 * speed, speed) for speed in speeds for angle in angles for side in sides]


def yaw_gain_of(signals: DriveSignals, ratio: float = RATIO) -> YawGainFit:
    """By the front wheels' angles."""
    assert signals.front_rad is not None
    arcs = fit_arcs(signals, find_stretches(signals, signals.front_rad))
    return fit_yaw_gain(arcs, chassis(ratio), arcs.stretches.steering, arcs.stretches.sigma_steering)


def yaw_gain_shares(draws: int, noise: Noise) -> tuple[float, float]:
    """Share of draws in which the interval of V_CHAR holds, and the largest relative error."""
    clean, found = drive(turns(), characteristic_mps=20.0), []
    for seed in range(draws):
        found.append(yaw_gain_of(measured(clean, noise, np.random.default_rng([seed, 3]))).characteristic_speed_mps)
    held = np.mean([v.low <= 20.0 <= v.high for v in found])
    return float(held), float(np.max(np.abs([v.value / 20.0 - 1.0 for v in found])))


# Robust lines.

LINE = np.array([2.0, 3.0])
LINE_CASES = {
    "few": (12, 0.0, ""),
    "pauses": (21, 0.0, ""),
    "outliers": (50, 0.1, ""),
    "groups": (100, 0.05, "group"),
    "memory": (300, 0.0, "serial"),
}


def line_shares(name: str, draws: int) -> Float[np.ndarray, "2"]:
    """Share of draws in which the intervals of level and slope hold."""
    count, outliers, kind = LINE_CASES[name]
    rng = np.random.default_rng(list(name.encode()))
    x, group = np.linspace(-1.0, 1.0, count), np.arange(count) * 20 // count
    hits = np.zeros(2)
    for _ in range(draws):
        noise = _with_memory(rng, count) if kind == "serial" else rng.normal(size=count)
        if kind == "group":
            noise += rng.normal(size=20)[group]
        noise += (rng.random(count) < outliers) * rng.normal(size=count) * 30.0
        fit = robust_line(
            x, LINE @ [np.ones(count), x] + noise, group=group if kind == "group" else None, serial=kind == "serial"
        )
        for index, row in enumerate(np.eye(2)):
            found = combine(fit, row)
            hits[index] += found.low <= LINE[index] <= found.high
    return hits / draws


def _with_memory(rng: np.random.Generator, count: int) -> Float[np.ndarray, " record"]:
    """First-order, 0.8 from record to record."""
    white = rng.normal(size=count)
    kept = np.linalg.solve(np.eye(count) - 0.8 * np.eye(count, k=-1), 0.6 * white)
    return np.asarray(kept + (white[0] - kept[0]) * 0.8 ** np.arange(count))


# Noises of the filter. One shape for all, as compiling it is most of the work: two minutes of driving, in which every
# noise leaves a trace.

LANES, SECONDS, STRETCH_S = 6, 20.0, 2.0
TRUE = usual_model(
    yaw_rate_noise=3e-3,
    acceleration_noise=0.3,
    side_noise=0.05,
    rate_bias_walk=2e-3,
    odometer_scale_walk=5e-3,
    gnss_error_sigma_m=0.1,
    gnss_error_s=10.0,
    lgpr_error_sigma_m=0.06,
    lgpr_error_m=8.0,
)
_WRONG = (1.6, 2.0, 1.6, 2.5, 2.5, 1.6, 2.0, 1.6, 0.5)
START = TRUE._replace(
    **{name: jnp.float32(wrong * getattr(TRUE, name)) for name, wrong in zip(NOISES, _WRONG, strict=True)}
)


def navigation_drives(motions: MotionInput, observations: Observations) -> NavigationDrives:
    zero = jnp.zeros(LANES, jnp.float32)
    return NavigationDrives(VehiclePose(zero, zero, zero), zero + SPEED_MPS, motions, observations)


def drawn_drives(model: FilterModel, first_seed: int) -> list[Drawn]:
    return [draw_drive(model, first_seed + lane, seconds=SECONDS) for lane in range(LANES)]


def noises_inside(fit: FusionFit) -> Bool[np.ndarray, " noise"]:
    return np.array([one.low < float(getattr(TRUE, name)) < one.high for name, one in fit.found.items()])


def noise_shares(fits: int) -> tuple[Float[np.ndarray, " noise"], float]:
    """Share of fits in which each noise is inside its interval, and of fits that told all of them."""
    inside = []
    for number in range(fits):
        many = navigation_drives(*stacked(drawn_drives(TRUE, 1000 + LANES * number)))
        found = fit_fusion(START, default_rules(), many, stretch_s=STRETCH_S)
        if len(found.found) == len(NOISES):
            inside.append(noises_inside(found))
    return np.mean(inside, axis=0), len(inside) / fits
