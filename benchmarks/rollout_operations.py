"""The least that rollouts can take: their operations a step, and what this machine's cores can do of them."""

import time
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend.core import ClosedJaxpr, Jaxpr

_ARITHMETIC = frozenset(
    ("add", "sub", "mul", "div", "neg", "abs", "max", "min", "sqrt", "floor", "sign", "select_n", "exp", "integer_pow")
)


def operations_a_step(rollout: ClosedJaxpr) -> int:
    """Arithmetic operations in the body of the longest loop of a traced rollout; a comparison is part of its choice."""
    loops = [equation for equation in _equations(rollout.jaxpr) if equation.primitive.name == "scan"]
    bodies = [loop.params["jaxpr"].jaxpr for loop in loops]
    return max(sum(inner.primitive.name in _ARITHMETIC for inner in _equations(body)) for body in bodies)


def bytes_a_step(rollout: ClosedJaxpr, lanes: int) -> int:
    """Bytes that one vehicle's step reads and writes where every step goes through memory: all that the longest loop
    carries, read and written, and what it is given, read.
    """
    loops = [equation for equation in _equations(rollout.jaxpr) if equation.primitive.name == "scan"]
    loop = max(loops, key=lambda found: len(found.params["jaxpr"].jaxpr.eqns))
    read, written = (sum(4 for one in ends if one.aval.shape == (lanes,)) for ends in (loop.invars, loop.outvars))
    return read + written


def peak_operations() -> float:
    """Float32 operations a second of all cores that JAX uses here: a matrix product's, best of five."""
    size = 1536
    matrix = jnp.ones((size, size), jnp.float32)
    product = jax.jit(jnp.matmul)
    jax.block_until_ready(product(matrix, matrix))
    taken_s = []
    for _ in range(5):
        begin = time.perf_counter()
        jax.block_until_ready(product(matrix, matrix))
        taken_s.append(time.perf_counter() - begin)
    return 2.0 * size**3 / min(taken_s)


def _equations(jaxpr: Jaxpr) -> list[Any]:
    """All equations, those of inner jaxprs included."""
    found: list[Any] = []
    for equation in jaxpr.eqns:
        found.append(equation)
        for value in equation.params.values():
            inner = getattr(value, "jaxpr", value)
            if isinstance(inner, Jaxpr):
                found += _equations(inner)
    return found
