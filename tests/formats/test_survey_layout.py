"""Where the lines of a made survey come to lie: by tape, by topography, by a grid's metres and by a receiver."""

from pathlib import Path

import numpy as np
import pyproj
import pytest

from formats.samples import write_dt1
from formats.side_samples import gga_at, gps_text
from formats.survey_sample import STEP_M, write_survey, write_topography
from lgprjax.formats import DriveLog, check_file, import_lines
from refusals import refused

_LATITUDE, _LONGITUDE = 48.0, 11.0


def _plane(latitude_deg: float = _LATITUDE, longitude_deg: float = _LONGITUDE) -> pyproj.Transformer:
    """Degrees to metres east and north of a place, by another way than the code takes."""
    plane = f"+proj=aeqd +lat_0={latitude_deg} +lon_0={longitude_deg} +ellps=WGS84 +units=m"
    return pyproj.Transformer.from_crs("+proj=longlat +ellps=WGS84", plane, always_xy=True)


def _antennas(output: Path, plane: pyproj.Transformer) -> np.ndarray:
    """Place of every channel at every scan [scan, channel, 2], metres east and north."""
    with DriveLog.open(output) as log:
        description = log.description
    track, array = description.navigation, description.array
    east, north = plane.transform(track.longitude_deg, track.latitude_deg)
    heading = np.deg2rad(track.heading_deg)[:, None]
    across = array.x_m[None, :] * np.sin(heading) - array.y_m[None, :] * np.cos(heading)
    ahead = array.x_m[None, :] * np.cos(heading) + array.y_m[None, :] * np.sin(heading)
    return np.stack([np.asarray(east)[:, None] + across, np.asarray(north)[:, None] + ahead], axis=-1)


def _ramps(folder: Path, count: int, traces: int = 6) -> list[Path]:
    """Small lines that are told apart by their values: 1000 times their number, and the trace's."""
    lines = [np.repeat(1000 * i + np.arange(traces)[:, None], 8, axis=1) for i in range(count)]
    return [write_dt1(folder / f"LINE{i}.DT1", line, step=STEP_M) for i, line in enumerate(lines)]


@pytest.mark.parametrize("places", [[0.0, 0.3, 0.5, 1.7], [-0.4, 2.0, 0.1, -3.0]])
def test_uneven_tape(places: list[float], tmp_path: Path) -> None:
    paths = _ramps(tmp_path, 4)
    output = tmp_path / "a.drive.h5"
    survey = import_lines(paths, lines_at_m=places, reversed_lines=[2], output=output)
    assert check_file(output) == []
    order = sorted(range(4), key=lambda i: places[i])
    assert [line.file for line in survey.lines] == [f"LINE{i}.DT1" for i in order]
    assert [line.reversed for line in survey.lines] == [i == 2 for i in order]
    assert survey.placed_by == "tape"
    with DriveLog.open(output) as log:
        np.testing.assert_allclose(log.description.array.y_m, [-places[i] for i in order], atol=1e-12)
        traces, _ = log.read_traces(0, log.scans)
        assert [entry["file"] for entry in log.description.provenance["lines"]] == [  # type: ignore[attr-defined]
            f"LINE{i}.DT1" for i in order
        ]
    for channel, i in enumerate(order):
        expected = 1000 * i + np.arange(6)
        np.testing.assert_array_equal(traces[:, channel, 0], expected[::-1] if i == 2 else expected)


def test_places_that_are_none(tmp_path: Path) -> None:
    paths = _ramps(tmp_path, 3)
    cases: list[tuple[dict[str, object], str, tuple[object, ...]]] = [
        ({"lines_at_m": [0.0, 1.0]}, "lines_at_m", (3, 2)),
        ({"lines_at_m": [0.0, 1.0, np.nan]}, "lines_at_m", (3, "nan")),
        ({"lines_at_m": [0.0, 1.0, 1.001]}, "lines_at_m", (0.001,)),
        ({"lines_at_m": [0.0, 1.0, 2.0], "line_spacing_m": 1.0}, "lines_at_m, line_spacing_m", ()),
        ({"lines_at_m": [0.0, 1.0, 2.0], "first_line_m": 1.0}, "lines_at_m, first_line_m", ()),
        ({"lines_at_m": [0.0, 250.0, 500.0]}, "lines_at_m", (100, 250)),
        ({"first_line_m": 2.0}, "first_line_m", ("--line-spacing-m",)),
        ({}, "positions", ("--line-spacing-m", "--lines-at-m")),
    ]
    before = sorted(tmp_path.iterdir())
    for options, place, values in cases:
        with refused(place, *values, file=None if options else "LINE0.DT1"):
            import_lines(paths, output=tmp_path / "a.drive.h5", **options)  # type: ignore[arg-type]
        assert sorted(tmp_path.iterdir()) == before
    # One line without positions among others is named.
    for i in (0, 2):
        write_topography(paths[i], np.arange(6) * STEP_M, np.full(6, float(i)))
    with refused("positions", file="LINE1.DT1"):
        import_lines(paths, output=tmp_path / "a.drive.h5")


