"""ImpulseRadar lines: the header of the vendor's manual, both sample types, arrays, and bad files."""

from pathlib import Path

import numpy as np
import pytest

from formats.samples import IPRB_TRACES as _TRACES
from formats.samples import write_iprb
from lgprjax.formats import DriveLog, SurveyOrigin, TraceRecording, check_file, import_iprb, read_iprb, read_iprb_array
from refusals import refused

_PLACE = SurveyOrigin(48.0, 11.0, 0.0)


@pytest.mark.parametrize("bits", [16, 32])
def test_line(tmp_path: Path, bits: int) -> None:
    stored = _TRACES * (1 if bits == 16 else 70000)
    profile = read_iprb(write_iprb(tmp_path / "a_001_A01.iprb", stored, bits=bits, ZERO__LEVEL=2))
    np.testing.assert_array_equal(profile.traces, stored)
    assert profile.channels.dtype == (np.int16 if bits == 16 else np.int32)
    # The manual's example: 500 samples at 10240 MHz are 48.828 ns, and 1741 traces of 0.009778 m end at 17.024 m.
    assert profile.sample_interval_ns == pytest.approx(48.828 / 500, rel=1e-3)
    assert profile.time_zero_ns == pytest.approx(2 * profile.sample_interval_ns)
    assert profile.spacing_m == 0.009778
    assert profile.centre_frequency_hz == 800e6
    assert profile.positions_m is not None
    np.testing.assert_allclose(profile.positions_m, np.arange(5) * 0.009778)


def test_line_without_its_data_version_is_of_16_bits_and_one_triggered_by_time_has_no_spacing(tmp_path: Path) -> None:
    path = write_iprb(tmp_path / "a.iprb", DATA__VERSION=None, FREQUENCY=None, ANTENNA=None, TRIG__SOURCE="time")
    profile = read_iprb(path)
    np.testing.assert_array_equal(profile.traces, _TRACES)
    assert (profile.centre_frequency_hz, profile.spacing_m, profile.positions_m) == (None, None, None)


def test_array_is_placed_by_its_headers(tmp_path: Path) -> None:
    # Named out of order; the third channel is leftmost (x counts to the right) and lies 0.1 m further back.
    right = {1: 0.08, 2: 0.16, 3: 0.0}
    paths = [
        write_iprb(
            tmp_path / f"SITE_001_A{number:02}.iprb",
            _TRACES + number,
            CHANNELS=3,
            CH_X_OFFSET=x,
            CH_Y_OFFSET=-0.1 if number == 3 else 0.0,
        )
        for number, x in right.items()
    ]
    profile = read_iprb_array(paths)
    np.testing.assert_array_equal(profile.channels[:, :, 0] - _TRACES[:, :1], [[3, 1, 2]] * 5)
    output = tmp_path / "a.drive.h5"
    import_iprb(paths, place=_PLACE, output=output)
    assert check_file(output) == []
    with DriveLog.open(output) as log:
        traces, valid = log.read_traces(0, log.scans)
        description = log.description
    np.testing.assert_array_equal(traces, np.stack([_TRACES + n for n in (3, 1, 2)], axis=1))
    assert valid.all()
    np.testing.assert_allclose(description.array.y_m, [0.0, -0.08, -0.16], atol=1e-12)
    np.testing.assert_allclose(description.array.x_m, [-0.1, 0.0, 0.0], atol=1e-12)
    assert isinstance(description.recording, TraceRecording)
    assert description.recording.centre_frequency_hz == 800e6
    assert description.odometry.distance_m[-1] == pytest.approx(4 * 0.009778)
    header = description.provenance["header"]
    assert isinstance(header, dict)
    assert header["USER DISTANCE INTERVAL"] == "0.010000"


@pytest.mark.parametrize("zeros", [(40, 10), (25, 40, 10)])
def test_every_channel_has_its_own_time_zero(zeros: tuple[int, ...], tmp_path: Path) -> None:
    """An echo 20 ns after time zero lies there in every channel of the array."""
    interval_ns = 0.5
    paths = []
    for number, zero in enumerate(zeros):
        traces = np.zeros((5, 800), np.int64)
        traces[:, zero + 40] = 1000 + number
        path = tmp_path / f"a_A{number}.iprb"
        window = {"TIMEWINDOW": 800 * interval_ns, "FREQUENCY": 1000.0 / interval_ns}
        paths.append(write_iprb(path, traces, CH_X_OFFSET=0.1 * number, ZERO__LEVEL=zero, **window))  # type: ignore[arg-type]
    profile = read_iprb_array(paths)
    at_ns = np.argmax(profile.channels, axis=2) * interval_ns - profile.time_zero_ns
    np.testing.assert_array_equal(at_ns, 20.0)
    np.testing.assert_array_equal(profile.channels.max(axis=2), [1000.0 + np.arange(len(zeros))] * 5)
    output = tmp_path / "a.drive.h5"
    import_iprb(paths, place=_PLACE, output=output)
    with DriveLog.open(output) as log:
        traces, _ = log.read_traces(0, log.scans)
        recording = log.description.recording
    assert isinstance(recording, TraceRecording)
    np.testing.assert_array_equal(np.argmax(traces, axis=2) * interval_ns - recording.time_zero_ns, 20.0)


