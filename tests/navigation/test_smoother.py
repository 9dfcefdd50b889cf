"""The smoother against batch conditioning in float64, and its honesty on drives with a gap in GNSS and LGPR."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from lgprjax.navigation.counter_steer_filter import (
    FilterInfo,
    FilterState,
    filter_drive,
    init_filter,
    smooth_estimates,
)
from lgprjax.navigation.counter_steer_model import FilterModel, NavEstimate
from lgprjax.navigation.observations import MotionInput, Observations, default_rules
from lgprjax.vehicle import VehiclePose
from linear_drives import LINEAR, STATES, draw_straight, gaussian_of, padded
from model_drives import SPEED_MPS, draw_drive, silenced, stacked, usual_model

_LANES, _TICKS = 24, 500
_RESTART = 250
_MODEL = usual_model(gnss_error_sigma_m=0.03, gnss_error_s=60.0)


def _start(model: FilterModel) -> FilterState:
    return init_filter(model, VehiclePose(*jnp.zeros(3, jnp.float32)), jnp.float32(SPEED_MPS))


@jax.jit
def _both(
    model: FilterModel, motions: MotionInput, observations: Observations, restarted: jax.Array
) -> tuple[NavEstimate, FilterInfo, NavEstimate]:
    def one(motion: MotionInput, observed: Observations) -> tuple[NavEstimate, FilterInfo, NavEstimate]:
        filtered, info = filter_drive(model, default_rules(), _start(model), motion, observed)
        return filtered, info, smooth_estimates(model, filtered, motion, restarted)

    return jax.vmap(one)(motions, observations)


_NEVER = np.zeros(_TICKS, bool)


class _Driven:
    """Drives of 25 s; neither GNSS nor LGPR from 8 to 20 s."""

    def __init__(self) -> None:
        self.drives = [
            silenced(silenced(draw_drive(_MODEL, seed, seconds=25.0), "gnss", 8.0, 20.0), "lgpr", 8.0, 20.0)
            for seed in range(_LANES)
        ]
        self.motions, self.observations = stacked(self.drives)
        self.filtered, self.info, self.smoothed = _both(_MODEL, self.motions, self.observations, jnp.asarray(_NEVER))
        self.states = np.stack([drive.states for drive in self.drives])

    def error_m(self, estimate: NavEstimate) -> np.ndarray:
        """Distance from the truth, [lane, tick]."""
        away = np.asarray(estimate.mean, np.float64)[..., :2] - self.states[..., :2]
        return np.asarray(np.hypot(away[..., 0], away[..., 1]))


@pytest.fixture(scope="module")
def driven() -> _Driven:
    return _Driven()


def test_smoothed_track_is_better_in_the_gap(driven: _Driven) -> None:
    gap = slice(180, 380)
    rms = [float(np.sqrt(np.mean(driven.error_m(e)[:, gap] ** 2))) for e in (driven.filtered, driven.smoothed)]
    assert rms[1] < 0.7 * rms[0]
    # At the end there is nothing later to learn from.
    np.testing.assert_allclose(driven.smoothed.mean[:, -1], driven.filtered.mean[:, -1])


@pytest.mark.parametrize("name", ["filtered", "smoothed"])
def test_errors_are_as_large_as_the_covariance_says(driven: _Driven, name: str) -> None:
    # Ticks far apart: neighbours share their errors. The last smoothed one is the filter's own.
    at = np.arange(60, _TICKS, 120)
    estimate: NavEstimate = getattr(driven, name)
    away = (np.asarray(estimate.mean, np.float64) - driven.states)[:, at]
    covariance = np.asarray(estimate.covariance, np.float64)
    for size in (3, 13):
        some = covariance[:, at, :size, :size]
        nees = np.einsum("lti,lti->lt", away[..., :size], np.linalg.solve(some, away[..., :size, None])[..., 0])
        # The mean over a lane is one draw: its spread is measured, not assumed.
        lane = nees.mean(axis=1)
        half = stats.t.ppf(0.995, _LANES - 1) * lane.std(ddof=1) / np.sqrt(_LANES)
        assert abs(lane.mean() - size) < half
        assert half < 0.45 * size
    sigma = np.sqrt(np.einsum("...ii->...i", covariance[:, :-1]))
    scaled = covariance[:, :-1] / (sigma[..., :, None] * sigma[..., None, :])
    np.testing.assert_allclose(scaled, scaled.swapaxes(-1, -2), atol=1e-6)
    assert np.linalg.eigvalsh(scaled).min() > 0.0
    before = np.sqrt(np.einsum("...ii->...i", np.asarray(driven.filtered.covariance, np.float64)[:, :-1]))
    assert np.max(sigma / before) < 1.01


def test_innovations_are_as_large_as_expected_and_hardly_one_is_rejected(driven: _Driven) -> None:
    """NIS a component of GNSS, heading, odometer and LGPR; rejects as rare as the gates say."""
    offered, accepted, nis = (np.asarray(part) for part in (driven.info.offered, driven.info.accepted, driven.info.nis))
    assert np.all(nis[~offered] == 0.0)
    mean = nis.sum(axis=(0, 1), dtype=np.float64) / offered.sum(axis=(0, 1)) / (2, 1, 1, 3)
    assert np.all(np.abs(mean - 1.0) < 0.1), mean
    assert (offered & ~accepted).sum() < 1e-3 * offered.sum()
    assert not np.asarray(driven.info.reacquired).any()


def test_nothing_is_carried_back_across_a_restart(driven: _Driven) -> None:
    restarted = _NEVER.copy()
    restarted[_RESTART] = True
    _, _, smoothed = _both(_MODEL, driven.motions, driven.observations, jnp.asarray(restarted))
    np.testing.assert_allclose(smoothed.mean[:, _RESTART - 1], driven.filtered.mean[:, _RESTART - 1], atol=1e-6)
    np.testing.assert_array_equal(smoothed.mean[:, _RESTART:], driven.smoothed.mean[:, _RESTART:])
    moved = np.abs(np.asarray(smoothed.mean - driven.smoothed.mean))[:, 100 : _RESTART - 1, :2]
    assert moved.max() > 0.005


def test_linear_drive_is_that_of_batch_conditioning_whatever_is_appended() -> None:
    ticks = 60
    drives = [draw_straight(seed, ticks) for seed in range(_LANES)]
    _, info, smoothed = _both(LINEAR, *padded(drives, _TICKS), jnp.asarray(_NEVER))
    assert bool((info.accepted == info.offered).all())
    for lane in range(3):
        prior = gaussian_of(drives[lane], ticks)
        seen = prior.rows @ prior.covariance
        gain = np.linalg.solve(seen @ prior.rows.T + np.diag(prior.noise), seen).T
        mean = prior.mean + gain @ (prior.values - prior.rows @ prior.mean)
        variance = np.diag(prior.covariance - gain @ seen)
        got = np.asarray(smoothed.mean, np.float64)[lane, :ticks][:, STATES]
        np.testing.assert_allclose(got.ravel(), mean, atol=5e-4)
        diagonal = np.einsum("tii->ti", np.asarray(smoothed.covariance, np.float64)[lane, :ticks])[:, STATES]
        np.testing.assert_allclose(np.sqrt(diagonal).ravel(), np.sqrt(variance), rtol=5e-3)
