"""Thresholds from made-up matches whose statistics are known."""

import numpy as np
import pytest

from lgprjax.registration import Fix, Outcomes, calibrate, joined, outcomes_of, squared_errors
from lgprjax.registration.calibrate import sigma_scale, tail_limit

RNG = np.random.default_rng(7)


def outcomes(count: int, strength: np.ndarray, lead: np.ndarray, right: bool, scale: float = 1.0) -> Outcomes:
    """Matches of scatter 0.1; errors ``scale`` times the sigma that the match claims, about a common offset."""
    spread = scale * RNG.normal(size=(count, 2)) * [0.01, 0.02]
    return Outcomes(
        score=0.1 * strength,
        margin=0.1 * lead,
        noise_floor=np.full(count, 0.1),
        right=np.full(count, right),
        error_m=spread + [0.01, -0.005],
        spread_m=spread,
        match_covariance=np.tile(np.diag([0.01**2, 0.02**2]), (count, 1, 1)),
        other_covariance=np.tile(0.01**2 * np.eye(2), (count, 1, 1)),
    )


def test_the_tail_of_an_exponential_is_read_off() -> None:
    """A value of mean 0.4 beyond 2 exceeds 2 + 0.4 ln(1/risk) with probability risk."""
    values, risk = 2.0 + RNG.exponential(0.4, 200_000), 1e-5
    assert tail_limit(values, risk) == pytest.approx(2.0 + 0.4 * np.log(1.0 / risk), rel=0.05)


def test_false_matches_stay_below_and_right_ones_pass() -> None:
    count = 20_000
    false = outcomes(count, 2.5 + RNG.exponential(0.35, count), RNG.exponential(0.45, count), False)
    true = outcomes(4000, RNG.normal(9.0, 0.8, 4000), RNG.normal(7.0, 0.8, 4000), True)
    found = calibrate(true, false, 1e-4)
    assert found.strength_by_chance == pytest.approx(2.5 + 0.35 * np.log(1e4), rel=0.06)
    # Score and lead are both passed by chance: each limit of the lead is for the square root of the risk.
    assert found.margin_by_chance == pytest.approx(0.45 * np.log(1e2), rel=0.06)
    fresh = 2.5 + RNG.exponential(0.35, 1_000_000)
    assert np.mean(fresh >= found.strength_by_chance) < 4e-4
    passed = (true.score >= found.strength_by_chance * 0.1) & (true.margin >= found.margin_by_chance * 0.1)
    assert passed.mean() > 0.97


def test_a_wrong_match_on_the_right_ground_raises_the_lead() -> None:
    false = outcomes(5000, 2.5 + RNG.exponential(0.3, 5000), RNG.exponential(0.1, 5000), False)
    true = outcomes(1000, np.full(1000, 9.0), np.full(1000, 8.0), True)
    twin = outcomes(20, np.full(20, 9.0), np.full(20, 5.0), False)
    assert calibrate(true, false, 1e-3).margin_by_chance < 5.0
    assert calibrate(joined([true, twin]), false, 1e-3).margin_by_chance == pytest.approx(6.0)


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_the_sigma_scale_is_that_of_the_errors(scale: float) -> None:
    matches = outcomes(20_000, np.full(20_000, 9.0), np.full(20_000, 8.0), True, scale)
    assert sigma_scale(matches) == pytest.approx(scale, rel=0.03)
    # The offset of 1.1 cm is covered by the labels' centimetre: two numbers, mean squared error near 2.
    nees = squared_errors(matches, scale)
    by_hand = matches.error_m**2 / (scale**2 * np.array([0.01, 0.02]) ** 2 + 0.01**2)
    np.testing.assert_allclose(nees, by_hand.sum(axis=1), rtol=1e-6)


def test_too_little_to_go_by_is_said() -> None:
    few, enough = (outcomes(n, np.full(n, 3.0), np.full(n, 0.5), False) for n in (50, 500))
    true = outcomes(10, np.full(10, 9.0), np.full(10, 8.0), True)
    with pytest.raises(ValueError, match="50"):
        calibrate(true, few, 1e-4)
    with pytest.raises(ValueError, match=r"\btrue\b"):
        calibrate(enough, enough, 1e-4)


def test_outcomes_know_right_from_wrong_and_leave_out_what_reached_no_place() -> None:
    pose = np.array([[1.0, 2.0, 0, 0, 0], [1.5, 2.0, 0, 0, 0], [np.nan] * 5, [1.02, 2.0, 0, 0, 0]])
    blank = np.zeros(4)
    covariance = np.tile(np.diag([0.03**2, 0.03**2, 1, 1, 1]), (4, 1, 1))
    fix = Fix(
        pose,
        covariance,
        blank,
        blank + 0.1,
        blank + 0.4,
        blank + 0.1,
        blank.astype(int),
        blank + 1,
        blank,
        blank,
        blank,
    )
    truth = np.tile([1.0, 2.0], (4, 1))
    found = outcomes_of(fix, truth, np.tile(0.01**2 * np.eye(2), (4, 1, 1)), np.full(4, 0.02**2))
    assert found.right.tolist() == [True, False, True]
    np.testing.assert_allclose(found.score, 0.5)
    np.testing.assert_allclose(found.match_covariance[0], (0.03**2 - 0.01**2) * np.eye(2))
    np.testing.assert_allclose(found.other_covariance, np.tile((0.01**2 + 0.02**2) * np.eye(2), (3, 1, 1)))
    np.testing.assert_allclose(found.spread_m[0], [-0.01, 0.0])
