"""Drives drawn from the filter's own model, in float64 and step by step: what an honest filter must cover."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lgprjax.navigation.counter_steer_model import FilterModel, default_model
from lgprjax.navigation.observations import (
    GnssObservation,
    HeadingObservation,
    LgprObservation,
    MotionInput,
    Observations,
    OdometerObservation,
)

TICK_S = 0.05
SPEED_MPS = 4.47


class Sensors(NamedTuple):
    """Ticks between the observations of a source, and their white sigmas."""

    gnss_every: int = 2
    heading_every: int = 1
    odometer_every: int = 1
    lgpr_every: int = 4
    gnss_m: float = 0.02
    heading_rad: float = 0.002
    odometer_mps: float = 0.03
    lgpr_m: float = 0.04
    lgpr_rad: float = 0.01


class Drawn(NamedTuple):
    """A drive: what it gave, and its true states at each tick's end."""

    motions: MotionInput
    observations: Observations
    states: Float[np.ndarray, "tick 13"]


def usual_model(**changed: float) -> FilterModel:
    """The default noises with the geometry of a made-up vehicle."""
    model = default_model(zero_slip_m=1.47, gnss_x_m=1.2, gnss_y_m=0.3, array_x_m=6.5, array_y_m=0.0)
    return model._replace(**{name: jnp.float32(value) for name, value in changed.items()})


_USUAL = Sensors()


def draw_drive(
    model: FilterModel, seed: int, *, seconds: float = 60.0, sensors: Sensors = _USUAL, winding_radps: float = 0.15
) -> Drawn:
    """A winding drive whose every error is drawn as the model says; the speed is held by a slow driver beside."""
    m = FilterModel(*(float(value) for value in model))  # type: ignore[arg-type]
    rng = np.random.default_rng(seed)
    ticks, dt = round(seconds / TICK_S), TICK_S
    x = np.zeros(13)
    x[:2] = rng.normal(0.0, float(m.initial_position_m), 2)
    x[2] = rng.normal(0.0, float(m.initial_yaw_rad))
    x[3] = SPEED_MPS + rng.normal(0.0, float(m.initial_speed_mps))
    x[4] = rng.normal(0.0, float(m.initial_rate_bias_radps))
    x[5] = rng.normal(0.0, float(m.initial_odometer_scale))
    x[6] = rng.normal(0.0, float(m.initial_clock_s))
    x[7:9] = rng.normal(0.0, float(m.initial_lever_m), 2)
    x[9:11] = rng.normal(0.0, float(m.gnss_error_sigma_m), 2)
    x[11:13] = rng.normal(0.0, float(m.lgpr_error_sigma_m), 2)
    rows, gyro = [], np.zeros(ticks)
    for tick in range(ticks):
        rate = winding_radps * np.sin(2.0 * np.pi * tick * dt / 17.0)
        x[3] += float(m.acceleration_noise) * np.sqrt(dt) * rng.normal() + 0.05 * (SPEED_MPS - x[3]) * dt
        x[4] += float(m.rate_bias_walk) * np.sqrt(dt) * rng.normal()
        x[5] += float(m.odometer_scale_walk) * np.sqrt(dt) * rng.normal()
        x[6] += float(m.clock_walk) * np.sqrt(dt) * rng.normal()
        x[7:9] += float(m.lever_walk) * np.sqrt(dt) * rng.normal(size=2)
        gyro[tick] = rate + x[4] + float(m.yaw_rate_noise) / np.sqrt(dt) * rng.normal()
        along, turned = x[3] * dt, rate * dt
        aside = -float(m.zero_slip_m) * turned + float(m.side_noise) * np.sqrt(dt) * rng.normal()
        # The chord of an arc points half of the turn ahead.
        half = 0.5 * turned
        shrunk = 1.0 if turned == 0.0 else np.sin(half) / half
        c, s = np.cos(x[2] + half), np.sin(x[2] + half)
        x[0] += shrunk * (c * along - s * aside)
        x[1] += shrunk * (s * along + c * aside)
        x[2] += turned
        for place, sigma, share in (
            (slice(9, 11), float(m.gnss_error_sigma_m), dt / float(m.gnss_error_s)),
            (slice(11, 13), float(m.lgpr_error_sigma_m), abs(along) / float(m.lgpr_error_m)),
        ):
            keep = np.exp(-share)
            x[place] = keep * x[place] + sigma * np.sqrt(1.0 - keep**2) * rng.normal(size=2)
        rows.append(x.copy())
    states = np.array(rows)
    motions = MotionInput(_single(gyro), _single(np.full(ticks, dt)))
    return Drawn(motions, _observe(m, states, gyro, sensors, rng), states)


