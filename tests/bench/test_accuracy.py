"""Accuracy from made-up errors: the relative metric of the literature, a row of map precisions."""

import numpy as np
import pytest

from benchmarks.accuracy import Labels, fit_fix_errors, relative_error
from benchmarks.map_precision import Outcome, Size, ratio_of, row_of


def test_relative_error_is_free_of_labels_and_lag() -> None:
    rng = np.random.default_rng(1)
    x = np.arange(0.0, 200.0, 0.25)
    truth = np.stack([x, np.full(len(x), 0.3)], axis=1)
    labelled = np.stack([x, np.zeros(len(x))], axis=1)
    label_error = np.stack([0.2 * np.sin(x / 30.0), 0.1 * np.cos(x / 40.0)], axis=1)
    lag = np.array([0.5, 0.0])
    noise = rng.normal(size=(len(x), 2)) * [0.05, 0.02]
    found = relative_error(label_error + lag + noise, truth, np.zeros(len(x)), Labels(labelled, label_error))
    assert found.cross_mean_m == pytest.approx(np.mean(np.abs(noise[:, 1])), rel=1e-6)
    assert found.mean_m == pytest.approx(np.mean(np.hypot(noise[:, 0] - np.median(noise[:, 0]), noise[:, 1])), rel=1e-3)


def test_places_far_from_the_map_take_no_part() -> None:
    truth = np.array([[0.0, 0.0], [0.0, 50.0]])
    found = relative_error(np.array([[0.0, 0.1], [0.0, 9.0]]), truth, np.zeros(2), Labels(truth[:1], np.zeros((1, 2))))
    assert found.cross_mean_m == pytest.approx(0.1)


def test_too_few_fixes_are_refused() -> None:
    travel = np.arange(60.0)
    with pytest.raises(ValueError, match="20"):
        fit_fix_errors(travel, travel < 20, np.zeros((60, 3)), np.ones(60), np.zeros(60))


def test_a_row_tells_errors_of_what_is_ok_and_how_sure_their_ratio_is() -> None:
    rng = np.random.default_rng(1)
    error_m, ok = np.abs(rng.normal(0.0, 0.01, 2800)), np.ones(2800, bool)
    error_m[:100], ok[:100] = np.nan, False
    full, worse = (Outcome(scale * error_m, ok, 1, 50) for scale in (1.0, 1.5))
    low, high = ratio_of(worse, full, np.random.default_rng(0))
    assert (low, high) == pytest.approx((1.5, 1.5), abs=1e-6)
    sizes = [Size(10.0, 1000, 800, 1600, 0.9), Size(30.0, 3000, 2400, 4800, 0.7)]
    assert row_of("y", sizes, worse, full)["rms_ratio"] == pytest.approx(1.5, abs=1e-3)
    worse.error_m[200] = 0.4
    row = row_of("x", sizes, worse, full)
    assert (row["bytes_per_m"], row["trace_bytes_per_m"], row["bits_a_number"]) == (100, 80, 4.0)
    assert row["correlation"] == 0.8
    assert row["ok"] == pytest.approx(2700 / 2800, abs=1e-4)
    assert (row["wrong_ok"], row["impostor_ok"], row["scans"]) == (1, 1, 2800)
    other = Outcome(np.abs(rng.normal(0.0, 0.01, 2800)), ok, 1, 50)
    low, high = ratio_of(other, full, np.random.default_rng(0))
    assert low < 1.0 < high
    assert high - low < 0.2
