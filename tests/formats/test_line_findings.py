"""What is found in the lines of a survey that was made here: time zero, sign, direction and start."""

from pathlib import Path

import numpy as np
import pytest

from formats.survey_sample import STEP_M, WAVE_SAMPLE, write_survey, write_topography
from lgprjax.formats import DriveLog, import_lines
from refusals import refused

_FIRSTS = [12, 9, 14, 11, 10, 13, 9, 12, 11]
"""Starts of nine lines in traces of 0.25 m: off by up to 1.25 m from each other."""
_ODD = [1, 3, 5, 7]
_TURNED = [2, 3, 7]
_WRONG_ZEROS = {1: 0.0, 4: 0.9, 6: 135.0}


def _read(path: Path) -> tuple[np.ndarray, np.ndarray]:
    with DriveLog.open(path) as log:
        return log.read_traces(0, log.scans)


def _level(places: np.ndarray) -> np.ndarray:
    """Without their mean and trend: neighbours do not tell what all lines have in common."""
    index = np.arange(len(places))
    return np.asarray(places - np.polyval(np.polyfit(index, places, 1), index))


def test_everything_is_found_without_an_option(tmp_path: Path) -> None:
    paths, truth = write_survey(
        tmp_path,
        firsts=_FIRSTS,
        traces=[100, 98, 101, 97, 100, 99, 102, 100, 96],
        reversed_lines=_ODD,
        inverted=_TURNED,
        time_zeros=_WRONG_ZEROS,
    )
    output = tmp_path / "a.drive.h5"
    survey = import_lines(paths, line_spacing_m=0.5, output=output)
    lines = survey.lines
    assert [line.file for line in lines] == [path.name for path in paths]
    assert [i for i, line in enumerate(lines) if line.reversed] == _ODD
    assert [line.direction_from for line in lines] == ["assumed"] + ["neighbours"] * 8
    assert [i for i, line in enumerate(lines) if line.inverted] == _TURNED
    assert [line.sign for line in lines] == [-1 if i in _TURNED else 1 for i in range(9)]
    wrong = [i in _WRONG_ZEROS for i in range(9)]
    assert [line.time_zero_from == "first break" for line in lines] == wrong
    np.testing.assert_allclose([line.time_zero for line in lines], WAVE_SAMPLE, atol=0.3)
    assert [line.time_zero_header for line in lines] == [_WRONG_ZEROS.get(i, WAVE_SAMPLE) for i in range(9)]
    assert {line.start_from for line in lines} == {"neighbours"}
    starts = np.array([line.start_m for line in lines])
    np.testing.assert_allclose(_level(starts), _level(np.array(_FIRSTS) * STEP_M), atol=1e-6)
    # Neighbours say which lines ran the other way, not which way the first one did.
    assert "direction" in survey.assumed
    # The drive log has them turned and put right.
    traces, valid = _read(output)
    for i, expected in enumerate(truth):
        there = traces[valid[:, i], i]
        # Starts that are no whole number of steps cost a trace at each end, and smooth a little.
        assert abs(len(there) - len(expected)) <= 2
        best = max(
            np.corrcoef(expected[at : at + 90].ravel(), there[:90].ravel())[0, 1] for at in range(len(expected) - 89)
        )
        assert best > 0.97


