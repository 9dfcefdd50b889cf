"""Real recordings registered with the thresholds that all ground shares. Figures: docs/performance.md."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from lgprjax.archive import RegisteredDrive, build_map, register_log
from lgprjax.bench.archive_drives import cut_drive
from lgprjax.formats import DriveLog, DriveWriter, MapFile, TraceRecording, import_lines
from lgprjax.registration import RegisterOptions

ALONG_M, CROSS_M = 0.3, 0.2

pytestmark = pytest.mark.real


class Tally(NamedTuple):
    """Windows tried, those called ok, and those of the ok that are right."""

    tried: int
    ok: int
    right: int

    def plus(self, other: "Tally") -> "Tally":
        return Tally(*(a + b for a, b in zip(self, other, strict=True)))


def judge(drive: RegisteredDrive) -> Tally:
    """Compare with where the survey says that the lines were: the prior, which no registration sees the inside of."""
    pose, prior = np.asarray(drive.fix.pose), drive.track.pose
    off = pose[:, :2] - prior[:, :2]
    cos, sin = np.cos(prior[:, 3]), np.sin(prior[:, 3])
    along, cross = cos * off[:, 0] + sin * off[:, 1], cos * off[:, 1] - sin * off[:, 0]
    code = drive.table["code"].to_numpy()
    ok = code == "ok"
    right = ok & (np.abs(along) <= ALONG_M) & (np.abs(cross) <= CROSS_M)
    return Tally(int(np.sum(code != "no_window")), int(ok.sum()), int(right.sum()))


def register(database: Path, log_path: Path, options: RegisterOptions | None = None) -> Tally:
    with MapFile.open(database) as source, DriveLog.open(log_path) as log:
        return judge(register_log(source, log, options or RegisterOptions()))


def test_parallel_lines_are_found_between_the_lines_of_the_map(real_data: Path, tmp_path: Path) -> None:
    """Map of the odd lines; three even lines at a time are live, by default."""
    lines = [real_data / "gpr_o_parallel_lines" / f"XLINE{number:02d}.DT1" for number in range(25)]
    odd, database = tmp_path / "odd.drive.h5", tmp_path / "odd.map.h5"
    import_lines(lines[1::2], line_spacing_m=0.4, first_line_m=0.2, output=odd)
    build_map([odd], database)
    tally = Tally(0, 0, 0)
    for first in range(0, 22, 2):
        live = tmp_path / f"even{first}.drive.h5"
        import_lines(lines[first : first + 5 : 2], line_spacing_m=0.4, first_line_m=0.2 * first, output=live)
        tally = tally.plus(register(database, live))
    print(f"parallel lines: {tally}")
    assert tally.tried >= 330
    # Lines of 11.6 m with a wavelength of a metre: a third of each is driven before four metres are (performance.md).
    assert tally.ok >= 0.3 * tally.tried
    assert tally.right >= 0.99 * tally.ok


def test_a_line_beside_the_map_is_not_lied_about(real_data: Path, tmp_path: Path) -> None:
    """Hautefeuille, line 1 the map, a third of line 2 live: half a metre beside a single line is off the map."""
    folder = real_data / "hautefeuille"
    one, two, database = tmp_path / "one.drive.h5", tmp_path / "two.drive.h5", tmp_path / "one.map.h5"
    import_lines([folder / "FILE__001.DZT"], line_spacing_m=0.5, length_m=30.0, output=one)
    import_lines(
        [folder / "FILE__002.DZT"],
        line_spacing_m=0.5,
        first_line_m=0.5,
        length_m=30.0,
        reversed_lines=(0,),
        output=two,
    )
    build_map([one], database)
    live = tmp_path / "live.drive.h5"
    with DriveLog.open(two) as log:
        cut_drive(log, 0, log.scans // 3, live)
    tally = register(database, live)
    print(f"Hautefeuille, a third of line 2 on line 1: {tally}")
    assert tally.tried > 30
    assert tally.ok == 0


def test_odd_and_even_traces_of_a_weak_line(real_data: Path, tmp_path: Path) -> None:
    """Yosemite: 50 MHz, a trace each two feet, so that map and live traces lie 1.22 m apart, half a step off."""
    whole = tmp_path / "whole.drive.h5"
    import_lines([real_data / "gprpy_yosemite" / "XLINE00.DT1"], line_spacing_m=0.5, output=whole)
    odd, even = tmp_path / "odd.drive.h5", tmp_path / "even.drive.h5"
    every_second(whole, odd, 1)
    every_second(whole, even, 0)
    database = tmp_path / "odd.map.h5"
    build_map([odd], database)
    tally = register(database, even)
    print(f"Yosemite: {tally}")
    assert tally.tried > 200
    assert tally.right >= 0.99 * tally.ok
    assert tally.ok >= 0.8 * tally.tried


def every_second(source: Path, target: Path, first: int) -> None:
    """Every second scan of a drive log as a drive log of its own."""
    with DriveLog.open(source) as log:
        recording = log.description.recording
        assert isinstance(recording, TraceRecording)
        traces, valid = log.read_traces(0, log.scans)
        with DriveWriter.create(target, log.description, channels=log.channels, dtype=np.float32) as writer:
            writer.append(
                log.scan_time_s[first::2], traces[first::2] + np.float32(recording.zero_level), valid[first::2]
            )
