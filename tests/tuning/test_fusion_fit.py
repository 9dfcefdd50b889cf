"""The fit of the filter's noises on drives drawn from known ones, and its likelihood against a Gaussian in float64."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import linear_drives
from lgprjax.navigation.counter_steer_model import FilterModel
from lgprjax.navigation.observations import MotionInput, Observations, default_rules
from lgprjax.tuning import NOISES, FusionFit, NavigationDrives, NotExcitedError, fit_fusion
from lgprjax.tuning.navigation import filter_drives, innovation_slopes, mean_nis, without_outliers
from lgprjax.vehicle import VehiclePose
from linear_drives import LINEAR, draw_straight, gaussian_of, padded
from model_drives import SPEED_MPS, Drawn, draw_drive, stacked, usual_model

# One shape for all, as compiling it is most of the work: two minutes of driving, in which every noise leaves a trace.
_LANES, _TICKS, _SECONDS, _STRETCH_S = 6, 400, 20.0, 2.0
_TRUE = usual_model(
    yaw_rate_noise=3e-3,
    acceleration_noise=0.3,
    side_noise=0.05,
    rate_bias_walk=2e-3,
    odometer_scale_walk=5e-3,
    gnss_error_sigma_m=0.1,
    gnss_error_s=10.0,
    lgpr_error_sigma_m=0.06,
    lgpr_error_m=8.0,
)
_WRONG = (1.6, 2.0, 1.6, 2.5, 2.5, 1.6, 2.0, 1.6, 0.5)
_START = _TRUE._replace(
    **{name: jnp.float32(wrong * getattr(_TRUE, name)) for name, wrong in zip(NOISES, _WRONG, strict=True)}
)
_LINEAR_TOLD = ("acceleration_noise", "side_noise", "gnss_error_sigma_m", "gnss_error_s")


def _drives(motions: MotionInput, observations: Observations) -> NavigationDrives:
    zero = jnp.zeros(_LANES, jnp.float32)
    return NavigationDrives(VehiclePose(zero, zero, zero), zero + SPEED_MPS, motions, observations)


def _drawn(model: FilterModel, first_seed: int) -> list[Drawn]:
    return [draw_drive(model, first_seed + lane, seconds=_SECONDS) for lane in range(_LANES)]


def _logarithms(model: FilterModel) -> np.ndarray:
    return np.log([float(getattr(model, name)) for name in NOISES])


def _sigmas_off(fit: FusionFit) -> np.ndarray:
    """By how many standard errors each logarithm found is off."""
    return np.array(
        [np.log(one.value / float(getattr(_TRUE, name))) * one.value / one.sigma for name, one in fit.found.items()]
    )


def _inside(fit: FusionFit) -> np.ndarray:
    return np.array([one.low < float(getattr(_TRUE, name)) < one.high for name, one in fit.found.items()])


@pytest.fixture(scope="module")
def drawn() -> list[Drawn]:
    return _drawn(_TRUE, 100)


@pytest.fixture(scope="module")
def drives(drawn: list[Drawn]) -> NavigationDrives:
    return _drives(*stacked(drawn))


@pytest.fixture(scope="module")
def fit(drives: NavigationDrives) -> FusionFit:
    return fit_fusion(_START, default_rules(), drives, stretch_s=_STRETCH_S)


def _whole_drive(drive: Drawn, ticks: int) -> float:
    """Log-likelihood of a linear drive as one Gaussian, float64."""
    one = gaussian_of(drive, ticks)
    covariance = one.rows @ one.covariance @ one.rows.T + np.diag(one.noise)
    return float(stats.multivariate_normal.logpdf(one.values, one.rows @ one.mean, covariance))


def test_innovations_likelihood_is_that_of_the_whole_drive(monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = 60
    straight = [draw_straight(seed, ticks) for seed in range(_LANES)]
    got = innovation_slopes(LINEAR, NOISES, _logarithms(LINEAR), _drives(*padded(straight, _TICKS)))
    for lane, drive in enumerate(straight):
        assert got.value[lane].sum() == pytest.approx(_whole_drive(drive, ticks), abs=0.02)
    assert np.all(got.value[:, ticks:] == 0.0)
    slope = got.slope.sum(axis=1)
    for name in _LINEAR_TOLD:
        around = []
        for factor in (np.exp(1e-3), np.exp(-1e-3)):
            moved = LINEAR._replace(**{name: jnp.float32(factor * float(getattr(LINEAR, name)))})
            monkeypatch.setattr(linear_drives, "LINEAR", moved)
            around.append([_whole_drive(drive, ticks) for drive in straight[:3]])
        wanted = (np.array(around[0]) - np.array(around[1])) / 2e-3
        np.testing.assert_allclose(slope[:3, NOISES.index(name)], wanted, rtol=0.01, atol=0.1)


def test_at_the_truth_slopes_vary_as_much_as_the_information_says(drives: NavigationDrives) -> None:
    slope = innovation_slopes(_TRUE, NOISES, _logarithms(_TRUE), drives).slope
    information = np.einsum("dtp,dtq->pq", slope, slope) / _LANES
    total = slope.sum(axis=1)
    score = float(np.einsum("dp,pq,dq->", total, np.linalg.inv(information), total))
    low, high = stats.chi2.ppf([0.0005, 0.9995], _LANES * len(NOISES))
    assert low < score < high


def test_true_noises_lie_in_the_intervals(fit: FusionFit) -> None:
    assert tuple(fit.found) == NOISES
    assert _inside(fit).sum() >= 7
    assert np.all(np.abs(_sigmas_off(fit)) < 3.0)
    for name, found in fit.found.items():
        assert found.low < found.value < found.high
        if not name.endswith(("error_s", "error_m", "error_sigma_m")):
            # Two minutes tell a motion's noise to a fifth; of the slow errors they see a dozen values.
            assert found.sigma < 0.2 * found.value


@pytest.mark.campaign
def test_intervals_cover() -> None:
    """Of 200 fits each interval holds the truth as often as it says."""
    fits = 200
    inside = []
    for number in range(fits):
        many = _drives(*stacked(_drawn(_TRUE, 1000 + _LANES * number)))
        found = fit_fusion(_START, default_rules(), many, stretch_s=_STRETCH_S)
        if len(found.found) == len(NOISES):
            inside.append(_inside(found))
    assert len(inside) > 0.9 * fits
    share = np.mean(inside, axis=0)
    assert np.all(share > 0.88)
    assert 0.92 < share.mean() < 0.98


def test_what_drives_do_not_tell_is_left_as_it_was() -> None:
    # A bias that hardly walks leaves no trace in twenty seconds.
    still = jnp.float32(1e-7)
    many = _drives(*stacked(_drawn(_TRUE._replace(rate_bias_walk=still), 400)))
    fit = fit_fusion(_START._replace(rate_bias_walk=still), default_rules(), many, stretch_s=_STRETCH_S)
    assert fit.left_open == ("rate_bias_walk",)
    assert fit.model.rate_bias_walk == still


def test_held_out_innovations_are_as_large_as_they_say(fit: FusionFit) -> None:
    held_out = _drives(*stacked(_drawn(_TRUE, 500)))
    before, after = (mean_nis(filter_drives(m, default_rules(), held_out)[1]) for m in (_START, fit.model))
    assert fit.gained > 100.0
    for source, nis in after.items():
        assert nis == pytest.approx(1.0, abs=0.1)
        assert abs(nis - 1.0) <= abs(before[source] - 1.0) + 0.02
    assert before["odometer"] < 0.8


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
        fit_fusion(narrow, default_rules(), _drives(motions, sure))
