"""Timing: every event in its row, and beyond the deadline what is beyond it."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from lgprjax.errors import InputError
from lgprjax.report import StageTimes, TimingPicture, draw_timing
from lgprjax.report.style import BLUE, VERMILLION

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
    assert "p99 6.34" in title
    assert "of 1000; 10 over 8 ms" in title
    deadline, middle, _ = (np.asarray(line.get_xdata())[0] for line in search.lines)
    assert (deadline, middle) == (8.0, pytest.approx(np.median(SEARCH_MS)))
    assert "of 3" in period.get_title(loc="left")
    assert "over" not in period.get_title(loc="left")
    assert "no event" in brake.get_title(loc="left")
    low, high = search.get_xlim()
    assert low < 2.0
    assert high > 100.0
    assert search.get_xscale() == "log"
    assert "A made-up run." in drawn[0].get_supxlabel()


def test_late_events_have_a_colour_and_a_hatch_of_their_own(tmp_path: Path, drawn: list[Figure]) -> None:
    draw_timing(timing(), tmp_path / "t.png")
    kept, late = drawn[0].axes[0].patches
    assert kept.get_facecolor()[:3] == pytest.approx([int(BLUE[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    assert late.get_facecolor()[:3] == pytest.approx([int(VERMILLION[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    assert (kept.get_hatch() or "", late.get_hatch()) == ("", "////")
    # Beyond the deadline nothing else stands in the bins.
    outline = np.asarray(late.get_path().vertices)
    assert outline[outline[:, 0] > 8.0, 1].max() == 10.0


@pytest.mark.parametrize(
    "values", [np.zeros(0), np.full(3, np.nan), np.zeros(4), np.array([7.0])], ids=["none", "nan", "zero", "one"]
)
def test_odd_input_draws(values: np.ndarray, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    shown = TimingPicture(title="t", stages=(StageTimes("only", values),), note="Said.")
    draw_timing(shown, tmp_path / "t.png")
    assert not caplog.records
    with pytest.raises(InputError, match="one that exists"):
        draw_timing(shown, tmp_path / "t.png")
