"""Covariance of a peak and the order of the codes, by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.registration import Code, RegisterOptions, Thresholds, default_thresholds
from lgprjax.registration.integrity import judge, peak_covariance, stencil_poses

STEPS = np.array([0.05, 0.06, 0.02, 0.01, 0.01])
HALF_WIDTH = np.array([0.5, 0.5, 0.08, 0.05, 0.03])
# Position is uniform in its region; of height, heading and roll the region is three sigma.
PRIOR_SIGMA = HALF_WIDTH / np.array([np.sqrt(3.0), np.sqrt(3.0), 3.0, 3.0, 3.0])


def parabola(hessian: np.ndarray, r: float) -> np.ndarray:
    """Correlations at the stencil of a summit of the given curvature."""
    pose = np.asarray(stencil_poses(jnp.zeros(5, jnp.float32), jnp.asarray(STEPS, dtype=jnp.float32)), float)
    return np.asarray(r + 0.5 * np.einsum("pi,ij,pj->p", pose, hessian, pose))


def covariance(stencil: np.ndarray, floor: float) -> np.ndarray:
    return np.asarray(
        peak_covariance(
            jnp.asarray(stencil, dtype=jnp.float32),
            jnp.asarray(STEPS, dtype=jnp.float32),
            jnp.float32(floor),
            jnp.asarray(HALF_WIDTH, dtype=jnp.float32),
        ),
        dtype=np.float64,
    )


def test_the_covariance_is_the_inverse_of_the_curvature_and_the_prior() -> None:
    """N r / (1 - r²) times the curvature, N = 1 / floor², beside the prior; axes coupled."""
    root = np.array(
        [[7.0, 1.0, 0, 0, 2.0], [0, 5.0, 0, 0, 0], [0, 0, 9.0, 3.0, 0], [0, 0, 0, 6.0, 0], [0, 0, 0, 0, 8.0]]
    )
    hessian = -root.T @ root * 0.1
    r, floor = 0.8, 0.1
    information = -hessian * 100.0 * r / (1 - r**2) + np.diag(1.0 / PRIOR_SIGMA**2)
    np.testing.assert_allclose(
        covariance(parabola(hessian, r), floor), np.linalg.inv(information), rtol=0.02, atol=1e-6
    )


def test_a_flat_or_hollow_peak_leaves_the_region() -> None:
    flat = covariance(np.full(31, 0.7), 0.1)
    np.testing.assert_allclose(flat, np.diag(PRIOR_SIGMA**2), rtol=1e-4, atol=1e-9)
    hollow = covariance(parabola(np.diag([-50.0, 20.0, 0.0, 0.0, 0.0]), 0.7), 0.1)
    sigma = np.sqrt(np.diag(hollow))
    np.testing.assert_allclose(sigma[1:], PRIOR_SIGMA[1:], rtol=1e-2)
    assert sigma[0] < 0.02


def test_stronger_noise_gives_wider_sigma() -> None:
    hessian = np.diag([-50.0, -50.0, -50.0, -5.0, -5.0])
    widths = [np.sqrt(covariance(parabola(hessian, r), 0.1)[0, 0]) for r in (0.9, 0.7, 0.5)]
    assert widths[0] < widths[1] < widths[2]


def test_a_stencil_that_leaves_the_map_does_not_sharpen_the_peak() -> None:
    """A step over the map's rim scores OFF_MAP_SCORE: it says nothing about how sharp the summit is."""
    hessian = np.diag([-2.0, -2.0, -5.0, -5.0, -5.0])
    whole = parabola(hessian, 0.8)
    pose = np.asarray(stencil_poses(jnp.zeros(5, jnp.float32), jnp.asarray(STEPS, dtype=jnp.float32)))
    broken = np.where(pose[:, 0] > 0.01, -2.0, whole)
    sigma, honest = (np.sqrt(np.diag(covariance(stencil, 0.1))) for stencil in (broken, whole))
    assert sigma[0] > 0.9 * honest[0]


T = default_thresholds()
GOOD = {"strength": 0.7, "margin": 0.2, "floor": 0.12, "best_overlap": 1.0, "on_edge": False, "finite": True}


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({}, Code.OK),
        ({"finite": False, "best_overlap": 0.0, "strength": -1.0}, Code.NON_FINITE),
        ({"best_overlap": 0.0, "strength": -1.0}, Code.OFF_MAP),
        ({"best_overlap": 0.59, "strength": -1.0}, Code.LOW_OVERLAP),
        ({"strength": 0.49, "on_edge": True, "margin": 0.0}, Code.LOW_CORRELATION),
        ({"strength": float("nan"), "margin": float("nan")}, Code.LOW_CORRELATION),
        ({"strength": float("-inf")}, Code.LOW_CORRELATION),
        ({"on_edge": True, "margin": 0.0}, Code.EDGE),
        ({"margin": 0.04, "floor": 0.0}, Code.AMBIGUOUS),
        ({"margin": 0.046, "floor": 0.0}, Code.OK),
        ({"margin": 0.16}, Code.AMBIGUOUS),
        ({"margin": 0.5, "floor": 0.4}, Code.AMBIGUOUS),
        ({"margin": float("nan")}, Code.AMBIGUOUS),
    ],
)
def test_the_first_reason_that_applies_is_the_code(change: dict[str, float | bool], code: Code) -> None:
    given = {**GOOD, **change}
    thresholds = Thresholds(*(jnp.float32(value) for value in T))
    result = judge(
        jnp.float32(given["strength"]),
        jnp.float32(given["margin"]),
        jnp.float32(given["floor"]),
        jnp.float32(given["best_overlap"]),
        jnp.asarray(bool(given["on_edge"])),
        jnp.asarray(bool(given["finite"])),
        thresholds,
    )
    assert int(result) == code


def test_a_window_may_be_fainter_than_a_single_scan() -> None:
    scan, window = default_thresholds(), default_thresholds(1.0)
    assert window.strength < scan.strength
    assert window.margin_by_chance < scan.margin_by_chance
    assert RegisterOptions().thresholds == scan
    assert RegisterOptions(window_m=1.0).thresholds == window
    assert RegisterOptions(window_m=1.0, own_thresholds=scan).thresholds == scan


def test_codes_have_the_names_of_the_contract() -> None:
    names = ["ok", "low_correlation", "ambiguous", "edge", "off_map", "low_overlap", "non_finite", "no_window"]
    assert [code.label for code in Code] == names
