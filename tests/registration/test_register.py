"""register_batch on a small synthetic tile: what it finds, what it refuses, and that lanes do not touch."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.registration import Code, Fix, Rules, SearchProblem, Thresholds, register_batch
from lgprjax.subsurface import Tile
from registration.synthetic_tile import (
    BASIS,
    CELLS,
    HALF_WIDTH,
    REFERENCE_M,
    SEARCH,
    THRESHOLDS,
    Ground,
    along_ground,
    make_problem,
    make_tile,
    periodic_ground,
    random_ground,
)

BATCH = 8
CENTRE = np.array([0.1, 0.0, REFERENCE_M, 0.0, 0.0])


@pytest.fixture(scope="module")
def ground() -> Ground:
    return random_ground(10)


@pytest.fixture(scope="module")
def tile(ground: Ground) -> Tile:
    return make_tile(ground)


def register(tile: Tile, problem: SearchProblem, thresholds: Thresholds = THRESHOLDS) -> Fix:
    fix: Fix = register_batch(
        tile,
        problem,
        Rules(jnp.float32(0.3), thresholds),
        jnp.float32(REFERENCE_M),
        BASIS.angular_frequency_rad_per_ns,
        spec=SEARCH,
    )
    return Fix(*(np.asarray(field) for field in fix))


def random_pairs(seed: int, centre: np.ndarray = CENTRE, batch: int = BATCH) -> tuple[np.ndarray, np.ndarray]:
    """Priors about a centre, and truths within the region about them."""
    rng = np.random.default_rng(seed)
    prior = centre + rng.uniform(-1, 1, (batch, 5)) * [0.2, 0.1, 0.01, 0.01, 0.0]
    truth = prior + rng.uniform(-1, 1, (batch, 5)) * [0.4, 0.35, 0.04, np.radians(2.0), np.radians(0.7)]
    return truth, prior


def assert_found(fix: Fix, truth: np.ndarray) -> None:
    assert fix.code.tolist() == [Code.OK] * len(truth)
    error = fix.pose - truth
    assert np.hypot(error[:, 0], error[:, 1]).max() < 0.03
    assert np.abs(error[:, 2]).max() < 0.03


def same(a: Fix, b: Fix, lanes: list[int], of: list[int] | None = None) -> None:
    """Bit for bit, but for the covariance: a library inverts it, whose last bit goes with the lane on some machines."""
    there = lanes if of is None else of
    for name, x, y in zip(Fix._fields, a, b, strict=True):
        if name == "covariance":
            largest = np.max(np.abs(y[there]), axis=(1, 2), keepdims=True)
            np.testing.assert_allclose(x[lanes] / largest, y[there] / largest, rtol=0.0, atol=1e-6)
        else:
            np.testing.assert_array_equal(x[lanes], y[there])


def test_a_known_pose_is_found(tile: Tile, ground: Ground) -> None:
    truth, prior = random_pairs(0)
    fix = register(tile, make_problem(ground, truth, prior))
    assert_found(fix, truth)
    assert np.all(fix.correlation > 0.85)
    lead = fix.correlation * np.sqrt(fix.overlap) - fix.runner_up
    assert np.all((fix.margin > 0.0) & (fix.margin <= lead + 1e-3))
    np.testing.assert_array_equal(fix.overlap_channels, 6)
    np.testing.assert_array_equal(fix.overlap, 1.0)


def test_the_heading_found_is_better_than_the_prior(tile: Tile, ground: Ground) -> None:
    """24 fixes; the priors err by 1.15 degrees RMS, the best pose that the score knows by 0.5."""
    errors = []
    for seed in (0, 1, 2):
        truth, prior = random_pairs(seed)
        errors.append(register(tile, make_problem(ground, truth, prior, seed=seed)).pose[:, 3] - truth[:, 3])
    assert np.degrees(np.sqrt(np.mean(np.concatenate(errors) ** 2))) < 0.8


@pytest.mark.parametrize(
    ("seed", "about"),
    [(3, [-0.1, 0.0, 0.0, np.pi, 0.0]), (4, [0.0, 0.0, 0.05, 0.0, 0.0]), (4, [0.0, 0.0, 0.2, 0.0, 0.0])],
)
def test_the_other_way_and_a_higher_array_are_found_when_the_prior_says_so(
    tile: Tile, ground: Ground, seed: int, about: tuple[float, ...]
) -> None:
    """5 cm, a load or a worn tyre: 0.33 ns; 20 cm, another vehicle: 1.3 ns, a quarter of a period at 200 MHz. The
    region in height then covers what is left."""
    truth, prior = random_pairs(seed, CENTRE + about)
    assert_found(register(tile, make_problem(ground, truth, prior)), truth)


def test_the_gain_of_the_live_scan_leaves_the_pose_alone(tile: Tile, ground: Ground) -> None:
    truth, prior = random_pairs(0)
    problem = make_problem(ground, truth, prior)
    once = register(tile, problem)
    for gain in (1e-4, 1e5):
        louder = problem._replace(
            template=problem.template._replace(coefficients=problem.template.coefficients * jnp.float32(gain))
        )
        again = register(tile, louder)
        np.testing.assert_array_equal(again.code, once.code)
        np.testing.assert_allclose(again.pose[:, :2], once.pose[:, :2], atol=1e-3)
        np.testing.assert_allclose(again.correlation, once.correlation, atol=1e-4)


def poisoned(problem: SearchProblem, lane: int, *, finite: bool) -> SearchProblem:
    coefficients = problem.template.coefficients.at[lane].set(jnp.nan)
    return problem._replace(
        template=problem.template._replace(coefficients=coefficients),
        finite=problem.finite.at[lane].set(finite),
    )


@pytest.mark.parametrize("finite", [False, True])
def test_a_lane_of_nan_leaves_its_neighbours_bit_identical(tile: Tile, ground: Ground, finite: bool) -> None:
    truth, prior = random_pairs(0)
    problem = make_problem(ground, truth, prior)
    clean, dirty = register(tile, problem), register(tile, poisoned(problem, 3, finite=finite))
    same(clean, dirty, [0, 1, 2, 4, 5, 6, 7])
    assert dirty.code[3] != Code.OK
    if not finite:
        assert dirty.code[3] == Code.NON_FINITE
    assert np.all(np.isnan(dirty.pose[3]))
    assert np.all(np.isnan(dirty.covariance[3]))


@pytest.mark.parametrize("field", [0, 3])
def test_a_prior_that_is_not_a_number_is_never_ok(tile: Tile, ground: Ground, field: int) -> None:
    truth, prior = random_pairs(0)
    problem = make_problem(ground, truth, prior)
    clean = register(tile, problem)
    dirty = register(tile, problem._replace(prior=problem.prior.at[5, field].set(jnp.nan)))
    same(clean, dirty, [0, 1, 2, 3, 4, 6, 7])
    assert dirty.code[5] != Code.OK


def test_some_dead_traces_do_no_harm(tile: Tile, ground: Ground) -> None:
    truth, prior = random_pairs(1)
    problem = make_problem(ground, truth, prior, seed=1)
    dead = jnp.asarray([1, 7, 13])
    template = problem.template._replace(
        valid=problem.template.valid.at[:, dead].set(False),
        coefficients=problem.template.coefficients.at[:, dead].set(jnp.nan),
    )
    fix = register(tile, problem._replace(template=template))
    assert_found(fix, truth)
    np.testing.assert_array_equal(fix.overlap_channels, 5)


def test_a_fix_depends_on_its_own_lane_only(tile: Tile, ground: Ground) -> None:
    """Other order, other neighbours, padding: the same bits."""
    truth, prior = random_pairs(2)
    problem = make_problem(ground, truth, prior, seed=2)
    whole = register(tile, problem)
    order = [5, 2, 7, 0, 1, 6, 3, 4]
    mixed = register(tile, jax.tree.map(lambda leaf: leaf[jnp.asarray(order)], problem))
    same(mixed, whole, list(range(BATCH)), order)
    padded = register(tile, jax.tree.map(lambda leaf: leaf[jnp.asarray([0, 1, 2, 0, 0, 0, 0, 0])], problem))
    same(padded, whole, [0, 1, 2])


def test_another_size_of_batch_gives_the_same_fixes(tile: Tile, ground: Ground) -> None:
    truth, prior = random_pairs(2)
    problem = make_problem(ground, truth, prior, seed=2)
    whole = register(tile, problem)
    part = register(tile, jax.tree.map(lambda leaf: leaf[:3], problem))
    np.testing.assert_array_equal(part.code, whole.code[:3])
    np.testing.assert_allclose(part.pose[:, :2], whole.pose[:3, :2], atol=1e-3)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_truth_outside_the_region_is_never_called_ok(tile: Tile, ground: Ground, seed: int) -> None:
    """Just outside, where the flank of the summit reaches in, and far outside."""
    rng = np.random.default_rng(seed)
    prior = np.tile(CENTRE, (BATCH, 1))
    truth = prior.copy()
    side = rng.choice([-1.0, 1.0], BATCH)
    truth[:4, 0] += side[:4] * [0.53, 0.58, 0.65, 0.8]
    truth[4:, 1] += side[4:] * [0.53, 0.58, 0.65, 0.75]
    fix = register(tile, make_problem(ground, truth, prior, seed=seed))
    assert Code.OK not in fix.code
    assert set(fix.code.tolist()) <= {Code.EDGE, Code.LOW_CORRELATION, Code.AMBIGUOUS}


def test_ground_that_is_not_the_maps_is_never_called_ok(tile: Tile) -> None:
    truth, prior = random_pairs(0)
    for seed in (20, 21, 22):
        fix = register(tile, make_problem(random_ground(seed), truth, prior, seed=seed))
        assert fix.code.tolist() == [Code.LOW_CORRELATION] * BATCH


def test_off_the_map_and_too_few_channels_have_codes_of_their_own(tile: Tile, ground: Ground) -> None:
    truth, prior = random_pairs(0)
    problem = make_problem(ground, truth, prior)
    # Lanes 0 and 1 far away; 2 to 4 on the rim, half the window beyond it, the region too narrow to reach inside.
    place = np.array([[30.0, 0.0], [0.0, -9.0], [0.0, 1.14], [0.0, -1.2], [-1.4, 0.0]])
    moved = problem.prior.at[:5, :2].set(jnp.asarray(place, dtype=jnp.float32))
    narrow = problem.half_width.at[2:5, :2].set(0.03)
    fix = register(tile, problem._replace(prior=moved, half_width=narrow))
    assert fix.code[:5].tolist() == [Code.OFF_MAP] * 2 + [Code.LOW_OVERLAP] * 3
    assert np.all(np.isnan(fix.pose[:5]))
    clean = register(tile, problem)
    same(fix, clean, [5, 6, 7])


def test_a_map_without_ground_is_no_map(ground: Ground) -> None:
    truth, prior = random_pairs(0)
    fix = register(make_tile(ground, np.zeros(CELLS, bool)), make_problem(ground, truth, prior))
    assert fix.code.tolist() == [Code.OFF_MAP] * BATCH


def test_ground_that_comes_again_is_ambiguous() -> None:
    """Three equal summits 0.4 m apart, none of them at the region's rim."""
    truth, prior = random_pairs(0)
    truth[:, 0] = prior[:, 0] + np.linspace(-0.03, 0.03, BATCH)
    stripes = periodic_ground(30, 0.4)
    tile, problem = make_tile(stripes), make_problem(stripes, truth, prior)
    # The summits themselves are what the noise floor is told from: less is asked of the score than of other ground.
    faint = THRESHOLDS._replace(strength_by_chance=jnp.float32(2.0))
    fix = register(tile, problem, faint)
    assert fix.code.tolist() == [Code.AMBIGUOUS] * BATCH
    assert np.all(fix.correlation > 0.8)
    assert Code.OK not in register(tile, problem).code


