"""Surfaces over prior errors and the peaks of windows, against sums written out in NumPy float64."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.registration import OFF_MAP_SCORE, ArrayColumns
from lgprjax.registration.coarse import Peaks, ScanBatch, WindowBatch, scan_surfaces, window_peaks
from lgprjax.registration.lattice import RunningSums, Surfaces
from registration.synthetic_tile import HALF, NS_PER_M, OMEGA

CHANNELS, NUMBERS, SCANS, PLACES, POINTS = 3, 4, 6, (13, 11), 9
STEP_M = np.array([0.15, 0.12])
ORIGIN_M = np.array([-0.9, -0.6])
RNG = np.random.default_rng(7)
COMPONENTS = np.linalg.qr(RNG.normal(size=(2 * HALF, NUMBERS)))[0]
VALUE = RNG.normal(size=(CHANNELS * NUMBERS, *PLACES))
GROUND = np.sum(VALUE**2, axis=0)
OVERLAP = np.where(RNG.uniform(size=PLACES) < 0.2, 1.0 / 3.0, 1.0)
COLUMNS = ArrayColumns(
    jnp.asarray(np.moveaxis(VALUE, 0, -1), dtype=jnp.float32),
    jnp.asarray(GROUND, dtype=jnp.float32),
    jnp.asarray(OVERLAP, dtype=jnp.float32),
    jnp.asarray(ORIGIN_M, dtype=jnp.float32),
    jnp.asarray(STEP_M, dtype=jnp.float32),
)
LIVE = RNG.normal(size=(SCANS, CHANNELS, 2 * HALF))
VALID = RNG.uniform(size=(SCANS, CHANNELS)) > 0.2
ABOVE_M = RNG.uniform(-0.05, 0.05, size=(SCANS, CHANNELS))
HEIGHTS_M = np.array([-0.04, 0.04])
TURN = np.radians(25.0)
AXES_M = 0.13 * np.array([[np.cos(TURN), -np.sin(TURN)], [np.sin(TURN), np.cos(TURN)]])
# The last two lattices reach beyond the columns.
AT_M = np.array([[-0.5, -0.45], [-0.42, -0.35], [-0.6, -0.3], [-0.55, -0.41], [0.3, 0.2], [-1.4, -1.1]])
DECOYS_M = RNG.uniform(-1.5, 1.5, size=(30, 2))


def single(value: np.ndarray) -> jnp.ndarray:
    return jnp.asarray(value, dtype=jnp.float32)


def products() -> np.ndarray:
    """Of every scan with every place of the columns: [scan, height, along, cross]."""
    live = np.where(VALID[..., None], LIVE, 0.0)
    wave = live[..., :HALF] + 1j * live[..., HALF:]
    raised = (ABOVE_M[:, None] + HEIGHTS_M[None, :, None])[..., None]
    wave = wave[:, None] * np.exp(1j * raised * NS_PER_M * OMEGA)
    heard = np.concatenate([wave.real, wave.imag], axis=-1) @ COMPONENTS
    return np.asarray(np.einsum("shcn,cnij->shij", heard, VALUE.reshape(CHANNELS, NUMBERS, *PLACES)))


def between(planes: np.ndarray, place_m: np.ndarray) -> np.ndarray:
    """The four places about a point, by their nearness; 0 where not all of them are."""
    cell = (place_m - ORIGIN_M) / STEP_M
    i, j = np.floor(cell).astype(int)
    u, v = cell - np.floor(cell)
    if min(i, j) < 0 or i + 1 >= PLACES[0] or j + 1 >= PLACES[1]:
        return np.zeros(len(planes))
    low = (1 - v) * planes[:, i, j] + v * planes[:, i, j + 1]
    return np.asarray((1 - u) * low + u * ((1 - v) * planes[:, i + 1, j] + v * planes[:, i + 1, j + 1]))


def with_roots(planes: np.ndarray, loud: float) -> np.ndarray:
    """Scans of a window count with the root of their loudness, and of the ground's."""
    ground = planes[-2]
    if ground <= 0.0:
        return np.concatenate([np.zeros(len(planes) - 1), planes[-1:]])
    return np.concatenate([planes[:-2] / np.sqrt(loud) / ground**0.25, [np.sqrt(ground)], planes[-1:]])