def _at_an_angle(paths: list[Path], origin: tuple[float, float], angle_deg: float) -> list[np.ndarray]:
    """Topography of lines 0.5 m apart that run at an angle to the x axis; the places of the traces [trace, 2]."""
    angle = np.deg2rad(angle_deg)
    ahead, right = np.array([np.cos(angle), np.sin(angle)]), np.array([np.sin(angle), -np.cos(angle)])
    places = []
    for i, path in enumerate(paths):
        along = np.arange(6) * STEP_M + 0.25 * (i % 2)
        place = np.array(origin) + along[:, None] * ahead + 0.5 * i * right
        write_topography(path, place[:, 0], place[:, 1])
        places.append(place)
    return places


@pytest.mark.parametrize(("angle_deg", "heading_deg"), [(0.0, 90.0), (30.0, 20.0), (145.0, 90.0), (-80.0, 20.0)])
def test_topography_in_metres_of_the_site(angle_deg: float, heading_deg: float, tmp_path: Path) -> None:
    """The site's x axis points along the heading that is given, its y axis to the left of that."""
    paths = _ramps(tmp_path, 3)
    places = _at_an_angle(paths, (4.0, -2.0), angle_deg)
    output = tmp_path / "a.drive.h5"
    survey = import_lines(
        paths, latitude_deg=_LATITUDE, longitude_deg=_LONGITUDE, heading_deg=heading_deg, output=output
    )
    assert check_file(output) == []
    assert survey.placed_by == "topography"
    assert "place on the earth" not in survey.assumed
    bearing = np.deg2rad(heading_deg)
    east_north = np.array([[np.sin(bearing), np.cos(bearing)], [-np.cos(bearing), np.sin(bearing)]])
    antennas = _antennas(output, _plane())
    with DriveLog.open(output) as log:
        traces, valid = log.read_traces(0, log.scans)
        track = log.description.navigation
        expected_deg = (heading_deg - angle_deg) % 360.0
        # Rows are written to a tenth of a millimetre.
        np.testing.assert_allclose((track.heading_deg - expected_deg + 180.0) % 360.0 - 180.0, 0.0, atol=0.01)
        left_m = np.diff(log.description.array.y_m)
        np.testing.assert_allclose(left_m, -0.5, atol=2e-4)
    for channel, place in enumerate(places):
        here = valid[:, channel]
        # Lines begin on one grid of scans or between its steps, and then lose a trace at an end.
        at = (traces[here, channel, 0] - 1000 * channel)[:, None]
        index = np.arange(6)
        expected = np.concatenate([np.interp(at, index, place[:, axis]) for axis in (0, 1)], axis=1) @ east_north
        assert here.sum() >= 5
        np.testing.assert_allclose(antennas[here, channel], expected, atol=0.003)


def test_topography_in_metres_of_a_grid(tmp_path: Path) -> None:
    paths = _ramps(tmp_path, 3)
    utm = pyproj.Transformer.from_crs("EPSG:32632", "EPSG:4326", always_xy=True)
    places = _at_an_angle(paths, (691_000.0, 5_335_000.0), 25.0)
    with refused("positions", 10, "--utm-zone", file="topo_LINE0.txt"):
        import_lines(paths, output=tmp_path / "a.drive.h5")
    with refused("utm_zone", "32X"):
        import_lines(paths, utm_zone="32X", output=tmp_path / "a.drive.h5")
    output = tmp_path / "a.drive.h5"
    survey = import_lines(paths, utm_zone="32N", output=output)
    assert survey.placed_by == "topography"
    assert "place on the earth" not in survey.assumed
    longitude, latitude = utm.transform(691_000.0, 5_335_000.0)
    plane = _plane(latitude, longitude)
    antennas = _antennas(output, plane)
    with DriveLog.open(output) as log:
        traces, valid = log.read_traces(0, log.scans)
    for channel, place in enumerate(places):
        here = valid[:, channel]
        at = (traces[here, channel, 0] - 1000 * channel)[:, None]
        index = np.arange(6)
        easting, northing = (np.interp(at[:, 0], index, place[:, axis]) for axis in (0, 1))
        expected = np.stack(plane.transform(*utm.transform(easting, northing)), axis=-1)
        # Metres of the grid are taken for metres of the ground: 0.04 % at most, a millimetre here.
        np.testing.assert_allclose(antennas[here, channel], expected, atol=0.005)


