"""The score against time-domain sums in float64, and the coarse surface against the score."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.registration import OFF_MAP_SCORE, Score, Template, score_poses
from lgprjax.registration.scan_search import CoarseSurface, coarse_surface, find_modes, trace_products
from lgprjax.subsurface import Tile
from registration.synthetic_tile import (
    BASIS,
    CELL_M,
    CELLS,
    HALF,
    INTERVAL_NS,
    LEFT_M,
    NS_PER_M,
    OFFSET_M,
    OMEGA,
    ORIGIN_M,
    REFERENCE_M,
    SAMPLES,
    TRACES,
    live,
    make_tile,
    places,
    random_ground,
)

MIN_OVERLAP = 0.6
POSES = 384
SHARP = jax.jit(score_poses)


def signals(coefficients: np.ndarray, advance_ns: np.ndarray) -> np.ndarray:
    """Explicit sums of cosines, each trace read ``advance_ns`` later than it was recorded."""
    time_ns = np.arange(SAMPLES) * INTERVAL_NS + np.asarray(advance_ns)[..., None]
    out = np.zeros(time_ns.shape)
    for k in range(HALF):
        real, imaginary = coefficients[..., k, None], coefficients[..., HALF + k, None]
        out += real * np.cos(OMEGA[k] * time_ns) - imaginary * np.sin(OMEGA[k] * time_ns)
    return np.asarray(out * np.sqrt(2.0 / SAMPLES))


def masked_tile() -> Tile:
    valid = np.ones(CELLS, bool)
    valid[20:24, 10:14] = False
    valid[40:, 30:] = False
    valid[5, 5] = False
    return make_tile(random_ground(0), valid)


def make_template(seed: int) -> Template:
    rng = np.random.default_rng(seed)
    truth = np.array([0.1, -0.2, 0.35, 0.03, 0.02])
    valid = np.ones(TRACES, bool)
    valid[[2, 9]] = False
    coefficients = np.where(valid[:, None], live(random_ground(0), truth, 0.5, rng), 0.0)
    return Template(
        jnp.asarray(coefficients, dtype=jnp.float32),
        jnp.asarray(OFFSET_M, dtype=jnp.float32),
        jnp.asarray(valid),
        jnp.asarray(np.arange(TRACES) // 6, dtype=jnp.int32),
    )


def random_poses() -> np.ndarray:
    """Near the truth, all over the tile, over its rim, and far off."""
    rng = np.random.default_rng(1)
    low, high = np.array([-1.7, -1.6, 0.1, -np.pi, -0.2]), np.array([1.7, 1.5, 0.6, np.pi, 0.2])
    pose = rng.uniform(low, high, (POSES, 5))
    pose[:100] = np.array([0.1, -0.2, 0.35, 0.03, 0.02]) + rng.normal(size=(100, 5)) * [0.1, 0.1, 0.03, 0.05, 0.03]
    pose[100:140, 0] = rng.choice([-1.4, 1.35, -1.2, 1.3], 40)
    pose[140:180, 1] = rng.choice([-1.2, 1.14, -0.9, 0.85], 40)
    pose[100:180, 3] = rng.choice([0.0, np.pi / 2, np.pi], 80) + rng.normal(size=80) * 0.01
    pose[380:, 0] = [50.0, -50.0, 3.0, 1e6]
    return np.asarray(pose.astype(np.float32), dtype=np.float64)


def oracle(tile: Tile, grid: np.ndarray, template: Template, pose: np.ndarray) -> tuple[float, float, np.ndarray, bool]:
    """r, strength, covered traces, and whether a place is so near a cell border that rounding decides.

    ``grid`` holds the tile's signals in time.
    """
    mask, usable = np.asarray(tile.valid), np.asarray(template.valid)
    above_m = pose[2] + LEFT_M * np.sin(pose[4]) - REFERENCE_M
    scan = signals(np.asarray(template.coefficients, float), above_m * NS_PER_M)
    product = live_power = ground_power = 0.0
    covered = np.zeros(TRACES, bool)
    doubtful = False
    for n, place in enumerate(places(pose)):
        a, c = (place - ORIGIN_M) / CELL_M
        i, j = int(np.floor(a)), int(np.floor(c))
        doubtful |= min(abs(a - round(a)), abs(c - round(c))) < 1e-4
        if not (0 <= i < CELLS[0] - 1 and 0 <= j < CELLS[1] - 1 and usable[n]):
            continue
        if not mask[i : i + 2, j : j + 2].all():
            continue
        covered[n] = True
        p, q = a - i, c - j
        there = (1 - p) * (1 - q) * grid[i, j] + (1 - p) * q * grid[i, j + 1]
        there = there + p * (1 - q) * grid[i + 1, j] + p * q * grid[i + 1, j + 1]
        product += float(scan[n] @ there)
        live_power += float(scan[n] @ scan[n])
        ground_power += float(there @ there)
    overlap = covered.sum() / usable.sum()
    if overlap < MIN_OVERLAP:
        return OFF_MAP_SCORE, OFF_MAP_SCORE, covered, doubtful
    r = product / np.sqrt(live_power * ground_power)
    return r, r * np.sqrt(overlap), covered, doubtful


def score(tile: Tile, template: Template, pose: np.ndarray) -> Score:
    result: Score = SHARP(
        tile,
        template,
        jnp.asarray(pose, dtype=jnp.float32),
        jnp.float32(REFERENCE_M),
        BASIS.angular_frequency_rad_per_ns,
        jnp.float32(MIN_OVERLAP),
    )
    return result


def test_the_score_is_the_normalised_correlation_in_time() -> None:
    tile, template, pose = masked_tile(), make_template(2), random_poses()
    result = score(tile, template, pose)
    grid = signals(np.asarray(tile.coefficients, float), np.zeros(CELLS))
    expected = [oracle(tile, grid, template, p) for p in pose]
    sure = np.array([not doubtful for *_, doubtful in expected])
    assert sure.sum() >= 300
    np.testing.assert_array_equal(np.asarray(result.covered)[sure], np.array([c for _, _, c, _ in expected])[sure])
    r, strength = (np.array([e[k] for e in expected]) for k in range(2))
    np.testing.assert_allclose(np.asarray(result.correlation)[sure], r[sure], atol=1e-5)
    np.testing.assert_allclose(np.asarray(result.score)[sure], strength[sure], atol=1e-5)
    # Every kind of pose was among them.
    covered = np.array([c.sum() for _, _, c, _ in expected])
    on_map = r > -1.5
    assert on_map.sum() > 80
    assert r.max() > 0.7
    assert np.sum(covered == 0) > 10
    assert np.sum((covered > 0) & ~on_map) > 20
    assert np.sum((covered < covered.max()) & on_map) > 20


def test_gain_of_the_live_scan_and_of_the_map_are_no_matter() -> None:
    tile, template, pose = masked_tile(), make_template(2), random_poses()
    once = score(tile, template, pose)
    for live_gain, map_gain in ((1e3, 1.0), (1e-4, 1e2), (1e5, 1e-3)):
        again = score(
            tile._replace(coefficients=tile.coefficients * map_gain),
            template._replace(coefficients=template.coefficients * live_gain),
            pose,
        )
        np.testing.assert_allclose(again.correlation, once.correlation, atol=1e-5)


LATTICE, MARGIN = (17, 13), (14, 10)
WHOLE_CELLS = np.array([[0, 6], [0, 2], [0, -2], [0, -6], [-4, 6], [-4, 2], [-4, -2], [-4, -6]])


def coarse_case(height_m: float) -> tuple[Tile, Template, np.ndarray]:
    """Eight traces that stand whole cells apart, and a prior on a cell."""
    tile = make_tile(random_ground(3))
    rng = np.random.default_rng(4)
    prior = np.array([ORIGIN_M[0] + 28 * CELL_M[0], ORIGIN_M[1] + 20 * CELL_M[1], height_m, 0.0, 0.0])
    ground = random_ground(3)
    wave = ground(prior[:2] + [3 * CELL_M[0], -2 * CELL_M[1]] + WHOLE_CELLS * CELL_M)
    wave = wave * np.exp(-1j * (height_m - REFERENCE_M) * NS_PER_M * OMEGA)
    coefficients = np.concatenate([wave.real, wave.imag], axis=-1) + 0.3 * rng.normal(size=(8, 2 * HALF))
    template = Template(
        jnp.asarray(coefficients, dtype=jnp.float32),
        jnp.asarray(WHOLE_CELLS * CELL_M, dtype=jnp.float32),
        jnp.ones(8, bool),
        jnp.asarray(np.arange(8) < 4),
    )
    return tile, template, prior


@jax.jit
def surface_and_score(
    tile: Tile, template: Template, prior: jax.Array, half_width_m: jax.Array, pose: jax.Array
) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    products = trace_products(tile, Template(*(field[None] for field in template)))[0]
    surface = coarse_surface(
        tile, template, products, prior, half_width_m, jnp.float32(0.5), lattice=LATTICE, margin=MARGIN
    )
    direct = score_poses(
        tile, template, pose, jnp.float32(REFERENCE_M), BASIS.angular_frequency_rad_per_ns, jnp.float32(0.5)
    )
    return surface.score, surface.overlap, surface.first_cell, direct.score


def lattice_poses(prior: np.ndarray) -> np.ndarray:
    pose = np.tile(prior, (LATTICE[0] * LATTICE[1], 1)).reshape(*LATTICE, 5)
    pose[..., 0] = ORIGIN_M[0] + (28 - LATTICE[0] // 2 + np.arange(LATTICE[0]))[:, None] * CELL_M[0]
    pose[..., 1] = ORIGIN_M[1] + (20 - LATTICE[1] // 2 + np.arange(LATTICE[1]))[None, :] * CELL_M[1]
    return pose


def run_coarse(
    tile: Tile, template: Template, prior: np.ndarray, half_width_m: float = 5.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    pose = lattice_poses(prior).reshape(-1, 5)
    outcome = surface_and_score(
        tile,
        template,
        jnp.asarray(prior, dtype=jnp.float32),
        jnp.full(2, half_width_m, jnp.float32),
        jnp.asarray(pose, dtype=jnp.float32),
    )
    strength, overlap, first, direct = (np.asarray(value) for value in outcome)
    return strength, overlap, first, direct.reshape(LATTICE)


def test_the_coarse_surface_is_the_score_at_its_points() -> None:
    strength, overlap, first, direct = run_coarse(*coarse_case(REFERENCE_M))
    np.testing.assert_array_equal(first, [28 - 8, 20 - 6])
    np.testing.assert_allclose(strength, direct, atol=3e-5)
    np.testing.assert_array_equal(overlap, 1.0)
    # The truth is three cells on and two to the right.
    assert strength.argmax() == (8 + 3) * LATTICE[1] + (6 - 2)
    assert strength.max() > 0.85


def test_the_coarse_surface_keeps_to_the_region_and_to_the_tile() -> None:
    """Oracle: sums over cells, one trace at a time; a hole in the tile, a region narrower than the lattice."""
    tile, template, prior = coarse_case(REFERENCE_M)
    valid = np.ones(CELLS, bool)
    valid[15:30, 25:] = False
    tile = make_tile(random_ground(3), valid)
    strength, overlap, first, _ = run_coarse(tile, template, prior, 0.26)
    grid, scan = np.asarray(tile.coefficients, float), np.asarray(template.coefficients, float)
    for a in range(LATTICE[0]):
        for c in range(LATTICE[1]):
            if abs(a - 8) * 0.05 > 0.26 or abs(c - 6) * 0.06 > 0.26:
                assert strength[a, c] == OFF_MAP_SCORE
                continue
            cells = [(first + [a, c] + shift) for shift in WHOLE_CELLS]
            on = [n for n, (i, j) in enumerate(cells) if 0 <= i < CELLS[0] and 0 <= j < CELLS[1] and valid[i, j]]
            assert overlap[a, c] == pytest.approx(len(on) / 8)
            if len(on) < 4:
                assert strength[a, c] == OFF_MAP_SCORE
                continue
            there = np.array([grid[tuple(cells[n])] for n in on])
            r = np.sum(scan[on] * there) / np.sqrt(np.sum(scan[on] ** 2) * np.sum(there**2))
            assert strength[a, c] == pytest.approx(r * np.sqrt(len(on) / 8), abs=2e-5)
    assert len(np.unique(overlap)) > 3


def test_modes_are_summits_apart_from_each_other() -> None:
    tile = make_tile(random_ground(3))
    rng = np.random.default_rng(5)
    strength = 0.05 * rng.normal(size=LATTICE)
    strength[4, 4], strength[5, 4], strength[12, 9], strength[4, 11] = 0.9, 0.85, 0.7, 0.6
    surface = CoarseSurface(
        jnp.asarray(strength, dtype=jnp.float32), jnp.ones(LATTICE, jnp.float32), jnp.asarray([10, 5], jnp.int32)
    )
    modes = find_modes(tile, surface, jnp.float32(0.21), modes=3)
    np.testing.assert_allclose(modes.score, [0.9, 0.7, 0.6], atol=1e-6)
    cells = (np.asarray(modes.place_m, float) - ORIGIN_M) / CELL_M
    np.testing.assert_allclose(cells, [[14, 9], [22, 14], [14, 16]], atol=1e-4)
    apart = (np.arange(17)[:, None] - 4) ** 2 * 0.05**2 + (np.arange(13)[None] - 4) ** 2 * 0.06**2
    assert float(modes.floor) == pytest.approx(strength[apart >= 0.21**2].std(), rel=1e-3)
