"""The worked area: against brute force, live as in one run, and silent wherever nothing may be claimed."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float

from lgprjax.coverage import CellGrid, Tool, ToolMoment, cell_centres, init_worked, run_worked, step_worked
from swept_draws import arc_share, drawn_errors, straight_share
from true_cells import true_cells

TOOL = Tool(width_m=1.2, length_m=0.4, ahead_m=1.1, left_m=0.1)
GRID = CellGrid(-1.5, -1.5, 0.1, 50, 44)
MOMENTS, STEP_M = 64, 0.05
START = (-1.3, -1.1, 0.7)
PASS_M = 40 * STEP_M
POWER = 16
Poses = Float[np.ndarray, "moment 3"]


def covariance(x: float, y: float, yaw_deg: float, xy: float = 0.0, xa: float = 0.0, ya: float = 0.0) -> np.ndarray:
    sigmas = np.array([x, y, np.radians(yaw_deg)])
    return np.array([[1.0, xy, xa], [xy, 1.0, ya], [xa, ya, 1.0]]) * np.outer(sigmas, sigmas)


FIXED = covariance(0.02, 0.02, 0.5, 0.5, 0.3, -0.4)
LOST = covariance(0.10, 0.06, 1.0, 0.2, 0.1, 0.6)
CASES = {
    "with fixes": FIXED,
    "heading at its limit": covariance(0.02, 0.03, 1.5, 0.0, 0.0, -0.5),
    "fixes lost": LOST,
    "errors along a diagonal": covariance(0.08, 0.08, 0.8, -0.9, 0.3, 0.0),
}


def line(
    count: int, *, radius_m: float = np.inf, start: tuple[float, float, float] = START, step_m: float = STEP_M
) -> Poses:
    """Poses of the reference point along a line or an arc."""
    way = step_m * np.arange(count)
    turned = way / radius_m
    chord = way * np.sinc(0.5 * turned / np.pi)
    middle = start[2] + 0.5 * turned
    return np.stack([start[0] + chord * np.cos(middle), start[1] + chord * np.sin(middle), start[2] + turned], axis=1)


def moments(poses: Poses, errors: np.ndarray, on: np.ndarray | None = None) -> ToolMoment:
    """As the step takes them, filled up with moments that are not on."""
    count = len(poses)
    filled = np.concatenate([poses, np.zeros((MOMENTS - count, 3))]).astype(np.float32)
    whole = np.zeros((MOMENTS, 3, 3), np.float32)
    whole[:count] = errors
    working = np.zeros(MOMENTS, bool)
    working[:count] = True if on is None else on
    x, y, yaw = (jnp.asarray(part) for part in filled.T)
    return ToolMoment(x, y, yaw, jnp.asarray(whole), jnp.asarray(working))


def claimed(poses: Poses, errors: np.ndarray, on: np.ndarray | None = None, grid: CellGrid = GRID) -> np.ndarray:
    return np.asarray(run_worked(grid, TOOL, init_worked(grid), moments(poses, errors, on)).probability, np.float64)


def places() -> Float[np.ndarray, "place 2"]:
    return np.stack([part.ravel() for part in np.meshgrid(*cell_centres(GRID))], axis=1)


def about_the_edge(probability: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Numbers of some cells that are neither certain nor hopeless, and of their neighbours."""
    some = (probability > 1e-3) & (probability < 0.9995)
    padded = np.pad(some, 1)
    near = padded[1:-1, :-2] | padded[1:-1, 2:] | padded[:-2, 1:-1] | padded[2:, 1:-1] | some
    return np.random.default_rng(seed).permutation(np.flatnonzero(near.ravel()))[:count]


@pytest.mark.parametrize("name", CASES)
def test_a_straight_pass_is_what_brute_force_finds(name: str) -> None:
    probability = claimed(line(41), CASES[name])
    chosen = about_the_edge(probability, 110, 1)
    errors = drawn_errors(CASES[name], POWER, 2)
    share = straight_share(TOOL, START, PASS_M, errors, places()[chosen])
    wrong = probability.ravel()[chosen] - share
    assert np.count_nonzero((share > 0.02) & (share < 0.98)) >= 25
    assert np.sqrt(np.mean(wrong**2)) <= 0.002
    assert np.max(np.abs(wrong)) <= 0.008


@pytest.mark.parametrize("radius_m", [6.0, -6.0])
def test_a_curved_pass_is_what_brute_force_finds(radius_m: float) -> None:
    probability = claimed(line(41, radius_m=radius_m), FIXED)
    chosen = about_the_edge(probability, 150, 3)
    share = arc_share(TOOL, START, radius_m, PASS_M, drawn_errors(FIXED, POWER, 4), places()[chosen])
    wrong = probability.ravel()[chosen] - share
    assert np.sqrt(np.mean(wrong**2)) <= 0.0005
    assert np.max(wrong) <= 0.001
    # At a corner of the pass a cell may be claimed less: its probability changes by 0.3 % with 0.15 mm.
    assert np.mean(np.abs(wrong) <= 0.001) >= 0.99
    assert np.min(wrong) >= -0.004


