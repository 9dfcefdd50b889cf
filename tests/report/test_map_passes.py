"""Passes over a map: cells in the colour of their number, holes hatched, ages where they are known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from lgprjax.report import MapPasses, draw_passes
from lgprjax.report.map import PASSES
from refusals import refused
from report.synthetic import numbers

PLACES, CELLS = 40, 7


def ground() -> MapPasses:
    """Two passes, on the left seven; bare from 12 to 14 m and, in one cell, at 30 m; of unknown age at the end."""
    passes = np.full((PLACES, CELLS), 2)
    passes[:, -2:] = 7
    hole = np.zeros((PLACES, CELLS), bool)
    hole[12:14, 2:5] = hole[30, 3] = True
    passes[hole] = 0
    passes[:, 0] = 0
    age = np.where(passes > 0, np.linspace(10.0, 400.0, PLACES)[:, None], np.nan)
    age[35:] = np.nan
    return MapPasses(
        name="road",
        at_m=np.arange(PLACES) + 0.5,
        across_m=0.25 * (np.arange(CELLS) - 3),
        passes=passes,
        age_days=age,
        hole=hole,
        half_like_m=0.31,
        today="2026-11-22",
    )


def test_cells_have_the_colour_of_their_passes_and_ages(tmp_path: Path, drawn: list[Figure]) -> None:
    shown = ground()
    draw_passes(shown, tmp_path / "p.png")
    above, below = drawn[0].axes[:2]
    counted, aged = above.images[-1], below.images[-1]
    values: np.ndarray = np.ma.filled(np.ma.asarray(counted.get_array()), np.nan).T
    np.testing.assert_array_equal(values, np.where(shown.passes > 0, np.minimum(shown.passes, 5), np.nan))
    colours = counted.to_rgba(np.array([1.0, 2.0, 5.0]))
    np.testing.assert_allclose(colours, [PASSES[0], PASSES[1], PASSES[4]])
    ages: np.ndarray = np.ma.filled(np.ma.asarray(aged.get_array()), np.nan).T
    np.testing.assert_array_equal(ages, shown.age_days)
    assert aged.get_clim() == (0.0, np.nanmax(shown.age_days))
    # Under it, ground is grey where its age is not known.
    grey: np.ndarray = np.ma.filled(np.ma.asarray(below.images[0].get_array()), np.nan).T
    np.testing.assert_array_equal(np.isfinite(grey), shown.passes > 0)
    assert above.get_ylim() == pytest.approx((-0.875, 0.875))
    assert counted.get_extent() == pytest.approx((0.0, 40.0, -0.875, 0.875))


def test_holes_are_hatched_where_they_are_and_the_bar_tells_likeness(tmp_path: Path, drawn: list[Figure]) -> None:
    draw_passes(ground(), tmp_path / "p.png")
    above = drawn[0].axes[0]
    hatched = [c for c in above.collections if c.get_hatch()]
    boxes = {tuple(np.round(path.get_extents().extents, 3)) for c in hatched for path in c.get_paths()}
    rows = [(-0.375 + 0.25 * row, -0.125 + 0.25 * row) for row in range(3)]
    assert boxes == {(12.0, low, 14.0, high) for low, high in rows} | {(30.0, -0.125, 31.0, 0.125)}
    marks = [line for line in above.lines if line.get_marker() == "v"]
    assert [float(np.ravel(line.get_xdata())[0]) for line in marks] == [13.0, 30.5]
    assert numbers(drawn[0].get_suptitle())[-2:] == ["3", "40"]
    # The bar is as long as the ground is alike.
    bars = [c for c in drawn[0].axes[0].collections if not c.get_hatch()]
    ends = np.concatenate([segment[:, 1] for c in bars for segment in c.get_segments()])  # type: ignore[attr-defined]
    assert np.ptp(ends) == pytest.approx(0.31)
    assert "2026-11-22" in drawn[0].get_supxlabel()


def test_odd_input_draws(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    whole = ground()
    bare = replace(
        whole,
        passes=np.zeros_like(whole.passes),
        age_days=np.full_like(whole.age_days, np.nan),
        hole=np.ones_like(whole.hole),
        half_like_m=None,
    )
    one = replace(
        whole,
        at_m=whole.at_m[:1],
        passes=whole.passes[:1],
        age_days=0.0 * whole.age_days[:1],
        hole=whole.hole[:1],
    )
    for number, shown in enumerate((bare, one)):
        draw_passes(shown, tmp_path / f"{number}.png")
    assert not caplog.records
    with refused("output", "--force", file="1.png"):
        draw_passes(whole, tmp_path / "1.png")
