"""ImpulseRadar lines: the header of the vendor's manual, both sample types, arrays, and bad files."""

from pathlib import Path

import numpy as np
import pytest

from formats.samples import IPRB_TRACES as _TRACES
from formats.samples import write_iprb
from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, SurveyOrigin, TraceRecording, check_file, import_iprb, read_iprb, read_iprb_array

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


def test_line_without_its_data_version_is_of_16_bits(tmp_path: Path) -> None:
    path = write_iprb(tmp_path / "a.iprb", DATA__VERSION=None, FREQUENCY=None, ANTENNA=None)
    np.testing.assert_array_equal(read_iprb(path).traces, _TRACES)
    assert read_iprb(path).centre_frequency_hz is None


def test_line_triggered_by_time_has_no_spacing(tmp_path: Path) -> None:
    profile = read_iprb(write_iprb(tmp_path / "a.iprb", TRIG__SOURCE="time"))
    assert profile.spacing_m is None
    assert profile.positions_m is None


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


@pytest.mark.parametrize("zeros", [(10, 40), (40, 10), (25, 40, 10)])
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


def test_time_zeros_of_different_recordings_are_no_array(tmp_path: Path) -> None:
    paths = [
        write_iprb(tmp_path / f"a_A{number}.iprb", CH_X_OFFSET=0.1 * number, ZERO__LEVEL=zero)
        for number, zero in enumerate((0, 0, 1))
    ]
    with pytest.raises(InputError, match=r"a_A2\.iprb: time zero: expected about 0 ns, found 0\.0976\d* ns"):
        read_iprb_array(paths)


def test_single_file_is_a_single_channel_wherever_it_sat_in_the_array(tmp_path: Path) -> None:
    path = write_iprb(tmp_path / "a_001_A04.iprb", CHANNELS=8, CH_X_OFFSET=0.3)
    import_iprb([path], place=_PLACE, length_m=2.0, output=tmp_path / "a.drive.h5")
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        np.testing.assert_array_equal(log.description.array.y_m, [0.0])
        assert log.description.odometry.distance_m[-1] == pytest.approx(2.0)


_BAD: list[tuple[dict[str, object], str]] = [
    ({"DATA__VERSION": 24}, "a.iprh: DATA VERSION: expected 16 or 32 (bits a sample), found 24"),
    ({"SAMPLES": 7, "TIMEWINDOW": 0.684}, "a.iprb: traces: expected 5 as a.iprh says, found 5 and a part of one"),
    ({"LAST__TRACE": 9}, "traces: expected 9 as a.iprh says, found 5; read the whole ones with lgprjax import"),
    ({"DATA__VERSION": 32}, "found 2 and a part of one; read the whole ones with lgprjax import --partial"),
    ({"TIMEWINDOW": -1}, "TIMEWINDOW: expected a number above zero, found -1"),
    ({"FREQUENCY": 800}, "FREQUENCY: expected 10243.3 MHz, 8 samples in the TIMEWINDOW, found 800"),
    ({"DISTANCE__INTERVAL": -0.01}, "DISTANCE INTERVAL: expected zero or more, found -0.01"),
    ({"ZERO__LEVEL": 8}, "ZERO LEVEL: expected a sample from 0 to 7, found 8"),
    ({"SAMPLES": "many"}, "SAMPLES: expected a number, found 'many'"),
]


@pytest.mark.parametrize(("lines", "words"), _BAD)
def test_bad_line_is_one_clear_line(tmp_path: Path, lines: dict[str, object], words: str) -> None:
    path = write_iprb(tmp_path / "a.iprb", **lines)  # type: ignore[arg-type]
    with pytest.raises(InputError) as caught:
        read_iprb(path)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_bad_arrays_are_one_line_and_leave_nothing(tmp_path: Path) -> None:
    first = write_iprb(tmp_path / "a_A01.iprb")
    again = write_iprb(tmp_path / "a_A02.iprb")
    short = write_iprb(tmp_path / "a_A03.iprb", _TRACES[:4], CH_X_OFFSET=0.1)
    wide = write_iprb(tmp_path / "a_A04.iprb", bits=32, CH_X_OFFSET=0.1)
    other = write_iprb(tmp_path / "a_A05.iprb", ANTENNA="400 MHz", CH_X_OFFSET=0.1)
    nowhere = write_iprb(tmp_path / "a_A06.iprb", CH_X_OFFSET=None)
    cut = write_iprb(tmp_path / "a_A07.iprb", CH_X_OFFSET=0.2)
    cut.write_bytes(cut.read_bytes()[:-3])
    lonely = tmp_path / "a_A08.iprb"
    lonely.write_bytes(b"data")
    before = sorted(tmp_path.iterdir())
    for paths, words in (
        ([], "channels: expected at least one .iprb file, found none"),
        (
            [first, again],
            "a_A02.iprh: CH_X_OFFSET: expected another place than every other channel, found 0 m in",
        ),
        ([first, short], "a_A03.iprb: recording: expected 5 traces of 8 samples of 16 bits as in a_A01.iprb, found 4"),
        ([first, wide], "found 5 traces of 8 samples of 32 bits"),
        ([first, other], "a_A05.iprh: ANTENNA: expected 800 MHz as in a_A01.iprh, found 400 MHz"),
        ([first, nowhere], "a_A06.iprh: CH_X_OFFSET: expected a number, found none"),
        ([first, cut], "a_A07.iprb: traces: expected 5 as a_A07.iprh says, found 4 and a part of one; read"),
        ([lonely], "header file: expected a_A08.iprh beside it, found none"),
        ([tmp_path / "a.rd3"], "file name: expected the suffix .iprb, found '.rd3'"),
    ):
        with pytest.raises(InputError) as caught:
            import_iprb(paths, place=_PLACE, output=tmp_path / "a.drive.h5")
        assert words in str(caught.value)
        assert sorted(tmp_path.iterdir()) == before