def test_a_pass_that_has_just_begun_is_not_taken_for_straight() -> None:
    """The map keeps its largest value: on an arc the outer edge leaves places that a straight way would go on over."""
    errors = drawn_errors(FIXED, POWER - 1, 4)
    for count in (2, 4, 8):
        poses = line(count, radius_m=6.0)
        probability = claimed(poses, FIXED)
        chosen = about_the_edge(probability, 60, 7)
        share = arc_share(TOOL, START, 6.0, (count - 1) * STEP_M, errors, places()[chosen])
        assert np.max(probability.ravel()[chosen] - share) <= 0.001


@pytest.mark.parametrize("radius_m", [-5.0, 2.0])
def test_a_tight_curve_claims_no_more_than_brute_force_finds(radius_m: float) -> None:
    probability = claimed(line(41, radius_m=radius_m), FIXED)
    chosen = about_the_edge(probability, 60, 5)
    share = arc_share(TOOL, START, radius_m, PASS_M, drawn_errors(FIXED, POWER - 1, 6), places()[chosen])
    assert np.max(probability.ravel()[chosen] - share) <= 0.003


def test_backwards_is_as_good_as_forwards() -> None:
    np.testing.assert_allclose(claimed(line(41)[::-1], LOST), claimed(line(41), LOST), atol=4e-3)


def test_a_place_is_claimed_more_surely_as_the_tool_leaves_it_behind_and_live_is_as_in_one_run() -> None:
    poses, state = line(41), init_worked(GRID)
    given = moments(poses, LOST)
    shown = []
    for place in range(MOMENTS):
        state = step_worked(GRID, TOOL, state, jax.tree.map(lambda part, place=place: part[place], given))
        shown.append(np.asarray(state.probability))
    np.testing.assert_allclose(shown[-1], claimed(poses, LOST), atol=1e-6)
    assert np.all(np.diff(np.stack(shown), axis=0) >= 0.0)
    middle = np.array([START[0], START[1]]) + (TOOL.ahead_m + 0.5) * np.array([np.cos(0.7), np.sin(0.7)])
    row, column = int((middle[1] + 1.5) / 0.1), int((middle[0] + 1.5) / 0.1)
    seen = [float(part[row, column]) for part in shown]
    assert seen[4] < 0.5 < seen[12] < seen[-1]
    assert step_worked._cache_size() == 1  # type: ignore[attr-defined]


def test_the_best_pass_counts_and_a_second_one_multiplies_nothing() -> None:
    poses = line(24)
    once = claimed(poses, LOST)
    on = np.ones(49, bool)
    on[24] = False
    twice = claimed(np.concatenate([poses, poses[:1], poses]), LOST, on)
    np.testing.assert_allclose(twice, once, atol=1e-6)
    errors = np.concatenate([np.broadcast_to(LOST, (25, 3, 3)), np.broadcast_to(FIXED, (24, 3, 3))])
    better = claimed(np.concatenate([poses, poses[:1], poses]), errors, on)
    np.testing.assert_allclose(better, np.maximum(once, claimed(poses, FIXED)), atol=1e-6)


def test_a_fix_tells_of_what_is_under_the_tool_when_it_comes_and_not_of_what_lies_behind() -> None:
    poses = line(30)
    errors = np.concatenate([np.broadcast_to(LOST, (29, 3, 3)), FIXED[None]])
    before, lost, fixed = claimed(poses[:29], LOST), claimed(poses, LOST), claimed(poses, errors)
    here = claimed(poses[29:], FIXED)
    under, behind = here > 0.55, here < 1e-3
    assert np.all(fixed[under] >= np.maximum(before, here)[under] - 0.02)
    assert np.all(fixed[under] <= np.maximum(lost, here)[under] + 0.03)
    assert np.max(fixed[under] - lost[under]) > 0.2
    assert np.all(fixed[behind] >= before[behind] - 1e-6)
    assert np.all(fixed[behind] <= lost[behind] + 1e-6)


def test_nothing_is_claimed_where_the_tool_was_off() -> None:
    poses, on = line(41), np.ones(41, bool)
    on[12:28] = False
    both = np.maximum(claimed(poses[:12], LOST), claimed(poses[28:], LOST))
    np.testing.assert_allclose(claimed(poses, LOST, on), both, atol=1e-6)