@pytest.fixture(scope="module")
def made() -> tuple[np.ndarray, ...]:
    batch = ScanBatch(single(LIVE), jnp.asarray(VALID), single(ABOVE_M), single(AT_M))
    geometry = (single(AXES_M), single(DECOYS_M), single(HEIGHTS_M), single(OMEGA))
    found = scan_surfaces(COLUMNS, single(COMPONENTS), batch, *geometry, points=(POINTS, POINTS - 2))
    return tuple(np.asarray(part, np.float64) for part in found)


def test_a_surface_is_what_the_columns_hold_at_every_prior_error(made: tuple[np.ndarray, ...]) -> None:
    surfaces = made[0]
    outside = 0
    for scan, product in enumerate(products()):
        planes = np.concatenate([product, GROUND[None], OVERLAP[None]])
        loud = np.sqrt(np.sum(LIVE[scan] ** 2 * VALID[scan][:, None]))
        for a in range(POINTS):
            for b in range(POINTS - 2):
                wanted = with_roots(between(planes, AT_M[scan] + a * AXES_M[0] + b * AXES_M[1]), loud)
                outside += not wanted.any()
                np.testing.assert_allclose(surfaces[scan, :, a, b], wanted, atol=3e-4)
    assert 40 < outside < 250


def test_decoys_are_the_nearest_places(made: tuple[np.ndarray, ...]) -> None:
    outside = 0
    for scan, product in enumerate(products()):
        planes = np.concatenate([product, GROUND[None], OVERLAP[None]])
        loud = np.sqrt(np.sum(LIVE[scan] ** 2 * VALID[scan][:, None]))
        for number, apart_m in enumerate(DECOYS_M):
            i, j = np.round((AT_M[scan] + apart_m - ORIGIN_M) / STEP_M).astype(int)
            inside = 0 <= i < PLACES[0] and 0 <= j < PLACES[1]
            outside += not inside
            wanted = with_roots(planes[:, i, j], loud) if inside else np.zeros(len(planes))
            np.testing.assert_allclose(made[1][scan, :, number], wanted, atol=3e-4)
    assert outside > 10


def test_the_loudness_of_a_scan_is_that_of_its_live_channels(made: tuple[np.ndarray, ...]) -> None:
    np.testing.assert_allclose(made[2], np.sqrt(np.sum(LIVE**2 * VALID[..., None], axis=(1, 2))), rtol=1e-5)


SIZE, STACK = 11, 9
MIN_OVERLAP, APART_M = 0.6, 2.6
LATTICE_M = np.array([1.0, 0.8])


class Stack(NamedTuple):
    """Surfaces of consecutive scans, made up: products of two heights, ground, overlap."""

    surfaces: np.ndarray
    decoys: np.ndarray
    power: np.ndarray


def made_stack(seed: int, decoys: int = 40) -> Stack:
    """White noise, in which the last scans have a peak near (6, 4)."""
    rng = np.random.default_rng(seed)
    i, j = np.meshgrid(np.arange(SIZE), np.arange(SIZE), indexing="ij")
    hill = np.exp(-((i - 6.2) ** 2 + (j - 3.9) ** 2) / 4.0)
    surfaces = np.zeros((STACK, 4, SIZE, SIZE))
    surfaces[:, :2] = rng.normal(size=(STACK, 2, SIZE, SIZE)) + np.array([1.0, 2.5])[None, :, None, None] * hill
    surfaces[:, 2] = rng.uniform(3.0, 5.0, size=(STACK, SIZE, SIZE))
    surfaces[:, 3] = rng.choice([0.4, 0.8, 1.0], p=[0.15, 0.25, 0.6], size=(STACK, SIZE, SIZE))
    spread = np.zeros((STACK, 4, decoys))
    spread[:, :2] = rng.normal(size=(STACK, 2, decoys))
    spread[:, 2] = rng.uniform(3.0, 5.0, size=(STACK, decoys))
    spread[:, 3] = rng.choice([0.0, 1.0], p=[0.1, 0.9], size=(STACK, 1)) if decoys else 0.0
    return Stack(surfaces, spread, rng.uniform(8.0, 12.0, size=STACK))


class Window(NamedTuple):
    """A window by direct sums: see ``Peaks``."""

    point: np.ndarray
    height: int
    score: float
    rival: float
    floor: float
    region_floor: float
    overlap: float
    area: int
    at_rim: bool


