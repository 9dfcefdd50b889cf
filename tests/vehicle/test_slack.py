"""Dead band and play of the steering, and the command that makes up for them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float

from lgprjax.vehicle import ideal_servo, init_servo, step_servo, step_slack

_STEP_S = 0.02
_DEAD_RAD, _PLAY_RAD = 0.0087, 0.014
_SLACK_RAD = _DEAD_RAD + 0.5 * _PLAY_RAD


def _followed(
    wanted_rad: Float[np.ndarray, " step"], slack_rad: float, lag_s: float = 0.1
) -> tuple[Float[np.ndarray, " step"], Float[np.ndarray, " step"]]:
    """Commands, and the wheels of a servo with dead band and play that gets them."""
    servo = ideal_servo(lag_s)._replace(dead_band_rad=jnp.float32(_DEAD_RAD), backlash_rad=jnp.float32(_PLAY_RAD))

    def step(carry, wanted):  # type: ignore[no-untyped-def]
        middle, state = carry
        middle, command = step_slack(slack_rad, middle, wanted)
        state = step_servo(state, servo, command, 1.0, _STEP_S)
        return (middle, state), (command, state.wheel_rad)

    first = (jnp.float32(0.0), init_servo(jnp.float32(0.0)))
    found = jax.lax.scan(step, first, jnp.asarray(wanted_rad, jnp.float32))[1]
    return np.asarray(found[0], np.float64), np.asarray(found[1], np.float64)


@pytest.mark.parametrize("size_rad", [0.01, 0.03, 0.1])
@pytest.mark.parametrize("period_s", [3.0, 8.0])
def test_the_wheels_come_where_they_are_wanted(size_rad: float, period_s: float) -> None:
    time_s = np.arange(0.0, 4.0 * period_s, _STEP_S)
    wanted = size_rad * np.sin(2.0 * np.pi * time_s / period_s)
    settled = time_s > period_s
    ideal = _lagged(wanted, 0.1)
    plain, made_up = (np.std((_followed(wanted, slack)[1] - ideal)[settled]) for slack in (0.0, _SLACK_RAD))
    assert made_up < 0.5 * plain
    assert made_up < 0.35 * _SLACK_RAD


def _lagged(wanted_rad: Float[np.ndarray, " step"], lag_s: float) -> Float[np.ndarray, " step"]:
    keep, found = np.exp(-_STEP_S / lag_s), [0.0]
    for angle in wanted_rad:
        found.append(angle + keep * (found[-1] - angle))
    return np.array(found[1:])


def test_a_command_leads_by_the_slack_at_most_and_without_a_jump() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        wanted = np.cumsum(rng.normal(0.0, 0.002, 2000))
        command, _ = _followed(wanted, _SLACK_RAD)
        assert np.abs(command - wanted).max() <= _SLACK_RAD * 1.001
        # A lead that changes sides does so over a half of its size.
        assert np.abs(np.diff(command)).max() <= 5.01 * np.abs(np.diff(wanted)).max()


def test_noise_does_not_throw_it_from_side_to_side() -> None:
    """A straight line with noise of a tenth of the slack: the command leads to neither side."""
    wanted = np.random.default_rng(2).normal(0.0, 0.1 * _SLACK_RAD, 5000)
    command, wheels = _followed(wanted, _SLACK_RAD)
    assert np.std(wheels) < 0.3 * _SLACK_RAD
    assert np.std(command) < 0.75 * _SLACK_RAD


def test_without_slack_nothing_is_changed() -> None:
    wanted = np.random.default_rng(3).normal(0.0, 0.1, 500).astype(np.float32)
    np.testing.assert_array_equal(_followed(wanted, 0.0)[0], wanted)
