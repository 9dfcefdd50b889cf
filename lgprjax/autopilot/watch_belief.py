"""The vehicle as the watches believe it to be: plain numbers of its calibration."""

import math
from typing import NamedTuple

RANGE_MARGIN_RAD = 0.06
"""How far a potentiometer may read beyond the ends of its map: wheels at their stop, noise, and no more."""


class Knots(NamedTuple):
    """A function by its values at even places, linear between and on with the end's slope beyond."""

    first: float
    step: float
    values: tuple[float, ...]


class WheelBelief(NamedTuple):
    """Steering as calibrated; angles are those of the front wheels.

    Attributes:
        angle_of_volts: front angle, rad, over potentiometer volts.
        encoder_counts_per_rad: of the servo's encoder.
        largest_rad: to either side.
        lag_s, rate_radps, delay_s, dead_band_rad, backlash_rad, nominal_v, stall_v: as in ``vehicle.Servo``.
    """

    angle_of_volts: Knots
    encoder_counts_per_rad: float
    largest_rad: float
    lag_s: float
    rate_radps: float
    delay_s: float
    dead_band_rad: float
    backlash_rad: float
    nominal_v: float
    stall_v: float


class ChassisBelief(NamedTuple):
    """Steering geometry: the magnitude of counter-steer over the front angle, both rad, and what slip costs."""

    wheelbase_m: float
    rear_of_front: Knots
    characteristic_speed_mps: float


class PedalBelief(NamedTuple):
    """A pedal, as in ``vehicle.Pedal``."""

    pre_tension: float
    dead_zone: float
    gain_mps2: float
    lag_s: float


class PedalsBelief(NamedTuple):
    """Both pedals, and what slows the vehicle without them."""

    throttle: PedalBelief
    brake: PedalBelief
    rolling_mps2: float
    drag_per_s: float


def linear_wheel_map(straight_v: float, v_per_rad: float, largest_rad: float) -> Knots:
    """Front angle over volts of a potentiometer without a measured map."""
    ends_v = sorted(straight_v + side * v_per_rad * largest_rad for side in (-1.0, 1.0))
    step_v = ends_v[1] - ends_v[0]
    return Knots(ends_v[0], step_v, tuple((end_v - straight_v) / v_per_rad for end_v in ends_v))


def proportional_rear(ratio: float) -> Knots:
    """Counter-steer at a constant share of the front angle."""
    return Knots(0.0, 1.0, (0.0, ratio))


def knot_value(knots: Knots, place: float) -> float:
    """The function at a place; not a number where the place is none."""
    at = (place - knots.first) / knots.step
    if not math.isfinite(at):
        return math.nan
    knot = min(max(math.floor(at), 0), len(knots.values) - 2)
    low, high = knots.values[knot], knots.values[knot + 1]
    return low + (at - knot) * (high - low)


def front_angle(belief: WheelBelief, volts: float) -> float:
    """Angle of the front wheels by the potentiometer, rad; not a number beyond its map by more than the margin."""
    angle = knot_value(belief.angle_of_volts, volts)
    ends = belief.angle_of_volts.values[0], belief.angle_of_volts.values[-1]
    inside = min(ends) - RANGE_MARGIN_RAD <= angle <= max(ends) + RANGE_MARGIN_RAD
    return angle if inside else math.nan


def curvature(belief: ChassisBelief, front_rad: float) -> float:
    """Turn of the vehicle over its way, 1/m, without slip: κ = (tan φ + tan ψ) / L."""
    return (math.tan(front_rad) + math.tan(knot_value(belief.rear_of_front, front_rad))) / belief.wheelbase_m


def yaw_gain(belief: ChassisBelief, speed_mps: float) -> float:
    """Share of the geometric yaw rate that is left at a speed."""
    return 1.0 / (1.0 + (speed_mps / belief.characteristic_speed_mps) ** 2)
