"""The hard set and the programs that search it: best at the truth by exhaustive search, found on a repeated road."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from bench.test_hard_set import CONFIG, in_band
from benchmarks import HardSet, HardSetConfig, make_hard_set, save_hard_set
from benchmarks.coverage import draw_ground
from benchmarks.long_map import CHANNELS, HEIGHT_M, RepeatedRoad
from benchmarks.process import ProgramError, run_program
from lgprjax.registration import RegisterOptions, ground_map_for, register_drive


@pytest.fixture(scope="module")
def hard() -> HardSet:
    return make_hard_set(5, CONFIG)


@pytest.mark.parametrize("problem", range(CONFIG.maps * CONFIG.scans))
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


def test_the_field_has_the_stated_autocorrelation_and_the_decoy_repeats() -> None:
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


def test_a_drive_is_found_on_a_repeated_road() -> None:
    road = RepeatedRoad(80.0, 40.0)
    block = road.live_block(52.0, 200, seed=3)
    assert block.traces.shape == (200, CHANNELS, 369)
    options = RegisterOptions(search_m=1.5, time_scale=1.0)
    ground = ground_map_for(road, options)
    blocks = [block._replace(truth=None)]
    (found,) = register_drive(ground, road.operators, road.array, blocks, options, recorded=369)
    assert block.truth is not None
    apart = np.hypot(*(found.fix.pose[:, :2] - block.truth[:, :2]).T)
    # The first metres are without what the track filter needs to have seen.
    assert np.mean(apart[100:] < 0.1) > 0.9
    assert np.all(np.abs(block.track.pose[:, :2] - block.truth[:, :2]) <= 1.0)
    assert road.operators(1.0).shape[0] == 369
    assert float(jnp.max(jnp.abs(road.operators(1.0)))) > 0.0
    assert road.height_reference_m[0] == HEIGHT_M


def test_stages_and_the_rest_are_the_whole(tmp_path: Path) -> None:
    file = tmp_path / "set.npz"
    save_hard_set(file, make_hard_set(4, HardSetConfig(maps=1, scans=2)))
    taken = run_program("benchmarks.stages", [str(file)], threads=1)
    whole = taken.pop("whole")
    assert sum(value for stage, value in taken.items() if "floor" not in stage) == pytest.approx(whole)
    assert min(taken[stage] for stage in ("products and surfaces", "floor from operations", "floor from bytes")) > 0


def test_a_program_that_fails_names_itself_and_what_it_lacks(tmp_path: Path) -> None:
    with pytest.raises(ProgramError, match=r"benchmarks\.no_such"):
        run_program("benchmarks.no_such", [], threads=1)
    with pytest.raises(ProgramError, match=r"none\.npz"):
        run_program(
            "benchmarks.rollout_peers.plain_python",
            [str(tmp_path / "none.npz"), str(tmp_path / "out.npz"), "--steps", "1", "--threads", "1"],
            threads=1,
        )
