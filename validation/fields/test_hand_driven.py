"""Fields worked by remote control without a plan, at the source's speeds: 0.25 to 1 mph, several vehicles' errors."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from lgprjax.coverage import CellState
from lgprjax.worked.layers import grid_of
from lgprjax.worked.record import read_cover_run, record_cover
from true_cells import true_cells
from worked.hand_driven import drive_by_hand

_OFF = {"kind": "gnss_off", "at_s": 45.0, "for_s": 30.0, "every_s": 90.0}


@pytest.mark.parametrize(
    ("seed", "speed_mps", "off"),
    [(2, 0.11, False), (3, 0.11, True), (71, 0.28, False), (1009, 0.45, True), (50_021, 0.45, False)],
)
def test_the_way_is_recorded(
    tmp_path: Path, seed: int, speed_mps: float, *, off: bool, record_property: Callable[[str, object], None]
) -> None:
    driven = drive_by_hand(tmp_path, swaths=4, speed_mps=speed_mps, seed=seed, faults=[_OFF] if off else None)
    record = record_cover([], [read_cover_run(driven.run)])
    grid = grid_of(record)
    poses, works = driven.truth()
    worked = true_cells(grid, record.tool, poses, works)
    for level, state in zip(record.cells.level, record.cells.state, strict=True):
        claimed = state == CellState.PROCESSED
        way = driven.middle_claimed(grid, claimed)
        true = float(np.mean(worked[claimed]))
        record_property(f"{level:g}_way", round(way, 4))
        record_property(f"{level:g}_claimed_to_worked", round(float(claimed.sum() / worked.sum()), 3))
        record_property(f"{level:g}_true", round(true, 5))
        assert way >= 0.95
        assert true >= level
