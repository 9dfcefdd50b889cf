"""Pedals of a vehicle that does not exist, for the tests."""

import jax.numpy as jnp

from lgprjax.vehicle import Pedal, Pedals


def pedals_with(throttle_gain: float = 3.0, rolling: float = 0.15, lag_s: float = 0.6) -> Pedals:
    """A throttle slower than the brake, both with slack and friction."""
    throttle = Pedal(*(jnp.float32(value) for value in (0.12, 0.05, throttle_gain, lag_s)))
    brake = Pedal(*(jnp.float32(value) for value in (0.18, 0.06, 6.0, 0.25)))
    return Pedals(throttle, brake, jnp.float32(rolling), jnp.float32(0.03))
