"""What a fix is worth against chance: against brute force, and against tails that are known."""

import numpy as np
import pytest
from scipy.stats import chi2, norm

from lgprjax.registration import (
    LADDER_M,
    POOLED,
    Chance,
    fit_chance,
    fit_sigma_scale,
    p_foreign,
    p_rival,
    thresholds_at,
)

RISK = 1e-4
WINDOWS = len(LADDER_M)


@pytest.mark.parametrize(("z", "rival"), [(3.0, 2.0), (2.2, 0.0)])
def test_no_resemblance_makes_a_mistake_more_probable_than_the_bound(z: float, rival: float) -> None:
    """The stated model, drawn: live data of the rival's ground, a best place that resembles it, noise in every number.

    Of the draws in which the rival scores as it did, the share in which the other place scores z or more is never
    above the bound, and reaches it at the worst resemblance.
    """
    rng = np.random.default_rng(5)
    numbers, draws, near = 6, 1_000_000, 0.05
    bound = float(p_rival(np.array(z), np.array(rival)))
    true = np.eye(numbers)[0]
    live = rival * true + rng.normal(size=(draws, numbers))
    alike = live[np.abs(live @ true - rival) < near]
    shares = []
    for resemblance in np.unique([0.0, 0.3, 0.5, rival / z, 0.8, 0.95]):
        other = np.zeros(numbers)
        other[:2] = resemblance, np.sqrt(1.0 - resemblance**2)
        shares.append(np.mean(alike @ other >= z))
    error = np.sqrt(bound / len(alike))
    # A rival is told within 0.05: that moves the bound a little, too.
    slack = float(p_rival(np.array(z), np.array(rival + near))) - bound
    assert max(shares) <= bound + slack + 4.0 * error
    assert max(shares) >= bound - slack - 4.0 * error


def test_a_rival_as_high_is_a_toss() -> None:
    np.testing.assert_allclose(p_rival(np.array([5.0, 4.0, 0.0]), np.array([5.0, 9.0, 0.0])), 0.5, atol=1e-6)
    assert p_rival(np.array(6.0), np.array(-3.0)) == pytest.approx(norm.sf(6.0), rel=1e-3)


def field_pieces(rng: np.random.Generator, pieces: int, places: int) -> np.ndarray:
    """Largest of so many independent normal scores in each piece, the same in all windows: [piece, window]."""
    return np.asarray(rng.normal(size=(pieces, places, WINDOWS)).max(axis=1))


def claimed_z(chance: Chance, risk: float) -> np.ndarray:
    """Score that a search of the same area is believed at, in each window."""
    z = np.linspace(0.0, 12.0, 24_001)
    p = p_foreign(np.tile(z[:, None], WINDOWS), np.tile(chance.area_m2, (len(z), 1)), chance, 1.0)
    return np.asarray(z[np.argmax(p <= risk, axis=0)])


def test_the_risk_that_is_claimed_holds_on_a_gaussian_field() -> None:
    """Best of 200 places, exact tail, which falls faster than the fit's: no claim below the truth, none far above."""
    rng, places, true = np.random.default_rng(0), 200, []
    for _ in range(15):
        z = claimed_z(fit_chance(field_pieces(rng, 240, places), np.full((240, WINDOWS), 8.0), 240.0), RISK)
        true.append(-np.expm1(places * np.log1p(-norm.sf(z))))
    told = np.concatenate(true)
    assert np.max(told) <= RISK
    assert np.median(told) > 1e-7


def test_the_risk_that_is_claimed_holds_on_an_exponential_tail() -> None:
    """Nothing helps the fit here: z² falls exactly as it assumes, and its safety alone makes the claim hold."""
    rng, scale, told = np.random.default_rng(1), 6.0, []
    for _ in range(40):
        square = 10.0 + rng.exponential(scale, size=(240, WINDOWS))
        z = claimed_z(fit_chance(np.sqrt(square), np.full((240, WINDOWS), 8.0), 240.0), RISK)
        told.append(np.exp(-(z**2 - 10.0) / scale))
    share = np.mean(np.concatenate(told) <= RISK)
    assert 0.8 <= share < 1.0
    assert 1e-6 < np.median(np.concatenate(told)) < RISK