def test_bent_lines_keep_their_own_paths(tmp_path: Path) -> None:
    paths = _ramps(tmp_path, 2, traces=60)
    turn = np.deg2rad(np.arange(60))
    for i, path in enumerate(paths):
        radius = 14.0 + i
        write_topography(path, radius * np.sin(turn), radius * (1 - np.cos(turn)) - i)
    output = tmp_path / "a.drive.h5"
    survey = import_lines(paths, latitude_deg=_LATITUDE, longitude_deg=_LONGITUDE, output=output)
    assert {line.direction_from for line in survey.lines} == {"topography"}
    antennas = _antennas(output, _plane())[:, 0]
    for i in range(2):
        expected = np.stack([(14.0 + i) * np.sin(turn), (14.0 + i) * (1 - np.cos(turn)) - i], axis=-1)
        np.testing.assert_allclose(antennas[60 * i : 60 * (i + 1)], expected, atol=0.002)
    with DriveLog.open(output) as log:
        headings = log.description.navigation.heading_deg
    np.testing.assert_allclose(headings[5:55], 90.0 - np.arange(5, 55), atol=0.5)
    # Fewer rows than traces would put the line anywhere.
    write_topography(paths[1], np.arange(20.0), np.arange(20.0) ** 2 / 20.0)
    with refused("rows", 60, "LINE1.DT1", file="topo_LINE1.txt", found=20):
        import_lines(paths, output=output, force=True)


def test_points_along_a_line_tell_heights_only(tmp_path: Path) -> None:
    (path,) = _ramps(tmp_path, 1, traces=40)
    path.with_name("LINE0.txt").write_text("position,elevation\n0,10\n4,11\n9.75,10.5\n")
    survey = import_lines([path], output=tmp_path / "a.drive.h5")
    assert survey.placed_by == "header"
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        np.testing.assert_allclose(log.description.odometry.distance_m, np.arange(40) * STEP_M, atol=1e-9)


def _write_gps(
    line: Path,
    east: np.ndarray,
    north: np.ndarray,
    *,
    every: int,
    noise_m: float = 0.0,
    seed: int = 0,
    first: int = 0,
    longitude_deg: float = _LONGITUDE,
) -> None:
    """A fix every few traces from the first on that has one, with noise, in ``NAME.GPS``."""
    rng = np.random.default_rng(seed)
    moved = [values + noise_m * rng.normal(size=len(values)) for values in (east, north)]
    longitude, latitude = _plane(_LATITUDE, longitude_deg).transform(moved[0], moved[1], direction="INVERSE")
    sentences = [
        [gga_at(n, latitude[n], longitude[n])] if n >= first and (n - first) % every == 0 else []
        for n in range(len(east))
    ]
    line.with_suffix(".GPS").write_text(gps_text(sentences), newline="")


@pytest.mark.parametrize("noise_m", [0.0, 0.05])
def test_receiver_beside_one_line(noise_m: float, tmp_path: Path) -> None:
    (path,), truth = write_survey(tmp_path, firsts=[5], traces=[120])
    along = np.arange(120) * STEP_M
    east, north = along * np.sin(0.6), along * np.cos(0.6)
    _write_gps(path, east, north, every=4, noise_m=noise_m, seed=1)
    output = tmp_path / "a.drive.h5"
    survey = import_lines([path], output=output)
    assert check_file(output) == []
    assert (survey.placed_by, survey.lines[0].direction_from) == ("receiver", "receiver")
    assert survey.lines[0].start_from == "receiver"
    assert "place on the earth" not in survey.assumed
    assert "direction" not in survey.assumed
    off = np.hypot(*(_antennas(output, _plane())[:, 0] - np.stack([east, north], axis=-1)).T)
    # Averaging leaves less than the noise of 5 cm each way; at the ends, where half the fixes count, about as much.
    assert off.max() < (0.01 if noise_m == 0.0 else 0.2)
    assert np.median(off) < (0.005 if noise_m == 0.0 else 0.05)
    with DriveLog.open(output) as log:
        traces, valid = log.read_traces(0, log.scans)
        headings = log.description.navigation.heading_deg
    assert valid.all()
    np.testing.assert_array_equal(traces[:, 0], truth[0])
    np.testing.assert_allclose(headings, np.rad2deg(0.6), atol=0.2 if noise_m == 0.0 else 8.0)


