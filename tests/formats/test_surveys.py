"""Parallel lines as one drive: geometry, resampling, reversed lines, time zero, and the real surveys."""

from pathlib import Path

import h5py
import numpy as np
import pyproj
import pytest

from formats.samples import dzt_header, real_data, write_dt1
from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, TraceRecording, check_file, import_lines


def _line(folder: Path, number: int, traces: np.ndarray, **options: object) -> Path:
    return write_dt1(folder / f"LINE{number:02}.DT1", traces, **options)  # type: ignore[arg-type]


def _read(path: Path) -> tuple[np.ndarray, np.ndarray]:
    with DriveLog.open(path) as log:
        return log.read_traces(0, log.scans)


def _ramp(count: int, *, samples: int = 8, factor: int = 100) -> np.ndarray:
    """Traces whose values rise by ``factor`` a trace and by one a sample."""
    return factor * np.arange(count)[:, None] + np.arange(samples)


def test_geometry_of_the_drive(tmp_path: Path) -> None:
    paths = [_line(tmp_path, i, _ramp(5) + 1000 * i) for i in range(3)]
    output = tmp_path / "a.drive.h5"
    import_lines(
        paths,
        line_spacing_m=0.2,
        first_line_m=-0.2,
        latitude_deg=48.0,
        longitude_deg=11.0,
        heading_deg=30.0,
        output=output,
    )
    assert check_file(output) == []
    with DriveLog.open(output) as log:
        description = log.description
        traces, valid = log.read_traces(0, log.scans)
        times = log.scan_time_s
    np.testing.assert_allclose(description.array.y_m, [0.2, 0.0, -0.2], atol=1e-12)
    np.testing.assert_array_equal(traces, np.stack([_ramp(5) + 1000 * i for i in range(3)], axis=1))
    assert valid.all()
    along = 0.05 * np.arange(5)
    np.testing.assert_allclose(times, along / 1.0)
    np.testing.assert_allclose(description.odometry.distance_m, along)
    navigation = description.navigation
    azimuth, _, distance = pyproj.Geod(ellps="WGS84").inv(
        11.0, 48.0, navigation.longitude_deg[-1], navigation.latitude_deg[-1]
    )
    assert distance == pytest.approx(0.2, abs=1e-6)
    assert azimuth == pytest.approx(30.0, abs=1e-3)
    np.testing.assert_allclose(navigation.heading_deg, 30.0, atol=1e-6)
    assert navigation.sigma_east_m is None
    assert navigation.sigma_heading_deg is None
    assert description.provenance["assumed"] == {
        "time": "unknown",
        "speed": "1 m/s",
        "odometry": "trace spacing or positions of the header",
        "position": "straight from the origin",
        "heading": "30 degrees all along",
        "height": "taken as 0",
        "roll": "taken as 0",
        "position sigma": "not recorded",
        "heading sigma": "not recorded",
        "direction": "as stored",
    }
    assert isinstance(description.recording, TraceRecording)
    assert description.recording.time_zero_ns == pytest.approx(1.0)


def test_lines_that_need_no_resampling_keep_their_type(tmp_path: Path) -> None:
    output = tmp_path / "a.drive.h5"
    import_lines([_line(tmp_path, 0, _ramp(4))], line_spacing_m=1.0, output=output)
    with h5py.File(output) as store:
        assert store["/radar/traces"].dtype == np.int16


def test_line_that_ends_early_is_invalid_there(tmp_path: Path) -> None:
    paths = [_line(tmp_path, 0, _ramp(3)), _line(tmp_path, 1, _ramp(5))]
    import_lines(paths, line_spacing_m=0.2, output=tmp_path / "a.drive.h5")
    traces, valid = _read(tmp_path / "a.drive.h5")
    np.testing.assert_array_equal(valid, [[True, True]] * 3 + [[False, True]] * 2)
    np.testing.assert_array_equal(traces[3:, 0], 0.0)


