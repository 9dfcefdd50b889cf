"""What the ground says of height, heading and roll, against matches drawn from known offsets.

The oracle is the linear Gaussian model itself: each match is an offset seen with known information, mixed with a prior.
"""

import numpy as np
import pytest

from lgprjax.radar import uniform_array
from lgprjax.registration import RegisterOptions
from lgprjax.registration.estimates import BOUNCE_M, WIDEST, AttitudeEstimate, Look, better_attitude, unknown_attitude
from lgprjax.registration.refine import PRIOR

CLAIMED_RAD = np.radians(0.3)
STEP_M = 0.1
SEEN = np.array([0.01, np.radians(1.5), np.radians(1.0)])
"""Standard deviations of one match by itself."""


def drive(
    estimate: AttitudeEstimate, truth: np.ndarray, seed: int, metres: float, moving: bool = True
) -> AttitudeEstimate:
    """Feed independent matches, eight at a time, as a search does; corrections are applied in between."""
    rng = np.random.default_rng(seed)
    for first in range(0, int(metres / STEP_M), 8):
        half = estimate.half_width(np.full(8, CLAIMED_RAD))
        offset, covariance = np.zeros((8, 3)), np.zeros((8, 3, 3))
        for row in range(8):
            prior = np.diag(np.asarray(PRIOR[2:5]) / half[row] ** 2)
            own = np.diag(SEEN**-2.0)
            seen = truth - estimate.applied + SEEN * rng.standard_normal(3)
            covariance[row] = np.linalg.inv(own + prior)
            offset[row] = covariance[row] @ own @ seen
        path_m = STEP_M * (first + np.arange(8)) * moving
        estimate.take(offset, covariance, half, path_m, np.zeros(8), np.full(8, CLAIMED_RAD))
        wanted = estimate.correction()
        if wanted is not None:
            estimate.applied = wanted
    return estimate


def fresh(channels: int = 9, wavelength_m: float = STEP_M) -> AttitudeEstimate:
    return AttitudeEstimate(RegisterOptions(), channels, wavelength_m, 1.0, np.zeros(3))


@pytest.mark.parametrize("heading_deg", [-12.0, 6.0])
def test_a_false_claim_is_contradicted_and_corrected(heading_deg: float) -> None:
    truth = np.array([0.2, np.radians(heading_deg), np.radians(-4.0)])
    off = []
    for seed in range(40):
        found = drive(fresh(), truth, seed, 8.0)
        off.append((found.applied - truth) / SEEN)
    # Eight metres are some fifty matches with fading: a mean of that many, less what is not worth a correction.
    assert np.max(np.abs(np.mean(off, axis=0))) < 0.2
    assert np.max(np.std(off, axis=0)) < 0.6


def test_a_true_claim_is_left_alone() -> None:
    truth = np.array([0.01, CLAIMED_RAD, np.radians(0.2)])
    changed = [np.any(drive(fresh(), truth, seed, 8.0).applied != 0.0) for seed in range(40)]
    assert np.mean(changed) <= 0.1


def test_the_region_narrows_to_the_claim_with_evidence_alone() -> None:
    claimed = RegisterOptions().half_width(np.full(1, CLAIMED_RAD), 1.0)[0, 2:5]
    at_first = fresh().half_width(np.full(1, CLAIMED_RAD))[0]
    later = drive(fresh(), np.zeros(3), 1, 12.0).half_width(np.full(1, CLAIMED_RAD))[0]
    assert np.all(at_first >= 0.99 * WIDEST)
    assert np.all(later < 0.35 * at_first)
    assert np.all(later >= claimed)


def test_the_same_ground_is_no_new_evidence() -> None:
    """A vehicle that stands still, or windows that share their ground, do not make sure by repetition."""
    one = drive(fresh(), np.zeros(3), 2, 0.8).half_width(np.full(1, CLAIMED_RAD))[0]
    standing = drive(fresh(), np.zeros(3), 2, 8.0, moving=False)
    again = standing.half_width(np.full(1, CLAIMED_RAD))[0]
    assert np.all(again >= one)


def test_few_channels_take_the_claim_as_it_is() -> None:
    found = drive(fresh(channels=3), np.array([0.2, 0.2, 0.1]), 3, 8.0)
    assert np.all(found.applied == 0.0)
    claimed = RegisterOptions().half_width(np.full(1, CLAIMED_RAD), 1.0)[0, 2:5]
    np.testing.assert_array_equal(found.half_width(np.full(1, CLAIMED_RAD))[0], claimed)


