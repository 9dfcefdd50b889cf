"""A survey line from the command line: what was assumed on the way is told by the map and beside the fixes."""

import json
from pathlib import Path

import numpy as np
import pytest

from formats.samples import write_dt1
from lgprjax.cli import main
from lgprjax.formats import MapFile


def _run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as stopped:
        main([str(each) for each in arguments])
    assert isinstance(stopped.value.code, int)
    return stopped.value.code


def test_what_a_survey_line_cannot_know_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One line twice: at its place, and at latitude 0, longitude 0 as nobody said one."""
    rng = np.random.default_rng(1)
    bell = np.exp(-0.5 * (np.arange(-12, 13) / 4.0) ** 2)
    ground = np.stack([np.convolve(row, bell, "same") for row in rng.normal(size=(64, 300))], axis=1)
    line = write_dt1(tmp_path / "LINE.DT1", np.rint(1000.0 * ground + 50.0 * rng.normal(size=ground.shape)))
    again = write_dt1(tmp_path / "AGAIN.DT1", np.rint(1000.0 * ground + 50.0 * rng.normal(size=ground.shape)))
    near, far, built = tmp_path / "near.drive.h5", tmp_path / "far.drive.h5", tmp_path / "m.map.h5"
    place = ("--latitude-deg", 48, "--longitude-deg", 11)
    narrow = ("--search-m", 0.5)  # two and a half metres are many wavelengths here, and minutes
    assert _run("import", "dt1", line, *place, "-o", tmp_path / "m.drive.h5") == 0
    assert _run("import", "dt1", again, *place, "-o", near) == 0
    assert _run("import", "dt1", again, "-o", far) == 0
    capsys.readouterr()
    assert _run("map", "build", tmp_path / "m.drive.h5", "-o", built, "--centre-frequency-mhz", 500) == 0
    told = capsys.readouterr().out.splitlines()[-1]
    assert told.startswith("assumed: odometry (")
    assert "position sigma (not recorded)" in told
    assert "time (" not in told
    with MapFile.open(built) as source:
        inputs = source.provenance["inputs"]
    assert isinstance(inputs, list)
    assert [row["assumed"]["time"] for row in inputs] == ["unknown"]

    assert _run("register", built, near, far, *narrow, "-o", tmp_path / "out", "--json", tmp_path / "out.json") == 0
    shown = capsys.readouterr().out
    here, there = json.loads((tmp_path / "out.json").read_text())
    assert any(each.startswith("assumed in this drive: time (unknown)") for each in here["remarks"])
    assert any(each.startswith("one channel on a map of one channel") for each in here["remarks"])
    assert not any(each.startswith("the drive is") for each in here["remarks"])
    # 48.94 degrees of a great circle by the cosine rule, a sphere of 6371 km being 0.5 % off the ellipsoid at most.
    (away,) = [each for each in there["remarks"] if each.startswith("the drive is")]
    great_km = 6371.0 * np.arccos(np.cos(np.radians(48.0)) * np.cos(np.radians(11.0)))
    assert float(away.split()[3]) == pytest.approx(great_km, rel=5e-3)
    assert away.endswith("km from the map m (nearest point)")
    assert not any(each.startswith("one channel") for each in there["remarks"])
    assert f"far: {away}" in shown
    assert "--latitude-deg" in shown
    assert _run("map", "update", built, far, "-o", tmp_path / "n.map.h5") == 1
    assert away in capsys.readouterr().err
