"""What benchmarks measure on: the hard set, exact where it says so; roads, fields and drives as they are said to be."""

from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Float
from scipy.ndimage import map_coordinates

from benchmarks import HardSet, HardSetConfig, load_hard_set, make_hard_set, save_hard_set, success
from benchmarks.archive import cut_drive
from benchmarks.coverage import sample_ground
from benchmarks.long_map import CHANNELS, RepeatedRoad
from benchmarks.registration import CELL_M, band_basis
from benchmarks.rollout_problem import as_rollout, load_problem, make_problem, save_problem
from benchmarks.worked_area import TOOL, brute_force, drive
from canon.site import Site
from lgprjax.coverage import CellGrid
from lgprjax.formats import DriveLog
from lgprjax.subsurface import StationSource
from refusals import refused

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


def test_ground_between_nodes_is_the_band_limited_field() -> None:
    """Against plane waves whose value anywhere is known, up to where the field has a millionth of its power."""
    rng = np.random.default_rng(2)
    wave = rng.uniform(-30.0, 30.0, (2, 7))
    nodes = np.stack(np.meshgrid(np.arange(60) * CELL_M[0], np.arange(50) * CELL_M[1], indexing="ij"), axis=-1)
    cells = rng.uniform(15.0, 30.0, (40, 2))
    found = sample_ground(np.cos(nodes @ wave), cells)
    np.testing.assert_allclose(found, np.cos((cells * CELL_M) @ wave), atol=2e-3)


def test_success_is_a_tenth_of_a_metre_on_the_ground() -> None:
    truth = np.zeros((3, 5))
    pose = np.array([[0.06, 0.07, 0, 0, 0], [0.08, 0.08, 0, 0, 0], [0.0, 0.099, 1.0, 1.0, 1.0]])
    assert success(pose, truth).tolist() == [True, False, True]


def test_saved_sets_come_back_and_other_files_are_refused(hard: HardSet, tmp_path: Path) -> None:
    save_hard_set(tmp_path / "set.npz", hard)
    for name, value in load_hard_set(tmp_path / "set.npz")._asdict().items():
        np.testing.assert_array_equal(value, getattr(hard, name))
    np.savez(tmp_path / "other.npz", ground=hard.ground)
    for name in ("no.npz", "other.npz"):
        with refused("hard set", "npz", file=name):
            load_hard_set(tmp_path / name)
    # Vehicles along a path: the same from the same seed.
    problem = make_problem(5, 10, 3)
    save_problem(tmp_path / "p.npz", problem)
    for one, other in zip(problem, load_problem(tmp_path / "p.npz"), strict=True):
        np.testing.assert_array_equal(one, other)
    assert not np.array_equal(problem.lanes, make_problem(5, 10, 4).lanes)
    spec, path, lane, start = as_rollout(problem, 10)
    assert spec.steps == 10
    assert start.x_m.shape == lane.speed_mps.shape == (5,)
    assert float(path.length_m) > 10 * 0.05 * 5.0


def test_the_drive_over_a_hectare_keeps_to_its_field_and_brute_force_is_the_swath() -> None:
    poses, covariances = drive(5000)
    assert poses[:, :2].min() >= 2.0 - 1e-9
    assert poses[:, :2].max() <= 98.0 + 1e-9
    assert np.linalg.eigvalsh(covariances).min() > 0.0
    assert len(np.unique(poses[:, 1])) == 3
    # Of hardly any error: from half a tool behind where the pass began to half a tool ahead of where it is.
    grid = CellGrid(0.0, 0.0, 0.05, 100, 100)
    share = brute_force(grid, np.array([1.0, 2.5, 0.0]), np.diag([1e-10, 1e-10, 1e-12]), 0.5, 20)
    assert set(np.unique(share)) <= {0.0, 1.0}
    assert share.sum() * grid.cell_m2 == pytest.approx((0.5 + TOOL.length_m) * TOOL.width_m, rel=0.1)


def test_a_road_repeats_its_ground_at_shifted_places() -> None:
    road = RepeatedRoad(60.0, 20.0, lanes=2)
    assert isinstance(road, StationSource)
    once = 500
    assert len(road.pose) == 2 * 3 * once
    np.testing.assert_allclose(road.pose[once : 2 * once, 0] - road.pose[:once, 0], 20.0)
    first, again = road.read_stations(np.array([7, 90])), road.read_stations(np.array([7, 90]) + 2 * once)
    np.testing.assert_array_equal(first.profile, again.profile)
    other = road.read_stations(np.array([7, 90]) + 3 * once)
    assert np.abs(other.profile - first.profile).max() > 0.1
    assert np.unique(np.round(np.diff(road.tile_frame[:, 0]), 3)).size < 6
    assert road.pose[0, 1] - road.pose[-1, 1] == pytest.approx(CHANNELS * 0.127)


def test_a_cut_drive_holds_its_scans_and_what_spans_them(site: Site, tmp_path: Path) -> None:
    path = tmp_path / "cut.drive.h5"
    with DriveLog.open(site.logs["live"]) as whole:
        cut_drive(whole, 100, 220, path)
        with DriveLog.open(path) as cut:
            assert cut.description.name == "cut"
            np.testing.assert_array_equal(cut.scan_time_s, whole.scan_time_s[100:220])
            for part, same in zip(cut.read_traces(0, 120), whole.read_traces(100, 220), strict=True):
                np.testing.assert_array_equal(part, same)
            for name in ("navigation", "odometry", "truth"):
                mine, theirs = (getattr(log.description, name) for log in (cut, whole))
                assert mine.time_s[0] <= cut.scan_time_s[0]
                assert mine.time_s[-1] >= cut.scan_time_s[-1]
                assert len(mine.time_s) < len(theirs.time_s)
