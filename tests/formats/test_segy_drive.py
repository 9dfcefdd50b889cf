"""SEG-Y lines as drives: on their coordinates, straight, resampled, and several side by side."""

from pathlib import Path

import numpy as np
import pyproj
import pytest

from formats.segy_sample import COUNTS, write_segy
from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, SurveyOrigin, TraceRecording, check_file, import_lines, import_segy, read_segy

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
    with pytest.raises(InputError, match=r"position of trace 5: expected steps like most of them, 0.1 m, found a step"):
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
        with pytest.raises(InputError, match="coordinates: expected --utm-zone, or --length-m to leave them unused"):
            import_segy(path, place=_PLACE, output=output)
    assert import_segy(path, place=_PLACE, utm_zone=None if degrees else "32N", output=output)
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
    assert "picoseconds" in str(description.provenance["reading"])


def test_tape_beats_coordinates_and_straight_line_without(tmp_path: Path) -> None:
    headers = {71: -100, 73: 1000 + 20 * np.arange(6), 77: 100}
    path = write_segy(tmp_path / "a.sgy", headers=headers)
    assert not import_segy(path, place=_PLACE, output=tmp_path / "a.drive.h5")
    assert not import_segy(path, place=_PLACE, length_m=5.0, output=tmp_path / "b.drive.h5")
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
        assert "picoseconds" in str(log.description.provenance["readings"])
    np.testing.assert_array_equal(traces, np.stack([COUNTS, COUNTS + 1], axis=1))
    silent = write_segy(tmp_path / "2.segy", interval=4000, headers=headers)
    import_lines([silent], line_spacing_m=0.5, sample_interval_ns=0.4, output=tmp_path / "b.drive.h5")
    with DriveLog.open(tmp_path / "b.drive.h5") as log:
        assert log.description.recording.sample_interval_ns == 0.4  # type: ignore[union-attr]
    with pytest.raises(InputError, match=r"expected SEG-Y, as a sample interval is given, found '.rd3'"):
        import_lines([tmp_path / "a.rd3"], line_spacing_m=0.5, sample_interval_ns=0.4, output=tmp_path / "c.drive.h5")


def test_traces_without_coordinates_need_a_length(tmp_path: Path) -> None:
    partly = 1000 + 20 * np.arange(6)
    partly[2] = 0
    path = write_segy(tmp_path / "a.sgy", headers={71: -100, 73: partly})
    assert "1 of 6 traces without" in str(read_segy(path).metadata["reading"])
    with pytest.raises(InputError, match="trace spacing: expected a spacing in the header, or the length"):
        import_segy(path, place=_PLACE, output=tmp_path / "a.drive.h5")
    with pytest.raises(InputError, match="expected eastings and northings, found sample interval"):
        import_segy(path, place=_PLACE, utm_zone="32N", output=tmp_path / "a.drive.h5")
    assert list(tmp_path.iterdir()) == [path]
