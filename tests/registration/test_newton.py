"""The climb against a score of its own in NumPy float64."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.registration import OFF_MAP_SCORE, Template, score_poses
from lgprjax.registration.refine import PRIOR, RefinedPeak, climb, covariance_of
from lgprjax.subsurface import Tile
from registration.synthetic_tile import (
    CELL_M,
    CELLS,
    HALF,
    HALF_WIDTH,
    NS_PER_M,
    OFFSET_M,
    OMEGA,
    ORIGIN_M,
    REFERENCE_M,
    SCANS,
    TRACES,
    make_problem,
    make_tile,
    random_ground,
    stacked,
)

GROUND = random_ground(3)
TILE = make_tile(GROUND)
WIDTH = np.append(HALF_WIDTH, np.radians(1.0))
NUMBERS = 300.0
BATCH = 4
SCENE = (jnp.float32(REFERENCE_M), jnp.asarray(OMEGA, dtype=jnp.float32), jnp.float32(0.5))
ALL_FREE = np.ones(6, bool)
CLIMB = jax.jit(climb, static_argnames="steps")
TRUTH = np.array(
    [
        [0.12, -0.08, 0.33, 0.02, 0.01, 0.0],
        [-0.21, 0.15, 0.27, -0.03, -0.01, 0.0],
        [0.4, 0.03, 0.3, 0.01, 0.015, 0.0],
        [-0.05, 0.31, 0.31, 0.0, 0.0, 0.0],
    ]
)


CENTRE = np.tile([0.0, 0.0, REFERENCE_M, 0.0, 0.0, 0.0], (BATCH, 1))


def run(
    template: Template,
    start: np.ndarray,
    free: np.ndarray = ALL_FREE,
    tile: Tile = TILE,
    prior: np.ndarray = CENTRE,
    *,
    steps: int = 3,
) -> RefinedPeak:
    rows = (start, prior, np.tile(WIDTH, (BATCH, 1)), np.full(BATCH, NUMBERS))
    summit: RefinedPeak = CLIMB(
        tile,
        *SCENE,
        template,
        *(jnp.asarray(row, dtype=jnp.float32) for row in rows),
        jnp.asarray(free),
        steps=steps,
    )
    return summit


def waves(template: Template, number: int) -> np.ndarray:
    value = np.asarray(template.coefficients[number], np.float64)
    return np.asarray(value[:, :HALF] + 1j * value[:, HALF:])


def heard(pose: np.ndarray, tile: Tile = TILE) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bilinear ground below each trace, whether it is on the map, and how high the antenna stands."""
    turn = np.array([[np.cos(pose[3]), -np.sin(pose[3])], [np.sin(pose[3]), np.cos(pose[3])]])
    cells = (pose[:2] + OFFSET_M @ turn.T - ORIGIN_M) / CELL_M
    value = np.asarray(tile.coefficients, np.float64)
    value = value[..., :HALF] + 1j * value[..., HALF:]
    ground, on_map = np.zeros((TRACES, HALF), complex), np.zeros(TRACES, bool)
    for trace, (x, y) in enumerate(cells):
        i, j = int(np.floor(x)), int(np.floor(y))
        if not (0 <= i < CELLS[0] - 1 and 0 <= j < CELLS[1] - 1):
            continue
        on_map[trace] = np.asarray(tile.valid)[i : i + 2, j : j + 2].all()
        along = value[i, j : j + 2] * (i + 1 - x) + value[i + 1, j : j + 2] * (x - i)
        ground[trace] = along[0] * (j + 1 - y) + along[1] * (y - j)
    above_m = pose[2] + OFFSET_M[:, 1] * np.sin(pose[4]) + OFFSET_M[:, 0] * np.sin(pose[5]) - REFERENCE_M
    return ground, on_map, above_m


def correlation(wave: np.ndarray, pose: np.ndarray, tile: Tile = TILE) -> float:
    ground, on_map, above_m = heard(pose, tile)
    raised = (wave * np.exp(1j * above_m[:, None] * NS_PER_M * OMEGA))[on_map]
    below = ground[on_map]
    return float(np.sum((raised * below.conj()).real) / (np.linalg.norm(raised) * np.linalg.norm(below)))