def test_time_zero_of_the_headers_of_the_option_and_of_the_first_break(tmp_path: Path) -> None:
    paths, _ = write_survey(tmp_path, firsts=_FIRSTS[:3], time_zeros={1: 41.5})
    survey = import_lines(paths, line_spacing_m=0.5, time_zero="header", output=tmp_path / "a.drive.h5")
    assert [line.time_zero for line in survey.lines] == pytest.approx([40.0, 41.5, 40.0])
    assert {line.time_zero_from for line in survey.lines} == {"header"}
    told = import_lines(paths, line_spacing_m=0.5, time_zero=30.0, output=tmp_path / "b.drive.h5")
    assert [line.time_zero for line in told.lines] == pytest.approx([37.5] * 3)
    assert {line.time_zero_from for line in told.lines} == {"option"}
    with DriveLog.open(tmp_path / "b.drive.h5") as log:
        assert log.description.recording.time_zero_ns == pytest.approx(30.0)  # type: ignore[union-attr]
    # Headers that are all wrong give way.
    paths, _ = write_survey(tmp_path, firsts=_FIRSTS[:3], time_zeros={0: 0.0, 1: 2.0, 2: 140.0})
    for line in import_lines(paths, line_spacing_m=0.5, output=tmp_path / "c.drive.h5").lines:
        assert line.time_zero_from == "first break"
        assert line.time_zero == line.first_break is not None
        assert WAVE_SAMPLE < line.time_zero < WAVE_SAMPLE + 6.0


def test_polarity_is_kept_where_it_is_wanted(tmp_path: Path) -> None:
    paths, truth = write_survey(tmp_path, firsts=[10, 10, 10], inverted=[1])
    survey = import_lines(paths, line_spacing_m=0.5, polarity="keep", output=tmp_path / "a.drive.h5")
    assert not any(line.inverted for line in survey.lines)
    assert [line.sign for line in survey.lines] == [1, -1, 1]
    assert survey.lines[1].correlation < -0.5
    traces, _ = _read(tmp_path / "a.drive.h5")
    np.testing.assert_array_equal(traces[:, 1], -truth[1])


@pytest.mark.parametrize(("option", "turned"), [("odd", [0, 2]), ("even", [1, 3]), ((3,), [3]), ((), [])])
def test_named_lines_are_reversed_and_no_others(
    option: str | tuple[int, ...], turned: list[int], tmp_path: Path
) -> None:
    # Numbers in the names count: they begin with an odd one here. What is stored is no zigzag.
    paths, truth = write_survey(tmp_path, firsts=[10] * 4, first_number=7)
    survey = import_lines(
        paths,
        line_spacing_m=0.5,
        reversed_lines=option,  # type: ignore[arg-type]
        output=tmp_path / "a.drive.h5",
    )
    assert [i for i, line in enumerate(survey.lines) if line.reversed] == turned
    assert {line.direction_from for line in survey.lines} == {"option"}
    traces, _ = _read(tmp_path / "a.drive.h5")
    for i, line in enumerate(truth):
        np.testing.assert_array_equal(traces[:100, i], line[::-1] if i in turned else line)


def _topography(paths: list[Path], *, follows: list[int]) -> None:
    """Rows along x, first trace of the ground at 0, lines 0.5 m apart; of some lines from the far end."""
    for i, path in enumerate(paths):
        east = (np.array(_FIRSTS[i]) + np.arange(100)) * STEP_M
        write_topography(path, east[::-1] if i in follows else east, np.full(100, 2.0 - 0.5 * i))


_EVEN = [0, 2, 4, 6, 8]


@pytest.mark.parametrize(
    ("walked_back", "rows"),
    [(_ODD, "one way"), (_EVEN, "one way"), (_EVEN, "as walked")],
    ids=["odd", "even", "walked"],
)
def test_topography_settles_the_direction(walked_back: list[int], rows: str, tmp_path: Path) -> None:
    """Zigzag alone does not tell which lines were walked back; the starts against the topography do."""
    paths, truth = write_survey(tmp_path, firsts=_FIRSTS, reversed_lines=walked_back, inverted=[4])
    _topography(paths, follows=walked_back if rows == "as walked" else [])
    survey = import_lines(paths, output=tmp_path / "a.drive.h5")
    assert survey.placed_by == "topography"
    found = {line.file: line for line in survey.lines}
    # The first line's rows say which way is ahead: where they begin at the far end, all is turned about.
    about = rows == "as walked" and 0 in walked_back
    for i, path in enumerate(paths):
        line = found[path.name]
        assert line.reversed == ((i in walked_back) != about)
        assert line.inverted == (i == 4)
        assert line.direction_from == line.start_from == "topography"
        begin_m = _FIRSTS[i] * STEP_M
        assert line.start_m == pytest.approx(-(begin_m + 99 * STEP_M) if about else begin_m)
    # Left is +N where east is ahead: the first line lies leftmost.
    traces, valid = _read(tmp_path / "a.drive.h5")
    order = range(9)[::-1] if about else range(9)
    for channel, i in enumerate(order):
        np.testing.assert_array_equal(traces[valid[:, channel], channel], truth[i][::-1] if about else truth[i])


