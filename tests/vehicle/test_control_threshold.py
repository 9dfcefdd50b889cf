"""A vehicle that ignores small commands, and the pulses that make up for it, against plain sums."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from lgprjax.vehicle import WheelSpeeds, init_pulses, obeyed_wheels, settle_pulses, step_pulses

THRESHOLD_MPS, STEP_S = 0.3, 0.02


def test_below_the_threshold_it_drives_straight_on_from_there_it_obeys() -> None:
    left = jnp.asarray([0.5, 0.5, 0.5, 0.5, 0.4], jnp.float32)
    right = jnp.asarray([0.5, 0.75, 1.0, 0.0, 0.2], jnp.float32)
    obeyed = obeyed_wheels(jnp.float32(0.5), WheelSpeeds(left, right))
    np.testing.assert_allclose(obeyed.left_mps, [0.5, 0.625, 0.5, 0.5, 0.3], rtol=1e-6)
    np.testing.assert_allclose(obeyed.right_mps, [0.5, 0.625, 1.0, 0.0, 0.3], rtol=1e-6)


@jax.jit
def made_up(
    asked_mps: Float[Array, " step"], mean_mps: Float[Array, ""], rate_mps2: Float[Array, ""]
) -> tuple[Float[Array, " step"], Float[Array, " step"]]:
    """Differences told to the wheels, and obeyed, behind a limiter of their rate."""
    threshold, step = jnp.float32(THRESHOLD_MPS), jnp.float32(STEP_S)
    change = rate_mps2 * step

    def one(carried, turn):  # type: ignore[no-untyped-def]
        pulses, last = carried
        asked = WheelSpeeds(mean_mps - 0.5 * turn, mean_mps + 0.5 * turn)
        pulses, told = step_pulses(threshold, pulses, asked, step)
        sent = WheelSpeeds(*(jnp.clip(now, was - change, was + change) for now, was in zip(told, last, strict=True)))
        obeyed = obeyed_wheels(threshold, sent)
        pulses = settle_pulses(threshold, pulses, asked, sent, step)
        return (pulses, sent), (told.right_mps - told.left_mps, obeyed.right_mps - obeyed.left_mps)

    start = (init_pulses(mean_mps), WheelSpeeds(mean_mps, mean_mps))
    driven: tuple[Float[Array, " step"], Float[Array, " step"]] = jax.lax.scan(one, start, asked_mps)[1]
    return driven


@pytest.mark.parametrize(("turn_mps", "rate_mps2"), [(0.01, 2.0), (-0.29, 100.0), (0.15, 2.0)])
def test_on_the_average_it_turns_as_asked(turn_mps: float, rate_mps2: float) -> None:
    asked = np.full(3000, turn_mps)
    _, obeyed = made_up(jnp.asarray(asked, jnp.float32), jnp.float32(0.45), jnp.float32(rate_mps2))
    owed_m = np.cumsum(asked - np.asarray(obeyed, np.float64)) * STEP_S
    # Never more than a pulse is owed, its ramps included: 0.06 s of it, and 0.16 s more at 2 m/s².
    assert np.abs(owed_m).max() < 1.3 * THRESHOLD_MPS * (0.06 + 0.32 / rate_mps2)
    assert np.mean(obeyed) == pytest.approx(turn_mps, abs=1.5e-3)


def test_a_turn_that_is_obeyed_passes_and_zero_changes_nothing() -> None:
    told, _ = made_up(jnp.full(3000, 0.4, jnp.float32), jnp.float32(0.45), jnp.float32(2.0))
    np.testing.assert_allclose(told, 0.4, rtol=1e-6)
    asked = WheelSpeeds(jnp.float32(0.4), jnp.float32(0.41))
    _, untouched = step_pulses(jnp.float32(0.0), init_pulses(jnp.float32(0.0)), asked, jnp.float32(STEP_S))
    np.testing.assert_allclose(untouched, asked, rtol=1e-6)


def test_standing_it_does_not_pulse() -> None:
    told, _ = made_up(jnp.full(3000, 0.05, jnp.float32), jnp.float32(0.0), jnp.float32(100.0))
    # A turn on the spot is asked for, and none that the vehicle obeys is sent.
    assert np.abs(np.asarray(told)).max() <= 0.05 + 1e-6
