"""The fit of the filter's noises on drives drawn from known ones, and its likelihood against a Gaussian in float64."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import linear_drives
from lgprjax.navigation.counter_steer_model import FilterModel
from lgprjax.navigation.observations import default_rules
from lgprjax.tuning import NOISES, FusionFit, NavigationDrives, NotExcitedError, fit_fusion
from lgprjax.tuning.navigation import filter_drives, innovation_slopes, mean_nis, without_outliers
from linear_drives import LINEAR, draw_straight, gaussian_of, padded
from model_drives import Drawn, stacked
from refusals import refused
from validation.vehicles.intervals import (
    LANES,
    START,
    STRETCH_S,
    TRUE,
    drawn_drives,
    navigation_drives,
    noises_inside,
)

_TICKS = 400
_LINEAR_TOLD = ("acceleration_noise", "side_noise", "gnss_error_sigma_m", "gnss_error_s")


def _logarithms(model: FilterModel) -> np.ndarray:
    return np.log([float(getattr(model, name)) for name in NOISES])


def _sigmas_off(fit: FusionFit) -> np.ndarray:
    """By how many standard errors each logarithm found is off."""
    return np.array(
        [np.log(one.value / float(getattr(TRUE, name))) * one.value / one.sigma for name, one in fit.found.items()]
    )


@pytest.fixture(scope="module")
def drawn() -> list[Drawn]:
    return drawn_drives(TRUE, 100)


@pytest.fixture(scope="module")
def drives(drawn: list[Drawn]) -> NavigationDrives:
    return navigation_drives(*stacked(drawn))


@pytest.fixture(scope="module")
def fit(drives: NavigationDrives) -> FusionFit:
    return fit_fusion(START, default_rules(), drives, stretch_s=STRETCH_S)


def _whole_drive(drive: Drawn, ticks: int) -> float:
    """Log-likelihood of a linear drive as one Gaussian, float64."""
    one = gaussian_of(drive, ticks)
    covariance = one.rows @ one.covariance @ one.rows.T + np.diag(one.noise)
    return float(stats.multivariate_normal.logpdf(one.values, one.rows @ one.mean, covariance))


def test_innovations_likelihood_is_that_of_the_whole_drive(monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = 60
    straight = [draw_straight(seed, ticks) for seed in range(LANES)]
    got = innovation_slopes(LINEAR, NOISES, _logarithms(LINEAR), navigation_drives(*padded(straight, _TICKS)))
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
    slope = innovation_slopes(TRUE, NOISES, _logarithms(TRUE), drives).slope
    information = np.einsum("dtp,dtq->pq", slope, slope) / LANES
    total = slope.sum(axis=1)
    score = float(np.einsum("dp,pq,dq->", total, np.linalg.inv(information), total))
    low, high = stats.chi2.ppf([0.0005, 0.9995], LANES * len(NOISES))
    assert low < score < high


def test_true_noises_lie_in_the_intervals(fit: FusionFit) -> None:
    assert tuple(fit.found) == NOISES
    assert noises_inside(fit).sum() >= 7
    assert np.all(np.abs(_sigmas_off(fit)) < 3.0)
    for name, found in fit.found.items():
        assert found.low < found.value < found.high
        if not name.endswith(("error_s", "error_m", "error_sigma_m")):
            # Two minutes tell a motion's noise to a fifth; of the slow errors they see a dozen values.
            assert found.sigma < 0.2 * found.value


def test_what_drives_do_not_tell_is_left_as_it_was() -> None:
    # A bias that hardly walks leaves no trace in twenty seconds.
    still = jnp.float32(1e-7)
    many = navigation_drives(*stacked(drawn_drives(TRUE._replace(rate_bias_walk=still), 400)))
    fit = fit_fusion(START._replace(rate_bias_walk=still), default_rules(), many, stretch_s=STRETCH_S)
    assert fit.left_open == ("rate_bias_walk",)
    assert fit.model.rate_bias_walk == still


def test_held_out_innovations_are_as_large_as_they_say(fit: FusionFit) -> None:
    held_out = navigation_drives(*stacked(drawn_drives(TRUE, 500)))
    before, after = (mean_nis(filter_drives(m, default_rules(), held_out)[1]) for m in (START, fit.model))
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
    kept, rejected = without_outliers(START, default_rules(), navigation_drives(motions, wrong))
    assert rejected["gnss"] == 1
    assert not bool(kept.observations.gnss.valid[2, at])
    assert int(kept.observations.gnss.valid.sum()) == int(gnss.valid.sum()) - 1


def test_start_that_shuts_out_a_source_is_refused(drawn: list[Drawn]) -> None:
    motions, observations = stacked(drawn)
    sure = observations._replace(lgpr=observations.lgpr._replace(covariance=1e-4 * observations.lgpr.covariance))
    narrow = START._replace(lgpr_error_sigma_m=jnp.float32(1e-3), side_noise=jnp.float32(1e-3))
    with refused("lgpr at the start model", "2 %", error=NotExcitedError):
        fit_fusion(narrow, default_rules(), navigation_drives(motions, sure))
