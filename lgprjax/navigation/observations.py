"""What the filter is given in a tick: the motion that the gyro saw and at most one observation of each source.

A slot that is not valid may hold anything, NaN too. An age counts back from the tick's end to the moment of measuring.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

SOURCES = ("gnss", "heading", "odometer", "lgpr")
"""Sources in the order in which a tick takes them, and in which every array over sources counts."""
GNSS, HEADING, ODOMETER, LGPR = range(4)


class Motion(NamedTuple):
    """What moves the filter on by a tick.

    Attributes:
        yaw_rate_radps: as the gyro reads it, its bias included; the mean over the tick.
        step_s: length of the tick.
    """

    yaw_rate_radps: Float[Array, "..."]
    step_s: Float[Array, "..."]


class GnssObservation(NamedTuple):
    """Position of the antenna in the map's frame, off by the GNSS error.

    Attributes:
        x_m, y_m: position.
        covariance: of its white noise, m²; the slow error is the model's.
        age_s: at the tick's end.
        valid: whether there is one.
    """

    x_m: Float[Array, "..."]
    y_m: Float[Array, "..."]
    covariance: Float[Array, "... 2 2"]
    age_s: Float[Array, "..."]
    valid: Bool[Array, "..."]


class HeadingObservation(NamedTuple):
    """Yaw of the body from two antennas or an INS; a course goes through ``course_observation`` first.

    Attributes:
        yaw_rad: any full turns more or less.
        variance: rad².
        age_s: at the tick's end.
        valid: whether there is one.
    """

    yaw_rad: Float[Array, "..."]
    variance: Float[Array, "..."]
    age_s: Float[Array, "..."]
    valid: Bool[Array, "..."]


class OdometerObservation(NamedTuple):
    """Forward speed by the wheels over the tick, scale error included.

    Attributes:
        speed_mps: negative in reverse.
        variance: m²/s².
        valid: whether there is one.
    """

    speed_mps: Float[Array, "..."]
    variance: Float[Array, "..."]
    valid: Bool[Array, "..."]


class LgprObservation(NamedTuple):
    """Pose of the array's centre in the map's frame, off by the LGPR error.

    Attributes:
        x_m, y_m: position.
        yaw_rad: any full turns more or less.
        covariance: of x, y and yaw, from the correlation's peak; what neighbouring fixes share is the model's.
        age_s: at the tick's end by the stamp; the filter adds what it believes of the clock.
        valid: whether there is one.
    """

    x_m: Float[Array, "..."]
    y_m: Float[Array, "..."]
    yaw_rad: Float[Array, "..."]
    covariance: Float[Array, "... 3 3"]
    age_s: Float[Array, "..."]
    valid: Bool[Array, "..."]


class Observations(NamedTuple):
    """A tick's slots, in the order of ``SOURCES``."""

    gnss: GnssObservation
    heading: HeadingObservation
    odometer: OdometerObservation
    lgpr: LgprObservation


def no_observations() -> Observations:
    """One lane's slots, all empty."""
    zero, one, no = jnp.float32(0.0), jnp.float32(1.0), jnp.asarray(False)
    return Observations(
        GnssObservation(zero, zero, jnp.eye(2, dtype=jnp.float32), zero, no),
        HeadingObservation(zero, one, zero, no),
        OdometerObservation(zero, one, no),
        LgprObservation(zero, zero, zero, jnp.eye(3, dtype=jnp.float32), zero, no),
    )


def valid_sources(observations: Observations) -> Bool[Array, "... 4"]:
    """Which slots hold an observation, in the order of ``SOURCES``."""
    return jnp.stack([slot.valid for slot in observations], axis=-1)