def test_topography_of_another_line_is_refused(tmp_path: Path) -> None:
    paths, _ = write_survey(tmp_path, firsts=[10, 10])
    for path, rows in zip(paths, (100, 60), strict=True):
        write_topography(path, np.arange(rows) * STEP_M, np.full(rows, 1.0 if rows == 100 else 0.0))
    with refused("rows", 100, "LINE01.DT1", file="topo_LINE01.txt", found=60):
        import_lines(paths, output=tmp_path / "a.drive.h5")


def test_single_line_is_taken_as_stored_and_says_so(tmp_path: Path) -> None:
    (path,), truth = write_survey(tmp_path, firsts=[10], reversed_lines=[0])
    survey = import_lines([path], output=tmp_path / "a.drive.h5")
    (line,) = survey.lines
    assert (line.reversed, line.inverted, line.direction_from, line.correlation) == (False, False, "assumed", 0.0)
    assert "direction" in survey.assumed
    assert survey.placed_by == "header"
    traces, _ = _read(tmp_path / "a.drive.h5")
    np.testing.assert_array_equal(traces[:, 0], truth[0][::-1])


def _cut(path: Path, traces: int) -> None:
    """End a line within the trace after so many."""
    trace_bytes = 128 + 2 * 160
    path.write_bytes(path.read_bytes()[: traces * trace_bytes + 33])


def test_cut_line_is_read_as_far_as_it_is_whole(tmp_path: Path) -> None:
    paths, truth = write_survey(tmp_path, firsts=[10, 12, 9], reversed_lines=[1])
    _cut(paths[2], 70)
    with refused("traces", "--partial", found=70):
        import_lines(paths, line_spacing_m=0.5, output=tmp_path / "a.drive.h5")
    assert not (tmp_path / "a.drive.h5").exists()
    survey = import_lines(paths, line_spacing_m=0.5, reversed_lines=[1], partial=True, output=tmp_path / "a.drive.h5")
    assert [line.cut is None for line in survey.lines] == [True, True, False]
    assert [line.traces for line in survey.lines] == [100, 100, 70]
    assert survey.lines[2].correlation > 0.5
    _, valid = _read(tmp_path / "a.drive.h5")
    assert valid.sum(axis=0)[2] in (69, 70, 71)
    assert len(truth[2]) == 100


@pytest.mark.parametrize("cut", [4, 5])
def test_cut_line_keeps_its_place_in_the_topography(cut: int, tmp_path: Path) -> None:
    """Of a line that was walked back the near end is missing, though its rows begin there."""
    paths, truth = write_survey(tmp_path, firsts=_FIRSTS, reversed_lines=_ODD)
    _topography(paths, follows=[])
    _cut(paths[cut], 80)
    import_lines(paths, partial=True, output=tmp_path / "a.drive.h5")
    traces, valid = _read(tmp_path / "a.drive.h5")
    # Scans begin where the first of all lines does: trace 9 of the ground.
    first = _FIRSTS[cut] - min(_FIRSTS) + (20 if cut in _ODD else 0)
    np.testing.assert_array_equal(np.flatnonzero(valid[:, cut]), np.arange(first, first + 80))
    np.testing.assert_array_equal(traces[valid[:, cut], cut], truth[cut][20:] if cut in _ODD else truth[cut][:80])
