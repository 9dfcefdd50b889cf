"""The coarse stage against sums written out in NumPy float64."""

import jax
import jax.numpy as jnp
import numpy as np

from lgprjax.registration import OFF_MAP_SCORE, ArrayColumns
from lgprjax.registration.places import (
    PlaceScores,
    find_summits,
    products_at_places,
    single_scores,
    window_scores,
)
from registration.synthetic_tile import HALF, NS_PER_M, OMEGA

CHANNELS, NUMBERS, SCANS, PLACES = 3, 4, 5, (13, 11)
STEP_M = np.array([0.15, 0.12])
ORIGIN_M = np.array([-0.9, -0.6])
RNG = np.random.default_rng(7)
COMPONENTS = np.linalg.qr(RNG.normal(size=(2 * HALF, NUMBERS)))[0]
VALUE = RNG.normal(size=(CHANNELS * NUMBERS, *PLACES))
OVERLAP = np.where(RNG.uniform(size=PLACES) < 0.2, 1.0 / 3.0, 1.0)
COLUMNS = ArrayColumns(
    jnp.asarray(VALUE, dtype=jnp.float32),
    jnp.asarray(np.sum(VALUE**2, axis=0), dtype=jnp.float32),
    jnp.asarray(OVERLAP, dtype=jnp.float32),
    jnp.asarray(ORIGIN_M, dtype=jnp.float32),
    jnp.asarray(STEP_M, dtype=jnp.float32),
)
LIVE = RNG.normal(size=(SCANS, CHANNELS, 2 * HALF))
ABOVE_M = RNG.uniform(-0.05, 0.05, size=(SCANS, CHANNELS))
HEIGHTS_M = np.array([-0.04, 0.04])
APART_M = 0.3


def products() -> np.ndarray:
    """[scan, height, along, cross]"""
    wave = LIVE[..., :HALF] + 1j * LIVE[..., HALF:]
    raised = (ABOVE_M[:, None] + HEIGHTS_M[None, :, None])[..., None]
    wave = wave[:, None] * np.exp(1j * raised * NS_PER_M * OMEGA)
    heard = np.concatenate([wave.real, wave.imag], axis=-1) @ COMPONENTS
    columns = VALUE.reshape(CHANNELS, NUMBERS, *PLACES)
    return np.asarray(np.einsum("shcn,cnij->shij", heard, columns))


def single(value: np.ndarray) -> jax.Array:
    return jnp.asarray(value, dtype=jnp.float32)


def test_products_are_sums_over_channels_and_depth() -> None:
    found = products_at_places(
        COLUMNS, single(COMPONENTS), single(LIVE), single(ABOVE_M), single(HEIGHTS_M), single(OMEGA)
    )
    np.testing.assert_allclose(found, products(), atol=2e-4)


def test_scores_of_single_scans() -> None:
    power = np.sum(LIVE**2, axis=(1, 2))
    power[2] = 0.0
    scores = single_scores(COLUMNS, single(products()), single(power), jnp.float32(0.5))
    level = np.sqrt(np.where(power > 0.0, power, 1.0)[:, None, None] * np.sum(VALUE**2, axis=0))
    usable = (OVERLAP >= 0.5)[None] & (power > 0.0)[:, None, None]
    np.testing.assert_allclose(
        scores.strength, np.where(usable, products().max(axis=1) / level, OFF_MAP_SCORE), atol=1e-5
    )


def test_a_window_is_the_sum_of_its_scans_where_it_puts_them() -> None:
    member = np.array([[4, 2, 0], [3, 1, 0]])
    shift = np.array([[[0, 0], [-1, 0], [-2, 1]], [[0, 0], [1, -1], [2, -1]]])
    border = (2, 1)
    power = np.sum(LIVE**2, axis=(1, 2))
    scores = window_scores(
        COLUMNS,
        single(products()),
        single(power),
        jnp.asarray(member, dtype=jnp.int32),
        jnp.asarray(shift, dtype=jnp.int32),
        jnp.float32(0.5),
        border=border,
    )
    edge = [(b, b) for b in border]
    padded = np.pad(products(), [(0, 0), (0, 0), *edge])
    ground, overlap = np.pad(np.sum(VALUE**2, axis=0), edge), np.pad(OVERLAP, edge)
    for end in range(2):
        total, below, share = np.zeros((2, *PLACES)), np.zeros(PLACES), np.zeros(PLACES)
        for scan, (i, j) in zip(member[end], shift[end] + border, strict=True):
            at = np.s_[i : i + PLACES[0], j : j + PLACES[1]]
            total += padded[scan][:, *at]
            below += ground[at]
            share += overlap[at] / 3.0
        np.testing.assert_allclose(scores.product[end], total, atol=1e-4)
        np.testing.assert_allclose(scores.overlap[end], share, atol=1e-6)
        usable = (share >= 0.5) & (below > 0.0)
        level = np.sqrt(np.where(below > 0.0, below, 1.0) * np.sum(power[member[end]]))
        np.testing.assert_allclose(
            scores.strength[end], np.where(usable, total.max(axis=0) / level, OFF_MAP_SCORE), atol=1e-5
        )


