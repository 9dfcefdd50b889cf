"""A survey line from the command line: what was assumed on the way is told beside the fixes, and how far away it is."""

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from canon.commands import run, succeed
from canon.site import Site
from formats.samples import write_dt1

LATITUDE_DEG, LONGITUDE_DEG = 48.0, 11.0


def test_what_a_survey_line_cannot_know_is_told(site: Site, short: Path, tmp_path: Path) -> None:
    """One line at its place, and at latitude 0, longitude 0 as nobody said one; the map is at neither."""
    traces = np.rint(1000.0 * np.random.default_rng(1).normal(size=(64, 300)))
    line = write_dt1(tmp_path / "LINE.DT1", traces)
    told, drive, nowhere = tmp_path / "out.json", tmp_path / "there.drive.h5", tmp_path / "nowhere.drive.h5"
    place = ("--latitude-deg", LATITUDE_DEG, "--longitude-deg", LONGITUDE_DEG)
    succeed("import", "dt1", line, *place, "-o", drive)
    succeed("import", "dt1", line, "-o", nowhere)
    shown = succeed("register", site.map, drive, nowhere, "-o", tmp_path / "out", "--json", told)
    figures = json.loads(told.read_text())
    # The generated site is at 42 degrees north, 71 west. By the cosine rule, a sphere of 6371 km being 0.5 % off the
    # ellipsoid at most.
    for one, latitude, longitude in zip(figures, (LATITUDE_DEG, 0.0), (LONGITUDE_DEG, 0.0), strict=True):
        assert any("time (unknown)" in each for each in one["remarks"])
        (away,) = [each for each in one["remarks"] if " km " in each]
        a, b, turn = np.radians([latitude, 42.0, longitude + 71.0])
        great_km = 6371.0 * np.arccos(np.sin(a) * np.sin(b) + np.cos(a) * np.cos(b) * np.cos(turn))
        assert float(away.partition(" km ")[0].split()[-1]) == pytest.approx(great_km, rel=5e-3)
        assert f"{one['name']}: {away}" in shown
    # How to say where it is.
    assert "--latitude-deg" in shown
    # A drive of the map's own radar, a degree to the north.
    far = tmp_path / "far.drive.h5"
    shutil.copyfile(short, far)
    with h5py.File(far, "r+") as store:
        store["gnss_ins/latitude_deg"][:] += 1.0
    done = run("map", "update", site.map, far, "-o", tmp_path / "n.map.h5")
    assert done.status == 1
    assert float(done.err.partition(" km ")[0].split()[-1]) == pytest.approx(111.0, rel=5e-3)
