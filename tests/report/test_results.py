"""Records and their figures, against hand computation."""

import io
import json
import math
import re

import numpy as np
import pytest
from rich.console import Console

from lgprjax.registration.fix import Code
from lgprjax.report import CODES, DriveResult, drive_section, summarise, summary_table, track_errors
from report.synthetic import declined_drive, straight_drive, without_truth


def hand_drive(**changes: object) -> DriveResult:
    """Six scans due north; the third and later fields tell each case apart."""
    north = np.arange(6.0)
    fields: dict[str, object] = {
        "name": "hand",
        "map_name": "map",
        "origin": (42.0, -71.0),
        "milliseconds_per_scan": 2.0,
        "time_s": north,
        "distance_m": north,
        # Heading north: east is to the right, so east +0.1 is cross -0.1; north is ahead.
        "east_m": np.array([0.1, -0.3, 0.0, 5.0, np.nan, np.nan]),
        "north_m": north + np.array([0.0, 0.4, -0.2, 0.0, np.nan, np.nan]),
        "prior_east_m": np.zeros(6),
        "prior_north_m": north,
        "heading_rad": np.full(6, np.pi / 2),
        "sigma_along_m": np.full(6, 0.1),
        "sigma_cross_m": np.full(6, 0.1),
        "correlation": np.array([0.9, 0.7, 0.8, 0.3, np.nan, np.nan]),
        "margin": np.full(6, 0.2),
        "p_false": np.array([1e-9, 1e-6, 1e-7, 0.5, 1.0, 1.0]),
        "code": np.array(["ok", "ok", "ok", "low_correlation", "off_map", "no_window"]),
        "truth_east_m": np.zeros(6),
        "truth_north_m": north,
        "truth_yaw_rad": np.full(6, np.pi / 2),
        "correlation_at_truth": np.array([0.5, 0.6, 0.7, 0.8, np.nan, np.nan]),
    }
    return DriveResult(**(fields | changes))  # type: ignore[arg-type]


def test_along_is_ahead_and_cross_is_left() -> None:
    assert tuple(code.label for code in Code) == CODES
    errors = track_errors(hand_drive())
    np.testing.assert_allclose(errors.along_m[:3], [0.0, 0.4, -0.2], atol=1e-12)
    np.testing.assert_allclose(errors.cross_m[:3], [-0.1, 0.3, 0.0], atol=1e-12)
    east = track_errors(hand_drive(truth_yaw_rad=np.zeros(6)))
    np.testing.assert_allclose(east.along_m[:3], [0.1, -0.3, 0.0], atol=1e-12)
    np.testing.assert_allclose(east.cross_m[:3], [0.0, 0.4, -0.2], atol=1e-12)


def test_summary_against_hand_computation() -> None:
    summary = summarise(hand_drive())
    assert (summary.scans, summary.tried, summary.ok, summary.judged) == (6, 5, 3, 3)
    assert summary.ok_fraction == pytest.approx(3 / 5)
    assert {label: n for label, n in summary.counts.items() if n} == {
        "ok": 3,
        "low_correlation": 1,
        "off_map": 1,
        "no_window": 1,
    }
    assert summary.median_correlation_ok == pytest.approx(0.8)
    assert summary.median_correlation_at_truth == pytest.approx(0.65)
    assert summary.rms_cross_m == pytest.approx(math.sqrt((0.01 + 0.09) / 3))
    assert summary.rms_along_m == pytest.approx(math.sqrt((0.16 + 0.04) / 3))
    assert summary.mean_absolute_total_m == pytest.approx((0.1 + 0.5 + 0.2) / 3)
    assert summary.mean_absolute_cross_m == pytest.approx((0.1 + 0.3) / 3)
    assert summary.max_error_m == pytest.approx(0.5)
    assert summary.wrong_ok == 1
    # A declined fix is no error, however far off.
    every = np.array(["ok", "ok", "ok", "ok", "off_map", "no_window"])
    assert summarise(hand_drive(code=every)).max_error_m == pytest.approx(5.0)
    values = " ".join(value for _, value in summary.as_rows())
    for value in ("3 (60.0 %", "1 low_correlation, 1 off_map", "0.500 m", "2.00 ms"):
        assert value in values
    for result in (hand_drive(), without_truth(), declined_drive()):
        found = summarise(result).as_json()
        assert json.loads(json.dumps(found, allow_nan=False)) == found