def test_lines_start_where_their_headers_say(tmp_path: Path) -> None:
    paths = [_line(tmp_path, 0, _ramp(3), start=0.1), _line(tmp_path, 1, _ramp(5))]
    import_lines(paths, line_spacing_m=0.2, output=tmp_path / "a.drive.h5")
    traces, valid = _read(tmp_path / "a.drive.h5")
    np.testing.assert_array_equal(valid[:, 0], [False, False, True, True, True])
    np.testing.assert_array_equal(traces[2:, 0], _ramp(3))


def test_lines_spread_over_the_tape(tmp_path: Path) -> None:
    # Both lines show the same ground, one with half the traces: spread over the tape they agree.
    paths = [_line(tmp_path, 0, _ramp(5, factor=200)), _line(tmp_path, 1, _ramp(9, factor=100))]
    import_lines(paths, line_spacing_m=0.5, length_m=4.0, output=tmp_path / "a.drive.h5")
    traces, valid = _read(tmp_path / "a.drive.h5")
    assert valid.all()
    np.testing.assert_allclose(traces[:, 0], traces[:, 1])
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        assert log.description.odometry.distance_m[-1] == pytest.approx(4.0)


def test_reversed_line_is_flipped(tmp_path: Path) -> None:
    paths = [_line(tmp_path, 0, _ramp(5)), _line(tmp_path, 1, _ramp(5)[::-1])]
    import_lines(paths, line_spacing_m=0.5, reversed_lines=[1], output=tmp_path / "a.drive.h5")
    traces, _ = _read(tmp_path / "a.drive.h5")
    np.testing.assert_array_equal(traces[:, 0], traces[:, 1])


@pytest.mark.parametrize("back", [0, 1])
def test_line_whose_positions_fall_is_walked_back(back: int, tmp_path: Path) -> None:
    """The other line begins at 1 m, whichever of them is the first."""
    rising, falling = 1.0 + 0.25 * np.arange(60), 14.75 - 0.25 * np.arange(60)
    positions = [falling, rising] if back == 0 else [rising, falling]
    paths = [_line(tmp_path, i, _ramp(60)[:, ::-1], positions=each, step=0.25) for i, each in enumerate(positions)]
    output = tmp_path / "a.drive.h5"
    survey = import_lines(paths, lines_at_m=[0.0, 1.0], output=output)
    assert [line.reversed for line in survey.lines] == [i == back for i in range(2)]
    assert [line.direction_from for line in survey.lines] == ["header"] * 2
    assert [line.start_m for line in survey.lines] == [1.0 if i != back else 0.0 for i in range(2)]
    assert "direction" not in survey.assumed
    with DriveLog.open(output) as log:
        np.testing.assert_allclose(log.description.odometry.distance_m, 0.25 * np.arange(64))
    traces, valid = _read(output)
    for channel, first in enumerate(line.start_m for line in survey.lines):
        low = round(first / 0.25)
        assert np.flatnonzero(valid[:, channel]).tolist() == list(range(low, low + 60))
        stored = _ramp(60)[:, -1]
        expected = stored[::-1] if channel == back else stored
        np.testing.assert_array_equal(traces[low : low + 60, channel, 0], expected)


def test_gap_in_the_positions_stays_open(tmp_path: Path) -> None:
    """Two metres were skipped after ten traces, walking either way."""
    places = 0.05 * np.arange(20) + 2.0 * (np.arange(20) >= 10)
    for name, positions in (("there", places), ("back", places[::-1])):
        path = write_dt1(tmp_path / f"{name}.DT1", _ramp(20), positions=positions)
        output = tmp_path / f"{name}.drive.h5"
        import_lines([path], output=output)
        with DriveLog.open(output) as log:
            travel_m = log.description.odometry.distance_m
        assert travel_m[-1] == pytest.approx(2.95)
        traces, valid = _read(output)
        gap = (travel_m > 0.46) & (travel_m < 2.49)
        assert np.array_equal(valid[:, 0], ~gap)
        expected = _ramp(20)[:, 0] if name == "there" else _ramp(20)[::-1, 0]
        np.testing.assert_allclose(traces[valid[:, 0], 0, 0], expected, atol=1.0)


