"""Real surveys without an option beyond what nobody can know: what is found against what their makers noted."""

import shutil
from pathlib import Path

import numpy as np
import pyproj
import pytest

from lgprjax.formats import DriveLog, check_file, find_side_files, import_lines, read_profile, read_side_file

pytestmark = pytest.mark.real

_SECOND_DAY = 67
"""First line of the second day, on which the antennas were turned about."""


def test_sign_direction_and_place_of_lines_of_two_days(real_data: Path, tmp_path: Path) -> None:
    """Eight lines with their topography; ``make validation NAME=surveys`` imports all 84."""
    folder, output = real_data / "flagogna", tmp_path / "a.drive.h5"
    survey = import_lines([folder / f"XLINE{number:03}.DT1" for number in range(61, 69)], output=output)
    assert check_file(output) == []
    assert survey.placed_by == "topography"
    across = []
    for line in survey.lines:
        number = int(line.file[5:8])
        north, east, _ = np.loadtxt(folder / f"topo_XLINE{number:03}.txt", delimiter=",", skiprows=1).T
        second = number >= _SECOND_DAY
        assert (line.sign, line.inverted, line.reversed) == (-1 if second else 1, second, number % 2 == 1), number
        assert line.direction_from == line.start_from == "topography"
        assert line.direct_wave is not None
        assert 65.0 <= line.direct_wave <= 75.0
        assert line.start_m == pytest.approx(east.min(), abs=1e-6)
        across.append(np.median(north))
    # Left of the lines' direction is +N: channel 0 is the line of the largest.
    assert [int(line.file[5:8]) for line in survey.lines] == list(range(68, 60, -1))
    with DriveLog.open(output) as log:
        np.testing.assert_allclose(log.description.array.y_m, across, atol=1e-6)
        _, valid = log.read_traces(0, log.scans)
    assert valid.sum(axis=0).tolist() == [line.traces for line in survey.lines]


def test_receivers_beside_the_lines(real_data: Path, tmp_path: Path) -> None:
    """Hand-held fixes of metres: passes one after another, as long as the header's step makes them."""
    folder = real_data / "flagogna"
    for path in (path for number in range(24, 28) for path in folder.glob(f"XLINE{number:03}.*")):
        shutil.copy(path, tmp_path)
    paths = sorted(tmp_path.glob("*.DT1"))
    survey = import_lines(paths, output=tmp_path / "a.drive.h5")
    assert survey.placed_by == "receiver"
    assert {line.direction_from for line in survey.lines} == {"receiver"}
    assert "place on the earth" not in survey.assumed
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        track = log.description.navigation
    begin, ways = 0, []
    for line in survey.lines:
        last = begin + line.traces - 1
        azimuth, _, length_m = pyproj.Geod(ellps="WGS84").inv(
            track.longitude_deg[begin], track.latitude_deg[begin], track.longitude_deg[last], track.latitude_deg[last]
        )
        assert length_m == pytest.approx(0.25 * (line.traces - 1), rel=0.12)
        ways.append(azimuth)
        begin = last + 1
    turns = np.abs((np.diff(ways) + 180.0) % 360.0 - 180.0)
    # Walked there and back.
    np.testing.assert_allclose(turns, 180.0, atol=15.0)


_SINGLE = {
    "gprpy_yosemite/XLINE00.DT1": 1060 * 0.3048,
    "gprpymini_mala500/utility_example.rd3": 1286 * 0.008688,
    "charisma_lab_slab/Lab_specimen_data.DZT": 331 * 0.008467,
}


def test_every_kind_of_file_needs_no_option(real_data: Path, tmp_path: Path) -> None:
    for name, length_m in _SINGLE.items():
        output = tmp_path / f"{Path(name).stem}.drive.h5"
        survey = import_lines([real_data / name], output=output)
        assert check_file(output) == []
        (line,) = survey.lines
        assert line.direction_from == "assumed"
        profile = read_profile(real_data / name)
        with DriveLog.open(output) as log:
            assert log.scans == line.traces == len(profile.channels)
            assert log.description.odometry.distance_m[-1] == pytest.approx(length_m, rel=2e-3)
            traces, valid = log.read_traces(0, log.scans)
        assert valid.all()
        np.testing.assert_array_equal(traces[:, 0], profile.traces)


def test_surveys_need_their_spacing_only(real_data: Path, tmp_path: Path) -> None:
    parallel = sorted((real_data / "gpr_o_parallel_lines").glob("*.DT1"))[-6:]
    survey = import_lines(parallel, line_spacing_m=0.2, output=tmp_path / "a.drive.h5")
    assert check_file(tmp_path / "a.drive.h5") == []
    assert [line.file for line in survey.lines if line.inverted] == ["XLINE24.DT1"]
    assert not any(line.reversed for line in survey.lines)
    # Half a metre apart nothing of one line is in the next: what nobody can see is said to be assumed.
    tape = sorted((real_data / "hautefeuille").glob("*.DZT"))
    survey = import_lines(tape, line_spacing_m=0.5, length_m=30.0, output=tmp_path / "b.drive.h5")
    assert {line.direction_from for line in survey.lines} == {"assumed"}
    assert "direction" in survey.assumed


def test_real_topography_of_other_layouts(real_data: Path) -> None:
    grid = read_side_file(real_data / "gprpy_yosemite" / "GPS.xyz")
    assert (grid.kind, len(grid.x)) == ("grid metres", 103)
    length_m = np.hypot(np.diff(grid.x), np.diff(grid.y)).sum()
    assert length_m == pytest.approx(1060 * 0.3048, rel=0.1)
    dune = find_side_files(real_data / "gprpy_dune" / "FILE____032.DZT")
    assert [each.name for each in dune] == ["FILE____032.txt"]
    along = read_side_file(dune[0])
    assert along.kind == "along metres"
    assert np.all(np.diff(along.x) > 0)
    assert along.x[-1] == pytest.approx(1040 * 0.02, rel=0.2)
