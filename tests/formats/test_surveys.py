"""Parallel lines as one drive: geometry, resampling, reversed lines, and time zero."""

from pathlib import Path

import h5py
import numpy as np
import pyproj
import pytest

from formats.samples import dzt_header, write_dt1
from lgprjax.formats import DriveLog, TraceRecording, assumed_of, check_file, import_lines
from refusals import refused


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
    assumed = assumed_of(description.provenance)
    assert "30" in assumed["heading"]
    assert "1 m/s" in assumed["speed"]
    assert isinstance(description.recording, TraceRecording)
    assert description.recording.time_zero_ns == pytest.approx(1.0)


def test_lines_begin_where_their_headers_say_end_where_they_end_and_keep_their_type(tmp_path: Path) -> None:
    output = tmp_path / "a.drive.h5"
    late = _line(tmp_path, 0, _ramp(3), start=0.1)
    import_lines([late, _line(tmp_path, 1, _ramp(5)), _line(tmp_path, 2, _ramp(3))], line_spacing_m=0.2, output=output)
    traces, valid = _read(output)
    np.testing.assert_array_equal(valid, [[False, True, True]] * 2 + [[True] * 3] + [[True, True, False]] * 2)
    np.testing.assert_array_equal(traces[2:, 0], _ramp(3))
    np.testing.assert_array_equal(traces[3:, 2], 0.0)
    with h5py.File(output) as store:
        assert store["/radar/traces"].dtype == np.int16


def test_lines_spread_over_the_tape(tmp_path: Path) -> None:
    # Both lines show the same ground, one with half the traces: spread over the tape they agree.
    paths = [_line(tmp_path, 0, _ramp(5, factor=200)), _line(tmp_path, 1, _ramp(9, factor=100))]
    import_lines(paths, line_spacing_m=0.5, length_m=4.0, output=tmp_path / "a.drive.h5")
    traces, valid = _read(tmp_path / "a.drive.h5")
    assert valid.all()
    np.testing.assert_allclose(traces[:, 0], traces[:, 1])
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        assert log.description.odometry.distance_m[-1] == pytest.approx(4.0)


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
    with refused("position of trace 4", found=-0.05):
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


def test_bad_surveys_are_refused_and_leave_nothing(tmp_path: Path) -> None:
    first, second = _line(tmp_path, 0, _ramp(4)), _line(tmp_path, 5, _ramp(4))
    timed = tmp_path / "timed.DZT"
    timed.write_bytes(dzt_header(bits=32, per_m=0.0) + np.arange(16, dtype="<i4").tobytes())
    wide, wider = tmp_path / "wide.DZT", tmp_path / "wider.DZT"
    for path in (wide, wider):
        path.write_bytes(dzt_header(word=2, bits=32, channels=2) * 2 + np.arange(32, dtype="<i4").tobytes())
    short = _line(tmp_path, 1, _ramp(4, samples=7))
    fine = _line(tmp_path, 2, _ramp(4), TOTAL_TIME_WINDOW=3.2)
    late = _line(tmp_path, 3, _ramp(4), TIMEZERO_AT_POINT=4)
    single = _line(tmp_path, 4, _ramp(1))
    nan = float("nan")
    # Files, options, and then the file, the place and values that are named.
    cases: list[tuple[list[Path], dict[str, object], str | None, str, tuple[object, ...]]] = [
        ([], {}, None, "lines", ()),
        ([first, short], {}, "LINE01.DT1", "samples a trace", (8, "LINE00.DT1", 7)),
        ([first, fine], {}, "LINE02.DT1", "sample interval", (0.8, "LINE00.DT1", 0.4)),
        ([first, second, late], {}, "LINE03.DT1", "time zero", (1, "--time-zero", 3.2)),
        ([first, single], {}, "LINE04.DT1", "traces", (2, 1)),
        ([timed], {}, "timed.DZT", "trace spacing", ("--length-m",)),
        ([wide, wider], {}, "wide.DZT", "channels", (2,)),
        ([first, second, first], {}, "LINE00.DT1", "lines", ()),
        ([first, second], {"line_spacing_m": 0.0}, None, "line_spacing_m", (100, 0)),
        ([first, second], {"length_m": -3.0}, None, "length_m", (-3,)),
        ([first, second], {"length_m": 48500.0}, "LINE00.DT1", "trace spacing", (10, 16166.7)),
        ([first], {"time_zero": nan}, "LINE00.DT1", "time zero", (6.4, "nan")),
        ([first], {"time_zero": -7.0}, "LINE00.DT1", "time zero", (6.4, -7)),
        ([first, second], {"reversed_lines": [2]}, None, "reversed_lines", (0, 1, 2)),
        ([tmp_path / "none.DT1"], {}, "none.DT1", "file", ()),
    ]
    before = sorted(tmp_path.iterdir())
    for paths, options, file, place, values in cases:
        with refused(place, *values, file=file):
            import_lines(paths, output=tmp_path / "a.drive.h5", **({"line_spacing_m": 0.5} | options))  # type: ignore[arg-type]
        assert sorted(tmp_path.iterdir()) == before
