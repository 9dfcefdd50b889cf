"""The relative metric of the literature, on errors that are made up."""

import numpy as np
import pytest

from benchmarks.accuracy import Labels, relative_error


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