def test_the_covariance_is_one(tile: Tile, ground: Ground) -> None:
    truth, prior = random_pairs(0)
    covariance = register(tile, make_problem(ground, truth, prior)).covariance.astype(float)
    np.testing.assert_allclose(covariance, covariance.swapaxes(1, 2), rtol=1e-3, atol=1e-9)
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    correlation = covariance / sigma[:, :, None] / sigma[:, None, :]
    assert np.linalg.eigvalsh(0.5 * (correlation + correlation.swapaxes(1, 2))).min() > 0.0
    # Never wider than the region allows, and not zero.
    assert np.all(sigma <= HALF_WIDTH / np.sqrt(3.0) * 1.001)
    assert np.all(sigma[:, :2] > 1e-4)
    assert np.all(sigma[:, :2] < 0.05)


def test_the_sigma_tells_the_size_of_the_error(tile: Tile, ground: Ground) -> None:
    """24 fixes at two levels of noise: errors of about one sigma, within a factor of three."""
    for noise in (0.4, 1.0):
        normalised = []
        for seed in (0, 1, 2):
            truth, prior = random_pairs(seed)
            fix = register(tile, make_problem(ground, truth, prior, noise=noise, seed=seed))
            sigma = np.sqrt(np.diagonal(fix.covariance, axis1=1, axis2=2)[:, :2])
            normalised.append((fix.pose - truth)[:, :2] / sigma)
        rms = np.sqrt(np.mean(np.concatenate(normalised) ** 2))
        assert 1 / 3 < rms < 3.0, f"noise {noise}: errors of {rms:.2f} sigma"


def test_ground_that_varies_along_only_leaves_the_cross_axis_open() -> None:
    truth, prior = random_pairs(0)
    furrows = along_ground(31)
    covariance = register(make_tile(furrows), make_problem(furrows, truth, prior)).covariance.astype(float)
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    inside = ~np.isnan(sigma[:, 0])
    assert inside.sum() >= 6
    assert np.all(sigma[inside, 0] < 0.05)
    np.testing.assert_allclose(sigma[inside, 1], HALF_WIDTH[1] / np.sqrt(3.0), rtol=0.2)


def compiles() -> int:
    return int(register_batch._cache_size())  # type: ignore[attr-defined]


def test_a_replay_is_one_compile(tile: Tile, ground: Ground) -> None:
    truth, prior = random_pairs(0)
    register(tile, make_problem(ground, truth, prior))
    before = compiles()
    for seed in range(4):
        truth, prior = random_pairs(50 + seed)
        problem = make_problem(ground, truth, prior, seed=seed, half_width=HALF_WIDTH * (0.5 + 0.1 * seed))
        register(tile if seed % 2 else make_tile(random_ground(seed)), poisoned(problem, seed, finite=False))
    assert compiles() == before
