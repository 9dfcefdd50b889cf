"""The look-ahead found by gradient beside a brute-force search, at full and at reduced torque."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.tuning import GradientConfig, TrialCourses, TunedLookAhead, judge, sweep_look_ahead, tune_look_ahead
from lgprjax.vehicle import LookAhead, look_ahead_m
from validation.vehicles.look_ahead_grid import FULL_V, WEAK_V, least_cost, trial_courses, vehicle

# As many schedules are judged at once as by the tuner's first sweep, 24: one compiled program serves all.
SPEEDS = (1.5, 4.47, 8.0)


@pytest.fixture(scope="module")
def trials() -> TrialCourses:
    return trial_courses(SPEEDS, duration_s=12.0)


@pytest.fixture(scope="module")
def tuned(trials: TrialCourses) -> dict[float, TunedLookAhead]:
    return {volts: tune_look_ahead(vehicle(volts), trials, GradientConfig(steps=40)) for volts in (FULL_V, WEAK_V)}


def test_gradient_is_as_good_as_brute_force(trials: TrialCourses, tuned: dict[float, TunedLookAhead]) -> None:
    """Within 2 % of the least cost of 72 schedules; ``make validation NAME=vehicles`` drives 3,600."""
    assert tuned[FULL_V].cost_m <= 1.02 * least_cost(trials, FULL_V, (6, 6, 1, 2), 3)


def test_less_torque_asks_for_a_longer_look_ahead(tuned: dict[float, TunedLookAhead]) -> None:
    """Found, not typed in: at every speed by a tenth or more."""
    full, weak = (
        np.asarray(look_ahead_m(tuned[volts].schedule, jnp.asarray(SPEEDS, jnp.float32))) for volts in (FULL_V, WEAK_V)
    )
    assert (weak > 1.1 * full).all()


def test_look_ahead_grows_with_speed_and_leaves_the_margin(
    trials: TrialCourses, tuned: dict[float, TunedLookAhead]
) -> None:
    for found in tuned.values():
        assert float(found.schedule.long_m) > 1.5 * float(found.schedule.short_m)
        assert (np.asarray(found.judged.margin_rad) >= trials.least_margin_rad).all()
        # Of 12 s that begin 3 m beside the path, or on it, at full torque and at less.
        assert (np.asarray(found.judged.error_m) < 0.75).all()


def test_sweep_is_what_single_drives_are(trials: TrialCourses) -> None:
    """One place of the surface, judged by itself."""
    swept = sweep_look_ahead(vehicle(), trials, [2.0, 5.0, 9.0] * 8)
    zero = jnp.float32(0.0)
    alone = judge(vehicle(), trials, LookAhead(jnp.float32(5.0), jnp.float32(5.0), zero, zero))
    for field, single in zip(swept, alone, strict=True):
        np.testing.assert_allclose(np.asarray(field)[1], np.asarray(single), rtol=2e-3, atol=1e-5)


def test_what_cannot_be_tuned_is_refused(trials: TrialCourses) -> None:
    with pytest.raises(ValueError, match="two"):
        tune_look_ahead(vehicle(), replace(trials, speeds_mps=(2.0,)))
    with pytest.raises(ValueError, match="margin"):
        tune_look_ahead(vehicle(), replace(trials, least_margin_rad=1.5))
    with pytest.raises(ValueError, match=r"0\.3"):
        tune_look_ahead(vehicle(delay_s=0.3), trials)
