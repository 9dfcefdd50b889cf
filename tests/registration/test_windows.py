"""Windows of the ladder where the stretch of known travel is shorter than they are, and their noise floors."""

import numpy as np
import pytest

from lgprjax.registration.coarse import Peaks
from lgprjax.registration.estimates import AttitudeEstimate
from lgprjax.registration.evidence import EvidenceSearch
from lgprjax.registration.judge import POOLED, RegisterOptions
from lgprjax.registration.lattice import ErrorLattice
from lgprjax.registration.queries import SearchSizes, Stops
from lgprjax.registration.windows import WindowJudge

LADDER_M, SPACING_M = (0.0, 1.0, 2.0, 4.0, 8.0), 0.1


def made_judge() -> WindowJudge:
    """Of an array 1.4 m wide; windows and floors need neither lattice nor attitudes."""
    plan = SearchSizes(SPACING_M, np.full(2, 0.1), LADDER_M, 80, 8, 0.3)
    lattice, attitude = object.__new__(ErrorLattice), object.__new__(AttitudeEstimate)
    return WindowJudge(1.4, 0.3, plan, RegisterOptions(), POOLED, lattice, attitude)


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
    first = made_judge().first_of(stops, np.arange(len(stops.path_m)))
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
    judge, stops = made_judge(), made_stops(30.0)
    count = len(stops.path_m)
    at = np.arange(count)
    first = judge.first_of(stops, at)
    members = at[:, None] + 1 - first
    rng = np.random.default_rng(2)
    # Where a window does not fit, what there is would be a shorter one: it must not count.
    floor = np.where(first >= 0, 0.3 / np.sqrt(members), 0.9) * rng.uniform(0.9, 1.1, size=members.shape)
    judge.make_room(count)
    pooled = judge.settled_floor(stops, at, first, peaks_with(floor))
    known = first >= 0
    np.testing.assert_allclose(pooled[known], (0.3 / np.sqrt(members))[known], rtol=0.1)
    assert np.all(pooled[~known] == 0.5)


def test_a_place_found_about_a_known_one_is_no_surer_than_that_one() -> None:
    """A jump inside the small region about it; without a place, the region it was found in counts."""
    judge = made_judge()
    judge.take(10.0, np.zeros(2), 2500.0, 7.0)
    assert judge.place.found_m == 10.0
    assert judge.place.found_in == pytest.approx((25.0, 7.0))
    judge.take(12.0, np.array([0.26, 0.0]), 49.0, 1.0)
    assert judge.place.found_m == 12.0
    assert judge.place.found_in == pytest.approx((25.0, 7.0))
    # A place carried back holds every window against all that was searched for it, wherever it moves.
    judge.place = judge.place._replace(found_m=np.inf)
    judge.take(14.0, np.array([0.6, 0.0]), 49.0, 1.0)
    assert judge.place.found_m == np.inf
    assert judge.place.found_in == pytest.approx((25.0, 7.0))


def test_what_a_prior_is_off_by_is_not_smoothed_over_unknown_travel() -> None:
    stops = made_stops(10.0, jump_m=5.0)
    away = np.where(stops.leg[:, None] == 1, np.array([10.0, 0.0]), 0.0)
    pose = stops.pose.copy()
    pose[:, :2] = away
    stops = stops._replace(pose=pose, reckoned_m=np.zeros_like(away))
    found = EvidenceSearch._astray(object.__new__(EvidenceSearch), stops)
    np.testing.assert_array_equal(found, away)
