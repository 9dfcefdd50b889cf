"""Peers in their own processes: each finds scans of a small set, and a failure is told."""

import importlib.util
from pathlib import Path

import pytest

from benchmarks import HardSetConfig, PeerResult, make_hard_set, run_peer, save_hard_set
from benchmarks.peers import PEERS

PROBLEMS = 4
SMALL: dict[str, tuple[str, ...]] = {
    "this_project": (),
    "numba_swarm": (),
    "numba_control": ("--rank", "16"),
    "pyswarms_peer": (),
    "evosax_peer": ("--particles", "384"),
    "direct_swarm": (),
}


@pytest.fixture(scope="module")
def hard_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bench") / "set.npz"
    save_hard_set(path, make_hard_set(3, HardSetConfig(maps=1, scans=PROBLEMS)))
    return path


def check(result: PeerResult) -> None:
    """All searches but the one with a single global best find all of four scans or all but one."""
    assert result.missing == ""
    assert result.problems == PROBLEMS
    assert result.successes >= (2 if result.name == "evosax_peer" else 3)
    assert result.median_error_m < 0.05
    assert 0.0 < result.single_ms < 1e5
    assert 0.0 < result.batch_ms < 1e5
    assert result.preparation_ms >= 0.0
    assert result.peak_rss_mb > 30.0
    assert (result.single_threads, result.batch_threads) == (1, 1)


@pytest.mark.parametrize("name", sorted(PEERS))
def test_peer_finds_scans_in_the_band(name: str, hard_file: Path) -> None:
    if importlib.util.find_spec(PEERS[name]) is None:
        pytest.skip(f"{PEERS[name]} is not installed")
    check(run_peer(name, hard_file, count=PROBLEMS, threads=(1,), options=SMALL[name]))


def test_full_samples_are_searched_too(hard_file: Path) -> None:
    result = run_peer("direct_swarm", hard_file, count=2, threads=(1,), options=("--full", "--particles", "192"))
    assert result.missing == ""
    assert result.setting == "full 192x40"
    assert result.evaluations == 192 * 41
    assert result.successes >= 1


def test_failed_process_is_told(hard_file: Path, tmp_path: Path) -> None:
    failed = run_peer("direct_swarm", hard_file, count=1, threads=(1,), options=("--no-such-option",))
    assert "--no-such-option" in failed.missing
    unread = run_peer("direct_swarm", tmp_path / "none.npz", count=1, threads=(1,))
    assert "none.npz" in unread.missing
