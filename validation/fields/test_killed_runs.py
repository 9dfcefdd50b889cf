"""Runs of a larger field that are cut off at random moments and taken up with ``--resume``."""

from collections.abc import Callable
from pathlib import Path

from validation.fields.killed_runs import work_through


def test_a_quarter_of_a_hectare_cut_off_ten_times(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """A quarter of an hour of a core. ``test_resumed_sessions`` has the hectare, by the compiled loop."""
    record_property("worked", work_through(tmp_path, 50.0, 50.0, kills=10, seed=5))


def test_a_small_field_cut_off_once(tmp_path: Path) -> None:
    work_through(tmp_path, 12.0, 5.0, kills=1, seed=4)
