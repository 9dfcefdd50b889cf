"""CMU-GPR sequences: truth, reversing, odometry alone, times, and bad files."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyproj
import pytest

from lgprjax.formats import DriveLog, SurveyOrigin, TraceRecording, check_file, import_cmu
from refusals import refused

_T0_S = 1613065150.25
_PLACE = SurveyOrigin(40.4433, -79.9436, 90.0)
_SAMPLES = 201


def _csv(path: Path, heading: str, *columns: np.ndarray) -> None:
    rows = np.column_stack(columns)
    text = "\n".join(",".join(f"{value:.6f}".rstrip("0").rstrip(".") for value in row) for row in rows)
    path.write_text(f"{heading}\n{text}\n" if len(rows) else f"{heading}\n")


def _profile(time_s: np.ndarray) -> np.ndarray:
    """Signed distance: 4 m ahead, a stop of 2 s, 1.5 m back; half a metre a second."""
    return np.asarray(np.interp(time_s, [0.0, 8.0, 10.0, 13.0], [0.0, 4.0, 4.0, 2.5]))


def _write(folder: Path, *, truth: bool = True, odometry_name: str = "we_odom.csv") -> np.ndarray:
    """A sequence along the direction 30 degrees left of the frame's x axis. Returns the amplitudes."""
    folder.mkdir(exist_ok=True)
    radar_s, odometry_s, truth_s = np.arange(0, 13, 0.1), np.arange(-0.5, 13.5, 0.05), np.arange(0.3, 12.5, 0.12)
    amplitudes = np.random.default_rng(6).integers(-30000, 30000, (len(radar_s), _SAMPLES))
    names = ",".join(f"amp_{i + 1}" for i in range(_SAMPLES))
    _csv(folder / "gpr_meas.csv", f"t_stamp,{names}", _T0_S + radar_s, amplitudes)
    _csv(folder / odometry_name, "t_stamp,dist_x", _T0_S + odometry_s, _profile(odometry_s))
    along = _profile(truth_s) if truth else np.zeros(0)
    angle = np.deg2rad(30.0)
    stamps = _T0_S + truth_s[: len(along)]
    place = (1 + along * np.cos(angle), 2 + along * np.sin(angle), 0 * along + 0.7)
    _csv(folder / "ts_meas.csv", "t_stamp,p_x,p_y,p_z", stamps, *place)
    return amplitudes


def _import(folder: Path, output: Path, **options: object) -> None:
    import_cmu(folder, output=output, **({"time_window_ns": 40.2, "place": _PLACE} | options))  # type: ignore[arg-type]


def test_sequence_with_a_total_station(tmp_path: Path) -> None:
    amplitudes = _write(tmp_path / "run")
    output = tmp_path / "a.drive.h5"
    _import(tmp_path / "run", output, time_zero_ns=3.0)
    assert check_file(output) == []
    with DriveLog.open(output) as log:
        description = log.description
        times = log.scan_time_s
        traces, valid = log.read_traces(0, log.scans)
    # Scans before and after the total station are left out: it ran from 0.3 to 12.42 s.
    np.testing.assert_allclose(times, np.arange(122) * 0.1, atol=1e-6)
    np.testing.assert_array_equal(traces[:, 0], amplitudes[3:125])
    assert valid.all()
    assert description.provenance["scans_left_out"] == 8
    assert datetime.fromisoformat(description.t0_utc) == datetime.fromtimestamp(_T0_S + 0.3, UTC)
    assert isinstance(description.recording, TraceRecording)
    assert description.recording.sample_interval_ns == pytest.approx(0.2)
    assert description.recording.time_zero_ns == 3.0
    assert description.recording.centre_frequency_hz == 500e6
    np.testing.assert_allclose(
        np.interp(times, description.odometry.time_s, description.odometry.distance_m), _profile(times + 0.3), atol=0.01
    )
    truth = description.truth
    assert truth is not None
    # x points east (heading 90), so y north: (1, 2) to (1 + 4 cos 30, 2 + 4 sin 30) about the origin.
    azimuth, _, distance = pyproj.Geod(ellps="WGS84").inv(
        np.full(len(truth.time_s), _PLACE.longitude_deg),
        np.full(len(truth.time_s), _PLACE.latitude_deg),
        truth.longitude_deg,
        truth.latitude_deg,
    )
    along = _profile(truth.time_s + 0.3)
    east, north = 1 + along * np.cos(np.pi / 6), 2 + along * np.sin(np.pi / 6)
    np.testing.assert_allclose(distance * np.sin(np.deg2rad(azimuth)), east, atol=1e-4)
    np.testing.assert_allclose(distance * np.cos(np.deg2rad(azimuth)), north, atol=1e-4)
    np.testing.assert_allclose(truth.height_m, 0.7)
    # The vehicle looks 60 degrees from north all along: ahead, standing and reversing.
    np.testing.assert_allclose(truth.heading_deg, 60.0, atol=0.05)
    np.testing.assert_array_equal(description.navigation.heading_deg, truth.heading_deg)
    assert truth.sigma_east_m is None
    assert description.navigation.sigma_east_m is None
    assert description.navigation.sigma_heading_deg is None


