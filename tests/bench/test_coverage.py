"""The benchmark of the worked area: its drive, its brute force, records of made-up figures, a tiny run."""

import numpy as np
import pytest

from benchmarks import coverage
from benchmarks.coverage import CoveragePlan, coverage_records, run_coverage
from benchmarks.process import ProgramError
from benchmarks.worked_area import TOOL, brute_force, drive
from lgprjax.coverage import CellGrid

FIGURES = {
    "cells": 4e6,
    "moments": 2000.0,
    "draws": 1e4,
    "p50_ms": 2.5,
    "p99_ms": 12.0,
    "max_ms": 20.0,
    "map_mb": 16.0,
    "peak_rss_mb": 400.0,
    "brute_force_ms": 1000.0,
    **{f"cached_made_s_{level}": 3.0 for level in ("0.95", "0.996")},
    **{f"cached_ms_{level}": 0.25 for level in ("0.95", "0.996")},
    **{f"cached_m2_{level}": 90.0 for level in ("0.95", "0.996")},
    **{f"ours_m2_{level}": 99.0 for level in ("0.95", "0.996")},
    **{f"cached_beyond_ours_cells_{level}": 0.0 for level in ("0.95", "0.996")},
}


def test_records_say_what_is_met_and_what_is_not() -> None:
    records = {record.key: record for record in coverage_records(FIGURES)}
    assert records["step, median"].met is True
    assert records["step, p99"].met is False
    assert records["steps in a period"].value == pytest.approx(40.0)
    assert records["brute force / step"].value == pytest.approx(400.0)
    assert records["cached shapes / step, 0.95"].value == pytest.approx(0.1)
    assert records["area / cached shapes, 0.996"].value == pytest.approx(1.1)
    assert records["cells of cached shapes alone, 0.95"].met is True


def test_the_drive_keeps_to_its_field_and_its_covariances_are_some() -> None:
    poses, covariances = drive(5000)
    assert poses[:, :2].min() >= 2.0 - 1e-9
    assert poses[:, :2].max() <= 98.0 + 1e-9
    assert np.linalg.eigvalsh(covariances).min() > 0.0
    assert len(np.unique(poses[:, 1])) == 3


def test_brute_force_of_hardly_any_error_is_the_swath() -> None:
    grid = CellGrid(0.0, 0.0, 0.05, 100, 100)
    share = brute_force(grid, np.array([1.0, 2.5, 0.0]), np.diag([1e-10, 1e-10, 1e-12]), 0.5, 20)
    # From half a tool behind where the pass began to half a tool ahead of where it is.
    assert set(np.unique(share)) <= {0.0, 1.0}
    assert share.sum() * grid.cell_m2 == pytest.approx((0.5 + TOOL.length_m) * TOOL.width_m, rel=0.1)


def test_what_does_not_run_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object, **__: object) -> dict[str, float]:
        raise ProgramError("benchmarks.worked_area: not done within 1 s")

    monkeypatch.setattr(coverage, "run_program", fails)
    outcome = run_coverage(CoveragePlan(10, 10), lambda _: None)
    assert outcome.records == []
    assert outcome.not_measured == ["benchmarks.worked_area: not done within 1 s"]