def hills(*tops: tuple[int, int, float]) -> np.ndarray:
    """Strength with round hills at these places, of these heights, over faint noise."""
    i, j = np.meshgrid(*map(np.arange, PLACES), indexing="ij")
    ground = 0.01 * np.random.default_rng(9).uniform(size=PLACES)
    for a, b, height in tops:
        ground = np.maximum(ground, height * np.exp(-((i - a) ** 2 + (j - b) ** 2) / 3.0))
    return np.asarray(ground)


def summits_of(strength: np.ndarray, centre: tuple[int, int], half_width_m: tuple[float, float]) -> list[np.ndarray]:
    """Places, strengths, heights and scatter that are found."""
    product = np.stack([0.5 * strength, strength])[None]
    found = find_summits(
        COLUMNS,
        PlaceScores(single(strength[None]), single(product), jnp.ones((1, *PLACES), jnp.float32)),
        single((ORIGIN_M + STEP_M * centre)[None]),
        single(np.array([half_width_m])),
        jnp.float32(APART_M),
        summits=2,
    )
    numbers = (np.asarray(found.place_m[0]) - ORIGIN_M) / STEP_M
    return [numbers, np.asarray(found.strength[0]), np.asarray(found.height[0]), np.asarray(found.floor[0])]


def test_two_summits_apart() -> None:
    # The third hill is higher than the second, but nearer than 0.3 m to the first: two places along are 0.3 m.
    strength = hills((4, 5, 0.9), (10, 2, 0.5))
    strength[5, 6] = 0.8
    place, found, height, floor = summits_of(strength, (6, 5), (5.0, 5.0))
    np.testing.assert_allclose(found, [0.9, 0.5], atol=1e-6)
    assert np.abs(place - [[4, 5], [10, 2]]).max() <= 0.5
    np.testing.assert_array_equal(height, [1, 1])
    i, j = np.meshgrid(*map(np.arange, PLACES), indexing="ij")
    peak = place[0] * STEP_M
    far = (i * STEP_M[0] - 4 * STEP_M[0]) ** 2 + (j * STEP_M[1] - 5 * STEP_M[1]) ** 2 >= APART_M**2 - 1e-6
    assert np.abs(peak - STEP_M * [4, 5]).max() < 0.08
    np.testing.assert_allclose(floor, strength[far].std(), rtol=2e-3)


def test_a_flank_beyond_the_distance_is_no_rival() -> None:
    i, j = np.meshgrid(*map(np.arange, PLACES), indexing="ij")
    wide = 0.9 - 0.004 * ((i - 6) ** 2 + (j - 5) ** 2)
    wide[11, 9] += 0.08
    _, found, _, _ = summits_of(wide, (6, 5), (5.0, 5.0))
    np.testing.assert_allclose(found, [0.9, wide[11, 9]], atol=1e-6)


def test_the_region_holds_and_its_rim_may_rise() -> None:
    # The best hill lies outside; the best place inside is on its slope, no summit, and found all the same.
    strength = hills((10, 5, 0.9), (2, 2, 0.3))
    _, found, _, _ = summits_of(strength, (5, 5), (4 * STEP_M[0], 5 * STEP_M[1]))
    np.testing.assert_allclose(found, [strength[9, 5], 0.3], atol=1e-6)


def test_the_top_between_places() -> None:
    i, j = np.meshgrid(*map(np.arange, PLACES), indexing="ij")
    strength = 0.9 - 0.01 * ((i - 6.3) ** 2 + (j - 4.8) ** 2)
    place, _, _, _ = summits_of(strength, (6, 5), (5.0, 5.0))
    np.testing.assert_allclose(place[0], [6.3, 4.8], atol=1e-3)