def test_nothing_is_claimed_across_a_jump() -> None:
    poses = np.concatenate([line(41)[:12], line(41)[28:]])
    both = np.maximum(claimed(poses[:12], LOST), claimed(poses[12:], LOST))
    np.testing.assert_allclose(claimed(poses, LOST), both, atol=1e-6)


def test_a_heading_that_is_corrected_on_the_way_makes_no_curve() -> None:
    """One degree at once, the tool's centre where it was: taken for a curve it would widen by centimetres."""
    poses, turned = line(41), np.radians(1.0)
    reach = np.array([np.cos(START[2]), np.sin(START[2])]) * TOOL.ahead_m
    poses[21:, :2] += reach - np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]]) @ reach
    poses[21:, 2] += turned
    ended = np.maximum(claimed(poses[:21], FIXED), claimed(poses[21:], FIXED))
    corrected, straight = claimed(poses, FIXED), claimed(line(41), FIXED)
    assert np.max(corrected - np.maximum(ended, straight)) < 0.02
    assert corrected.sum() > 0.98 * straight.sum()


def test_standing_still_changes_nothing() -> None:
    poses = np.concatenate([line(20), np.repeat(line(20)[-1:], 30, axis=0)])
    np.testing.assert_allclose(claimed(poses, LOST), claimed(line(20), LOST), atol=1e-6)


def test_a_turn_on_the_spot_sweeps_nothing() -> None:
    """No more is claimed than what some moment's rectangle is over by itself."""
    poses = np.zeros((11, 3))
    poses[:, 2] = np.linspace(0.0, 0.3, 11)
    single = np.max([claimed(pose[None], FIXED) for pose in poses], axis=0)
    turned = claimed(poses, FIXED)
    assert np.max(turned - single) < 0.02
    assert turned.sum() > 0.95 * single.sum()


BAD = {
    "no number": np.full((3, 3), np.nan),
    "no error at all": np.zeros((3, 3)),
    "negative": -FIXED,
    "more than related": covariance(0.02, 0.02, 0.5, 0.9, 0.9, -0.9),
    "heading unknown": covariance(0.02, 0.02, 20.0),
    "endless": np.full((3, 3), np.inf),
}


def test_nothing_is_claimed_of_a_covariance_that_is_none() -> None:
    expected = claimed(line(41)[20:], FIXED)
    for name, bad in BAD.items():
        errors = np.concatenate([np.broadcast_to(bad, (20, 3, 3)), np.broadcast_to(FIXED, (21, 3, 3))])
        np.testing.assert_allclose(claimed(line(41), errors), expected, atol=1e-6, err_msg=name)


def test_nothing_is_claimed_of_a_pose_that_is_none() -> None:
    poses = line(41)
    poses[10:30, 0] = np.nan
    both = np.maximum(claimed(poses[:10], FIXED), claimed(poses[30:], FIXED))
    np.testing.assert_allclose(claimed(poses, FIXED), both, atol=1e-6)


def test_cells_at_the_border_are_those_of_a_larger_grid_and_none_is_taken_for_another() -> None:
    whole = claimed(line(41), LOST)
    small = CellGrid(GRID.east_m + 0.7, GRID.north_m + 0.9, GRID.cell_m, 14, 11)
    np.testing.assert_allclose(claimed(line(41), LOST, grid=small), whole[9:23, 7:18], atol=1e-4)
    far = line(41) + np.array([100.0, -80.0, 0.0])
    assert claimed(far, LOST).max() == 0.0


def test_a_tight_turn_beyond_the_border_claims_nothing_within() -> None:
    """There the slice is not about the tool: what lies across the turn's centre, metres away, is none of its ground."""
    for away_m in np.arange(0.9, 4.0, 0.6):
        for side in (-1.0, 1.0):
            start = (GRID.east_m + GRID.cell_m * GRID.east_cells + away_m, -0.7, 0.0)
            poses = line(64, radius_m=side * 1.5, start=start)
            assert claimed(poses, FIXED).max() == 0.0, (away_m, side)


def test_nothing_is_ever_certain() -> None:
    tiny = covariance(1e-3, 1e-3, 0.05)
    assert 0.9999 < claimed(line(41), tiny).max() < 1.0


def test_true_cells_are_those_of_the_rectangle() -> None:
    grid = CellGrid(-2.0, -2.0, 0.1, 40, 40)
    poses = np.array([[0.0, -0.2, 0.0], [0.1, -0.2, 0.0], [5.0, 5.0, 1.0]])
    over = true_cells(grid, Tool(1.2, 0.4, 1.0, 0.2), poses, np.array([True, True, True]))
    rows, columns = np.nonzero(over)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (14, 25, 28, 32)
    assert over.sum() == 12 * 5
