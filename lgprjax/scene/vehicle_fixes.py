"""Fixes of a simulated vehicle's drive, drawn from an error model: neither ground nor radar is behind them."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from lgprjax.scene.fix_errors import FixErrors, FixErrorState, init_fix_errors, step_fix_errors
from lgprjax.scene.manoeuvres import STEP_S
from lgprjax.scene.vehicle_sensors import DriveTruth

# What a fix knows of height and roll; level ground and a level vehicle.
_SIGMA_HEIGHT_M, _SIGMA_ROLL_RAD = 0.05, 0.002

# Drawn for a multiple of so many scans: few lengths are compiled. What is drawn for a scan does not depend on it.
_BLOCK_SCANS = 1024


class VehicleFixes(NamedTuple):
    """Fixes of the array's centre in the drive's frame, one a scan.

    Attributes:
        time_s: of the scans.
        found: where there is a fix; the others' poses are not a number.
        pose: east_m, north_m, height_m, yaw_rad, roll_rad.
        covariance: of them, as the fixes report it.
        sigma_m: along and across the fix's heading, as reported.
        strength: correlation of the fixes that there are.
    """

    time_s: Float[np.ndarray, " scan"]
    found: Bool[np.ndarray, " scan"]
    pose: Float[np.ndarray, "scan 5"]
    covariance: Float[np.ndarray, "scan 5 5"]
    sigma_m: tuple[float, float]
    strength: float


def draw_vehicle_fixes(
    truth: DriveTruth, errors: FixErrors, *, array_x_m: float, rate_hz: float, seed: int
) -> VehicleFixes:
    """The fixes that a drive's scans would give.

    Args:
        truth: of the drive.
        errors: what fixes are wrong by.
        array_x_m: the array's centre ahead of the rear axle, on the centre line.
        rate_hz: of the scans, no more than the simulation's 100 Hz.
        seed: of all that is drawn.
    """
    every = max(round(1.0 / (STEP_S * rate_hz)), 1)
    scan = np.arange(0, truth.time_s.size, every)
    way_m = np.append(0.0, np.abs(np.diff(truth.travel_m[scan])))
    way_m = np.pad(way_m, (0, -scan.size % _BLOCK_SCANS))
    drawn = _drawn(errors, jax.random.key(seed), jnp.asarray(way_m, jnp.float32))
    found, error = np.asarray(drawn[0])[: scan.size], np.asarray(drawn[1], np.float64)[: scan.size]
    yaw = truth.yaw_rad[scan]
    cos, sin = np.cos(yaw), np.sin(yaw)
    along, aside = array_x_m + error[:, 0], error[:, 1]
    level = np.zeros(scan.size)
    east = truth.east_m[scan] + cos * along - sin * aside
    north = truth.north_m[scan] + sin * along + cos * aside
    pose = np.stack([east, north, level, yaw + error[:, 2], level], axis=1)
    reported = np.asarray(errors.reported_sigma, np.float64)
    # Reported along and across the heading that the fix itself tells.
    cos, sin = np.cos(pose[:, 3]), np.sin(pose[:, 3])
    turned = np.stack([np.stack([cos, -sin], axis=1), np.stack([sin, cos], axis=1)], axis=1)
    covariance = np.zeros((scan.size, 5, 5))
    covariance[:, :2, :2] = turned @ np.diag(reported[:2] ** 2) @ np.swapaxes(turned, 1, 2)
    covariance[:, 2, 2], covariance[:, 3, 3] = _SIGMA_HEIGHT_M**2, reported[2] ** 2
    covariance[:, 4, 4] = _SIGMA_ROLL_RAD**2
    pose[~found], covariance[~found] = np.nan, np.nan
    sigma_m = (float(reported[0]), float(reported[1]))
    return VehicleFixes(truth.time_s[scan], found, pose, covariance, sigma_m, float(errors.strength))


@jax.jit
def _drawn(
    errors: FixErrors, key: PRNGKeyArray, way_m: Float[Array, " scan"]
) -> tuple[Bool[Array, " scan"], Float[Array, "scan 3"]]:
    start, steps = jax.random.split(key)

    def step(
        state: FixErrorState, told: tuple[PRNGKeyArray, Float[Array, ""]]
    ) -> tuple[FixErrorState, tuple[Bool[Array, ""], Float[Array, "3"]]]:
        state, error = step_fix_errors(errors, state, *told)
        return state, (state.found, error)

    told = (jax.random.split(steps, way_m.size), way_m)
    drawn: tuple[Bool[Array, " scan"], Float[Array, "scan 3"]] = jax.lax.scan(
        step, init_fix_errors(errors, start), told
    )[1]
    return drawn