def as_template(wave: np.ndarray, valid: np.ndarray | None = None) -> Template:
    problem = make_problem(GROUND, TRUTH[:, :5], TRUTH[:, :5], noise=0.3, seed=5).template
    valid = np.ones((BATCH, TRACES), bool) if valid is None else valid
    value = np.where(valid[..., None], stacked(wave), 0.0)
    return problem._replace(coefficients=jnp.asarray(value, dtype=jnp.float32), valid=jnp.asarray(valid))


NOISY = make_problem(GROUND, TRUTH[:, :5], TRUTH[:, :5], noise=0.3, seed=5).template
NOISY_WAVE = np.stack([waves(NOISY, number) for number in range(BATCH)])


def off_by_6_cm() -> np.ndarray:
    turn = np.array([0.3, 1.9, 3.5, 5.1])
    start = CENTRE.copy()
    start[:, :2] = TRUTH[:, :2] + 0.06 * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    return start


def test_reaches_the_truth_and_says_what_the_score_says() -> None:
    free = np.array([True] * 5 + [False])
    top = run(NOISY, off_by_6_cm(), free)
    pose = np.asarray(top.pose)
    assert np.hypot(*(pose - TRUTH).T[:2]).max() < 0.012
    assert np.abs(pose - TRUTH)[:, 3].max() < np.radians(1.2)
    for number in range(BATCH):
        one = jax.tree.map(lambda field, number=number: field[number], NOISY)
        score = score_poses(TILE, one, top.pose[number : number + 1, :5], *SCENE)
        np.testing.assert_allclose(top.correlation[number], score.correlation[0], atol=1e-5)
        oracle = correlation(NOISY_WAVE[number], pose[number].astype(np.float64))
        np.testing.assert_allclose(top.correlation[number], oracle, atol=1e-5)


def log_posterior(wave: np.ndarray, pose: np.ndarray) -> float:
    away = pose[2:] - np.array([REFERENCE_M, 0.0, 0.0, 0.0])
    pull = np.asarray(PRIOR)[2:] / WIDTH[2:] ** 2
    return float(-0.5 * NUMBERS * np.log(1.0 - correlation(wave, pose) ** 2) - 0.5 * np.sum(pull * away**2))


def test_ends_where_nothing_near_is_higher() -> None:
    top = run(NOISY, off_by_6_cm())
    for _ in range(4):
        top = run(NOISY, np.asarray(top.pose))
    sigma = np.sqrt(
        np.diagonal(
            covariance_of(
                top,
                jnp.asarray(np.tile(WIDTH, (BATCH, 1)), dtype=jnp.float32),
                jnp.asarray(ALL_FREE),
                jnp.asarray(CELL_M, dtype=jnp.float32),
            ),
            axis1=1,
            axis2=2,
        )
    )
    for number in range(BATCH):
        pose = np.asarray(top.pose[number], np.float64)
        reached = log_posterior(NOISY_WAVE[number], pose)
        # The slope jumps from cell to cell, so that it need not vanish at the summit; but nothing near is higher.
        for degree in range(5):
            for sign in (-0.3, 0.3):
                beside = pose + sign * sigma[number, degree] * np.eye(6)[degree]
                assert log_posterior(NOISY_WAVE[number], beside) < reached + 0.005


def log_likelihood(wave: np.ndarray, pose: np.ndarray, tile: Tile) -> float:
    """With the one gain and the one noise that are the most likely."""
    ground, on_map, above_m = heard(pose, tile)
    assert on_map.all()
    raised = wave * np.exp(1j * above_m[:, None] * NS_PER_M * OMEGA)

    gain = np.sum((raised * ground.conj()).real) / np.sum(np.abs(ground) ** 2)
    return float(-0.5 * NUMBERS * np.log(np.sum(np.abs(raised - gain * ground) ** 2)))


