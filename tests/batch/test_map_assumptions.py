"""How far a drive lies from a map, against every pair of places; and what a map says its labels rest on."""

import re
from dataclasses import replace

import numpy as np
import pyproj
import pytest

from canon.site import Site
from lgprjax.batch import assumptions as map_assumptions
from lgprjax.batch.assumptions import away_in_words, distance_to_map_m, map_assumed_in_words
from lgprjax.formats import DriveLog, MapFile


@pytest.mark.parametrize("north_deg", [0.0, 0.001, -60.0])
def test_distance_is_that_of_the_nearest_pair(site: Site, north_deg: float, monkeypatch: pytest.MonkeyPatch) -> None:
    with MapFile.open(site.map) as source, DriveLog.open(site.logs["live"]) as log:
        track = log.description.navigation
        moved = replace(track, latitude_deg=track.latitude_deg + north_deg)
        monkeypatch.setattr(log, "description", replace(log.description, navigation=moved))
        frame, pose = source.description.frame, source.pose
        latitude, longitude, _ = frame.to_geodetic(pose[:, 0], pose[:, 1], np.zeros(len(pose)))
        geod = pyproj.Geod(ellps="WGS84")
        step = slice(None, None, 10)
        here, there = np.meshgrid(np.arange(len(moved.time_s))[step], np.arange(len(pose)))
        pairs_m = geod.inv(
            moved.longitude_deg[here], moved.latitude_deg[here], longitude[there].astype(float), latitude[there]
        )[2]
        found_m = distance_to_map_m(source, log)
        # Every tenth place of the drive, which are less than half a metre apart.
        assert found_m == pytest.approx(pairs_m.min(), abs=0.5)
        words = away_in_words(source, log)
        if north_deg == 0.0:
            assert words is None
            assert map_assumed_in_words(source) is None
        else:
            told = f"{found_m:.0f} m" if found_m < 1e3 else f"{found_m / 1e3:.1f} km"
            assert words is not None
            assert f" {told} " in words
            assert source.description.name in words


def test_what_labels_rest_on_is_told_by_baseline() -> None:
    told, roll = map_assumptions.assumptions_by_baseline, {"roll": "zero"}
    assert told([{}, {}]) is None
    # Of all baselines: without their numbers.
    assert told([roll, roll]) == "roll (zero)"
    words = told([{}, roll, {**roll, "height": "0"}])
    assert words is not None
    assert re.findall(r"(\w+) \((\w+)\)|(\d)", words) == [
        *(("roll", "zero", ""), ("", "", "1"), ("", "", "2")),
        *(("height", "0", ""), ("", "", "2")),
    ]
