"""What a vehicle's log says of a drive: navigation, steering sensors and odometer, with their noise and faults."""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.scene.manoeuvres import STEP_S, Manoeuvre
from lgprjax.scene.sensors import Intervals, gauss_markov
from lgprjax.vehicle.signals import DriveSignals
from lgprjax.vehicle.steering_sensors import Encoder, Potentiometer, read_encoder, read_potentiometer

DEGREE = np.pi / 180.0


class DriveTruth(NamedTuple):
    """How a drive was, at the simulation's steps.

    Attributes:
        time_s: from 0.
        east_m, north_m, yaw_rad: of the rear axle; from the origin, along the x axis.
        travel_m, speed_mps: along the body axis; negative speed in reverse.
        front_rad, rear_rad: of the wheels, counter-clockwise positive.
        motor_rad: steering angle at the encoder, before the play.
        steering_rad: steering angle at the potentiometer, behind it.
    """

    time_s: Float[np.ndarray, " step"]
    east_m: Float[np.ndarray, " step"]
    north_m: Float[np.ndarray, " step"]
    yaw_rad: Float[np.ndarray, " step"]
    travel_m: Float[np.ndarray, " step"]
    speed_mps: Float[np.ndarray, " step"]
    front_rad: Float[np.ndarray, " step"]
    rear_rad: Float[np.ndarray, " step"]
    motor_rad: Float[np.ndarray, " step"]
    steering_rad: Float[np.ndarray, " step"]


@dataclass(frozen=True)
class VehicleSensors:
    """Rates, noise and faults of the sensors. Sigmas are of white noise unless told.

    Attributes:
        record_hz: of the log; the simulation's 100 Hz or a whole part of it.
        gnss_hz: of the fixes; records between have no position.
        position_sigma_m: of east and of north.
        position_wander_m, position_wander_s: sigma and time constant of a slow error of each (Gauss-Markov) against
            the true frame; navigation knows nothing of it, its sigma is that of the white part.
        heading_sigma_rad, heading_wander_rad, heading_wander_s: the same of the INS heading, at every record.
        heading_bias_rad: by which the INS is mounted askew.
        front_sigma_rad, rear_sigma_rad, potentiometer_sigma_v: of the steering sensors.
        odometer_scale_error, odometer_sigma_m: distance reads (1 + scale) times the truth plus noise.
        yaw_rate_noise: white noise of the gyro, rad/s/√Hz.
        yaw_rate_bias_radps, yaw_rate_bias_walk: its bias at the start, and the bias's random walk in rad/s/√s.
        fix_hz: of the radar's fixes, for drives that have any.
        outlier_share, outlier_m: share of fixes that are displaced, by a normal deviate of this sigma.
        spike_share, spike_v: share of potentiometer readings that are displaced, by a normal deviate of this sigma.
        gnss_gaps_s: (start, stop) intervals without fixes.
        record_gaps_s: (start, stop) intervals that the log has lost altogether.
    """

    record_hz: float = 50.0
    gnss_hz: float = 10.0
    position_sigma_m: float = 0.02
    position_wander_m: float = 0.0
    position_wander_s: float = 60.0
    heading_sigma_rad: float = 0.05 * DEGREE
    heading_wander_rad: float = 0.0
    heading_wander_s: float = 60.0
    heading_bias_rad: float = 0.0
    front_sigma_rad: float = 0.1 * DEGREE
    rear_sigma_rad: float = 0.1 * DEGREE
    potentiometer_sigma_v: float = 0.004
    odometer_scale_error: float = 0.005
    odometer_sigma_m: float = 0.002
    yaw_rate_noise: float = 5e-4
    yaw_rate_bias_radps: float = 0.0
    yaw_rate_bias_walk: float = 0.0
    fix_hz: float = 10.0
    outlier_share: float = 0.0
    outlier_m: float = 2.0
    spike_share: float = 0.0
    spike_v: float = 0.5
    gnss_gaps_s: Intervals = ()
    record_gaps_s: Intervals = ()


