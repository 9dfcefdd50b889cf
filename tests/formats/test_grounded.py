"""GROUNDED-style runs: order of the channels, heading, standing and reversing, and bad files."""

from pathlib import Path

import numpy as np
import pyproj
import pytest

from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, assumed_of, check_file, import_grounded

_EASTING_M, _NORTHING_M = 300000.0, 4700000.0


def _write_run(
    folder: Path,
    along_m: np.ndarray,
    *,
    grid_heading_deg: float = 30.0,
    channels: int = 3,
    left_first: bool = True,
    dtype: type = np.uint8,
) -> tuple[np.ndarray, np.ndarray]:
    """A run along a straight line; antennas 0.1 m apart. Returns the cube and the points as stored."""
    folder.mkdir(exist_ok=True)
    forward = np.array([np.sin(np.deg2rad(grid_heading_deg)), np.cos(np.deg2rad(grid_heading_deg))])
    left = np.array([-forward[1], forward[0]])
    offsets = ((channels - 1) / 2 - np.arange(channels)) * 0.1
    points = np.array([_EASTING_M, _NORTHING_M]) + along_m[:, None, None] * forward + offsets[None, :, None] * left
    cube: np.ndarray = np.random.default_rng(3).integers(0, 256, (len(along_m), 7, channels)).astype(dtype)
    if not left_first:
        points, cube = points[:, ::-1], cube[:, :, ::-1]
    np.save(folder / "run.npy", cube)
    np.save(folder / "run_UTM_point.npy", points)
    return cube, points


