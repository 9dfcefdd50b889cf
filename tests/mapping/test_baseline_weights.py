"""Weights of baselines: the best mean of noisy copies of one ground, halved in a year."""

import re
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from lgprjax.mapping.weights import HALF_LIFE_DAYS, moment_of, newer_than, weigh_baselines

TODAY = datetime(2026, 11, 22, tzinfo=UTC)
NONE = np.full((3, 3), np.nan)


def pairs(rho: np.ndarray) -> np.ndarray:
    return np.outer(rho, rho)


def test_agreement_gives_the_weights_of_the_best_mean() -> None:
    """Those of least squares with the whole covariance of what is heard, from the correlations alone."""
    rho = np.array([0.9, 0.8, 0.6, 0.85])
    covariance = np.outer(rho, rho) + np.diag(1.0 - rho**2)
    found = weigh_baselines([TODAY] * 4, covariance, np.full(4, np.nan))
    best = np.linalg.solve(covariance, rho)
    np.testing.assert_allclose([each.weight for each in found], best / best.max(), rtol=2e-3)
    # Two baselines share their noise.
    first, second = weigh_baselines([TODAY] * 2, pairs(np.array([0.95, 0.7])), np.full(2, np.nan))
    assert first.weight == pytest.approx(1.0)
    assert second.weight == pytest.approx(1.0, abs=1e-3)


def test_a_year_halves() -> None:
    dates = [TODAY, TODAY - timedelta(days=HALF_LIFE_DAYS), TODAY - timedelta(days=2 * HALF_LIFE_DAYS)]
    found = weigh_baselines(dates, pairs(np.full(3, 0.8)), np.full(3, np.nan))
    np.testing.assert_allclose([each.weight for each in found], [1.0, 0.5, 0.25], rtol=1e-3)
    assert re.findall(r"[\d.]+", found[1].reasons)[:2] == ["365", "0.50"]
    # Ground never vanishes.
    found = weigh_baselines([TODAY, TODAY - timedelta(days=20_000)], NONE[:2, :2], np.full(2, 0.6))
    assert found[1].weight == 0.05


def test_without_neighbours_the_signal_counts_and_without_anything_nothing() -> None:
    found = weigh_baselines([None] * 3, NONE, np.array([0.8, 0.4, np.nan]))
    assert found[0].weight == 1.0
    expected = np.sqrt(0.4) / 0.6 / (np.sqrt(0.8) / 0.2)
    assert found[1].weight == pytest.approx(expected, rel=1e-3)
    assert found[1].weight < found[2].weight < 1.0


def test_a_baseline_beside_no_other_is_judged_by_its_signal_among_others() -> None:
    agreement = NONE.copy()
    agreement[0, 1] = agreement[1, 0] = 0.64
    found = weigh_baselines([TODAY] * 3, agreement, np.array([np.nan, np.nan, 0.64]))
    np.testing.assert_allclose([each.weight for each in found], 1.0, rtol=2e-3)


def test_dates() -> None:
    assert moment_of("2026-01-01T00:00:00") == moment_of("2026-01-01T01:00:00+01:00")
    assert moment_of(None) is None
    assert moment_of("yesterday") is None
    dates = [moment_of("2026-01-01"), moment_of("2025-01-01"), None, moment_of("2026-01-01")]
    newer = newer_than(dates)
    assert np.argwhere(newer).tolist() == [[0, 1], [3, 1]]