def read_sensors(
    truth: DriveTruth,
    manoeuvre: Manoeuvre,
    sensors: VehicleSensors,
    potentiometer: Potentiometer,
    encoder: Encoder,
    seed: int,
) -> DriveSignals:
    """The log of a drive. The encoder's zero is drawn: it is unknown at every start.

    Every effect draws from a stream of its own: switching one on leaves the others as they were.

    Raises:
        ValueError: the record rate is no whole part of the simulation's, or fixes come faster than records.
    """
    record = _record_steps(truth, sensors)
    count = record.size
    time_s = truth.time_s[record]
    place = np.stack([truth.east_m[record], truth.north_m[record]], axis=1)
    place += _noise(seed, 1, (count, 2), sensors.position_sigma_m)
    place += _wander(seed, 2, (count, 2), sensors.position_wander_m, sensors.position_wander_s, sensors.record_hz)
    displaced = _stream(seed, 3).random(count) < sensors.outlier_share
    place += displaced[:, None] * _noise(seed, 4, (count, 2), sensors.outlier_m)
    place[~_fixed(time_s, sensors)] = np.nan
    yaw = truth.yaw_rad[record] + sensors.heading_bias_rad + _noise(seed, 5, (count,), sensors.heading_sigma_rad)
    yaw += _wander(seed, 6, (count, 1), sensors.heading_wander_rad, sensors.heading_wander_s, sensors.record_hz)[:, 0]
    volts = read_potentiometer(potentiometer, truth.steering_rad[record])
    volts = volts + _noise(seed, 7, (count,), sensors.potentiometer_sigma_v)
    volts += (_stream(seed, 8).random(count) < sensors.spike_share) * _noise(seed, 9, (count,), sensors.spike_v)
    zero_counts = float(_stream(seed, 10).integers(-100_000, 100_000)) + float(_stream(seed, 11).random())
    travel = (1.0 + sensors.odometer_scale_error) * truth.travel_m[record]
    heading_sigma = np.hypot(sensors.heading_sigma_rad, sensors.heading_wander_rad)
    log = DriveSignals(
        time_s=time_s,
        east_m=place[:, 0],
        north_m=place[:, 1],
        sigma_position_m=np.full(count, sensors.position_sigma_m),
        yaw_rad=yaw,
        sigma_yaw_rad=np.full(count, heading_sigma),
        travel_m=travel + _noise(seed, 12, (count,), sensors.odometer_sigma_m),
        command_rad=None if manoeuvre.by_hand else manoeuvre.wanted_rad[record],
        front_rad=truth.front_rad[record] + _noise(seed, 13, (count,), sensors.front_sigma_rad),
        rear_rad=truth.rear_rad[record] + _noise(seed, 14, (count,), sensors.rear_sigma_rad),
        potentiometer_v=volts,
        encoder_counts=read_encoder(encoder._replace(zero_counts=zero_counts), truth.motor_rad[record]),
        supply_v=manoeuvre.supply_v[record],
        throttle=None if manoeuvre.throttle is None else manoeuvre.throttle[record],
        brake=None if manoeuvre.brake is None else manoeuvre.brake[record],
    )
    kept = ~_within(time_s, sensors.record_gaps_s)
    lasting: DriveSignals = jax.tree.map(lambda signal: signal[kept], log)
    return lasting


def read_yaw_rate(truth: DriveTruth, sensors: VehicleSensors, seed: int) -> Float[np.ndarray, " record"]:
    """Yaw rate by gyro, rad/s counter-clockwise, at the records of ``read_sensors``.

    A record's noise is such that the sum over the records has the sensor's density.

    Raises:
        ValueError: as ``read_sensors``.
    """
    record = _record_steps(truth, sensors)
    walk = np.cumsum(_noise(seed, 15, (record.size,), sensors.yaw_rate_bias_walk / np.sqrt(sensors.record_hz)))
    rate = np.gradient(truth.yaw_rad, STEP_S)[record] + sensors.yaw_rate_bias_radps + walk
    rate += _noise(seed, 16, (record.size,), sensors.yaw_rate_noise * np.sqrt(sensors.record_hz))
    return np.asarray(rate[~_within(truth.time_s[record], sensors.record_gaps_s)])


def _record_steps(truth: DriveTruth, sensors: VehicleSensors) -> Int[np.ndarray, " record"]:
    every = round(1.0 / (STEP_S * sensors.record_hz))
    if every < 1 or abs(every * STEP_S * sensors.record_hz - 1.0) > 1e-9:
        raise ValueError(f"record_hz is {1.0 / STEP_S:g} or a whole part of it, not {sensors.record_hz:g}")
    if not 0.0 < sensors.gnss_hz <= sensors.record_hz:
        raise ValueError(f"gnss_hz is positive and at most record_hz, not {sensors.gnss_hz:g}")
    return np.arange(0, truth.time_s.size, every)


def _fixed(time_s: Float[np.ndarray, " record"], sensors: VehicleSensors) -> Bool[np.ndarray, " record"]:
    """Records with a fix: the first in each of its periods, but for the gaps."""
    period = np.floor(time_s * sensors.gnss_hz + 1e-6)
    return np.asarray((np.diff(period, prepend=-1.0) > 0) & ~_within(time_s, sensors.gnss_gaps_s))


def _within(time_s: Float[np.ndarray, " record"], intervals_s: Intervals) -> Bool[np.ndarray, " record"]:
    inside = np.zeros(time_s.size, bool)
    for start_s, stop_s in intervals_s:
        inside |= (time_s >= start_s) & (time_s < stop_s)
    return inside


def _stream(seed: int, effect: int) -> np.random.Generator:
    return np.random.default_rng([seed, 7, effect])


def _noise(seed: int, effect: int, shape: tuple[int, ...], sigma: float) -> Float[np.ndarray, "..."]:
    return sigma * _stream(seed, effect).normal(size=shape)


def _wander(
    seed: int, effect: int, shape: tuple[int, int], sigma: float, time_constant_s: float, rate_hz: float
) -> Float[np.ndarray, "record state"]:
    if sigma == 0.0:
        return np.zeros(shape)
    keep = float(np.exp(-1.0 / (rate_hz * time_constant_s)))
    return gauss_markov(_stream(seed, effect), np.full(shape[1], sigma), keep, shape[0])
