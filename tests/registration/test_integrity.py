"""Covariance of a peak and the order of the codes, by hand; what the options make of a prior."""

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.registration import Code, RegisterOptions, Thresholds, sigmas_along_cross
from lgprjax.registration.judge import judge
from lgprjax.registration.refine import RefinedPeak, covariance_of

HALF_WIDTH = np.array([0.5, 0.5, 0.08, 0.05, 0.03, 1.0])
# Position is uniform in its region; of height, heading and roll the region is three sigma.
PRIOR_SIGMA = HALF_WIDTH / np.array([np.sqrt(3.0), np.sqrt(3.0), 3.0, 3.0, 3.0, 3.0])
FREE = np.array([True, True, True, True, True, False])
CELL_M = np.array([0.04, 0.06])


def covariance(information: np.ndarray, narrow: tuple[bool, bool] = (False, False)) -> np.ndarray:
    """Of one summit."""
    summit = RefinedPeak(
        pose=jnp.zeros((1, 6), jnp.float32),
        correlation=jnp.full(1, 0.7, jnp.float32),
        overlap=jnp.ones(1, jnp.float32),
        information=jnp.asarray(information[None], dtype=jnp.float32),
        covered=jnp.ones((1, 11), bool),
        narrow=jnp.asarray([narrow]),
        asked=jnp.zeros((1, 6), jnp.float32),
    )
    widths = jnp.asarray(HALF_WIDTH[None], dtype=jnp.float32)
    found = covariance_of(summit, widths, jnp.asarray(FREE), jnp.asarray(CELL_M, dtype=jnp.float32))
    return np.asarray(found[0], dtype=np.float64)


def test_the_covariance_is_the_inverse_of_the_information_and_the_prior() -> None:
    """Information of the match beside that of the prior; axes coupled."""
    root = np.zeros((6, 6))
    root[:5, :5] = np.array([[7, 1, 0, 0, 2], [0, 5, 0, 0, 0], [0, 0, 9, 3, 0], [0, 0, 0, 6, 0], [0, 0, 0, 0, 8]])
    match = root.T @ root * 28.0
    information = (match + np.diag(1.0 / PRIOR_SIGMA**2))[:5, :5]
    np.testing.assert_allclose(covariance(match), np.linalg.inv(information), rtol=1e-3, atol=1e-8)


def test_a_flat_peak_leaves_the_region_and_a_line_is_as_wide_as_a_step_aside() -> None:
    """The map of a single channel: nothing tells where across it the vehicle stands, but that it stands on it."""
    flat = covariance(np.zeros((6, 6)))
    np.testing.assert_allclose(flat, np.diag(PRIOR_SIGMA[:5] ** 2), rtol=1e-4, atol=1e-9)
    sigma = np.sqrt(np.diag(covariance(np.zeros((6, 6)), (False, True))))
    assert sigma[0] == pytest.approx(PRIOR_SIGMA[0], rel=1e-3)
    assert sigma[1] == pytest.approx(CELL_M[1] / np.sqrt(3.0), rel=0.02)


T = Thresholds(strength_by_chance=5.0, margin_by_chance=1.0, overlap=0.6)
GOOD = {"score": 0.7, "rival": 0.4, "floor": 0.12, "best_overlap": 1.0, "on_edge": False, "finite": True}


CODES: list[tuple[dict[str, float | bool], Code]] = [
    ({}, Code.OK),
    ({"finite": False, "best_overlap": 0.0, "score": -1.0}, Code.NON_FINITE),
    ({"best_overlap": 0.0, "score": -1.0}, Code.OFF_MAP),
    ({"best_overlap": 0.59, "score": -1.0}, Code.LOW_OVERLAP),
    ({"score": 0.59, "on_edge": True, "rival": 0.58}, Code.LOW_CORRELATION),
    ({"score": 0.61}, Code.OK),
    ({"score": 0.61, "floor": 0.13}, Code.LOW_CORRELATION),
    ({"score": float("nan"), "rival": float("nan")}, Code.LOW_CORRELATION),
    ({"score": float("-inf")}, Code.LOW_CORRELATION),
    ({"on_edge": True, "rival": 0.7}, Code.EDGE),
    ({"rival": 0.59}, Code.AMBIGUOUS),
    ({"rival": 0.57}, Code.OK),
    ({"rival": float("nan")}, Code.AMBIGUOUS),
]


def test_the_first_reason_that_applies_is_the_code() -> None:
    thresholds = Thresholds(*(jnp.float32(value) for value in T))
    rows = [{**GOOD, **change} for change, _ in CODES]
    score, rival, floor, overlap = (
        jnp.asarray([row[name] for row in rows], dtype=jnp.float32)
        for name in ("score", "rival", "floor", "best_overlap")
    )
    on_edge, finite = (jnp.asarray([bool(row[name]) for row in rows]) for name in ("on_edge", "finite"))
    found = judge(score, rival, floor, overlap, on_edge, finite, thresholds)
    assert [int(code) for code in found] == [code for _, code in CODES]


def test_the_region_is_what_the_log_says_of_its_position() -> None:
    options = RegisterOptions()
    assert options.search_half_m() == 2.5
    assert options.search_half_m(np.array([0.2, np.nan])) == 2.5
    # Four sigma and half a metre, in halves of a metre, within bounds.
    assert options.search_half_m(np.array([0.2, 0.6])) == 3.0
    assert options.search_half_m(np.array([0.01])) == 2.0
    assert options.search_half_m(np.array([9.0])) == 6.0
    assert RegisterOptions(search_m=1.7).search_half_m(np.array([9.0])) == 1.7


def test_the_heading_is_searched_as_far_as_it_is_unsure() -> None:
    sigma = np.radians([0.1, 1.0, 4.0])
    widths = RegisterOptions().half_width(sigma, 2.5)
    np.testing.assert_allclose(np.degrees(widths[:, 3]), [1.0, 3.0, 5.0])
    assert np.all(widths[:, :2] == 2.5)


def test_codes_have_the_names_of_the_contract() -> None:
    names = ["ok", "low_correlation", "ambiguous", "edge", "off_map", "low_overlap", "non_finite", "no_window"]
    assert [code.label for code in Code] == names


def test_sigmas_along_and_across_are_those_of_the_turned_covariance() -> None:
    rng = np.random.default_rng(4)
    root = rng.normal(size=(20, 5, 5))
    covariance, yaw = root @ root.transpose(0, 2, 1), rng.uniform(-np.pi, np.pi, 20)
    along, cross = sigmas_along_cross(covariance, yaw)
    for number in range(20):
        cos, sin = np.cos(yaw[number]), np.sin(yaw[number])
        axes = np.array([[cos, sin], [-sin, cos]])
        turned = axes @ covariance[number, :2, :2] @ axes.T
        np.testing.assert_allclose([along[number], cross[number]], np.sqrt(np.diag(turned)), rtol=1e-12)
