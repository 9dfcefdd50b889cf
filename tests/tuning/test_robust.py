"""Robust fits: SciPy's quantiles and least squares as oracles, outliers, and coverage of every kind of interval."""

import numpy as np
import pytest
from jaxtyping import Float
from scipy import optimize, stats

from lgprjax.tuning.robust import (
    NotExcitedError,
    clipped_mean,
    estimate,
    independent_share,
    median,
    robust_line,
    robust_polynomial,
    student_95,
)
from refusals import refused
from turning_drives import covered_band
from validation.vehicles.intervals import LINE, line_shares

DRAWS = 200


def test_students_quantile_leaves_a_twentieth_outside_and_an_interval_is_the_sigma_times_it() -> None:
    for degrees in (3.0, 4.5, 8.0, 20.0, 300.0):
        assert student_95(degrees) == pytest.approx(stats.t.ppf(0.975, degrees), abs=2e-6)
    with pytest.raises(ValueError, match=r"2\.9"):
        student_95(2.9)
    low, high = estimate(1.0, 0.5, 10.0)[2:]
    assert (low, high) == pytest.approx(stats.t.interval(0.95, 10, 1.0, 0.5), abs=1e-5)


def test_the_median_is_numpys() -> None:
    rng = np.random.default_rng(1)
    for count in (1, 2, 7, 8):
        values = rng.normal(size=count)
        assert median(values) == np.median(values)


def test_a_clipped_mean_does_not_see_spikes() -> None:
    values = np.random.default_rng(2).normal(5.0, 0.1, 200)
    spiked = values.copy()
    spiked[::20] = 1000.0
    assert clipped_mean(spiked) == pytest.approx(np.delete(values, np.s_[::20]).mean(), abs=0.005)


def test_coefficients_are_those_of_scipys_search_for_the_same_loss() -> None:
    rng = np.random.default_rng(3)
    x = np.linspace(-1.0, 1.0, 60)
    y = 2.0 + 3.0 * x + 0.1 * rng.normal(size=60)
    y[::9] += 4.0
    fit = robust_line(x, y)

    def loss(line: Float[np.ndarray, "2"]) -> float:
        share = np.minimum(((y - line[0] - line[1] * x) / (4.685 * fit.scale)) ** 2, 1.0)
        return float(np.sum(1.0 - (1.0 - share) ** 3))

    searched = optimize.minimize(loss, LINE, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12})
    np.testing.assert_allclose(fit.coefficients, searched.x, atol=1e-6)
    assert (fit.weight[::9] == 0.0).all()
    assert fit.scale == pytest.approx(0.1, rel=0.35)


def test_without_outliers_it_is_nearly_least_squares() -> None:
    rng = np.random.default_rng(4)
    x = np.linspace(0.0, 4.0, 400)
    y = 1.0 - 2.0 * x + 0.5 * x**2 + 0.1 * rng.normal(size=400)
    fit = robust_polynomial(x, y, 2)
    plain, covariance = np.polyfit(x, y, 2, cov=True)
    sigma = np.sqrt(np.diag(covariance))
    assert (np.abs(fit.coefficients[::-1] - plain) < 0.5 * sigma).all()
    np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance))[::-1], sigma, rtol=0.12)


def test_two_fifths_of_outliers_on_one_side_do_not_move_the_line() -> None:
    rng = np.random.default_rng(5)
    x = np.linspace(-1.0, 1.0, 100)
    y = LINE[0] + LINE[1] * x + 0.01 * rng.normal(size=100)
    y[rng.permutation(100)[:40]] += 5.0
    np.testing.assert_allclose(robust_line(x, y).coefficients, LINE, atol=0.02)


def test_a_line_without_noise_is_found_as_it_is() -> None:
    x = np.arange(10.0)
    np.testing.assert_allclose(robust_line(x, 2.0 + 3.0 * x).coefficients, LINE, rtol=1e-9)


def test_independent_records_of_a_series_with_memory() -> None:
    rng = np.random.default_rng(6)
    white = rng.normal(size=20_000)
    kept = np.empty(white.size)
    kept[0] = white[0]
    for now in range(1, white.size):
        kept[now] = 0.8 * kept[now - 1] + 0.6 * white[now]
    assert independent_share(kept) == pytest.approx(0.2 / 1.8, rel=0.15)
    assert independent_share(white) > 0.9
    assert independent_share(np.ones(50)) == 1.0


@pytest.mark.parametrize("name", ["few", "outliers", "groups"])
def test_intervals_of_level_and_slope_cover(name: str) -> None:
    shares = line_shares(name, DRAWS)
    low, high = covered_band(DRAWS)
    assert ((shares >= low) & (shares <= high)).all(), shares


def test_what_cannot_be_fitted_is_refused() -> None:
    x = np.arange(20.0)
    with refused("fit", 5, error=NotExcitedError, found=4):
        robust_line(x[:4], x[:4])
    with refused("fit", 2, error=NotExcitedError):
        robust_line(np.ones(20), x)
    with refused("fit", 5, error=NotExcitedError, found=3):
        robust_line(x, x + np.sin(7.0 * x), group=np.arange(20) // 7)