def _observe(
    m: FilterModel, end: np.ndarray, gyro: np.ndarray, sensors: Sensors, rng: np.random.Generator
) -> Observations:
    ticks = len(end)
    number = np.arange(1, ticks + 1)
    c, s = np.cos(end[:, 2]), np.sin(end[:, 2])
    rate = gyro - end[:, 4]

    def body_point(x_m: np.ndarray | float, y_m: np.ndarray | float) -> np.ndarray:
        return np.stack([end[:, 0] + c * x_m - s * y_m, end[:, 1] + s * x_m + c * y_m], axis=1)

    antenna = body_point(float(m.gnss_x_m), float(m.gnss_y_m))
    gnss = antenna + end[:, 9:11] + sensors.gnss_m * rng.normal(size=(ticks, 2))
    yaw = end[:, 2] + sensors.heading_rad * rng.normal(size=ticks)
    wheels = end[:, 3] * (1.0 + end[:, 5]) + sensors.odometer_mps * rng.normal(size=ticks)
    # A fix is older than its stamp says: where the array was then, from where it is and how it moves.
    late = end[:, 6]
    lever_x, lever_y = float(m.array_x_m) + end[:, 7], float(m.array_y_m) + end[:, 8]
    back_x, back_y = -late * (end[:, 3] - rate * lever_y), -late * rate * (lever_x - float(m.zero_slip_m))
    array = body_point(lever_x + back_x, lever_y + back_y)
    fix = array + end[:, 11:13] + sensors.lgpr_m * rng.normal(size=(ticks, 2))
    fix_yaw = end[:, 2] - late * rate + sensors.lgpr_rad * rng.normal(size=ticks)
    zero = np.zeros(ticks)
    return Observations(
        GnssObservation(
            _single(gnss[:, 0]),
            _single(gnss[:, 1]),
            _single(np.tile(sensors.gnss_m**2 * np.eye(2), (ticks, 1, 1))),
            _single(zero),
            jnp.asarray(number % sensors.gnss_every == 0),
        ),
        HeadingObservation(
            _single(yaw),
            _single(zero + sensors.heading_rad**2),
            _single(zero),
            jnp.asarray(number % sensors.heading_every == 0),
        ),
        OdometerObservation(
            _single(wheels), _single(zero + sensors.odometer_mps**2), jnp.asarray(number % sensors.odometer_every == 0)
        ),
        LgprObservation(
            _single(fix[:, 0]),
            _single(fix[:, 1]),
            _single(fix_yaw),
            _single(np.tile(np.diag([sensors.lgpr_m**2, sensors.lgpr_m**2, sensors.lgpr_rad**2]), (ticks, 1, 1))),
            _single(zero),
            jnp.asarray(number % sensors.lgpr_every == 0),
        ),
    )


def silenced(drawn: Drawn, source: str, from_s: float, to_s: float) -> Drawn:
    """The drive without a source's observations in [from, to) seconds."""
    slot = getattr(drawn.observations, source)
    time_s = TICK_S * np.arange(1, slot.valid.size + 1)
    kept = slot._replace(valid=slot.valid & jnp.asarray((time_s < from_s) | (time_s >= to_s)))
    return drawn._replace(observations=drawn.observations._replace(**{source: kept}))


def stacked(drives: list[Drawn]) -> tuple[MotionInput, Observations]:
    """Motions and observations of drives of equal length, with a leading axis drive."""
    many: tuple[MotionInput, Observations] = jax.tree.map(
        lambda *leaves: jnp.stack(leaves), *[(drive.motions, drive.observations) for drive in drives]
    )
    return many


def _single(values: np.ndarray) -> jax.Array:
    return jnp.asarray(values, jnp.float32)
