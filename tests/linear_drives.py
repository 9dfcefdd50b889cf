"""Straight drives in which all but position, speed and GNSS error is known: linear, so one Gaussian over the whole."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lgprjax.navigation.observations import MotionInput, Observations
from model_drives import SPEED_MPS, TICK_S, Drawn, Sensors, draw_drive, silenced, stacked, usual_model

LINEAR = usual_model(
    gnss_error_sigma_m=0.03,
    gnss_error_s=60.0,
    initial_yaw_rad=1e-7,
    initial_rate_bias_radps=1e-7,
    initial_odometer_scale=1e-7,
    yaw_rate_noise=1e-9,
    rate_bias_walk=1e-9,
    odometer_scale_walk=1e-9,
    side_noise=0.05,
)
STATES = np.array([0, 1, 3, 9, 10])
"""Those of the filter that are not known: x, y, speed, and the GNSS error."""


class Gaussian(NamedTuple):
    """Of all states at all ticks beforehand, and what was observed of them: ``values = rows @ states + noise``."""

    mean: Float[np.ndarray, " state"]
    covariance: Float[np.ndarray, "state state"]
    rows: Float[np.ndarray, "value state"]
    values: Float[np.ndarray, " value"]
    noise: Float[np.ndarray, " value"]


def draw_straight(seed: int, ticks: int) -> Drawn:
    """GNSS and odometer only, and a gap in GNSS."""
    sensors = Sensors(gnss_every=3, odometer_every=2)
    drawn = draw_drive(LINEAR, seed, seconds=ticks * TICK_S, sensors=sensors, winding_radps=0.0)
    drawn = silenced(silenced(drawn, "lgpr", 0.0, np.inf), "heading", 0.0, np.inf)
    return silenced(drawn, "gnss", 1.0, 2.0)


def padded(drives: list[Drawn], ticks: int) -> tuple[MotionInput, Observations]:
    """Drives made longer by ticks of no length without observations, which change nothing."""
    motions, observations = stacked(drives)
    short = motions.step_s.shape[1]

    def pad(leaf: jax.Array) -> jax.Array:
        return jnp.pad(leaf, ((0, 0), (0, ticks - short)) + ((0, 0),) * (leaf.ndim - 2))

    longer: tuple[MotionInput, Observations] = jax.tree.map(pad, (motions, observations))
    return longer


def gaussian_of(drive: Drawn, ticks: int) -> Gaussian:
    """The drive as one Gaussian, in float64."""
    m = {name: float(value) for name, value in LINEAR._asdict().items()}
    dt, size = TICK_S, 5
    keep = np.exp(-dt / m["gnss_error_s"])
    F = np.diag([1.0, 1.0, 1.0, keep, keep])
    F[0, 2] = dt
    speed, side = m["acceleration_noise"] ** 2 * dt, m["side_noise"] ** 2 * dt
    Q = np.diag([0.0, side, 0.0, *[m["gnss_error_sigma_m"] ** 2 * (1.0 - keep**2)] * 2])
    Q += speed * np.outer(F[:, 2], F[:, 2])
    mean, P = (
        np.array([0.0, 0.0, SPEED_MPS, 0.0, 0.0]),
        np.diag(
            [m["initial_position_m"] ** 2] * 2 + [m["initial_speed_mps"] ** 2] + [m["gnss_error_sigma_m"] ** 2] * 2
        ),
    )
    means, prior = np.zeros((ticks, size)), np.zeros((ticks, size, ticks, size))
    for tick in range(ticks):
        mean, P = F @ mean, F @ P @ F.T + Q
        means[tick], block = mean, P
        for later in range(tick, ticks):
            prior[later, :, tick], prior[tick, :, later] = block, block.T
            block = F @ block
    seen = drive.observations
    rows, values, noise = [], [], []
    for tick in range(ticks):
        for column, error, observed in ((0, 3, seen.gnss.x_m), (1, 4, seen.gnss.y_m)):
            if bool(seen.gnss.valid[tick]):
                row = np.zeros((ticks, size))
                row[tick, [column, error]] = 1.0
                lever = m["gnss_x_m"] if column == 0 else m["gnss_y_m"]
                rows.append(row.ravel())
                values.append(float(observed[tick]) - lever)
                noise.append(float(seen.gnss.covariance[tick, 0, 0]))
        if bool(seen.odometer.valid[tick]):
            row = np.zeros((ticks, size))
            row[tick, 2] = 1.0
            rows.append(row.ravel())
            values.append(float(seen.odometer.speed_mps[tick]))
            noise.append(float(seen.odometer.variance[tick]))
    flat = prior.reshape(ticks * size, ticks * size)
    return Gaussian(means.ravel(), flat, np.array(rows), np.array(values), np.array(noise))