def test_positions_that_jitter_or_stand_are_no_gaps(tmp_path: Path) -> None:
    jitter = 0.01 * np.random.default_rng(1).uniform(-1.0, 1.0, 20)
    for name, positions in (("jitter", 0.05 * np.arange(20) + jitter), ("none", np.zeros(20))):
        output = tmp_path / f"{name}.drive.h5"
        import_lines([write_dt1(tmp_path / f"{name}.DT1", _ramp(20), positions=positions)], output=output)
        traces, valid = _read(output)
        assert valid.all()
        np.testing.assert_array_equal(traces[:, 0], _ramp(20))


def test_positions_that_turn_back_are_named(tmp_path: Path) -> None:
    positions = 0.05 * np.array([0, 1, 2, 3, 2, 3, 4, 5])
    path = write_dt1(tmp_path / "a.DT1", _ramp(8), positions=positions)
    with pytest.raises(InputError, match=r"position of trace 4: expected positions that rise .* a step of -0.05 m"):
        import_lines([path], output=tmp_path / "a.drive.h5")
    import_lines([path], length_m=0.7, output=tmp_path / "a.drive.h5")


def test_lines_of_other_spacing_are_resampled(tmp_path: Path) -> None:
    paths = [_line(tmp_path, 0, _ramp(5), step=0.1), _line(tmp_path, 1, _ramp(9, factor=50), step=0.05)]
    import_lines(paths, line_spacing_m=0.5, output=tmp_path / "a.drive.h5")
    traces, valid = _read(tmp_path / "a.drive.h5")
    assert valid.all()
    np.testing.assert_allclose(traces[:, 0], traces[:, 1])


def test_time_zero_is_brought_together(tmp_path: Path) -> None:
    # The third line began 0.4 samples earlier: its ramp stands 0.4 lower until it is moved.
    paths = [_line(tmp_path, i, _ramp(4, samples=40)) for i in range(2)]
    paths.append(_line(tmp_path, 2, _ramp(4, samples=40), TIMEZERO_AT_POINT=1.65))
    import_lines(paths, line_spacing_m=0.5, output=tmp_path / "a.drive.h5")
    traces, _ = _read(tmp_path / "a.drive.h5")
    np.testing.assert_allclose(traces[:, 2, :-1], traces[:, 0, :-1] + 0.4, rtol=1e-5)


def test_one_file_of_several_channels_is_as_many_lines(tmp_path: Path) -> None:
    path = tmp_path / "a.DZT"
    block = dzt_header(word=2, bits=32, channels=2)
    path.write_bytes(block + block + np.arange(64, dtype="<i4").tobytes())
    import_lines([path], line_spacing_m=0.5, output=tmp_path / "a.drive.h5")
    traces, _ = _read(tmp_path / "a.drive.h5")
    assert traces.shape == (4, 2, 8)
    np.testing.assert_array_equal(traces[1, 1, 2:], np.arange(26, 32))