def test_single_file_is_a_single_channel_wherever_it_sat_in_the_array(tmp_path: Path) -> None:
    path = write_iprb(tmp_path / "a_001_A04.iprb", CHANNELS=8, CH_X_OFFSET=0.3)
    import_iprb([path], place=_PLACE, length_m=2.0, output=tmp_path / "a.drive.h5")
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        np.testing.assert_array_equal(log.description.array.y_m, [0.0])
        assert log.description.odometry.distance_m[-1] == pytest.approx(2.0)


def test_bad_lines_are_refused(tmp_path: Path) -> None:
    header, line = "a.iprh", "a.iprb"
    cases: list[tuple[dict[str, object], str, str, tuple[object, ...]]] = [
        ({"DATA__VERSION": 24}, header, "DATA VERSION", (16, 32, 24)),
        ({"SAMPLES": 7, "TIMEWINDOW": 0.684}, line, "traces", (5, header)),
        ({"LAST__TRACE": 9}, line, "traces", (9, header, 5)),
        ({"DATA__VERSION": 32}, line, "traces", (2, "--partial")),
        ({"TIMEWINDOW": -1}, header, "TIMEWINDOW", (-1,)),
        ({"FREQUENCY": 800}, header, "FREQUENCY", (10243.3, 8, 800)),
        ({"DISTANCE__INTERVAL": -0.01}, header, "DISTANCE INTERVAL", (-0.01,)),
        ({"ZERO__LEVEL": 8}, header, "ZERO LEVEL", (7, 8)),
        ({"SAMPLES": "many"}, header, "SAMPLES", ("many",)),
    ]
    for lines, file, place, values in cases:
        path = write_iprb(tmp_path / line, **lines)  # type: ignore[arg-type]
        with refused(place, *values, file=file):
            read_iprb(path)


def test_bad_arrays_are_refused_and_leave_nothing(tmp_path: Path) -> None:
    first = write_iprb(tmp_path / "a_A01.iprb")
    again = write_iprb(tmp_path / "a_A02.iprb")
    short = write_iprb(tmp_path / "a_A03.iprb", _TRACES[:4], CH_X_OFFSET=0.1)
    wide = write_iprb(tmp_path / "a_A04.iprb", bits=32, CH_X_OFFSET=0.1)
    other = write_iprb(tmp_path / "a_A05.iprb", ANTENNA="400 MHz", CH_X_OFFSET=0.1)
    nowhere = write_iprb(tmp_path / "a_A06.iprb", CH_X_OFFSET=None)
    cut = write_iprb(tmp_path / "a_A07.iprb", CH_X_OFFSET=0.2)
    cut.write_bytes(cut.read_bytes()[:-3])
    late = write_iprb(tmp_path / "a_A09.iprb", CH_X_OFFSET=0.1, ZERO__LEVEL=1)
    lonely = tmp_path / "a_A08.iprb"
    lonely.write_bytes(b"data")
    before = sorted(tmp_path.iterdir())
    cases: list[tuple[list[Path], str | None, str, tuple[object, ...]]] = [
        ([], None, "channels", (".iprb",)),
        ([first, again], "a_A02.iprh", "CH_X_OFFSET", (0,)),
        ([first, short], "a_A03.iprb", "recording", (5, 8, 16, "a_A01.iprb", 4)),
        ([first, wide], "a_A04.iprb", "recording", (32,)),
        ([first, other], "a_A05.iprh", "ANTENNA", ("800 MHz", "a_A01.iprh", "400 MHz")),
        ([first, nowhere], "a_A06.iprh", "CH_X_OFFSET", ()),
        ([first, cut], "a_A07.iprb", "traces", (5, "a_A07.iprh", 4)),
        # Time zeros a sample apart are those of different recordings.
        ([first, late], "a_A01.iprb", "time zero", (0.0976,)),
        ([lonely], "a_A08.iprb", "header file", ("a_A08.iprh",)),
        ([tmp_path / "a.rd3"], "a.rd3", "file name", (".iprb", ".rd3")),
    ]
    for paths, file, place, values in cases:
        with refused(place, *values, file=file):
            import_iprb(paths, place=_PLACE, output=tmp_path / "a.drive.h5")
        assert sorted(tmp_path.iterdir()) == before
