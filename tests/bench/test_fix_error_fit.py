"""The error model of fixes finds again what fixes were drawn from."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks.accuracy import fit_fix_errors
from lgprjax.scene import FixErrors, init_fix_errors, step_fix_errors

_WAY_M = 0.1


def _model() -> FixErrors:
    def row(*values: float) -> jax.Array:
        return jnp.asarray(values, jnp.float32)

    return FixErrors(
        slow_sigma=row(0.02, 0.03, 0.004),
        slow_m=jnp.float32(2.0),
        white_sigma=row(0.03, 0.01, 0.002),
        bias=row(0.01, -0.02, 0.001),
        reported_sigma=row(0.03, 0.03, 0.005),
        found_m=jnp.float32(6.0),
        lost_m=jnp.float32(1.5),
        strength=jnp.float32(0.8),
        p_false=jnp.float32(1e-9),
    )


def test_the_fit_finds_what_was_drawn() -> None:
    model, scans = _model(), 40_000
    keys = jax.random.split(jax.random.key(1), scans)

    def step(state, key):  # type: ignore[no-untyped-def]
        state, error = step_fix_errors(model, state, key, jnp.float32(_WAY_M))
        return state, (state.found, error)

    _, (found, error) = jax.jit(lambda start: jax.lax.scan(step, start, keys))(
        init_fix_errors(model, jax.random.key(2))
    )
    travel = _WAY_M * np.arange(scans)
    ok = np.asarray(found)
    fit = fit_fix_errors(travel, ok, np.asarray(error, np.float64), np.where(ok, 0.8, 0.4), np.where(ok, 1e-9, 1.0))
    assert ok.mean() == pytest.approx(6.0 / 7.5, abs=0.03)
    assert fit.bias == pytest.approx([0.01, -0.02, 0.001], abs=0.003)
    assert fit.slow_sigma == pytest.approx([0.02, 0.03, 0.004], rel=0.12)
    assert fit.white_sigma == pytest.approx([0.03, 0.01, 0.002], rel=0.15)
    assert fit.slow_m == pytest.approx(2.0, rel=0.25)
    assert fit.found_m == pytest.approx(6.0, rel=0.12)
    assert fit.lost_m == pytest.approx(1.5, rel=0.12)
    assert fit.strength == 0.8
    assert fit.p_false == 1e-9


def test_too_few_fixes_are_refused() -> None:
    travel = np.arange(60.0)
    with pytest.raises(ValueError, match="20 fixes are too few"):
        fit_fix_errors(travel, travel < 20, np.zeros((60, 3)), np.ones(60), np.zeros(60))
