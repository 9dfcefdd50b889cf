"""The clock of compiling: it runs while JAX compiles, and not while it computes."""

import time

import jax
import jax.numpy as jnp

from lgprjax.machine import compile_clock


def test_compiling_is_told_apart_from_computing() -> None:
    clock, began = compile_clock(), time.perf_counter()
    # A constant of its own: nothing of it can have been compiled before.
    program = jax.jit(lambda x: jnp.sin(x * began).sum() + jax.jit(jnp.cos)(x).sum())
    program(jnp.ones(100)).block_until_ready()
    took = time.perf_counter() - began
    compiled = clock.seconds_since(began)
    assert 0.3 * took < compiled <= took
    again = time.perf_counter()
    time.sleep(0.01)
    assert clock.seconds_since(again) == 0.0
