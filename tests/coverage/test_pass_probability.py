"""One pass over a place: closed forms where there are any."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float
from scipy.stats import multivariate_normal, norm

from lgprjax.coverage import Tool
from lgprjax.coverage.worked import Passing, pass_probability

NARROW = Tool(width_m=1.2, length_m=1e-3, ahead_m=2.0, left_m=0.0)
FAR_M = 50.0
PLACES = 81

probability_of = jax.jit(pass_probability)


def covariance(
    forward: float, left: float, yaw: float, *, fl: float = 0.0, fy: float = 0.0, ly: float = 0.0
) -> np.ndarray:
    sigmas = np.array([forward, left, yaw])
    return np.array([[1.0, fl, fy], [fl, 1.0, ly], [fy, ly, 1.0]]) * np.outer(sigmas, sigmas)


def passing(
    errors: np.ndarray, left: np.ndarray, *, first: float | np.ndarray = FAR_M, last: float | np.ndarray = -FAR_M
) -> Passing:
    def column(value: float | np.ndarray) -> Float[Array, " place"]:
        return jnp.asarray(np.broadcast_to(value, left.shape), jnp.float32)

    return Passing(
        covariance=jnp.asarray(np.broadcast_to(errors, (*left.shape, 3, 3)), jnp.float32),
        left_m=column(left),
        curvature_radpm=column(0.0),
        first_m=column(first),
        last_m=column(last),
    )


@pytest.mark.parametrize("related", [-0.8, 0.8])
def test_in_the_middle_of_a_pass_it_is_the_normal_error_between_the_tools_edges(related: float) -> None:
    left = np.linspace(-0.9, 0.9, PLACES)
    errors = covariance(0.03, 0.02, 0.02, ly=related)
    found = np.asarray(probability_of(NARROW, passing(errors, left)))
    sigma = np.sqrt(errors[1, 1] + 4.0 * errors[2, 2] + 4.0 * errors[1, 2])
    expected = norm.cdf((0.6 - left) / sigma) - norm.cdf((-0.6 - left) / sigma)
    # The turned lever: half of side × variance of yaw, 0.1 mm; and what lies beyond the counted tail.
    np.testing.assert_allclose(found, expected, atol=3e-3)
    assert np.all(found <= 1.0)


def test_two_centimetres_and_a_degree_and_a_half_lose_nine_or_fifteen_centimetres_a_side() -> None:
    left = np.linspace(0.4, 0.6, PLACES)
    found = np.asarray(probability_of(NARROW, passing(covariance(0.02, 0.02, np.radians(1.5)), left)))
    for level, lost_m in ((0.95, 0.09), (0.996, 0.15)):
        assert 0.6 - left[found >= level].max() == pytest.approx(lost_m, abs=0.006)


@pytest.mark.parametrize("related", [-0.9, 0.7])
def test_at_an_end_the_errors_along_and_aside_count_together(related: float) -> None:
    """A known heading leaves two normal errors; the corner of the swath is one of their cumulative distribution."""
    tool = NARROW._replace(length_m=0.4, ahead_m=0.0)
    along, left = (part.ravel() for part in np.meshgrid(np.linspace(-0.5, 0.1, 9), np.linspace(0.4, 0.8, 9)))
    errors = covariance(0.10, 0.08, 1e-5, fl=related)
    found = np.asarray(probability_of(tool, passing(errors, left, last=along)))
    # Over: the error along is at least last - 0.2, the error to the left at least left - 0.6.
    upper = multivariate_normal(np.zeros(2), errors[:2, :2])
    expected = np.array([upper.cdf(np.array([0.2 - a, 0.6 - e])) for a, e in zip(along, left, strict=True)])
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_left_and_right_are_alike() -> None:
    tool = Tool(1.2, 0.4, 1.1, 0.1)
    left = np.linspace(-0.9, 0.9, PLACES)
    errors = covariance(0.03, 0.02, 0.02, fl=0.3, fy=-0.2, ly=0.4)
    mirror = np.diag([1.0, -1.0, -1.0])
    one = probability_of(tool, passing(errors, left, last=0.05))
    other = probability_of(tool._replace(left_m=-0.1), passing(mirror @ errors @ mirror, -left, last=0.05))
    np.testing.assert_allclose(one, other, atol=1e-5)


def test_a_longer_pass_never_has_less() -> None:
    tool = Tool(1.2, 0.4, 1.1, 0.0)
    left = np.linspace(-0.8, 0.8, PLACES)
    errors = covariance(0.08, 0.05, 0.02, ly=0.6)
    last = [np.asarray(probability_of(tool, passing(errors, left, last=end))) for end in np.linspace(0.6, -1.0, 17)]
    assert np.all(np.diff(np.stack(last), axis=0) >= -1e-5)
    assert last[0].max() < 0.01
    assert last[-1].max() > 0.99


def test_a_pass_that_went_nowhere_claims_what_one_rectangle_does() -> None:
    """No errors to speak of: inside it is certain but for the tail that is never claimed, outside it is nothing."""
    tool = Tool(1.2, 0.4, 1.1, 0.0)
    left, along = np.zeros(PLACES), np.zeros(PLACES)
    left[:4], along[:4] = [0.0, 0.59, 0.0, 0.61], [0.19, 0.0, 0.21, 0.0]
    found = probability_of(tool, passing(covariance(1e-3, 1e-3, 1e-4), left, first=along, last=along))
    np.testing.assert_allclose(found[:4], [1.0, 1.0, 0.0, 0.0], atol=1e-4)
    assert float(jnp.max(found)) < 1.0