def _import(folder: Path, output: Path, **options: object) -> None:
    arguments: dict[str, object] = {"utm_zone": "19N", "sample_interval_ns": 0.3, "scan_rate_hz": 126.0} | options
    import_grounded(folder, output=output, **arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize("left_first", [True, False])
def test_channel_order_is_found_and_heading_is_true_north(tmp_path: Path, left_first: bool) -> None:
    output = tmp_path / "a.drive.h5"
    cube, _ = _write_run(tmp_path / "run", np.arange(50) * 0.035, left_first=left_first)
    _import(tmp_path / "run", output)
    assert check_file(output) == []
    with DriveLog.open(output) as log:
        description = log.description
        traces, valid = log.read_traces(0, log.scans)
        np.testing.assert_allclose(log.scan_time_s, np.arange(50) / 126)
    due = cube.transpose(0, 2, 1).astype(np.float32) - 128
    np.testing.assert_array_equal(traces, due if left_first else due[:, ::-1])
    assert valid.all()
    np.testing.assert_allclose(description.array.y_m, [0.1, 0.0, -0.1], atol=1e-6)
    np.testing.assert_allclose(description.array.x_m, 0.0, atol=1e-6)
    np.testing.assert_allclose(description.odometry.distance_m, np.arange(50) * 0.035, atol=1e-6)
    # The heading must be that of the track on the ellipsoid, not on the grid (they differ by 1.6 degrees here).
    navigation = description.navigation
    azimuth, _, distance = pyproj.Geod(ellps="WGS84").inv(
        navigation.longitude_deg[0],
        navigation.latitude_deg[0],
        navigation.longitude_deg[-1],
        navigation.latitude_deg[-1],
    )
    assert navigation.heading_deg[0] == pytest.approx(azimuth, abs=1e-3)
    assert abs(azimuth - 30.0) > 1.0
    assert distance == pytest.approx(49 * 0.035, rel=1e-3)


def test_standing_and_reversing_keep_the_heading(tmp_path: Path) -> None:
    along = np.concatenate([np.arange(60) * 0.05, np.full(20, 2.95), 2.95 - np.arange(1, 21) * 0.05])
    _write_run(tmp_path / "run", along)
    _import(tmp_path / "run", tmp_path / "a.drive.h5")
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        description = log.description
    assert np.ptp(description.navigation.heading_deg) < 1e-3
    np.testing.assert_allclose(description.odometry.distance_m, along, atol=1e-6)


def test_single_channel_takes_its_heading_from_the_motion(tmp_path: Path) -> None:
    along = np.concatenate([np.zeros(5), np.arange(20) * 0.05, np.full(5, 0.95)])
    _write_run(tmp_path / "run", along, channels=1)
    _import(tmp_path / "run", tmp_path / "a.drive.h5")
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        assert np.ptp(log.description.navigation.heading_deg) < 1e-3
        assert log.description.odometry.distance_m[-1] == pytest.approx(0.95, abs=1e-6)


def test_floats_have_no_zero_level_and_long_runs_are_streamed(tmp_path: Path) -> None:
    cube, _ = _write_run(tmp_path / "run", np.arange(5000) * 0.01, channels=2, dtype=np.float64)
    _import(tmp_path / "run", tmp_path / "a.drive.h5", utm_zone="19n")
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        traces, _ = log.read_traces(4090, 4100)
    np.testing.assert_array_equal(traces, cube[4090:4100].transpose(0, 2, 1).astype(np.float32))


def test_southern_zone(tmp_path: Path) -> None:
    _write_run(tmp_path / "run", np.arange(9) * 0.1)
    _import(tmp_path / "run", tmp_path / "a.drive.h5", utm_zone="19S")
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        assert log.description.navigation.latitude_deg[0] < -40


def test_time_zero_is_the_first_sample_unless_given(tmp_path: Path) -> None:
    _write_run(tmp_path / "run", np.arange(9) * 0.1)
    for name, time_zero_ns in (("a", 0.0), ("b", 1.2)):
        _import(tmp_path / "run", tmp_path / f"{name}.drive.h5", time_zero_ns=time_zero_ns)
        with DriveLog.open(tmp_path / f"{name}.drive.h5") as log:
            assert log.description.recording.time_zero_ns == time_zero_ns  # type: ignore[union-attr]
            assert ("time zero" in assumed_of(log.description.provenance)) == (time_zero_ns == 0.0)


def test_bad_runs_are_one_line_and_leave_nothing(tmp_path: Path) -> None:
    run = tmp_path / "run"
    along = np.arange(9) * 0.1
    cube, points = _write_run(run, along)
    spoiled = points.copy()
    spoiled[4, 1, 0] = np.nan
    cases: list[tuple[dict[str, object], dict[str, object], str]] = [
        (
            {},
            {"utm_zone": "north"},
            "utm_zone: expected a number from 1 to 60 and the hemisphere, N or S, such as 19N",
        ),
        ({}, {"utm_zone": "61N"}, "found '61N'"),
        ({}, {"scan_rate_hz": 0.0}, "scan_rate_hz: expected a number above zero, found 0"),
        ({}, {"sample_interval_ns": -1.0}, "sample_interval_ns: expected a number above zero, found -1"),
        ({}, {"time_zero_ns": 2.1}, "time_zero_ns: expected a number below the 2.1 ns of a trace, found 2.1"),
        ({}, {"time_zero_ns": float("nan")}, "time_zero_ns: expected a number below the 2.1 ns of a trace, found nan"),
        ({"run.npy": None}, {}, "run.npy: file: expected a readable file, found No such file"),
        ({"run_UTM_point.npy": None}, {}, "run_UTM_point.npy: file: expected a readable file"),
        ({"run.npy": b""}, {}, "run.npy: file: expected a whole NumPy file"),
        ({"run.npy": b"text"}, {}, "run.npy: file: expected a whole NumPy file"),
        ({"run.npy": (run / "run.npy").read_bytes()[:-5]}, {}, "found one that is cut short or another format"),
        ({"run.npy": cube[0]}, {}, "run.npy: shape: expected axes [scan, sample, channel], found shape (7, 3)"),
        ({"run.npy": cube[:0]}, {}, "run.npy: shape: expected axes"),
        ({"run.npy": cube[:1], "run_UTM_point.npy": points[:1]}, {}, "scans: expected at least 2, found 1"),
        ({"run.npy": cube.astype(complex)}, {}, "run.npy: type: expected uint8 or"),
        ({"run_UTM_point.npy": points[:8]}, {}, "expected shape (9, 3, 2), as run.npy has 9 scans of 3 channels"),
        ({"run_UTM_point.npy": points[:, :2]}, {}, "found shape (9, 2, 2)"),
        ({"run_UTM_point.npy": spoiled}, {}, "found 1 of 9 scans otherwise, the first is 4"),
        ({"run_UTM_point.npy": points * 0 + 12}, {}, "positions: expected UTM metres"),
        (
            {"run_UTM_point.npy": points[:1] + 0 * points},
            {},
            "expected a vehicle that moves, found one that stands still",
        ),
        ({"run_UTM_point.npy": points[:, [0, 2, 1]]}, {}, "channels: expected an order from side to side"),
        ({"run_UTM_point.npy": points[:, [0, 0, 0]]}, {}, "scan 0: expected channels in a line, found the ends in one"),
        ({"run_UTM_point.npy": points[:, :, ::-1]}, {}, "positions: expected UTM metres"),
        ({"run_UTM_point.npy": points.astype("U9")}, {}, "type: expected numbers"),
    ]
    for number, (changes, options, words) in enumerate(cases):
        _write_run(run, along)
        for name, content in changes.items():
            if content is None:
                (run / name).unlink()
            elif isinstance(content, bytes):
                (run / name).write_bytes(content)
            else:
                np.save(run / name, content)  # type: ignore[arg-type]
        with pytest.raises(InputError) as caught:
            _import(run, tmp_path / "a.drive.h5", **options)
        assert words in str(caught.value), number
        assert "\n" not in str(caught.value)
        assert list(tmp_path.iterdir()) == [run]
