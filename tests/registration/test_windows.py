"""Windows of the ladder where the stretch of known travel is shorter than they are, and their noise floors."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from lgprjax.registration.coarse import Peaks
from lgprjax.registration.evidence import EvidenceSearch
from lgprjax.registration.queries import Stops

LADDER_M, SPACING_M = (0.0, 1.0, 2.0, 4.0, 8.0), 0.1


def made_search() -> Any:
    search: Any = object.__new__(EvidenceSearch)
    search.plan = SimpleNamespace(windows_m=LADDER_M, spacing_m=SPACING_M)
    search._wavelength_m = 0.3
    return search


def made_stops(metres: float, jump_m: float = np.inf) -> Stops:
    path_m = SPACING_M * np.arange(round(metres / SPACING_M) + 1)
    none, count = np.zeros(len(path_m)), len(path_m)
    traces = np.zeros((count, 1, 2), np.float32)
    valid, leg = np.ones((count, 1), bool), (path_m >= jump_m).astype(int)
    return Stops(np.arange(count), traces, traces, valid, np.zeros((count, 5)), none, none, traces[:, 0], path_m, leg)


def peaks_with(floor: np.ndarray) -> Peaks:
    """Nothing but noise floors."""
    none, flags = 0.0 * floor, np.zeros(floor.shape, bool)
    whole = np.zeros(floor.shape, int)
    return Peaks(np.zeros((*floor.shape, 2)), whole, none, none, floor, none, none, none, flags, whole)


def test_a_leg_is_matched_whole_by_windows_that_it_is_too_short_for() -> None:
    stops = made_stops(20.0, jump_m=10.0)
    first = made_search()._first_of(stops, np.arange(len(stops.path_m)))
    lengths = np.where(first >= 0, stops.path_m[:, None] - stops.path_m[np.maximum(first, 0)], np.nan)
    since = stops.path_m - np.where(stops.leg == 1, 10.0, 0.0)
    for number, length_m in enumerate(LADDER_M):
        shorter_m = LADDER_M[number - 1] if number else 0.0
        known = np.isfinite(lengths[:, number])
        # There as soon as it holds more than the next shorter one, never longer than its length or its leg.
        assert known[since >= max(1.3 * shorter_m, 0.5 * length_m) + SPACING_M].all()
        assert not known[since < max(1.2 * shorter_m, 0.5 * length_m) - SPACING_M].any()
        wanted = np.minimum(since, length_m)
        np.testing.assert_allclose(lengths[known, number], wanted[known], atol=SPACING_M + 1e-6)


def test_a_noise_floor_is_that_of_windows_of_its_own_length() -> None:
    """Noise in each scan, independent of the others': floors fall with the root of what a window holds."""
    search, stops = made_search(), made_stops(30.0)
    count = len(stops.path_m)
    at = np.arange(count)
    first = search._first_of(stops, at)
    members = at[:, None] + 1 - first
    rng = np.random.default_rng(2)
    # Where a window does not fit, what there is would be a shorter one: it must not count.
    floor = np.where(first >= 0, 0.3 / np.sqrt(members), 0.9) * rng.uniform(0.9, 1.1, size=members.shape)
    search._floor = np.zeros((4, count, len(LADDER_M)))
    pooled = search._settled_floor(stops, at, first, peaks_with(floor))
    known = first >= 0
    np.testing.assert_allclose(pooled[known], (0.3 / np.sqrt(members))[known], rtol=0.1)
    assert np.all(pooled[~known] == 0.5)
