"""Distances from a baseline, against geometry."""

import numpy as np
import pytest

from lgprjax.simulation.loop import cross_track_m, tracking_error


def _circle(radius_m: float, step_m: float, laps: float = 1.0) -> np.ndarray:
    angle = np.arange(0.0, 2.0 * np.pi * laps, step_m / radius_m)
    return np.stack([radius_m * np.cos(angle), radius_m * np.sin(angle)], axis=1)


def test_offset_from_a_circle_is_the_difference_of_radii() -> None:
    baseline = _circle(30.0, 0.1)
    inside = _circle(29.8, 0.21)[:-2]
    cross = cross_track_m(inside, baseline)
    # Counter-clockwise the centre is to the left; the chord's sagitta is 0.04 mm.
    assert cross == pytest.approx(np.full(len(inside), 0.2), abs=1e-4)
    found = tracking_error(inside, baseline, np.ones(len(inside), bool))
    assert found.rms_m == pytest.approx(0.2, abs=1e-4)
    assert found.within_foot == pytest.approx(1.0)
    assert found.way_m == pytest.approx(2.0 * np.pi * 29.8, rel=0.01)


def test_the_distance_is_to_the_line_not_to_a_point() -> None:
    baseline = np.stack([np.arange(0.0, 10.0, 0.5), np.zeros(20)], axis=1)
    track = np.array([[0.25, 0.1], [1.25, -0.1], [2.75, 0.4]])
    assert cross_track_m(track, baseline) == pytest.approx([0.1, -0.1, 0.4], abs=1e-12)


def test_a_baseline_that_crosses_itself_is_followed() -> None:
    angle = np.arange(0.0, 2.0 * np.pi, 0.005)
    eight = np.stack([20.0 * np.sin(angle), 20.0 * np.sin(angle) * np.cos(angle)], axis=1)
    cross = cross_track_m(eight[::2], eight)
    assert np.abs(cross).max() < 1e-9


def test_share_within_a_foot_is_by_length() -> None:
    baseline = np.stack([np.arange(0.0, 101.0), np.zeros(101)], axis=1)
    x = np.arange(0.0, 100.0, 0.5)
    track = np.stack([x, np.where(x < 25.0, 0.4, 0.1)], axis=1)
    found = tracking_error(track, baseline, np.ones(len(track), bool))
    assert found.within_foot == pytest.approx(0.75, abs=0.01)
    assert found.largest_m == pytest.approx(0.4)
    assert found.rms_m == pytest.approx(np.sqrt(0.25 * 0.4**2 + 0.75 * 0.1**2), rel=0.01)
