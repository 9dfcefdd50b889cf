"""Sensors of the steering: a potentiometer for the absolute angle and the servo's encoder, whose zero is unknown.

Both measure the steering angle, which is that of the linkage's shaft, scaled so that near straight it is the front
wheels' angle; with a proportional linkage it is the wheels' angle throughout. The encoder sits at the motor, the
potentiometer at the wheels: the play of the linkage is between them.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Potentiometer(NamedTuple):
    """Voltage over steering angle: a polynomial, usually a straight line.

    Attributes:
        straight_v: voltage with straight wheels.
        per_rad_v: V/rad, V/rad², … of the steering angle: at least the first.
        largest_rad: steering angle up to which the polynomial holds, to either side.
    """

    straight_v: float
    per_rad_v: tuple[float, ...]
    largest_rad: float


class Encoder(NamedTuple):
    """Counts of the servo's encoder.

    Attributes:
        counts_per_rad: counts per radian of steering angle.
        zero_counts: reading with straight wheels; different after every start.
    """

    counts_per_rad: float
    zero_counts: float


def read_potentiometer(sensor: Potentiometer, steering_rad: Float[np.ndarray, " *n"]) -> Float[np.ndarray, " *n"]:
    """Voltage at steering angles."""
    return np.asarray(np.polynomial.polynomial.polyval(steering_rad, (sensor.straight_v, *sensor.per_rad_v)))


def read_encoder(sensor: Encoder, steering_rad: Float[np.ndarray, " *n"]) -> Float[np.ndarray, " *n"]:
    """Whole counts at steering angles."""
    return np.asarray(np.round(sensor.zero_counts + sensor.counts_per_rad * steering_rad))


# Signals of a vehicle's log on one clock.


class DriveSignals(NamedTuple):
    """Signals of a drive at common times. Signals that a log does not hold are ``None``.

    Position and heading are NaN at a record without a measurement of their own: GNSS is slower than the servo, and
    values interpolated between fixes would share their noise.

    Attributes:
        time_s: record times, increasing; steps may be uneven.
        east_m, north_m: position of the rear axle, level local metres.
        sigma_position_m: standard deviation of each of the two, as stated by navigation.
        yaw_rad: heading of the body by INS, counter-clockwise from east, without jumps of a turn.
        sigma_yaw_rad: standard deviation of the heading.
        travel_m: signed cumulative travel by odometry; falls in reverse.
        command_rad: front angle commanded to the servo.
        front_rad, rear_rad: measured wheel angles, counter-clockwise positive: the rear wheels' is negative in a left
            turn.
        potentiometer_v: voltage of the absolute wheel angle's potentiometer.
        encoder_counts: counts of the servo's encoder since it was switched on.
        supply_v: voltage at the servo.
        throttle, brake: commands, 0 to 1.
    """

    time_s: Float[np.ndarray, " record"]
    east_m: Float[np.ndarray, " record"]
    north_m: Float[np.ndarray, " record"]
    sigma_position_m: Float[np.ndarray, " record"]
    yaw_rad: Float[np.ndarray, " record"]
    sigma_yaw_rad: Float[np.ndarray, " record"]
    travel_m: Float[np.ndarray, " record"]
    command_rad: Float[np.ndarray, " record"] | None = None
    front_rad: Float[np.ndarray, " record"] | None = None
    rear_rad: Float[np.ndarray, " record"] | None = None
    potentiometer_v: Float[np.ndarray, " record"] | None = None
    encoder_counts: Float[np.ndarray, " record"] | None = None
    supply_v: Float[np.ndarray, " record"] | None = None
    throttle: Float[np.ndarray, " record"] | None = None
    brake: Float[np.ndarray, " record"] | None = None