def test_a_heading_that_is_fed_back_is_not_corrected_twice() -> None:
    """Its region reaches as far as the ground says; height and roll, which no filter corrects, are."""
    estimate = AttitudeEstimate(RegisterOptions(), 9, STEP_M, 1.0, np.zeros(3), fed_back=True)
    truth = np.array([0.2, np.radians(6.0), np.radians(-4.0)])
    drive(estimate, truth, 5, 8.0)
    assert estimate.applied[1] == 0.0
    assert np.all(np.abs(estimate.applied - truth)[[0, 2]] < [0.02, np.radians(1.0)])
    assert estimate.half_width(np.full(1, CLAIMED_RAD))[0, 1] > np.radians(6.0)


def test_what_was_found_by_trial_gives_way_to_matches() -> None:
    estimate = fresh()
    estimate.suppose(np.array([0.0, np.radians(4.0), 0.0]))
    wanted = estimate.correction()
    assert wanted is not None
    estimate.applied = wanted
    assert estimate.applied[1] == pytest.approx(np.radians(4.0))
    truth = np.array([0.0, np.radians(6.5), 0.0])
    drive(estimate, truth, 4, 8.0)
    assert np.degrees(abs(estimate.applied[1] - truth[1])) < 1.0


HERE, BESIDE, ELSEWHERE = np.zeros(2), np.array([0.1, 0.0]), np.array([0.8, 0.0])


def looks(*found: tuple[float, np.ndarray]) -> list[Look]:
    """Scores in noise floors of a tenth, and places."""
    return [Look(0.1 * z, 0.1, 0.0, place) for z, place in found]


ATTITUDES: list[tuple[list[tuple[float, np.ndarray]], int | None]] = [
    # Nothing matches as the log has it, one attitude does.
    ([(3.0, HERE), (3.2, ELSEWHERE), (9.0, BESIDE)], 2),
    # Others lead to the same place: which of them is the true one does no harm.
    ([(3.0, BESIDE), (8.5, BESIDE), (9.0, HERE)], 2),
    # Ground that comes again on a bend: turned by as much, the next period fits about as well.
    ([(7.0, HERE), (8.4, HERE), (9.0, ELSEWHERE)], None),
    # The same where scores are high: a step between attitudes costs the true place more than noise does.
    ([(10.0, HERE), (14.4, HERE), (15.5, ELSEWHERE)], None),
    # Hardly better than the present one.
    ([(8.0, HERE), (9.0, HERE)], None),
    ([(8.0, HERE)], None),
]


def test_another_attitude_is_taken_where_no_other_place_is_about_as_good() -> None:
    for found, taken in ATTITUDES:
        assert better_attitude(looks(*found), apart_m=0.3) == taken, found


@pytest.mark.parametrize("width_m", [0.7, 1.4])
def test_an_array_on_two_baselines_rolls_with_their_heights(width_m: float) -> None:
    """Half of the array on ground that is too high by one bounce, half by another: the straight line through them."""
    channels = 8
    array = uniform_array(channels, width_m / (channels - 1))
    rng = np.random.default_rng(8)
    tilts = []
    for _ in range(2000):
        heights = BOUNCE_M * np.repeat(rng.standard_normal(2), channels // 2)
        tilts.append(np.polyfit(array.y_m, heights, 1)[0])
    said = unknown_attitude(array, 50.0, 0.0)
    # Somewhere between an array on one baseline, whose roll is as good as its match, and one on two equal halves.
    assert 0.0 < said[2] < np.std(tilts) < 3.0 * said[2]
    assert said[0] == pytest.approx(BOUNCE_M)
    assert said[1] == 0.0


def test_a_time_scale_half_a_percent_off_is_a_height() -> None:
    """An echo late in the profile is delayed by the scale as by a height: the longer the profile, the more."""
    array = uniform_array(8, 0.1)
    late_ns = 0.005 * 200.0 / 3.0
    said = unknown_attitude(array, 200.0, 0.005)
    assert said[0] == pytest.approx(np.hypot(BOUNCE_M, 0.299792458 * late_ns / 2.0))
