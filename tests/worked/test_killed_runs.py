"""Runs of a small field that are cut off at random moments and taken up with ``--resume``."""

from pathlib import Path

from validation.fields.killed_runs import work_through


def test_a_small_field_cut_off_twice(tmp_path: Path) -> None:
    work_through(tmp_path, 12.0, 5.0, kills=2, seed=4)