def test_receiver_beside_a_line_with_a_gap_is_averaged_as_well(tmp_path: Path) -> None:
    """Two metres were skipped in the middle; before the first fix the line goes on in its usual step."""
    along = np.arange(120) * STEP_M + 2.0 * (np.arange(120) >= 60)
    traces = np.random.default_rng(1).normal(scale=1000.0, size=(120, 64)).astype(np.int16)
    path = write_dt1(tmp_path / "a.DT1", traces, step=STEP_M, positions=along)
    _write_gps(path, np.zeros(120), along, every=4, first=20, noise_m=0.05, seed=1)
    import_lines([path], output=tmp_path / "a.drive.h5")
    antennas = _antennas(tmp_path / "a.drive.h5", _plane())[:, 0]
    off = np.hypot(*(antennas - np.stack([np.zeros(120), along], axis=-1)).T)
    assert np.median(off[20:]) < 0.04
    assert off[:20].max() < 1.0
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        np.testing.assert_allclose(log.description.odometry.distance_m, along, atol=1e-5)


@pytest.mark.parametrize("longitude_deg", [_LONGITUDE, 180.0 - 5e-5])
def test_receiver_that_finds_itself_late_and_crosses_the_date_line(longitude_deg: float, tmp_path: Path) -> None:
    (path,), _ = write_survey(tmp_path, firsts=[5], traces=[100])
    east = np.arange(100) * STEP_M
    _write_gps(path, east, 0.3 * east, every=5, first=23, longitude_deg=longitude_deg)
    import_lines([path], output=tmp_path / "a.drive.h5")
    antennas = _antennas(tmp_path / "a.drive.h5", _plane(_LATITUDE, longitude_deg))[:, 0]
    # Traces before the first fix go on as the line began; digits of NMEA are worth 2 mm.
    np.testing.assert_allclose(antennas, np.stack([east, 0.3 * east], axis=-1), atol=0.01)


def test_receiver_beside_several_lines(tmp_path: Path) -> None:
    """Lines are passes one after another, each on its own path and in the direction in which it was walked."""
    paths, truth = write_survey(tmp_path, firsts=[5, 5, 5], traces=[80, 90, 70], reversed_lines=[1])
    east_north = []
    for i, (path, line) in enumerate(zip(paths, truth, strict=True)):
        along = np.arange(len(line)) * STEP_M
        north = along[::-1] if i == 1 else along
        _write_gps(path, np.full(len(line), 0.5 * i), north, every=5)
        east_north.append(np.stack([np.full(len(line), 0.5 * i), north], axis=-1))
    output = tmp_path / "a.drive.h5"
    survey = import_lines(paths, output=output)
    assert check_file(output) == []
    assert survey.placed_by == "receiver"
    assert {line.direction_from for line in survey.lines} == {"receiver"}
    assert not any(line.reversed for line in survey.lines)
    off = np.hypot(*(_antennas(output, _plane())[:, 0] - np.concatenate(east_north)).T)
    assert off.max() < 0.01
    with DriveLog.open(output) as log:
        traces, _ = log.read_traces(0, log.scans)
        travel = log.description.odometry.distance_m
        headings = log.description.navigation.heading_deg
        assert log.description.array.y_m.tolist() == [0.0]
    expected = np.concatenate([truth[0], truth[1][::-1], truth[2]])
    np.testing.assert_array_equal(traces[:, 0], expected)
    # Within a line travel is the header's; from line to line it is far more than any filter spans.
    ends = np.cumsum([80, 90])
    steps = np.diff(travel)
    np.testing.assert_allclose(np.delete(steps, ends - 1), STEP_M, atol=1e-9)
    assert steps[ends - 1].min() > 50.0
    np.testing.assert_allclose((headings[:80] + 180) % 360, 180.0, atol=0.2)
    np.testing.assert_allclose(headings[80:170], 180.0, atol=0.2)


def test_beside_a_tape_a_receiver_without_a_fix_does_not_matter(tmp_path: Path) -> None:
    paths = _ramps(tmp_path, 2)
    for path in paths:
        path.with_suffix(".GPS").write_text(gps_text([[]] * 6), newline="")
    with refused("positions", "sentences 0", file="LINE0.GPS"):
        import_lines(paths, output=tmp_path / "a.drive.h5")
    assert import_lines(paths, line_spacing_m=0.5, output=tmp_path / "a.drive.h5").placed_by == "tape"