def test_bad_surveys_are_one_line_and_leave_nothing(tmp_path: Path) -> None:
    first = _line(tmp_path, 0, _ramp(4))
    timed = tmp_path / "timed.DZT"
    timed.write_bytes(dzt_header(bits=32, per_m=0.0) + np.arange(16, dtype="<i4").tobytes())
    second = _line(tmp_path, 5, _ramp(4))
    wide, wider = tmp_path / "wide.DZT", tmp_path / "wider.DZT"
    for path in (wide, wider):
        path.write_bytes(dzt_header(word=2, bits=32, channels=2) * 2 + np.arange(32, dtype="<i4").tobytes())
    cases: list[tuple[list[Path], dict[str, object], str]] = [
        ([], {}, "lines: expected at least one file, found none"),
        ([first, _line(tmp_path, 1, _ramp(4, samples=7))], {}, "LINE01.DT1: samples a trace: expected 8 as in LINE00"),
        (
            [first, _line(tmp_path, 2, _ramp(4), TOTAL_TIME_WINDOW=3.2)],
            {},
            "LINE02.DT1: sample interval: expected 0.8 ns as in LINE00.DT1, found 0.4 ns",
        ),
        (
            [first, second, _line(tmp_path, 3, _ramp(4), TIMEZERO_AT_POINT=4)],
            {},
            "LINE03.DT1: time zero: expected about 1 ns, or --time-zero (the record begins after",
        ),
        ([first, _line(tmp_path, 4, _ramp(1))], {}, "LINE04.DT1: traces: expected at least 2, found 1"),
        ([timed], {}, "timed.DZT: trace spacing: expected a spacing in the header, or --length-m"),
        ([wide, wider], {}, "wide.DZT: channels: expected one in each of several files, found 2: import it by"),
        ([first, second, first], {}, "LINE00.DT1: lines: expected each file once, found it twice"),
        ([first, second], {"line_spacing_m": 0.0}, "line_spacing_m: expected metres, above 0 and up to 100, found 0"),
        ([first, second], {"length_m": -3.0}, "length_m: expected a length above zero, found -3"),
        ([first, second], {"length_m": 48500.0}, "up to 10 m apart (are the places millimetres?), found 16166.7 m"),
        ([first], {"time_zero": float("nan")}, "LINE00.DT1: time zero: expected less than its 6.4 ns, found nan ns"),
        ([first], {"time_zero": -7.0}, "LINE00.DT1: time zero: expected less than its 6.4 ns, found -7 ns"),
        ([first, second], {"reversed_lines": [2]}, "reversed_lines: expected numbers from 0 to 1, found 2"),
        ([tmp_path / "none.DT1"], {}, "none.DT1: file: expected a readable file, found no such file"),
    ]
    before = sorted(tmp_path.iterdir())
    for paths, options, words in cases:
        with pytest.raises(InputError) as caught:
            import_lines(paths, output=tmp_path / "a.drive.h5", **({"line_spacing_m": 0.5} | options))  # type: ignore[arg-type]
        assert words in str(caught.value)
        assert sorted(tmp_path.iterdir()) == before


@pytest.mark.real
def test_real_parallel_lines(tmp_path: Path) -> None:
    paths = sorted((real_data() / "gpr_o_parallel_lines").glob("*.DT1"))
    import_lines(paths, line_spacing_m=0.2, polarity="keep", output=tmp_path / "a.drive.h5")
    traces, valid = _read(tmp_path / "a.drive.h5")
    assert traces.shape == (240, 25, 250)
    assert valid.sum(axis=0).tolist()[::8] == [232, 233, 236, 218]
    # Neighbouring lines see the same layers; line 24 was recorded with the other polarity.
    mean = traces[:200].mean(axis=0)[:, 10:]
    neighbours = [np.corrcoef(mean[i], mean[i + 1])[0, 1] for i in range(24)]
    assert min(neighbours[:23]) > 0.9
    assert neighbours[23] < -0.9
    survey = import_lines(paths, line_spacing_m=0.2, output=tmp_path / "b.drive.h5")
    assert [line.inverted for line in survey.lines] == [False] * 24 + [True]
    assert not any(line.reversed for line in survey.lines)
    assert {line.start_m for line in survey.lines} == {0.0}


@pytest.mark.real
def test_real_zigzag_lines_on_the_tape(tmp_path: Path) -> None:
    paths = sorted((real_data() / "hautefeuille").glob("*.DZT"))
    import_lines(paths, line_spacing_m=0.5, length_m=30.0, reversed_lines=[1], output=tmp_path / "a.drive.h5")
    traces, valid = _read(tmp_path / "a.drive.h5")
    assert traces.shape == (1793, 3, 512)
    assert valid.all()
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        assert log.description.odometry.distance_m[-1] == pytest.approx(30.0)
