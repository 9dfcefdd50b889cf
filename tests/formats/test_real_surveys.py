"""Real surveys without an option beyond what nobody can know: what is found against what their makers noted."""

import shutil
from pathlib import Path

import numpy as np
import pyproj
import pytest

from lgprjax.formats import DriveLog, Survey, check_file, import_lines, read_profile

pytestmark = pytest.mark.real

_SECOND_DAY = 67
"""First line of the second day, on which the antennas were turned about."""


def _number(name: str) -> int:
    return int(name[5:8])


def _topography(folder: Path, number: int) -> np.ndarray:
    """Rows of N, E, Z."""
    return np.loadtxt(folder / f"topo_XLINE{number:03}.txt", delimiter=",", skiprows=1)


@pytest.fixture(scope="module")
def flagogna(real_data: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Survey, Path, Path]:
    """All lines imported with their topography beside them: what was found, the drive log, the folder."""
    folder = real_data / "flagogna"
    output = tmp_path_factory.mktemp("flagogna") / "a.drive.h5"
    paths = sorted(folder.glob("*.DT1"))
    assert len(paths) == 84
    return import_lines(paths, output=output), output, folder


def test_direct_wave_sign_and_direction(flagogna: tuple[Survey, Path, Path]) -> None:
    survey, _, _ = flagogna
    assert survey.placed_by == "topography"
    lines = {_number(line.file): line for line in survey.lines}
    assert sorted(lines) == list(range(20, 104))
    for number, line in lines.items():
        low, high = (72.0, 74.0) if number < _SECOND_DAY else (66.0, 69.0)
        assert line.direct_wave is not None
        assert low - 1.0 <= line.direct_wave <= high + 1.0, number
        assert line.sign == (1 if number < _SECOND_DAY else -1), number
        assert line.inverted == (number >= _SECOND_DAY), number
        assert line.reversed == (number % 2 == 1), number
        assert line.direction_from == line.start_from == "topography"
        # Headers of nothing or of no unit are passed over; the others are kept.
        assert (line.time_zero_from == "first break") == (line.time_zero_header < 1.0), number
        assert 61.0 <= line.time_zero <= 66.0, number
    assert sum(line.time_zero_from == "first break" for line in lines.values()) == 10
    neighbours = np.array([line.correlation for line in survey.lines[1:]])
    # One pair is of both days and of either sign.
    assert np.sum(neighbours < 0.0) == 1
    assert np.median(np.abs(neighbours)) > 0.55


def test_lines_lie_as_their_topography_says(flagogna: tuple[Survey, Path, Path]) -> None:
    survey, output, folder = flagogna
    assert check_file(output) == []
    for line in survey.lines:
        assert line.start_m == pytest.approx(_topography(folder, _number(line.file))[:, 1].min(), abs=1e-6)
    # Left of the lines' direction is +N: channel 0 is the line of the largest.
    across = [np.median(_topography(folder, _number(line.file))[:, 0]) for line in survey.lines]
    assert [_number(line.file) for line in survey.lines] == list(range(103, 19, -1))
    with DriveLog.open(output) as log:
        np.testing.assert_allclose(log.description.array.y_m, across, atol=1e-6)
        _, valid = log.read_traces(0, log.scans)
    assert valid.sum(axis=0).tolist() == [line.traces for line in survey.lines]


def test_zigzag_and_starts_are_found_without_topography(flagogna: tuple[Survey, Path, Path], tmp_path: Path) -> None:
    folder = flagogna[2]
    for path in [*folder.glob("*.DT1"), *folder.glob("*.HD")]:
        shutil.copy(path, tmp_path)
    paths = sorted(tmp_path.glob("*.DT1"))
    survey = import_lines(paths, line_spacing_m=0.25, output=tmp_path / "a.drive.h5")
    assert [_number(line.file) for line in survey.lines] == list(range(20, 104))
    assert [line.direction_from for line in survey.lines] == ["assumed"] + ["neighbours"] * 83
    for line in survey.lines:
        assert line.reversed == (_number(line.file) % 2 == 1)
        assert line.inverted == (_number(line.file) >= _SECOND_DAY)
        assert line.start_from == "neighbours"
    begins = np.array([_topography(folder, _number(line.file))[:, 1].min() for line in survey.lines])
    off = np.array([line.start_m for line in survey.lines]) - begins
    off -= np.median(off)
    # Measured: 0.27 m root mean square, 93 % within 0.5 m, 0.76 m at most, where starts differ by 0.60 m. From line to
    # line, where nothing adds up, all are about within a trace: 0.27 m.
    assert off.std() < 0.35
    assert np.mean(np.abs(off) < 0.5) > 0.85
    assert np.abs(off).max() < 1.0
    assert np.mean(np.abs(np.diff(off)) < 0.3) > 0.97
    assert begins.std() > 0.55


def test_receivers_beside_the_lines(flagogna: tuple[Survey, Path, Path], tmp_path: Path) -> None:
    """Hand-held fixes of metres: passes one after another, as long as the header's step makes them."""
    folder = flagogna[2]
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
    "gprpy_dune/FILE____032.DZT": 20.78,
    "gprpy_yosemite/XLINE00.DT1": 1060 * 0.3048,
    "gprpymini_mala500/utility_example.rd3": 1286 * 0.008688,
    "charisma_lab_slab/Lab_specimen_data.DZT": 331 * 0.008467,
    "hautefeuille/FILE__001.DZT": 1778 / 60,
    "hautefeuille/FILE__002.DZT": 1790 / 60,
    "hautefeuille/FILE__003.DZT": 1792 / 60,
    "gpr_o_parallel_lines/XLINE00.DT1": 231 * 0.05,
    "flagogna/XLINE030.DT1": 198 * 0.25,
}


@pytest.mark.parametrize("name", _SINGLE)
def test_every_kind_of_file_needs_no_option(name: str, real_data: Path, tmp_path: Path) -> None:
    output = tmp_path / "a.drive.h5"
    survey = import_lines([real_data / name], output=output)
    assert check_file(output) == []
    (line,) = survey.lines
    assert line.direction_from == "assumed"
    profile = read_profile(real_data / name)
    with DriveLog.open(output) as log:
        assert log.scans == line.traces == len(profile.channels)
        assert log.description.odometry.distance_m[-1] == pytest.approx(_SINGLE[name], rel=2e-3)
        traces, valid = log.read_traces(0, log.scans)
    assert valid.all()
    np.testing.assert_array_equal(traces[:, 0], profile.traces)


def test_surveys_need_their_spacing_only(real_data: Path, tmp_path: Path) -> None:
    parallel = sorted((real_data / "gpr_o_parallel_lines").glob("*.DT1"))
    survey = import_lines(parallel, line_spacing_m=0.2, output=tmp_path / "a.drive.h5")
    assert check_file(tmp_path / "a.drive.h5") == []
    assert [line.file for line in survey.lines if line.inverted] == ["XLINE24.DT1"]
    assert not any(line.reversed for line in survey.lines)
    # Half a metre apart nothing of one line is in the next: what nobody can see is said to be assumed.
    tape = sorted((real_data / "hautefeuille").glob("*.DZT"))
    survey = import_lines(tape, line_spacing_m=0.5, length_m=30.0, output=tmp_path / "b.drive.h5")
    assert {line.direction_from for line in survey.lines} == {"assumed"}
    assert survey.assumed["direction"] == "as stored"
    survey = import_lines(
        tape, line_spacing_m=0.5, length_m=30.0, reversed_lines="even", output=tmp_path / "c.drive.h5"
    )
    assert [line.reversed for line in survey.lines] == [False, True, False]
