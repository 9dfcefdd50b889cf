"""The hard set: the same from the same seed, exact where it says so, and best at the truth by exhaustive search."""

from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Float
from scipy.ndimage import map_coordinates

from benchmarks import HardSet, HardSetConfig, load_hard_set, make_hard_set, save_hard_set, success
from benchmarks.coverage import draw_ground, sample_ground
from benchmarks.registration import CELL_M, band_basis
from lgprjax.errors import InputError

CONFIG = HardSetConfig(maps=1, scans=6)


@pytest.fixture(scope="module")
def hard() -> HardSet:
    return make_hard_set(5, CONFIG)


def spline_response(hard: HardSet, problem: int, pose: Float[np.ndarray, " 5"]) -> Float[np.ndarray, "channel number"]:
    """What the array hears by SciPy's quintic spline and a sum over each sample's own delay: no code of the package."""
    ground = hard.ground[hard.map_index[problem]].astype(np.float64)
    left = 0.127 * (5 - np.arange(11))
    along = (pose[0] - np.sin(pose[3]) * left - hard.origin_m[0]) / hard.cell_m[0]
    cross = (pose[1] + np.cos(pose[3]) * left - hard.origin_m[1]) / hard.cell_m[1]
    heard = np.stack([map_coordinates(layer, [along, cross], order=5) for layer in np.moveaxis(ground, -1, 0)], axis=-1)
    later_ns = 2.0 * (pose[2] + left * np.sin(pose[4]) - 0.3) / 0.299792458
    time_ns = 0.16 * np.arange(369)
    half = len(hard.omega)
    traces = np.empty((11, 369))
    for channel in range(11):
        angle = np.outer(time_ns - later_ns[channel], hard.omega)
        traces[channel] = np.cos(angle) @ heard[channel, :half] - np.sin(angle) @ heard[channel, half:]
    return np.asarray(traces * np.sqrt(2.0 / 369))


def correlation(one: Float[np.ndarray, "..."], other: Float[np.ndarray, "..."]) -> float:
    return float(np.sum(one * other) / np.sqrt(np.sum(one**2) * np.sum(other**2)))


def in_band(samples: Float[np.ndarray, "channel sample"]) -> Float[np.ndarray, "channel sample"]:
    """Band-limited by NumPy's own Fourier transform: harmonics 5 to 26."""
    spectrum = np.fft.rfft(samples.astype(np.float64), axis=-1)
    spectrum[..., :5] = 0.0
    spectrum[..., 27:] = 0.0
    return np.fft.irfft(spectrum, 369, axis=-1)


def test_the_same_seed_gives_the_same_problems_and_another_does_not(hard: HardSet) -> None:
    again, other = make_hard_set(5, CONFIG), make_hard_set(6, CONFIG)
    for name in HardSet._fields:
        np.testing.assert_array_equal(getattr(hard, name), getattr(again, name))
    assert not np.array_equal(hard.scans, other.scans)
    assert not np.array_equal(hard.truth, other.truth)


def test_scans_are_int8_values_and_truths_lie_in_the_inner_box(hard: HardSet) -> None:
    np.testing.assert_array_equal(hard.scans, hard.scans.astype(np.int8))
    assert np.all(np.abs(hard.scans).max(axis=(1, 2)) > 60)
    assert np.all(np.abs(hard.truth - hard.prior) <= 0.8 * hard.half_width)
    assert np.all((hard.correlation >= 0.45) & (hard.correlation <= 0.65))


def test_basis_is_orthonormal_so_that_parseval_holds(hard: HardSet) -> None:
    basis, omega = band_basis()
    assert basis.shape == (369, 44)
    np.testing.assert_allclose(basis.T @ basis, np.eye(44), atol=1e-12)
    np.testing.assert_allclose(omega / (2 * np.pi) * 1e3, np.fft.rfftfreq(369, 0.16e-3)[5:27], rtol=1e-12)
    scan = hard.scans[0].astype(np.float64)
    np.testing.assert_allclose(np.sum((scan @ basis) ** 2), np.sum(in_band(scan) ** 2), rtol=1e-10)


def test_r_at_the_truth_is_as_drawn(hard: HardSet) -> None:
    for problem in range(len(hard.truth)):
        heard = spline_response(hard, problem, hard.truth[problem])
        found = correlation(heard, in_band(hard.scans[problem]))
        # Rounding to int8 and the spline's own error.
        assert abs(found - hard.correlation[problem]) < 2e-3


