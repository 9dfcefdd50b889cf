"""The source's cached shapes: chosen as it says, stamped where they belong, and never more than the live map claims."""

import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks.cached_shapes import ShapeCache, choose_shape, make_shapes, stamp_shape
from lgprjax.coverage import LEVELS, CellGrid, CellState, Tool, ToolMoment, cell_states, init_worked, run_worked

TOOL = Tool(width_m=1.2, length_m=0.4, ahead_m=1.1, left_m=0.1)
LEVEL = LEVELS[0]
GRID = CellGrid(-1.5, -1.5, 0.1, 50, 44)
POSITION_M = np.array([0.01, 0.02, 0.04, 0.08])
HEADING_RAD = np.radians([0.25, 0.5, 1.0])


@pytest.fixture(scope="module")
def cache() -> ShapeCache:
    return make_shapes(TOOL, LEVEL, POSITION_M, HEADING_RAD, draws=4000)


def of_sigmas(position: float, heading: float, related: float = 0.0) -> np.ndarray:
    whole = np.diag(np.array([position, position, heading]) ** 2)
    whole[1, 2] = whole[2, 1] = related * position * heading
    return whole


def test_shapes_shrink_with_errors(cache: ShapeCache) -> None:
    counts = cache.shapes.sum(axis=(2, 3))
    assert np.all(np.diff(counts, axis=0) <= 0)
    assert np.all(np.diff(counts, axis=1) <= 0)
    assert counts[0, 0] > counts[-1, -1]


def test_the_smallest_cached_errors_that_are_not_smaller_are_chosen(cache: ShapeCache) -> None:
    shapes = cache.shapes
    assert choose_shape(cache, of_sigmas(0.02 - 1e-9, np.radians(0.5) - 1e-9)) is not None
    found = choose_shape(cache, of_sigmas(0.0201, np.radians(0.3)))
    assert found is not None
    np.testing.assert_array_equal(found, shapes[2, 1])
    # Wholly related errors count for their square root of two.
    related = choose_shape(cache, of_sigmas(0.0295, np.radians(0.3), 0.999))
    assert related is not None
    np.testing.assert_array_equal(related, shapes[3, 1])
    assert choose_shape(cache, of_sigmas(0.09, np.radians(0.3))) is None
    assert choose_shape(cache, of_sigmas(0.01, np.radians(2.0))) is None


def test_a_stamp_lies_under_the_tool_and_stays_within_the_grid() -> None:
    exact = make_shapes(TOOL, 0.95, np.array([1e-5]), np.array([1e-6]), draws=4000)
    claimed = np.zeros(GRID.shape, bool)
    assert exact.shapes[0, 0, 1:-1, 1:-1].all()
    tiny = of_sigmas(1e-6, 1e-7)
    stamp_shape(claimed, GRID, exact, (0.0, 0.0, np.pi / 2), tiny)
    rows, columns = np.nonzero(claimed)
    # Ahead is north now and left is west: the centre is at (-0.1, 1.1).
    np.testing.assert_allclose([(rows.min(), rows.max()), (columns.min(), columns.max())], [(24, 27), (8, 19)])
    assert claimed.sum() == 4 * 12
    for corner in ((-1.5, -2.6), (2.9, 3.5), (50.0, 50.0)):
        stamp_shape(claimed, GRID, exact, (*corner, np.pi / 2), tiny)
    assert 48 <= claimed.sum() <= 3 * 48


def test_the_cache_is_a_lower_bound_of_the_live_map(cache: ShapeCache) -> None:
    """On an arc of 6 m, by errors that differ from moment to moment."""
    rng = np.random.default_rng(0)
    way = 0.05 * np.arange(64)
    yaw = 0.6 + way / 6.0
    steps = np.diff(way, prepend=0.0)
    poses = np.stack([np.cumsum(steps * np.cos(yaw)) - 1.2, np.cumsum(steps * np.sin(yaw)) - 1.1, yaw], axis=1)
    mixed = rng.standard_normal((64, 3, 3)) + 2.0 * np.eye(3)
    related = mixed @ mixed.transpose(0, 2, 1)
    sigmas = rng.uniform(0.2, 1.0, (64, 1)) * np.array([0.04, 0.04, np.radians(0.8)])
    scale = sigmas / np.sqrt(np.diagonal(related, axis1=1, axis2=2))
    covariances = related * scale[:, :, None] * scale[:, None, :]
    on = np.arange(64) < 50
    claimed = np.zeros(GRID.shape, bool)
    for pose, covariance in zip(poses[on].tolist(), covariances[on], strict=True):
        stamp_shape(claimed, GRID, cache, (pose[0], pose[1], pose[2]), covariance)
    x, y, heading = (jnp.asarray(part, jnp.float32) for part in poses.T)
    moments = ToolMoment(x, y, heading, jnp.asarray(covariances, jnp.float32), jnp.asarray(on))
    live = cell_states(run_worked(GRID, TOOL, init_worked(GRID), moments).probability, LEVEL) == CellState.PROCESSED
    assert not np.any(claimed & ~live)
    assert 100 < claimed.sum() < live.sum()