def test_few_pieces_borrow_the_pooled_tail() -> None:
    rng = np.random.default_rng(2)
    few = fit_chance(field_pieces(rng, 59, 100), np.full((59, WINDOWS), 8.0), 30.0)
    assert (few.pieces, few.own) == (30, False)
    for name in ("start", "share", "scale", "area_m2"):
        np.testing.assert_array_equal(getattr(few, name), getattr(POOLED, name))
    highest = field_pieces(rng, 200, 100)
    # Of the longest window there are too few.
    highest[40:, -1] = np.nan
    some = fit_chance(highest, np.full((200, WINDOWS), 5.0), 200.0)
    assert some.own
    assert some.start[-1] == POOLED.start[-1]
    assert some.area_m2.tolist() == [5.0] * (WINDOWS - 1) + [POOLED.area_m2[-1]]
    assert some.start[0] == pytest.approx(chi2.isf(2 * 0.001, 1), rel=0.15)
    # Pieces that share their ground tell nothing of a tail.
    shared = fit_chance(highest, np.full((200, WINDOWS), 5.0), 5.0)
    assert (shared.pieces, shared.own) == (5, False)
    for name in ("start", "share", "scale", "area_m2"):
        np.testing.assert_array_equal(getattr(shared, name), getattr(POOLED, name))


def test_more_places_and_more_trials_have_more_chances() -> None:
    z = np.full(WINDOWS, 7.0)
    once = p_foreign(z, POOLED.area_m2, POOLED, 1.0)
    np.testing.assert_allclose(p_foreign(z, 3.0 * POOLED.area_m2, POOLED, 1.0), 3.0 * once, rtol=1e-9)
    np.testing.assert_allclose(p_foreign(z, POOLED.area_m2, POOLED, 25.0), np.minimum(25.0 * once, 1.0), rtol=1e-9)
    at_start = p_foreign(np.sqrt(POOLED.start), POOLED.area_m2, POOLED, 1.0)
    np.testing.assert_allclose(at_start, POOLED.share, rtol=1e-9)
    every = p_foreign(np.tile(np.linspace(-2.0, 9.0, 200)[:, None], WINDOWS), np.full((200, WINDOWS), 8.0), POOLED, 1.0)
    assert np.all(np.diff(every, axis=0) <= 0.0)
    np.testing.assert_allclose(every[0], 8.0 / POOLED.area_m2)


def test_other_lengths_are_judged_as_the_next_shorter_one() -> None:
    chance = POOLED._replace(start=np.arange(10.0, 10.0 + WINDOWS))
    start = chance.for_windows((0.0, 0.5, 1.0, 3.9, 4.0, 10.0), 0.4).start
    np.testing.assert_array_equal(start, [10.0, 10.0, 11.0, 12.0, 13.0, 14.0])


def test_a_single_search_is_asked_for_what_its_risk_takes() -> None:
    window_m = 4.0
    thresholds = thresholds_at(RISK, window_m, 9.0, 0.4)
    own = POOLED.for_windows((window_m,), 0.4)
    p = p_foreign(np.array([thresholds.strength_by_chance]), np.array([9.0]), own, 1.0)
    # A piece has ten independent looks, a single match is one of them.
    assert p[0] == pytest.approx(10.0 * RISK, rel=1e-6)


def test_a_sigma_scale_is_what_left_out_pieces_say() -> None:
    draw = np.random.default_rng(5)
    # Errors 1.6 sigmas wide in both directions, from 400 pieces: what many grounds have counts for 20.
    squared = 0.5 * np.sum((1.6 * draw.standard_normal((400, 2))) ** 2, axis=1)
    scale, pieces = fit_sigma_scale(squared, 0.1, 0.1, 0.4)
    assert pieces == 400
    assert scale == pytest.approx(1.6, abs=0.08)


def test_few_pieces_say_little_and_a_wrong_match_no_more_than_its_share() -> None:
    pooled, none = fit_sigma_scale(np.zeros(0), 0.1, 0.1, 0.4)
    assert none == 0
    assert pooled == pytest.approx(POOLED.sigma_scale)
    few, _ = fit_sigma_scale(np.full(5, 0.2), 0.1, 0.1, 0.4)
    assert 1.0 < few < pooled
    good = np.full(50, 1.0)
    assert fit_sigma_scale(np.append(good, 1e6), 0.1, 0.1, 0.4)[0] < 1.4


def test_lines_farther_apart_than_half_a_wavelength_widen_the_sigmas() -> None:
    near, at_half, beyond = (
        fit_sigma_scale(np.zeros(0), spacing_m, spacing_m, 0.4)[0] for spacing_m in (0.05, 0.2, 0.4)
    )
    assert near == at_half
    assert beyond == pytest.approx(2.0**0.5 * near)
    # What a wider gap adds where a line is left out is not the map's.
    squared = np.full(2000, 3.0)
    assert fit_sigma_scale(squared, 0.2, 0.4, 0.4)[0] == pytest.approx(1.5**0.5, rel=0.01)
    assert fit_sigma_scale(squared, 0.05, 0.1, 0.4)[0] == pytest.approx(3.0**0.5, rel=0.01)
