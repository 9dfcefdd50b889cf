"""SEG-Y lines as drives: on their coordinates, straight, resampled, and several side by side."""

from pathlib import Path

import numpy as np
import pyproj
import pytest

from formats.segy_sample import COUNTS, write_segy
from lgprjax.formats import DriveLog, SurveyOrigin, TraceRecording, check_file, import_lines, import_segy, read_segy
from refusals import refused

_PLACE = SurveyOrigin(48.0, 11.0, 30.0)


def test_uneven_positions_are_resampled_to_an_even_step(tmp_path: Path) -> None:
    along_cm = np.array([0, 10, 20, 40, 50, 60])
    ramp = along_cm[:, None] * np.ones(10)  # the signal is the position: after resampling it must rise evenly
    path = write_segy(tmp_path / "a.sgy", ramp, headers={71: -100, 73: 1000 + along_cm, 77: 100})
    assert read_segy(path).spacing_m is None
    import_segy(path, place=_PLACE, output=tmp_path / "a.drive.h5")
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        traces, valid = log.read_traces(0, log.scans)
        np.testing.assert_allclose(log.description.odometry.distance_m, np.arange(7) * 0.1, atol=1e-12)
    np.testing.assert_allclose(traces[:, 0, 0], np.arange(7) * 10, atol=1e-4)
    assert valid.all()


def test_gap_is_left_open_and_a_wild_position_refused(tmp_path: Path) -> None:
    along_cm = np.array([0, 10, 20, 70, 80, 90])
    path = write_segy(tmp_path / "a.sgy", headers={71: -100, 73: 1000 + along_cm, 77: 100})
    import_segy(path, place=_PLACE, output=tmp_path / "a.drive.h5")
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        traces, valid = log.read_traces(0, log.scans)
    np.testing.assert_array_equal(valid[:, 0], [True] * 3 + [False] * 4 + [True] * 3)
    np.testing.assert_array_equal(traces[valid[:, 0], 0], COUNTS)
    wild = write_segy(tmp_path / "b.sgy", headers={71: -100, 73: 1000 + along_cm * [1, 1, 1, 1, 1, 100], 77: 100})
    with refused("position of trace 5", 0.1):
        import_segy(wild, place=_PLACE, output=tmp_path / "b.drive.h5")


