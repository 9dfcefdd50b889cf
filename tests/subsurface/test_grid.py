"""Gridding and sampling against slow loops in float64."""

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.subsurface import GridSpec, Tile, TraceSet, grid_spec, grid_traces, sample_tile

SPEC = GridSpec(
    along_cells=16, cross_cells=16, along_cell_m=0.05, cross_cell_m=0.06, along_spread_m=0.04, cross_spread_m=0.076
)
ORIGIN_M = np.array([-0.31, -0.42])
HALF = 3
TRACES = 48


def trace_set(turn_rad: np.ndarray, weight: np.ndarray) -> TraceSet:
    rng = np.random.default_rng(0)
    # A lower left part with traces, some beyond the rim; elsewhere none.
    position = rng.uniform([-0.5, -0.6], [0.3, 0.25], (TRACES, 2))
    coefficients = rng.normal(size=(TRACES, 2 * HALF))
    direction = np.stack([np.cos(turn_rad), np.sin(turn_rad)])
    return TraceSet(*(field.astype(np.float32) for field in (coefficients, position.T, direction, weight)))


def oracle(traces: TraceSet) -> tuple[np.ndarray, np.ndarray]:
    """Every trace with every cell: a Gaussian along and across the trace's own track, cut off at two deviations."""
    coefficients, position, direction, weight = (np.asarray(field, dtype=np.float64) for field in traces)
    position, direction = position.T, direction.T
    total = np.zeros((16, 16, 2 * HALF))
    weights = np.zeros((16, 16))
    valid = np.zeros((16, 16), bool)
    for n in range(TRACES):
        for i in range(16):
            for j in range(16):
                d = ORIGIN_M + [i * 0.05, j * 0.06] - position[n]
                along = (d @ direction[n]) / 0.04
                cross = (d @ [-direction[n, 1], direction[n, 0]]) / 0.076
                if weight[n] > 0 and abs(along) <= 2 and abs(cross) <= 2:
                    w = weight[n] * np.exp(-(along**2 + cross**2) / 2)
                    total[i, j] += w * coefficients[n]
                    weights[i, j] += w
                    valid[i, j] |= abs(along) <= 1.5 and abs(cross) <= 1.0
    value = np.where(valid[..., None], total / np.maximum(weights, 1e-12)[..., None], 0.0)
    return value, valid


def gridded(traces: TraceSet) -> Tile:
    return grid_traces(traces, ORIGIN_M, spec=SPEC)


RNG = np.random.default_rng(1)
AHEAD = np.zeros(TRACES)
EQUAL = np.ones(TRACES)
CASES = {
    "turned": (RNG.uniform(-np.pi, np.pi, TRACES), EQUAL),
    "weights": (AHEAD, np.where(RNG.random(TRACES) < 0.4, 0.0, RNG.uniform(0.2, 3.0, TRACES))),
}


@pytest.mark.parametrize("case", list(CASES))
def test_a_tile_is_the_weighted_mean_written_out(case: str) -> None:
    traces = trace_set(*CASES[case])
    tile = gridded(traces)
    value, valid = oracle(traces)
    np.testing.assert_array_equal(tile.valid, valid)
    np.testing.assert_allclose(tile.coefficients, value, atol=2e-5)
    np.testing.assert_allclose(tile.power, np.sum(value**2, axis=-1), atol=1e-4)
    assert 30 < valid.sum() < 200
    assert not np.asarray(tile.coefficients)[~valid].any()


def test_invalid_traces_add_nothing() -> None:
    """Whatever stands in them."""
    weight = np.concatenate([np.ones(30), np.zeros(TRACES - 30)])
    traces = trace_set(AHEAD, weight)
    other = TraceSet(*(field.copy() for field in traces))
    other.coefficients[30:], other.position_m[:, 30:] = np.nan, 0.0
    alone = TraceSet(traces.coefficients[:30], traces.position_m[:, :30], traces.direction[:, :30], traces.weight[:30])
    for a, b, c in zip(gridded(traces), gridded(other), gridded(alone), strict=True):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(a, c)


@pytest.mark.parametrize("kept", [0, TRACES])
def test_a_tile_without_traces_is_empty(kept: int) -> None:
    traces = trace_set(AHEAD, np.zeros(TRACES))
    tile = gridded(TraceSet(*(field[..., :kept] for field in traces))._replace(coefficients=traces.coefficients[:kept]))
    assert tile.coefficients.shape == (16, 16, 2 * HALF)
    assert not np.asarray(tile.valid).any()
    assert not np.asarray(tile.coefficients).any()


