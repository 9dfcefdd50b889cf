"""How well a filter's noises explain a logged drive: the likelihood of its innovations, tick by tick, and its slopes.

If the noises are right, innovations are independent in time: so are the likelihood's slopes, and the sum of their
squares is the information that the drives hold about the noises (Berndt, Hall, Hall and Hausman 1974).
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.navigation.error_state import correct, predict, weigh
from lgprjax.navigation.filter import init_filter
from lgprjax.navigation.filter_model import FilterModel, NavEstimate
from lgprjax.navigation.innovations import (
    gnss_innovation,
    heading_innovation,
    lgpr_innovation,
    odometer_innovation,
)
from lgprjax.navigation.observations import Motion, Observations
from lgprjax.vehicle import VehiclePose

# Slopes are differences of lanes: forward differentiation takes twice as long to compile and five times as long to
# run. So wide that float32 leaves 0.004 of a tick's slope, and so narrow that the most likely logarithm moves by less
# than a thousandth.
_ASIDE = 0.05


class NavigationDrives(NamedTuple):
    """Logged drives on ticks, leading axis drive; a shorter one ends in ticks of no length without observations.

    Attributes:
        start: pose of the rear axle before the first tick.
        speed_mps: then.
        motions, observations: axes drive, tick.
    """

    start: VehiclePose
    speed_mps: Float[Array, " drive"]
    motions: Motion
    observations: Observations


class Slopes(NamedTuple):
    """Log-likelihood of each tick's innovations, and its slopes by the logarithms of the noises."""

    value: Float[np.ndarray, "drive tick"]
    slope: Float[np.ndarray, "drive tick noise"]


def innovation_slopes(
    model: FilterModel, names: tuple[str, ...], logarithms: Float[np.ndarray, " noise"], drives: NavigationDrives
) -> Slopes:
    """Log-likelihood and slopes at noises.

    Args:
        model: everything but the noises named.
        names: fields of the model.
        logarithms: natural, of their values.
        drives: outliers taken out: every valid observation is used.
    """
    value, slope = _slopes(model, names, jnp.asarray(logarithms, jnp.float32), drives)
    return Slopes(np.asarray(value, np.float64), np.asarray(slope, np.float64))


def with_noises(model: FilterModel, names: tuple[str, ...], values: Float[Array | np.ndarray, " noise"]) -> FilterModel:
    """The model with other noises."""
    return model._replace(**{name: jnp.asarray(values[i], jnp.float32) for i, name in enumerate(names)})


@partial(jax.jit, static_argnames="names")
def _slopes(
    model: FilterModel, names: tuple[str, ...], logarithms: Float[Array, " noise"], drives: NavigationDrives
) -> tuple[Float[Array, "drive tick"], Float[Array, "drive tick noise"]]:
    def values(logs: Float[Array, " noise"]) -> Float[Array, "drive tick"]:
        noisy = with_noises(model, names, jnp.exp(logs))
        found: Float[Array, "drive tick"] = jax.vmap(lambda drive: _log_likelihood(noisy, drive))(drives)
        return found

    aside = _ASIDE * jnp.eye(len(names), dtype=jnp.float32)
    points = logarithms[None, :] + jnp.concatenate([jnp.zeros((1, len(names)), jnp.float32), aside, -aside])
    at, above, below = jnp.split(jax.vmap(values)(points), [1, 1 + len(names)])
    return at[0], jnp.moveaxis((above - below) / (2.0 * _ASIDE), 0, -1)


def _log_likelihood(model: FilterModel, drive: NavigationDrives) -> Float[Array, " tick"]:
    def step(estimate: NavEstimate, tick: tuple[Motion, Observations]) -> tuple[NavEstimate, Float[Array, ""]]:
        motion, seen = tick
        estimate = predict(model, estimate, motion)
        total = jnp.float32(0.0)
        for source in range(4):
            # Each source is linearised where those before it have led.
            innovation = (
                lambda e: gnss_innovation(model, e, motion, seen.gnss),
                lambda e: heading_innovation(e, motion, seen.heading),
                lambda e: odometer_innovation(e, seen.odometer),
                lambda e: lgpr_innovation(model, e, motion, seen.lgpr),
            )[source](estimate)
            weighed = weigh(estimate, innovation)
            size = len(innovation.rows)
            misfit = weighed.nis + _log_determinant(weighed.covariance) + size * jnp.log(2.0 * jnp.pi)
            total = total - jnp.where(innovation.offered, 0.5 * misfit, 0.0)
            estimate = correct(estimate, innovation, weighed, innovation.offered)
        return estimate, total

    start = init_filter(model, drive.start, drive.speed_mps).estimate
    values: Float[Array, " tick"] = jax.lax.scan(step, start, (drive.motions, drive.observations))[1]
    return values


def _log_determinant(covariance: Float[Array, "part part"]) -> Float[Array, ""]:
    """Of one to three components, scaled before the products: metres and radians differ."""
    count = covariance.shape[0]
    variance = jnp.diagonal(covariance)
    sigma = jnp.sqrt(variance)
    scaled = covariance / (sigma[:, None] * sigma[None, :])
    left = jnp.float32(1.0)
    if count == 2:
        left = 1.0 - scaled[0, 1] ** 2
    if count == 3:
        a, b, c = scaled[0, 1], scaled[0, 2], scaled[1, 2]
        left = 1.0 + 2.0 * a * b * c - a * a - b * b - c * c
    return jnp.log(variance).sum() + jnp.log(left)