def _curve(radius_m: float = 30.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Easting, northing and grid heading of a quarter of a circle driven clockwise, heading north first."""
    angle = np.linspace(0.0, np.pi / 2, 120)
    return 500800 + radius_m * (1 - np.cos(angle)), 5316000 + radius_m * np.sin(angle), np.rad2deg(angle)


@pytest.mark.parametrize("degrees", [False, True])
def test_line_on_the_earth(tmp_path: Path, degrees: bool) -> None:
    easting, northing, heading = _curve()
    utm = pyproj.Proj(proj="utm", zone=32, ellps="WGS84")
    longitude, latitude = utm(easting, northing, inverse=True)
    # Degrees as ten-thousandths of a second of arc, metres as centimetres.
    scale, unit = (36e6, 2) if degrees else (100.0, 1)
    x, y = (longitude, latitude) if degrees else (easting, northing)
    headers = {71: -10000 if degrees else -100, 73: np.rint(x * scale), 77: np.rint(y * scale), 89: unit}
    traces = np.tile(np.arange(10), (120, 1)) + np.arange(120)[:, None]
    path = write_segy(tmp_path / "a.sgy", traces, headers=headers)
    output = tmp_path / "a.drive.h5"
    if not degrees:
        with refused("coordinates", "--utm-zone", "--length-m"):
            import_segy(path, place=_PLACE, output=output)
    # Told to be unused: the zone where there are degrees, the place in any case.
    unused = import_segy(path, place=_PLACE, utm_zone="32N", output=output)
    assert ["32N" in line for line in unused] == ([True, False] if degrees else [False])
    assert check_file(output) == []
    with DriveLog.open(output) as log:
        description = log.description
        stored, _ = log.read_traces(0, log.scans)
    np.testing.assert_array_equal(stored[:, 0], traces)
    navigation = description.navigation
    error_m = pyproj.Geod(ellps="WGS84").inv(longitude, latitude, navigation.longitude_deg, navigation.latitude_deg)[2]
    assert max(error_m) < 0.01
    true_deg = heading + utm.get_factors(longitude, latitude).meridian_convergence
    off_deg = (navigation.heading_deg - true_deg + 180) % 360 - 180
    # In the middle the chord of a circle is parallel to the tangent; a centimetre over a metre is 0.6 degrees.
    assert np.abs(off_deg[3:-3]).max() < 1.0
    assert description.odometry.distance_m[-1] == pytest.approx(30 * np.pi / 2, abs=0.05)
    assert isinstance(description.recording, TraceRecording)


def test_tape_beats_coordinates_and_straight_line_without(tmp_path: Path) -> None:
    headers = {71: -100, 73: 1000 + 20 * np.arange(6), 77: 100}
    path = write_segy(tmp_path / "a.sgy", headers=headers)
    assert import_segy(path, place=_PLACE, output=tmp_path / "a.drive.h5") == ()
    unused = import_segy(path, place=_PLACE, utm_zone="32N", length_m=5.0, output=tmp_path / "b.drive.h5")
    assert ["32N" in line for line in unused] == [True]
    for name, length_m in (("a", 1.0), ("b", 5.0)):
        with DriveLog.open(tmp_path / f"{name}.drive.h5") as log:
            assert log.description.odometry.distance_m[-1] == pytest.approx(length_m)
            np.testing.assert_allclose(log.description.navigation.heading_deg, 30.0, atol=1e-4)


def test_parallel_segy_lines(tmp_path: Path) -> None:
    headers = {71: -100, 73: 1000 + 20 * np.arange(6), 77: 100}
    paths = [write_segy(tmp_path / f"{n}.segy", COUNTS + n, headers=headers) for n in range(2)]
    import_lines(paths, line_spacing_m=0.5, output=tmp_path / "a.drive.h5")
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        traces, _ = log.read_traces(0, log.scans)
        assert len(log.description.provenance["readings"]) == 2  # type: ignore[arg-type]
    np.testing.assert_array_equal(traces, np.stack([COUNTS, COUNTS + 1], axis=1))
    silent = write_segy(tmp_path / "2.segy", interval=4000, headers=headers)
    import_lines([silent], line_spacing_m=0.5, sample_interval_ns=0.4, output=tmp_path / "b.drive.h5")
    with DriveLog.open(tmp_path / "b.drive.h5") as log:
        assert log.description.recording.sample_interval_ns == 0.4  # type: ignore[union-attr]
    with refused("file name", ".rd3"):
        import_lines([tmp_path / "a.rd3"], line_spacing_m=0.5, sample_interval_ns=0.4, output=tmp_path / "c.drive.h5")


def _coordinates(path: Path, x: np.ndarray, y: np.ndarray, traces: np.ndarray, *, degrees: bool = False) -> Path:
    """A line with coordinates in centimetres, or in ten-thousandths of a second of arc."""
    scale, scalar, unit = (36e6, -10000, 2) if degrees else (100.0, -100, 1)
    return write_segy(path, traces, headers={71: scalar, 73: np.rint(x * scale), 77: np.rint(y * scale), 89: unit})


def _places(output: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Longitude and latitude of the scans, and their travel."""
    with DriveLog.open(output) as log:
        track, odometry = log.description.navigation, log.description.odometry
    return track.longitude_deg, track.latitude_deg, odometry.distance_m


def test_several_lines_in_degrees_are_passes_on_their_own_coordinates(tmp_path: Path) -> None:
    """The second line's receiver was slower than the radar: it has a new place at every third trace only."""
    utm = pyproj.Proj(proj="utm", zone=32, ellps="WGS84")
    east, north, _ = _curve()
    expected = [utm(east, north + 2.0 * line, inverse=True) for line in range(2)]
    traces = np.tile(np.arange(10), (120, 1)) + np.arange(120)[:, None]
    held = np.arange(120) // 3 * 3
    paths = [
        _coordinates(tmp_path / "0.sgy", *expected[0], traces, degrees=True),
        _coordinates(tmp_path / "1.sgy", expected[1][0][held], expected[1][1][held], traces, degrees=True),
    ]
    output = tmp_path / "a.drive.h5"
    survey = import_lines(paths, output=output)
    assert check_file(output) == []
    assert survey.placed_by == "header"
    assert {line.direction_from for line in survey.lines} == {line.start_from for line in survey.lines} == {"header"}
    assert "place on the earth" not in survey.assumed
    longitude, latitude, travel_m = _places(output)
    for line, tolerance_m in ((0, 0.01), (1, 0.03)):
        part = slice(120 * line, 120 * (line + 1))
        off_m = pyproj.Geod(ellps="WGS84").inv(*expected[line], longitude[part], latitude[part])[2]
        assert np.max(off_m) < tolerance_m
        assert np.ptp(travel_m[part]) == pytest.approx(30 * np.pi / 2, abs=0.1)


def test_one_line_in_degrees_is_not_moved_to_the_origin(tmp_path: Path) -> None:
    path = _coordinates(tmp_path / "0.sgy", 11.0 + 2e-6 * np.arange(6), np.full(6, 48.0), COUNTS, degrees=True)
    import_lines([path], output=tmp_path / "a.drive.h5")
    longitude, latitude, _ = _places(tmp_path / "a.drive.h5")
    np.testing.assert_allclose([longitude[0], latitude[0]], [11.0, 48.0], atol=1e-6)


@pytest.mark.parametrize("site", [False, True])
def test_several_straight_lines_in_metres_lie_side_by_side(tmp_path: Path, site: bool) -> None:
    """Metres of a UTM zone, or of the site: its x axis points along the heading."""
    x0, y0 = (10.0, 20.0) if site else (500_800.0, 5_316_000.0)
    along = 0.2 * np.arange(6)
    paths = [
        _coordinates(tmp_path / f"{line}.sgy", x0 + along, np.full(6, y0 + 0.5 * line), COUNTS + line)
        for line in range(2)
    ]
    output = tmp_path / "a.drive.h5"
    if site:
        survey = import_lines(paths, latitude_deg=48.0, longitude_deg=11.0, output=output)
    else:
        with refused("positions", "--utm-zone", 10, file="0.sgy"):
            import_lines(paths, output=output)
        survey = import_lines(paths, utm_zone="32N", output=output)
    assert survey.placed_by == "header"
    assert [line.file for line in survey.lines] == ["1.sgy", "0.sgy"]
    assert {line.start_from for line in survey.lines} == {"header"}
    assert ("32N" in survey.assumed["position"]) == (not site)
    with DriveLog.open(output) as log:
        description = log.description
        traces, valid = log.read_traces(0, log.scans)
    left_m = description.array.y_m
    assert np.diff(left_m).tolist() == pytest.approx([-0.5])
    assert valid.all()
    # The lines are to the left of the track by what the northern one is.
    np.testing.assert_array_equal(traces, np.stack([COUNTS + 1, COUNTS], axis=1))
    plane = (
        pyproj.Proj(proj="aeqd", ellps="WGS84", lat_0=48.0, lon_0=11.0)
        if site
        else pyproj.Proj(proj="utm", zone=32, ellps="WGS84")
    )
    longitude, latitude, _ = _places(output)
    east, north = plane(longitude, latitude)
    np.testing.assert_allclose(east, x0 + along, atol=0.02)
    np.testing.assert_allclose(north + left_m[1], y0, atol=0.02)


def test_traces_without_coordinates_need_a_length(tmp_path: Path) -> None:
    partly = 1000 + 20 * np.arange(6)
    partly[2] = 0
    path = write_segy(tmp_path / "a.sgy", headers={71: -100, 73: partly})
    with refused("trace spacing", "--length-m"):
        import_segy(path, place=_PLACE, output=tmp_path / "a.drive.h5")
    with refused("coordinates"):
        import_segy(path, place=_PLACE, utm_zone="32N", output=tmp_path / "a.drive.h5")
    assert list(tmp_path.iterdir()) == [path]