@pytest.mark.parametrize("absent", [True, False])
def test_sequence_by_odometry_alone(tmp_path: Path, absent: bool) -> None:
    amplitudes = _write(tmp_path / "run", truth=False, odometry_name="we_odom_meas.csv")
    if absent:
        (tmp_path / "run" / "ts_meas.csv").unlink()
    _import(tmp_path / "run", tmp_path / "a.drive.h5", place=SurveyOrigin(40.0, -80.0, 30.0))
    assert check_file(tmp_path / "a.drive.h5") == []
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        description = log.description
        assert log.scans == len(amplitudes)
    assert description.truth is None
    navigation = description.navigation
    np.testing.assert_allclose(navigation.heading_deg, 30.0, atol=1e-3)
    north_m = (navigation.latitude_deg - 40.0) * 111.035e3  # a degree of latitude at 40 north
    np.testing.assert_allclose(north_m, description.odometry.distance_m * np.cos(np.deg2rad(30)), atol=2e-3)
    assert description.provenance["positions"] == "odometry along a straight line"


def test_repeated_times_are_left_out_and_counted_and_floats_stay(tmp_path: Path) -> None:
    _write(tmp_path / "run", truth=False)
    path = tmp_path / "run" / "gpr_meas.csv"
    rows = path.read_text().splitlines()
    rows[2] = rows[2].rsplit(",", 1)[0] + ",0.5"
    path.write_text("\n".join([*rows[:4], rows[3], *rows[4:]]))
    _import(tmp_path / "run", tmp_path / "a.drive.h5")
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        traces, _ = log.read_traces(0, log.scans)
        assert log.description.provenance["rows_of_repeated_time"] == 1
    assert len(traces) == 130
    assert traces[1, 0, -1] == 0.5


def test_bad_sequences_are_refused_and_leave_nothing(tmp_path: Path) -> None:
    run = tmp_path / "run"
    _write(run)
    whole = {path.name: path.read_bytes() for path in run.iterdir()}
    radar_file, wheel_file, truth_file = "gpr_meas.csv", "we_odom.csv", "ts_meas.csv"
    radar, odometry = (whole[name].splitlines(keepends=True) for name in (radar_file, wheel_file))
    standing = b"t,x,y,z\n" + b"".join(b"%.2f,1,2,0\n" % (_T0_S + i) for i in range(12))
    # Files that are changed, options, and then the file, the place and values that are named.
    cases: list[tuple[dict[str, bytes | None], dict[str, object], str | None, str, tuple[object, ...]]] = [
        ({}, {"time_window_ns": 0.0}, None, "time_window_ns", (0,)),
        ({}, {"time_zero_ns": float("inf")}, None, "time_zero_ns", (40.2, "inf")),
        ({}, {"place": SurveyOrigin(0.0, 400.0, 0.0)}, None, "longitude_deg", (360, 400)),
        ({radar_file: None}, {}, radar_file, "file", ()),
        ({wheel_file: None}, {}, wheel_file, "file", ()),
        ({radar_file: b""}, {}, radar_file, "rows", (2, 0)),
        ({radar_file: b"".join(radar[:2])}, {}, radar_file, "rows", (2, 1)),
        ({radar_file: whole[radar_file][:-700]}, {}, radar_file, "row 130 below the heading, column 87", ()),
        (
            {radar_file: b"".join([*radar[:4], b"stop\n"])},
            {},
            radar_file,
            "row 4 below the heading, column 1",
            ("stop",),
        ),
        ({radar_file: b"".join([*radar[:4], radar[2]])}, {}, radar_file, "row 4 below the heading", ()),
        ({radar_file: radar[0] + radar[1][:200] + b"\n" + radar[2]}, {}, radar_file, "file", ()),
        ({radar_file: whole[wheel_file]}, {}, radar_file, "columns", (3, 2)),
        ({wheel_file: whole[truth_file]}, {}, wheel_file, "columns", (2, 4)),
        ({wheel_file: b"".join(odometry[:1])}, {}, wheel_file, "rows", (2, 0)),
        ({wheel_file: b"t,d\n5,0\n6,1\n"}, {}, radar_file, "times", ("6.00",)),
        ({truth_file: standing}, {}, truth_file, "positions", ()),
        ({truth_file: whole[wheel_file]}, {}, truth_file, "columns", (4, 2)),
        ({truth_file: b"\x89PNG\r\n\x1a\n\0\0\0"}, {}, truth_file, "columns", (4, 1)),
    ]
    for changes, options, file, place, values in cases:
        for name, content in (whole | changes).items():
            (run / name).unlink(missing_ok=True)
            if content is not None:
                (run / name).write_bytes(content)
        with refused(place, *values, file=file):
            _import(run, tmp_path / "a.drive.h5", **options)
        assert list(tmp_path.iterdir()) == [run]
