"""Timing: every event in its row, and beyond the deadline what is beyond it."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from lgprjax.report import StageTimes, TimingPicture, draw_timing
from refusals import refused
from report.synthetic import numbers

SEARCH_MS = np.concatenate([np.linspace(2.0, 6.0, 990), np.full(10, 40.0)])


def timing() -> TimingPicture:
    return TimingPicture(
        title="from scan to command",
        stages=(
            StageTimes("search", SEARCH_MS, 8.0),
            StageTimes("period", np.array([19.9, 20.0, np.nan, 20.1])),
            StageTimes("brake", np.zeros(0), 100.0),
        ),
        note="A made-up run.",
    )


def test_rows_hold_all_events_and_tell_the_late_ones(tmp_path: Path, drawn: list[Figure]) -> None:
    draw_timing(timing(), tmp_path / "t.png")
    search, period, brake = drawn[0].axes
    title = search.get_title(loc="left")
    assert {"6.34", "1000", "10", "8"} <= set(numbers(title))
    deadline, middle, _ = (np.asarray(line.get_xdata())[0] for line in search.lines)
    assert (deadline, middle) == (8.0, pytest.approx(np.median(SEARCH_MS)))
    assert "3" in numbers(period.get_title(loc="left"))
    assert numbers(brake.get_title(loc="left")) == []
    # Beyond the deadline stands what is beyond it, hatched.
    kept, late = search.patches
    assert (kept.get_hatch() or "", late.get_hatch()) == ("", "////")
    outline = np.asarray(late.get_path().vertices)
    assert outline[outline[:, 0] > 8.0, 1].max() == 10.0
    low, high = search.get_xlim()
    assert low < 2.0
    assert high > 100.0
    assert search.get_xscale() == "log"
    assert "A made-up run." in drawn[0].get_supxlabel()


def test_odd_input_draws(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for number, values in enumerate((np.zeros(0), np.full(3, np.nan), np.zeros(4), np.array([7.0]))):
        shown = TimingPicture(title="t", stages=(StageTimes("only", values),), note="Said.")
        draw_timing(shown, tmp_path / f"{number}.png")
    assert not caplog.records
    with refused("output", "--force", file="0.png"):
        draw_timing(shown, tmp_path / "0.png")
