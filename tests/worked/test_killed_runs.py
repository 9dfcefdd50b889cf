"""A run of a small field that is cut off at a random moment and taken up with ``--resume``."""

from pathlib import Path

from validation.fields.killed_runs import work_through


def test_a_small_field_cut_off_once(tmp_path: Path) -> None:
    work_through(tmp_path, 12.0, 5.0, kills=1, seed=4)