def window_of(stack: Stack, first: int, last: int, centre: np.ndarray, half_m: float) -> Window:
    """The best place of a window and what stands beside it."""
    rows, columns = stack.surfaces.shape[2:]
    span = slice(first, last + 1)
    power, scans = stack.power[span].sum(), last + 1 - first

    def scores(planes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        total = planes[span].sum(axis=0)
        overlap = total[3] / scans
        usable = (overlap >= MIN_OVERLAP - 1e-9) & (total[2] > 0.0)
        level = np.sqrt(np.where(usable, total[2], 1.0) * power)
        return np.where(usable, total[:2].max(axis=0) / level, OFF_MAP_SCORE), overlap, total[:2].argmax(axis=0)

    score, overlap, height = scores(stack.surfaces)
    room = half_m / LATTICE_M + 0.5
    inside = np.array(
        [[np.all(np.abs(np.array([a, b]) - centre) <= room) for b in range(columns)] for a in range(rows)]
    )
    within = np.where(inside, score, OFF_MAP_SCORE)
    a, b = np.unravel_index(np.argmax(within), within.shape)
    around = np.pad(score, 1, constant_values=OFF_MAP_SCORE)

    def neighbours(p: int, q: int) -> float:
        patch = around[p : p + 3, q : q + 3].copy()
        patch[1, 1] = OFF_MAP_SCORE
        return float(patch.max())

    peaks = [
        (float(score[p, q]), float(np.hypot(*(LATTICE_M * [p - a, q - b]))))
        for p in range(rows)
        for q in range(columns)
        if inside[p, q] and score[p, q] > OFF_MAP_SCORE and score[p, q] >= neighbours(p, q)
    ]
    rival = max((value for value, apart in peaks if apart >= APART_M), default=OFF_MAP_SCORE)
    decoy = scores(stack.decoys[..., None])[0].ravel()
    known = decoy[decoy > OFF_MAP_SCORE]
    floor = float(np.sqrt(np.mean(known**2))) if len(known) >= 12 else 0.0
    p, q = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    far = (np.hypot(LATTICE_M[0] * (p - a), LATTICE_M[1] * (q - b)) >= 2.0 * APART_M) & (score > OFF_MAP_SCORE)
    region_floor = float(np.sqrt(np.mean(score[far] ** 2))) if far.sum() >= 16 else 0.0
    point = np.array([a, b], np.float64)
    if 0 < a < rows - 1 and 0 < b < columns - 1:
        for axis, (before, after) in enumerate(
            ((score[a - 1, b], score[a + 1, b]), (score[a, b - 1], score[a, b + 1]))
        ):
            bend = before + after - 2 * score[a, b]
            if bend < -1e-6 and min(before, after) > OFF_MAP_SCORE:
                point[axis] += np.clip(0.5 * (before - after) / bend, -0.5, 0.5)
    area = int(np.sum(inside & (score > OFF_MAP_SCORE)))
    share = float(np.max(np.where(inside, overlap, 0.0)))
    rising = neighbours(int(a), int(b)) > score[a, b]
    return Window(point, int(height[a, b]), float(score[a, b]), rival, floor, region_floor, share, area, rising)


CARRIED = np.array([6.3, 4.2])
CARRIED_M, NEAR = 1.0, (5, 7)


def peaks_of(
    stack: Stack, first: np.ndarray, last: np.ndarray, centre: np.ndarray, half_m: float
) -> tuple[Peaks, Peaks]:
    """Of the whole region, and near the carried place."""
    ends = len(last)
    every = Surfaces(stack.surfaces, stack.decoys, stack.power)
    sums = RunningSums(Surfaces(*(part[:0] for part in every)), 0, STACK)
    for part in (slice(0, 4), slice(4, STACK)):
        sums.append(Surfaces(*(field[part] for field in every)))
    windows = WindowBatch(
        *sums.over(first, last),
        jnp.asarray(np.where(first >= 0, last[:, None] + 1 - first, 0), dtype=jnp.int32),
        single(centre),
        jnp.full(ends, half_m, jnp.float32),
        single(np.tile(CARRIED, (ends, 1))),
        jnp.full(ends, CARRIED_M, jnp.float32),
    )
    found = window_peaks(
        windows,
        single(LATTICE_M),
        jnp.float32(APART_M),
        jnp.float32(MIN_OVERLAP),
        near=NEAR,
    )
    whole, close = (Peaks(*(np.asarray(field) for field in each)) for each in found)
    return whole, close


def check(got: Peaks, wanted: Window, floor: float) -> None:
    np.testing.assert_allclose(got.point, wanted.point, atol=2e-3)
    assert int(got.height) == wanted.height
    np.testing.assert_allclose(got.score, wanted.score, atol=1e-5)
    np.testing.assert_allclose(got.rival, wanted.rival, atol=1e-5)
    np.testing.assert_allclose(got.floor, floor, rtol=1e-4)
    np.testing.assert_allclose(got.region_floor, wanted.region_floor, rtol=1e-4)
    np.testing.assert_allclose(got.overlap, wanted.overlap, atol=1e-5)
    assert int(got.area) == wanted.area
    assert bool(got.at_rim) == wanted.at_rim


@pytest.mark.parametrize(("seed", "half_m"), [(0, 2.0), (1, 3.5), (2, 8.0)])
def test_a_window_is_the_sum_of_its_scans(seed: int, half_m: float) -> None:
    stack = made_stack(seed)
    first = np.array([[8, 6, 0], [5, 4, 2], [-1, 1, -1]])
    last = np.array([8, 5, 3])
    centre = np.array([[5.0, 5.0], [4.6, 5.3], [5.2, 4.4]])
    found, near = peaks_of(stack, first, last, centre, half_m)
    # The part of the lattice about the carried place, whole points.
    corner = np.round(CARRIED).astype(int) - np.array(NEAR) // 2
    part = stack.surfaces[:, :, corner[0] : corner[0] + NEAR[0], corner[1] : corner[1] + NEAR[1]]
    assert part.shape[2:] == NEAR
    for end in range(3):
        for window in range(3):
            got, close = (Peaks(*(field[end, window] for field in each)) for each in (found, near))
            if first[end, window] < 0:
                assert got.score == close.score == OFF_MAP_SCORE
                continue
            span = (first[end, window], last[end])
            wanted = window_of(stack, *span, centre[end], half_m)
            check(got, wanted, wanted.floor)
            beside = window_of(stack._replace(surfaces=part), *span, CARRIED - corner, CARRIED_M)
            check(close, beside._replace(point=beside.point + corner), wanted.floor)


def test_scans_before_a_window_are_none_of_its_business() -> None:
    """Running sums: what was loud long ago leaves a trace of rounding only."""
    stack = made_stack(3)
    loud = stack._replace(surfaces=stack.surfaces.copy())
    loud.surfaces[:4, :2] *= 100.0
    first, last, centre = np.full((3, 3), 6), np.full(3, 8), np.full((3, 2), 5.0)
    quiet, after = (peaks_of(each, first, last, centre, 8.0)[0] for each in (stack, loud))
    np.testing.assert_allclose(after.score, quiet.score, atol=1e-4)
    np.testing.assert_allclose(after.point, quiet.point, atol=1e-2)


def test_a_region_off_the_map_has_no_place() -> None:
    stack = made_stack(4)
    stack.surfaces[:, 2:] = 0.0
    found, _ = peaks_of(stack, np.full((3, 3), 3), np.full(3, 8), np.full((3, 2), 5.0), 3.0)
    assert np.all(found.score == OFF_MAP_SCORE)
    assert not np.any([found.overlap, found.area])


def test_sums_of_a_long_drive_are_those_of_its_windows() -> None:
    rng = np.random.default_rng(3)
    room, count = 6, 64
    whole = Surfaces(rng.normal(size=(count, 3, 5, 4)), rng.normal(size=(count, 3, 7)), rng.uniform(size=count))
    sums, dropped, low = RunningSums(Surfaces(*(part[:0] for part in whole)), 0, room), 0, 0
    while low < count:
        high = min(count, low + int(rng.integers(1, room)))
        sums.append(Surfaces(*(field[low:high] for field in whole)))
        low = high
        # Stops are counted from a later one on, as those before are forgotten.
        sums.renumber(2)
        dropped += 2
        assert sums.end == high - dropped
        begin = max(high - room, 0)
        last, first = np.array([high - 1 - dropped]), np.array([[high - 1, begin]]) - dropped
        if begin < dropped:
            continue
        got = sums.over(np.concatenate([first, [[-1]]], axis=1), last)
        for field, every in zip(got, whole, strict=True):
            np.testing.assert_allclose(field[0, 0], every[high - 1], rtol=1e-5, atol=1e-6)
            np.testing.assert_allclose(field[0, 1], every[begin:high].sum(axis=0), rtol=1e-5, atol=1e-6)
            assert not np.any(field[0, 2])
    assert dropped > room