def test_truth_unknown_at_some_scans_judges_the_others() -> None:
    truth = np.zeros(6)
    truth[1] = np.nan
    summary = summarise(hand_drive(truth_east_m=truth))
    assert (summary.ok, summary.judged, summary.wrong_ok) == (3, 2, 0)
    assert summary.max_error_m == pytest.approx(0.2)
    # Where none was judged none is called right; where none was tried there is no share.
    summary = summarise(hand_drive(truth_east_m=np.where(np.arange(6) < 3, np.nan, 0.0)))
    assert (summary.ok, summary.judged, summary.wrong_ok) == (3, 0, None)
    assert re.findall(r"\d+", drive_section(summary, ()).text) == ["3", "5"]
    nothing = summarise(hand_drive(code=np.full(6, "no_window")))
    assert (nothing.ok_fraction, nothing.median_correlation_ok) == (None, None)


def test_without_truth_no_error_is_stated() -> None:
    summary = summarise(without_truth())
    assert summary.ok > 0
    assert summary.judged == 0
    for value in (summary.rms_cross_m, summary.rms_along_m, summary.max_error_m, summary.wrong_ok):
        assert value is None
    rows = dict(summary.as_rows())
    assert "–" not in rows.values()
    assert {"60.0 m", f"{summary.median_sigma_cross_m:.3f} m"} <= set(rows.values())


def test_differences_from_the_prior_use_its_heading() -> None:
    nothing = dict.fromkeys(("truth_east_m", "truth_north_m", "truth_yaw_rad"))
    errors = track_errors(hand_drive(**nothing, prior_east_m=np.full(6, 1.0), heading_rad=np.zeros(6)))
    np.testing.assert_allclose(errors.along_m[:3], [-0.9, -1.3, -1.0], atol=1e-12)
    np.testing.assert_allclose(errors.cross_m[:3], [0.0, 0.4, -0.2], atol=1e-12)


def test_every_ok_of_an_impostor_is_wrong() -> None:
    summary = summarise(hand_drive(impostor=True))
    assert (summary.ok, summary.wrong_ok, summary.judged) == (3, 3, 0)
    assert summary.rms_cross_m is None
    assert summarise(declined_drive()).wrong_ok == 0


def test_unknown_code_and_partial_truth_are_refused() -> None:
    with pytest.raises(ValueError, match="perfect"):
        hand_drive(code=np.full(6, "perfect"))
    with pytest.raises(ValueError, match="truth"):
        hand_drive(truth_yaw_rad=None)


def test_terminal_table_has_a_column_a_drive_and_marks_the_wrong() -> None:
    table = summary_table([summarise(straight_drive()), summarise(hand_drive())])
    assert [column.style for column in table.columns[1:]] == ["", "bold red"]
    rows = list(zip(*(column.cells for column in table.columns[1:]), strict=True))
    assert ("0", "1") in rows


def test_without_truth_the_terminal_table_says_what_is_known_instead() -> None:
    summaries = [summarise(without_truth()), summarise(without_truth(name="third", code=np.full(400, "edge")))]
    table, judged = summary_table(summaries), summary_table([summarise(straight_drive())])
    rows = list(zip(*(column.cells for column in table.columns[1:]), strict=True))
    assert ("60.0 m", "60.0 m") in rows
    # Of a drive without an ok fix errors are not known; of the other one they are; no row is empty.
    assert (f"{summaries[0].median_sigma_cross_m:.3f} m", "–") in rows
    assert not any(set(cells) == {"–"} for cells in rows)
    assert set(table.columns[0].cells) - set(judged.columns[0].cells)
    assert set(judged.columns[0].cells) - set(table.columns[0].cells)


def test_offsets_from_the_log_and_from_the_lines_by_hand() -> None:
    line = np.stack([np.full(61, 2.0), np.arange(0.0, 6.1, 0.1)], axis=1)
    summary = summarise(hand_drive(baseline_tracks=(line, line + 40.0)))
    assert summary.length_m == pytest.approx(5.0)
    assert summary.median_offset_m == pytest.approx(0.2)
    assert summary.median_off_line_m == pytest.approx(2.0)
    nowhere = summarise(hand_drive(baseline_tracks=(line,), place_assumed=True))
    assert (nowhere.median_offset_m, nowhere.median_off_line_m) == (None, None)
    assert summarise(hand_drive()).median_off_line_m is None


def test_brackets_in_names_stay_in_the_terminal_table() -> None:
    told = io.StringIO()
    named = summarise(hand_drive(name="road[left]", map_name="m[old]"))
    Console(file=told, width=100, no_color=True).print(summary_table([named]))
    assert "road[left]" in told.getvalue()
    assert "m[old]" in told.getvalue()
