"""Turning drives by plain geometry: the rear axle on a circle about the turn's centre, in NumPy float64."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lgprjax.tuning.arcs import Arcs, find_stretches, fit_arcs
from lgprjax.vehicle.kinematics import Chassis, ProportionalRear
from lgprjax.vehicle.sensors import DriveSignals

WHEELBASE_M, RATIO = 3.8, 0.63
LARGEST_RAD = np.radians(30.0)
STRAIGHT_V, PER_RAD_V = 2.43, 2.0
RATE_HZ, PAUSE_S = 10.0, 2.0


class Leg(NamedTuple):
    """One way at one setting."""

    front_rad: float
    length_m: float
    speed_mps: float


class Noise(NamedTuple):
    """Of the sensors; white unless told. ``wander`` is a Gauss-Markov part of the heading."""

    position_m: float = 0.02
    outlier_share: float = 0.03
    outlier_m: float = 3.0
    heading_rad: float = np.radians(0.05)
    wander_rad: float = 0.0
    wander_s: float = 60.0
    volts: float = 0.002
    front_rad: float = np.radians(0.02)


def palm_legs(settings: int = 11, speed_mps: float = 1.5) -> list[Leg]:
    """Full left to full right, a quarter of a circle or 20 m forward and back at each setting."""
    legs = []
    for front in np.linspace(LARGEST_RAD, -LARGEST_RAD, settings):
        bend = abs(np.tan(front) + np.tan(RATIO * front)) / WHEELBASE_M
        length = min(0.5 * np.pi / max(bend, 1e-9), 20.0)
        legs += [Leg(front, length, speed_mps), Leg(front, length, -speed_mps)]
    return legs


def drive(legs: list[Leg], characteristic_mps: float = np.inf, ratio: float = RATIO) -> DriveSignals:
    """The drive without noise, standing still between legs; only what calibrations of turning look at."""
    tracks: list[list[Float[np.ndarray, " record"]]] = [[] for _ in range(6)]
    time = tracks[0]
    at_s, at_m, x, y, heading = 0.0, 0.0, 3.0, -5.0, 0.4
    for leg in legs:
        behind = np.tan(ratio * leg.front_rad)
        bend = (np.tan(leg.front_rad) + behind) / WHEELBASE_M
        gain = 1.0 / (1.0 + (leg.speed_mps / characteristic_mps) ** 2)
        count = max(int(leg.length_m / abs(leg.speed_mps) * RATE_HZ), 2)
        way = leg.speed_mps * np.arange(count) / RATE_HZ
        turned = gain * bend * way
        # The turn's centre: x_c ahead of the axle, 1/(G κ) to its left; the axle turns about it with the body.
        if abs(bend) > 1e-12:
            ahead, left = WHEELBASE_M * behind / (np.tan(leg.front_rad) + behind), 1.0 / (gain * bend)
            cx = x + ahead * np.cos(heading) - left * np.sin(heading)
            cy = y + ahead * np.sin(heading) + left * np.cos(heading)
            px = cx + np.cos(turned) * (x - cx) - np.sin(turned) * (y - cy)
            py = cy + np.sin(turned) * (x - cx) + np.cos(turned) * (y - cy)
        else:
            px, py = x + way * np.cos(heading), y + way * np.sin(heading)
        still = int(PAUSE_S * RATE_HZ)
        for track, part in zip(
            tracks,
            (at_s + np.arange(count) / RATE_HZ, px, py, heading + turned, at_m + way, np.full(count, leg.front_rad)),
            strict=True,
        ):
            track.append(part)
            last = part[-1] + np.arange(1, still + 1) / RATE_HZ if track is time else np.full(still, part[-1])
            track.append(last)
        at_s, at_m = time[-1][-1] + 1.0 / RATE_HZ, at_m + way[-1]
        x, y, heading = px[-1], py[-1], heading + turned[-1]
    columns = [np.concatenate(track) for track in tracks]
    size = len(columns[0])
    return DriveSignals(
        time_s=columns[0],
        east_m=columns[1],
        north_m=columns[2],
        sigma_position_m=np.full(size, 0.02),
        yaw_rad=columns[3],
        sigma_yaw_rad=np.full(size, np.radians(0.1)),
        travel_m=columns[4],
        front_rad=columns[5],
        rear_rad=-ratio * columns[5],
        potentiometer_v=STRAIGHT_V + PER_RAD_V * columns[5],
    )


def measured(clean: DriveSignals, noise: Noise, rng: np.random.Generator, askew_rad: float = 0.0) -> DriveSignals:
    """The drive as sensors see it."""
    assert clean.front_rad is not None
    assert clean.rear_rad is not None
    assert clean.potentiometer_v is not None
    size = len(clean.time_s)
    place = rng.normal(size=(2, size)) * noise.position_m
    place += (rng.random(size) < noise.outlier_share) * rng.normal(size=(2, size)) * noise.outlier_m
    heading = rng.normal(size=size) * noise.heading_rad + askew_rad
    if noise.wander_rad:
        heading += noise.wander_rad * gauss_markov(rng, size, float(np.exp(-1.0 / RATE_HZ / noise.wander_s)))
    return clean._replace(
        east_m=clean.east_m + place[0],
        north_m=clean.north_m + place[1],
        yaw_rad=clean.yaw_rad + heading,
        potentiometer_v=clean.potentiometer_v + rng.normal(size=size) * noise.volts,
        front_rad=clean.front_rad + rng.normal(size=size) * noise.front_rad,
        rear_rad=clean.rear_rad + rng.normal(size=size) * noise.front_rad,
    )


def chassis(ratio: float = RATIO, characteristic_mps: float = np.inf) -> Chassis:
    """The vehicle as a calibration believes it to be."""
    base, anchor, rear, largest, slip = (
        jnp.float32(v) for v in (WHEELBASE_M, 0.0, ratio, LARGEST_RAD, characteristic_mps)
    )
    return Chassis(base, anchor, ProportionalRear(rear), largest, slip)


def arcs_of(signals: DriveSignals) -> Arcs:
    """Arcs of the stretches that the potentiometer holds."""
    assert signals.potentiometer_v is not None
    return fit_arcs(signals, find_stretches(signals, signals.potentiometer_v))


def gauss_markov(rng: np.random.Generator, size: int, keep: float) -> Float[np.ndarray, " record"]:
    """First-order process of unit variance."""
    from scipy.signal import lfilter

    kicks = rng.normal(size=size) * np.sqrt(1.0 - keep**2)
    kicks[0] = rng.normal()
    return np.asarray(lfilter([1.0], [1.0, -keep], kicks))


def covered_band(draws: int) -> tuple[float, float]:
    """93 to 97 %, and for fewer than 2,000 draws wider by twice what chance adds."""
    more = 0.0 if draws >= 2000 else 2.0 * (0.95 * 0.05 / draws) ** 0.5
    return 0.93 - more, 0.97 + more