@pytest.mark.parametrize("problem", [0, 3])
def test_exhaustive_search_finds_the_truth_and_nothing_better(hard: HardSet, problem: int) -> None:
    """Every node of the box at the true height, heading and roll, then the truth itself, in float64."""
    truth = hard.truth[problem]
    heard = in_band(hard.scans[problem]) @ hard.basis
    half = len(hard.omega)
    left = 0.127 * (5 - np.arange(11))
    later_ns = 2.0 * (truth[2] + left * np.sin(truth[4]) - 0.3) / 0.299792458
    turned = (heard[:, :half] + 1j * heard[:, half:]) * np.exp(1j * later_ns[:, None] * hard.omega)
    at_reference = np.concatenate([turned.real, turned.imag], axis=1)
    ground = hard.ground[hard.map_index[problem]].astype(np.float64)
    along, cross = np.meshgrid(np.arange(-3.48, 3.5, 0.08), np.arange(-3.43, 3.5, 0.0635), indexing="ij")
    product, power = np.zeros(along.shape), np.zeros(along.shape)
    for channel in range(11):
        i = (along - np.sin(truth[3]) * left[channel] - hard.origin_m[0]) / hard.cell_m[0]
        j = (cross + np.cos(truth[3]) * left[channel] - hard.origin_m[1]) / hard.cell_m[1]
        low_i, low_j = i.astype(int), j.astype(int)
        a, b = (i - low_i)[..., None], (j - low_j)[..., None]
        under = (1 - a) * (1 - b) * ground[low_i, low_j] + (1 - a) * b * ground[low_i, low_j + 1]
        under += a * (1 - b) * ground[low_i + 1, low_j] + a * b * ground[low_i + 1, low_j + 1]
        product += under @ at_reference[channel]
        power += np.sum(under**2, axis=-1)
    r = product / np.sqrt(power * np.sum(heard**2))
    best = np.unravel_index(int(np.argmax(r)), r.shape)
    assert np.hypot(along[best] - truth[0], cross[best] - truth[1]) < 0.08
    away = np.hypot(along - truth[0], cross - truth[1]) > 0.25
    assert r[away].max() < hard.correlation[problem] - 0.03
    assert r.max() < hard.correlation[problem] + 0.02


def test_ground_between_nodes_is_the_band_limited_field() -> None:
    """Against plane waves whose value anywhere is known, up to where the field has a millionth of its power."""
    rng = np.random.default_rng(2)
    wave = rng.uniform(-30.0, 30.0, (2, 7))
    nodes = np.stack(np.meshgrid(np.arange(60) * CELL_M[0], np.arange(50) * CELL_M[1], indexing="ij"), axis=-1)
    cells = rng.uniform(15.0, 30.0, (40, 2))
    found = sample_ground(np.cos(nodes @ wave), cells)
    np.testing.assert_allclose(found, np.cos((cells * CELL_M) @ wave), atol=2e-3)


def test_field_has_the_stated_autocorrelation_and_the_decoy_repeats() -> None:
    rng = np.random.default_rng(3)
    cell = np.array([0.061, 0.0635])
    plain = draw_ground(rng, (400, 60), cell, np.eye(12), HardSetConfig(decoy_share=0.0))
    np.testing.assert_allclose(np.mean(plain**2), 1.0, atol=0.05)
    for step in (1, 2, 3):
        expected = np.exp(-((step * cell[0]) ** 2) / (2 * 0.12**2))
        np.testing.assert_allclose(np.mean(plain[step:] * plain[:-step]), expected, atol=0.05)
    # Ten cells are one pitch: the decoy alone is the same again, in the mixture its share is.
    decoy = draw_ground(rng, (40, 60), cell, np.eye(12), HardSetConfig(decoy_share=1.0))
    np.testing.assert_allclose(decoy[10:], decoy[:-10], atol=1e-9)
    mixed = draw_ground(rng, (400, 60), cell, np.eye(12), HardSetConfig(decoy_share=0.35))
    np.testing.assert_allclose(np.mean(mixed[10:] * mixed[:-10]), 0.35, atol=0.06)


def test_success_is_a_tenth_of_a_metre_on_the_ground() -> None:
    truth = np.zeros((3, 5))
    pose = np.array([[0.06, 0.07, 0, 0, 0], [0.08, 0.08, 0, 0, 0], [0.0, 0.099, 1.0, 1.0, 1.0]])
    assert success(pose, truth).tolist() == [True, False, True]


def test_saved_sets_come_back_and_other_files_are_refused(hard: HardSet, tmp_path: Path) -> None:
    save_hard_set(tmp_path / "set.npz", hard)
    for name, value in load_hard_set(tmp_path / "set.npz")._asdict().items():
        np.testing.assert_array_equal(value, getattr(hard, name))
    with pytest.raises(InputError, match=r"no\.npz: hard set: expected an npz file"):
        load_hard_set(tmp_path / "no.npz")
    np.savez(tmp_path / "other.npz", ground=hard.ground)
    with pytest.raises(InputError, match=r"other\.npz: hard set"):
        load_hard_set(tmp_path / "other.npz")
