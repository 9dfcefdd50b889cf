"""The fit of the filter's noises on drives drawn from known ones, and its likelihood against a Gaussian in float64."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from lgprjax.navigation.filter_model import FilterModel
from lgprjax.navigation.gates import default_rules
from lgprjax.navigation.observations import Motion, Observations
from lgprjax.tuning.estimate import NotExcitedError
from lgprjax.tuning.fusion_fit import FusionFit, filter_drives, fit_fusion, mean_nis, without_outliers
from lgprjax.tuning.innovations_likelihood import NavigationDrives, innovation_slopes
from lgprjax.vehicle import VehiclePose
from linear_drives import LINEAR, draw_straight, gaussian_of, padded
from model_drives import SPEED_MPS, Drawn, draw_drive, stacked, usual_model

_LANES, _TICKS = 6, 400
_NAMES = ("acceleration_noise", "side_noise", "rate_bias_walk", "lgpr_error_sigma_m", "lgpr_error_m")
# A bias that hardly walks leaves no trace in twenty seconds.
_TRUE = usual_model(acceleration_noise=0.3, side_noise=0.03, rate_bias_walk=1e-7, lgpr_error_m=8.0)
_START = usual_model(
    acceleration_noise=0.8, side_noise=0.1, rate_bias_walk=1e-7, lgpr_error_sigma_m=0.08, lgpr_error_m=4.0
)


def _drives(motions: Motion, observations: Observations) -> NavigationDrives:
    zero = jnp.zeros(_LANES, jnp.float32)
    return NavigationDrives(VehiclePose(zero, zero, zero), zero + SPEED_MPS, motions, observations)


def _logarithms(model: FilterModel) -> np.ndarray:
    return np.log([float(getattr(model, name)) for name in _NAMES])


@pytest.fixture(scope="module")
def drawn() -> list[Drawn]:
    return [draw_drive(_TRUE, seed, seconds=20.0) for seed in range(_LANES)]


@pytest.fixture(scope="module")
def drives(drawn: list[Drawn]) -> NavigationDrives:
    return _drives(*stacked(drawn))


@pytest.fixture(scope="module")
def fit(drives: NavigationDrives) -> FusionFit:
    return fit_fusion(_START, default_rules(), drives, names=_NAMES, stretch_s=2.0)


def test_innovations_likelihood_is_that_of_the_whole_drive() -> None:
    ticks = 60
    straight = [draw_straight(seed, ticks) for seed in range(_LANES)]
    got = innovation_slopes(LINEAR, _NAMES, _logarithms(LINEAR), _drives(*padded(straight, _TICKS)))
    for lane, drive in enumerate(straight):
        one = gaussian_of(drive, ticks)
        covariance = one.rows @ one.covariance @ one.rows.T + np.diag(one.noise)
        wanted = stats.multivariate_normal.logpdf(one.values, one.rows @ one.mean, covariance)
        assert got.value[lane].sum() == pytest.approx(wanted, abs=0.02)
    assert np.all(got.value[:, ticks:] == 0.0)


def test_slopes_are_those_of_the_likelihood(drives: NavigationDrives) -> None:
    at = _logarithms(_START)
    slope = innovation_slopes(_START, _NAMES, at, drives).slope.sum(axis=(0, 1))
    for i in (0, 1, 3, 4):
        moved = 0.05 * np.eye(len(at))[i]
        high, low = (innovation_slopes(_START, _NAMES, at + sign * moved, drives).value.sum() for sign in (1, -1))
        assert slope[i] == pytest.approx((high - low) / 0.1, rel=0.02, abs=1.0)


def test_at_the_truth_slopes_vary_as_much_as_the_information_says(drives: NavigationDrives) -> None:
    told = [0, 1, 3, 4]
    slope = innovation_slopes(_TRUE, _NAMES, _logarithms(_TRUE), drives).slope[..., told]
    information = np.einsum("dtp,dtq->pq", slope, slope) / _LANES
    total = slope.sum(axis=1)
    score = float(np.einsum("dp,pq,dq->", total, np.linalg.inv(information), total))
    low, high = stats.chi2.ppf([0.0005, 0.9995], _LANES * len(told))
    assert low < score < high


def test_true_noises_lie_in_the_intervals(fit: FusionFit) -> None:
    assert set(fit.found) == {"acceleration_noise", "side_noise", "lgpr_error_sigma_m", "lgpr_error_m"}
    for name, found in fit.found.items():
        # Four intervals of 95 %: three halves of each hold all of them nearly always.
        half = 1.5 * np.log(found.high / found.value)
        assert abs(np.log(found.value / float(getattr(_TRUE, name)))) < half
        assert found.low < found.value < found.high
        assert np.log(found.high / found.low) < 2.0


def test_what_drives_do_not_tell_is_left_as_it_was(fit: FusionFit) -> None:
    assert fit.left_open == ("rate_bias_walk",)
    assert float(fit.model.rate_bias_walk) == float(_START.rate_bias_walk)


def test_held_out_innovations_are_as_large_as_they_say(fit: FusionFit) -> None:
    held_out = _drives(*stacked([draw_drive(_TRUE, 100 + seed, seconds=20.0) for seed in range(_LANES)]))
    before, after = (mean_nis(filter_drives(m, default_rules(), held_out)[1]) for m in (_START, fit.model))
    assert fit.gained > 100.0
    for source, nis in after.items():
        assert nis == pytest.approx(1.0, abs=0.1)
        assert abs(nis - 1.0) <= abs(before[source] - 1.0) + 0.02
    assert before["lgpr"] < 0.85


def test_outliers_are_left_out_and_counted(drawn: list[Drawn]) -> None:
    motions, observations = stacked(drawn)
    gnss = observations.gnss
    at = int(np.flatnonzero(np.asarray(gnss.valid[2]))[50])
    wrong = observations._replace(gnss=gnss._replace(x_m=gnss.x_m.at[2, at].add(9.0)))
    kept, rejected = without_outliers(_START, default_rules(), _drives(motions, wrong))
    assert rejected["gnss"] == 1
    assert not bool(kept.observations.gnss.valid[2, at])
    assert int(kept.observations.gnss.valid.sum()) == int(gnss.valid.sum()) - 1


def test_start_that_shuts_out_a_source_is_refused(drawn: list[Drawn]) -> None:
    motions, observations = stacked(drawn)
    sure = observations._replace(lgpr=observations.lgpr._replace(covariance=1e-4 * observations.lgpr.covariance))
    narrow = _START._replace(lgpr_error_sigma_m=jnp.float32(1e-3), side_noise=jnp.float32(1e-3))
    with pytest.raises(NotExcitedError, match="at the start model: expected 2 % rejected"):
        fit_fusion(narrow, default_rules(), _drives(motions, sure), names=_NAMES)