def test_traces_in_parts_are_one_set(monkeypatch: pytest.MonkeyPatch) -> None:
    traces = trace_set(*CASES["turned"])
    whole = gridded(traces)
    monkeypatch.setattr("lgprjax.subsurface.grid._TOGETHER", 7)
    for a, b in zip(gridded(traces), whole, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-6)


def test_the_sizes_of_grids_come_from_a_ladder_and_spreads_from_steps_and_pitch() -> None:
    sizes = set()
    for along_m in np.linspace(0.5, 20.0, 60):
        spec = grid_spec(float(along_m), 2.0, step_m=0.05, pitch_m=0.127, wavelength_m=0.5)
        assert spec.along_cells * spec.along_cell_m >= along_m
        assert spec.cross_cells * spec.cross_cell_m >= 2.0
        sizes.add(spec.along_cells)
    assert sizes <= {*range(16, 129, 8), *range(160, 513, 32)}
    assert len(sizes) <= 27
    # So that a map's noise draws no match to the middle between its traces: validation/worlds/test_interpolation_pull.
    for step_m, along_m in ((0.05, 0.04), (0.1, 0.06), (0.2, 0.1), (0.4, 0.16)):
        spec = grid_spec(10.0, 2.0, step_m=step_m, pitch_m=0.127, wavelength_m=0.5)
        assert (spec.along_spread_m, spec.cross_spread_m) == pytest.approx((along_m, 0.0762))


@pytest.fixture(scope="module")
def tile() -> Tile:
    """A grid of 7 x 5 cells with a hole."""
    rng = np.random.default_rng(3)
    valid = np.ones((7, 5), bool)
    valid[3, 2] = False
    coefficients = np.where(valid[..., None], rng.normal(size=(7, 5, 4)), 0.0)
    return Tile(
        coefficients=jnp.asarray(coefficients, dtype=jnp.float32),
        power=jnp.asarray(np.sum(coefficients**2, axis=-1), dtype=jnp.float32),
        valid=jnp.asarray(valid),
        origin_m=jnp.asarray([-1.0, 2.0], dtype=jnp.float32),
        cell_m=jnp.asarray([0.5, 0.25], dtype=jnp.float32),
    )


def bilinear(tile: Tile, position: np.ndarray) -> tuple[np.ndarray, bool]:
    """By hand, as the mean over the cross axis of means over the along axis."""
    grid, valid = np.asarray(tile.coefficients, float), np.asarray(tile.valid)
    a, c = (position[0] + 1.0) / 0.5, (position[1] - 2.0) / 0.25
    i, j = int(np.floor(a)), int(np.floor(c))
    if not (0 <= i <= 5 and 0 <= j <= 3):
        return np.zeros(4), False
    if not valid[i : i + 2, j : j + 2].all():
        return np.zeros(4), False
    near = grid[i, j] + (a - i) * (grid[i + 1, j] - grid[i, j])
    far = grid[i, j + 1] + (a - i) * (grid[i + 1, j + 1] - grid[i, j + 1])
    return near + (c - j) * (far - near), True


def test_sampling_is_bilinear_and_off_the_map_there_is_nothing(tile: Tile) -> None:
    rng = np.random.default_rng(4)
    position = rng.uniform([-2.0, 1.5], [3.0, 3.5], (500, 2))
    position[:8] = [
        [-1.0, 2.0],  # the first cell
        [-1.001, 2.1],  # just before it
        [1.999, 2.999],  # just within the last one
        [2.001, 2.5],
        [0.3, 3.001],
        [0.5, 2.5],  # on the hole
        [1e4, 2.5],  # far away
        [-1e30, 1e30],
    ]
    value, covered = sample_tile(tile, jnp.asarray(position, dtype=jnp.float32))
    expected = [bilinear(tile, p) for p in np.asarray(position, np.float32).astype(float)]
    np.testing.assert_array_equal(covered, [c for _, c in expected])
    np.testing.assert_allclose(value, [v for v, _ in expected], atol=1e-5)
    assert 50 < np.sum(covered) < 450
    value, covered = sample_tile(tile, jnp.full((3, 2, 2), 2.2, jnp.float32))
    assert (value.shape, covered.shape) == ((3, 2, 4), (3, 2))
