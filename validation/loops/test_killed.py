"""The recorder, and either end of a ring, killed at random moments under load."""

from pathlib import Path

import pytest

from runtime.recorder_process import check_kills
from validation.loops.ring_ends import check_killed_reader, check_killed_writer


@pytest.mark.parametrize("seed", range(20))
def test_a_recorder_killed_at_200_moments(tmp_path: Path, seed: int) -> None:
    check_kills(tmp_path, 10, 100 + seed)


def test_the_writer_of_a_ring(tmp_path: Path) -> None:
    check_killed_writer(tmp_path / "r", 60)


def test_the_reader_of_a_ring(tmp_path: Path) -> None:
    check_killed_reader(tmp_path / "r", 60)
