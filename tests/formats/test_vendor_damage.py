"""Damaged vendor files and side files are read or refused; ``make validation NAME=damage`` tries far more damages."""

from pathlib import Path

import pytest

from validation.damage.vendor_files import SUBJECTS, check_damages


@pytest.mark.parametrize("name", SUBJECTS)
def test_damaged_files_are_read_or_refused(name: str, tmp_path: Path) -> None:
    check_damages(name, 60 if SUBJECTS[name].fatal else 10, tmp_path)