def test_information_is_the_curvature() -> None:
    """Where live and ground agree the curvature needs first derivatives only, so that it must be exact. What the ground
    does not hold, here all high frequencies, is noise, as loud in each scan.
    """
    low = np.arange(HALF) < 2 * HALF // 3
    tile = make_tile(lambda place: GROUND(place) * low)
    pose = TRUTH + np.array([0.0037, 0.0, 0.0, 0.0, 0.0, 0.008])
    noise = np.random.default_rng(8).normal(size=(BATCH, TRACES, HALF)) * np.where(low, 0.0, 0.6)
    of_scans = noise.reshape(BATCH, SCANS, -1)
    of_scans /= np.linalg.norm(of_scans, axis=-1, keepdims=True) / 8.0
    clean = []
    for number in range(BATCH):
        ground, on_map, above_m = heard(pose[number], tile)
        assert on_map.all()
        clean.append((ground + noise[number]) * np.exp(-1j * above_m[:, None] * NS_PER_M * OMEGA))
    top = run(as_template(np.stack(clean)), pose, tile=tile, steps=1)
    # So small that no trace crosses into the next cell, where the slope jumps.
    unit = np.diag([1e-5, 1e-5, 1e-5, 2e-5, 2e-5, 1e-4])
    for number in range(BATCH):

        def r(move: np.ndarray, number: int = number) -> float:
            return log_likelihood(clean[number], pose[number] + move, tile)

        hessian = np.empty((6, 6))
        for i in range(6):
            for j in range(6):
                a, b = unit[i], unit[j]
                hessian[i, j] = (r(a + b) - r(a - b) - r(b - a) + r(-a - b)) / (4.0 * unit[i, i] * unit[j, j])
        scale = 1.0 / np.sqrt(-np.diagonal(hessian))
        found = np.asarray(top.information[number], np.float64)
        np.testing.assert_allclose(found * np.outer(scale, scale), -hessian * np.outer(scale, scale), atol=3e-3)


@pytest.mark.parametrize("still", [(2, 4, 5), (0, 3)])
def test_what_is_not_free_stays(still: tuple[int, ...]) -> None:
    free = ~np.isin(np.arange(6), still)
    start = off_by_6_cm()
    moved = np.asarray(run(NOISY, start, free).pose) != start.astype(np.float32)
    assert not moved[:, ~free].any()
    assert moved[:, free].all()


def test_traces_off_the_map_do_not_count() -> None:
    covered = np.ones(CELLS, bool)
    covered[:, 23:] = False
    tile = make_tile(GROUND, covered)
    pose = CENTRE
    valid = np.ones((BATCH, TRACES), bool)
    valid[1, 3], valid[2, 0] = False, False
    # What they would say if they did: louder than all the rest.
    wave = np.where(heard(pose[0], tile)[1][None, :, None], NOISY_WAVE, 50.0 * NOISY_WAVE)
    top = run(as_template(wave, valid), pose, tile=tile, steps=1)
    for number in range(BATCH):
        ground, on_map, _ = heard(pose[number], tile)
        use = on_map & valid[number]
        assert 0 < use.sum() < TRACES
        np.testing.assert_array_equal(top.covered[number], use)
        live = NOISY_WAVE[number][use]
        oracle = np.sum((live * ground[use].conj()).real) / (np.linalg.norm(live) * np.linalg.norm(ground[use]))
        np.testing.assert_allclose(top.correlation[number], oracle, atol=1e-5)
        share = use.sum() / valid[number].sum()
        np.testing.assert_allclose(top.overlap[number], share, atol=1e-5)


def test_a_pose_off_the_map_scores_nothing_and_stays() -> None:
    start = CENTRE.copy()
    start[:, :2] = [[9.0, 0.0], [-9.0, 0.0], [0.0, 9.0], [0.0, -9.0]]
    top = run(NOISY, start, prior=start)
    np.testing.assert_array_equal(top.correlation, np.full(BATCH, OFF_MAP_SCORE, np.float32))
    np.testing.assert_array_equal(top.overlap, np.zeros(BATCH, np.float32))
    np.testing.assert_array_equal(top.pose, start.astype(np.float32))
    assert not np.asarray(top.covered).any()
    assert np.all(np.asarray(top.information) == 0.0)


def test_a_pose_is_not_drawn_to_where_more_of_it_lies_on_the_map() -> None:
    """The map ends beside the array: the true pose is higher, and has fewer traces on it than the start."""
    covered = np.ones(CELLS, bool)
    covered[:, 24:] = False
    tile = make_tile(GROUND, covered)
    start = CENTRE.copy()
    start[:, :2] = TRUTH[:, :2] - [0.0, 0.05]
    first = run(NOISY, start, tile=tile, steps=1)
    top = run(NOISY, start, tile=tile, steps=6)
    fewer = np.asarray(top.overlap) < np.asarray(first.overlap) - 0.05
    assert fewer.sum() >= 2
    assert np.hypot(*(np.asarray(top.pose) - TRUTH).T[:2])[fewer].max() < 0.015
