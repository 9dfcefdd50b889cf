"""GROUNDED-style runs: order of the channels, heading, standing and reversing, and bad files."""

from pathlib import Path

import numpy as np
import pyproj
import pytest

from lgprjax.formats import DriveLog, assumed_of, check_file, import_grounded
from refusals import refused

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


@pytest.mark.parametrize("channels", [3, 1])
def test_standing_and_reversing_keep_the_heading(tmp_path: Path, channels: int) -> None:
    """A single channel takes its heading from the motion."""
    back = 2.95 - np.arange(1, 21) * 0.05 if channels > 1 else np.zeros(0)
    along = np.concatenate([np.zeros(5), np.arange(60) * 0.05, np.full(20, 2.95), back])
    _write_run(tmp_path / "run", along, channels=channels)
    _import(tmp_path / "run", tmp_path / "a.drive.h5")
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        description = log.description
    assert np.ptp(description.navigation.heading_deg) < 1e-3
    np.testing.assert_allclose(description.odometry.distance_m, along, atol=1e-6)


def test_floats_have_no_zero_level_and_long_runs_are_streamed(tmp_path: Path) -> None:
    cube, _ = _write_run(tmp_path / "run", np.arange(5000) * 0.01, channels=2, dtype=np.float64)
    _import(tmp_path / "run", tmp_path / "a.drive.h5", utm_zone="19n")
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        traces, _ = log.read_traces(4090, 4100)
    np.testing.assert_array_equal(traces, cube[4090:4100].transpose(0, 2, 1).astype(np.float32))


def test_southern_zone_and_time_zero_that_is_the_first_sample_unless_given(tmp_path: Path) -> None:
    _write_run(tmp_path / "run", np.arange(9) * 0.1)
    for name, time_zero_ns in (("a", 0.0), ("b", 1.2)):
        _import(tmp_path / "run", tmp_path / f"{name}.drive.h5", utm_zone="19S", time_zero_ns=time_zero_ns)
        with DriveLog.open(tmp_path / f"{name}.drive.h5") as log:
            assert log.description.navigation.latitude_deg[0] < -40
            assert log.description.recording.time_zero_ns == time_zero_ns  # type: ignore[union-attr]
            assert ("time zero" in assumed_of(log.description.provenance)) == (time_zero_ns == 0.0)


def test_bad_runs_are_refused_and_leave_nothing(tmp_path: Path) -> None:
    run = tmp_path / "run"
    along = np.arange(9) * 0.1
    cube, points = _write_run(run, along)
    spoiled = points.copy()
    spoiled[4, 1, 0] = np.nan
    radar, where = "run.npy", "run_UTM_point.npy"
    # Files that are changed, options, and then place and values that are named, and the file.
    cases: list[tuple[dict[str, object], dict[str, object], str, tuple[object, ...], str | None]] = [
        ({}, {"utm_zone": "north"}, "utm_zone", ("north", "19N"), None),
        ({}, {"utm_zone": "61N"}, "utm_zone", ("61N", 60), None),
        ({}, {"scan_rate_hz": 0.0}, "scan_rate_hz", (0,), None),
        ({}, {"sample_interval_ns": -1.0}, "sample_interval_ns", (-1,), None),
        ({}, {"time_zero_ns": 2.1}, "time_zero_ns", (2.1,), None),
        ({}, {"time_zero_ns": float("nan")}, "time_zero_ns", (2.1, "nan"), None),
        ({radar: None}, {}, "file", (), radar),
        ({where: None}, {}, "file", (), where),
        ({radar: b""}, {}, "file", (), radar),
        ({radar: b"text"}, {}, "file", (), radar),
        ({radar: (run / radar).read_bytes()[:-5]}, {}, "file", (), radar),
        ({radar: cube[0]}, {}, "shape", ((7, 3),), radar),
        ({radar: cube[:0]}, {}, "shape", ((0, 7, 3),), radar),
        ({radar: cube[:1], where: points[:1]}, {}, "scans", (2, 1), radar),
        ({radar: cube.astype(complex)}, {}, "type", ("uint8", "complex128"), radar),
        ({where: points[:8]}, {}, "shape", ((9, 3, 2), (8, 3, 2), radar), where),
        ({where: points[:, :2]}, {}, "shape", ((9, 2, 2),), where),
        ({where: spoiled}, {}, "positions", (1, 9, 4), where),
        ({where: points * 0 + 12}, {}, "positions", (12,), where),
        ({where: points[:1] + 0 * points}, {}, "positions", (), where),
        ({where: points[:, [0, 2, 1]]}, {}, "channels", (), where),
        ({where: points[:, [0, 0, 0]]}, {}, "scan 0", (), where),
        ({where: points[:, :, ::-1]}, {}, "positions", (900000,), where),
        ({where: points.astype("U9")}, {}, "type", (), where),
    ]
    for changes, options, place, values, file in cases:
        _write_run(run, along)
        for name, content in changes.items():
            if content is None:
                (run / name).unlink()
            elif isinstance(content, bytes):
                (run / name).write_bytes(content)
            else:
                np.save(run / name, content)  # type: ignore[arg-type]
        with refused(place, *values, file=file):
            _import(run, tmp_path / "a.drive.h5", **options)
        assert list(tmp_path.iterdir()) == [run]
