"""Confidence: rows of the right fixes, and curves that a reader can check by counting."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lgprjax.report import StatedErrors, draw_confidence, stated_errors
from lgprjax.report.style import VERMILLION
from refusals import refused
from report.synthetic import declined_drive, numbers, straight_drive, without_truth

FIXES = 4000


def honest(scale: float = 1.0) -> StatedErrors:
    """Errors drawn from their stated sigmas, times ``scale``; the smaller the evidence the larger the error."""
    rng = np.random.default_rng(5)
    sigma = np.geomspace(0.01, 0.08, FIXES)
    ok = np.arange(FIXES) % 10 != 0
    return StatedErrors(
        name="a drive",
        along_m=scale * sigma * rng.standard_normal(FIXES),
        cross_m=scale * sigma * rng.standard_normal(FIXES),
        sigma_along_m=sigma,
        sigma_cross_m=sigma,
        evidence=np.linspace(12.0, 4.0, FIXES),
        ok=ok,
    )


def test_rows_are_the_tried_fixes_whose_truth_is_known() -> None:
    drive = straight_drive()
    truth_east = np.array(drive.truth_east_m)
    truth_east[:50] = np.nan
    short = replace(drive, truth_east_m=truth_east)
    stated = stated_errors([short, without_truth(), replace(straight_drive(), impostor=True)])
    assert len(stated.ok) == len(drive.code) - 50
    assert stated.name == drive.name
    np.testing.assert_array_equal(stated.ok, drive.ok[50:])
    np.testing.assert_allclose(10.0**-stated.evidence, drive.p_false[50:], rtol=1e-9)
    off = np.hypot(drive.east_m - drive.truth_east_m, drive.north_m - drive.truth_north_m)[50:]
    np.testing.assert_allclose(stated.total_m, off, rtol=1e-9)
    assert len(stated_errors([drive, drive]).ok) == 2 * len(drive.code)
    assert len(stated_errors([declined_drive()]).ok) == 0


def bins_of(axes: Axes) -> list[tuple[np.ndarray, np.ndarray]]:
    """Stated and true of each series."""
    series = [container.lines[0] for container in axes.containers]  # type: ignore[attr-defined]
    return [(np.asarray(line.get_xdata()), np.asarray(line.get_ydata())) for line in series]


def test_reliability_shows_how_far_sigmas_are_from_errors(tmp_path: Path, drawn: list[Figure]) -> None:
    scale = 2.5
    draw_confidence(honest(scale), tmp_path / "c.png")
    axes = drawn[0].axes[0]
    for stated_cm, true_cm in bins_of(axes):
        assert len(stated_cm) == 8
        # 450 errors a bin: their root mean square is known to 1/sqrt(2 · 450) of itself.
        np.testing.assert_allclose(true_cm, scale * stated_cm, rtol=4.0 / 30.0)
    legend = axes.get_legend()
    assert legend is not None
    assert any(float(each) == pytest.approx(31.1, abs=3.0) for each in numbers(legend.get_texts()[0].get_text()))


def test_errors_stand_by_evidence_and_declined_fixes_apart(tmp_path: Path, drawn: list[Figure]) -> None:
    stated = honest()
    draw_confidence(stated, tmp_path / "c.png")
    lines = drawn[0].axes[1].lines[:4]
    low, middle, high, declined = (np.asarray(line.get_xdata()) for line in lines)
    total_cm = 100.0 * stated.total_m
    third = np.sort(stated.evidence[stated.ok])[stated.ok.sum() // 3]
    lowest = np.sort(total_cm[stated.ok & (stated.evidence < third)])
    np.testing.assert_allclose(low[1 : len(lowest) + 1], np.maximum(lowest, 0.1))
    assert np.median(low) > np.median(middle) > np.median(high)
    np.testing.assert_allclose(declined[1:], np.maximum(np.sort(total_cm[~stated.ok]), 0.1))
    assert all(np.asarray(line.get_ydata())[-1] == pytest.approx(100.0) for line in lines)
    assert lines[3].get_color() == VERMILLION
    assert {"10.0", "4000"} <= set(numbers(drawn[0].get_suptitle()))


def test_what_a_smaller_risk_costs_is_what_counting_says(tmp_path: Path, drawn: list[Figure]) -> None:
    stated = honest(4.0)
    draw_confidence(stated, tmp_path / "c.png")
    declined, wrong = drawn[0].axes[2].lines[:2]
    asked = np.asarray(declined.get_xdata())
    for number in (0, 700, 2500, len(asked) - 1):
        kept = stated.ok & (stated.evidence >= asked[number])
        share = 100.0 * (1.0 - kept.sum() / FIXES)
        assert np.asarray(declined.get_ydata())[number] == pytest.approx(share)
        off = 100.0 * np.mean(stated.total_m[kept] > 0.3)
        assert np.asarray(wrong.get_ydata())[number] == pytest.approx(off)
    assert np.asarray(wrong.get_ydata())[0] > 1.0


def first(count: int) -> StatedErrors:
    whole = honest()
    return StatedErrors(**{name: each if name == "name" else each[:count] for name, each in vars(whole).items()})


ODD = (
    first(0),
    first(1),
    replace(honest(), ok=np.zeros(FIXES, bool)),
    replace(honest(), along_m=np.full(FIXES, np.nan), ok=np.zeros(FIXES, bool)),
    replace(honest(), along_m=np.zeros(FIXES), cross_m=np.zeros(FIXES)),
    replace(honest(), sigma_along_m=np.zeros(FIXES), sigma_cross_m=np.full(FIXES, np.nan)),
)


def test_odd_input_draws(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for number, stated in enumerate(ODD):
        draw_confidence(stated, tmp_path / f"{number}.png")
    assert not caplog.records
    with refused("output", "--force", file="0.png"):
        draw_confidence(ODD[0], tmp_path / "0.png")
