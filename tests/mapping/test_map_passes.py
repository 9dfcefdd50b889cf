"""Passes over the ground of a map: two lanes side by side, a hole, a dead half of the array, days of recording."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Int

from canon.site import Site
from lgprjax.formats import DriveLog, MapFile
from lgprjax.mapping.matching import places_of_drives, route_of
from lgprjax.mapping.survey import STEP_M, GroundPasses, MapSurvey, ground_passes, half_like_m
from lgprjax.subsurface import Stations

BARE_M = (12.3, 13.9)  # along the route
PITCH_M = 0.127


class Damaged(MapFile):
    """No baseline holds data over a stretch, and the second one's left half is dead."""

    def read_stations(self, stations: Int[np.ndarray, " scan"]) -> Stations:
        """Stations with what is damaged not valid."""
        read = super().read_stations(stations)
        along_m = self.pose[stations, 0] - self.pose[0, 0]
        read.valid[(along_m > BARE_M[0]) & (along_m < BARE_M[1])] = False
        read.valid[self.drive[stations] == 1, :6] = False
        return read


def passes_of(kind: type[MapFile], path: Path) -> GroundPasses:
    with kind.open(path) as source:
        return ground_passes(source, route_of(places_of_drives(source, STEP_M), STEP_M))


@pytest.fixture(scope="module")
def sound(site: Site) -> GroundPasses:
    return passes_of(MapFile, site.map)


def test_cells_count_the_lanes_that_cover_them(sound: GroundPasses, site: Site) -> None:
    """The route is the left lane's; the right one lies some 0.6 m beside it, each array reaches 0.64 m to its sides."""
    with MapFile.open(site.map) as source:
        left, right = (source.pose[source.drive == drive, :2] for drive in (0, 1))
    # The road runs east, and both lanes weave.
    east_m = left[0, 0] + sound.at_m
    beside_m = np.interp(east_m, *right.T) - np.interp(east_m, *left.T)
    reach_m, counted = 5 * PITCH_M, 0
    for place in range(2, len(east_m) - 2):
        lanes = (0.0, float(beside_m[place]))
        for cell, across_m in enumerate(sound.across_m):
            # A cell that the rim of a lane cuts may be counted or not.
            if min(abs(abs(across_m - lane) - reach_m) for lane in lanes) > 1.5 * PITCH_M:
                expected = sum(abs(across_m - lane) <= reach_m for lane in lanes)
                assert sound.passes[place, cell] == expected, (place, cell)
                counted += 1
    assert counted > 200
    assert set(np.unique(sound.passes)) == {0, 1, 2}
    assert not sound.hole.any()


def test_days_are_those_of_the_newest_drive(sound: GroundPasses, site: Site) -> None:
    days = []
    for name in ("baseline_left", "baseline_right"):
        with DriveLog.open(site.logs[name]) as log:
            recorded = datetime.fromisoformat(log.description.t0_utc)
        days.append((recorded - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds() / 86400.0)
    known = sound.passes > 0
    np.testing.assert_array_equal(np.isfinite(sound.newest_day), known)
    both = sound.newest_day[sound.passes == 2]
    np.testing.assert_allclose(both, max(days))
    assert set(np.unique(sound.newest_day[known])) <= set(days)


def test_a_bare_stretch_is_a_hole_and_dead_channels_pass_nothing(site: Site, sound: GroundPasses) -> None:
    found = passes_of(Damaged, site.map)
    middle = int(np.argmin(np.abs(found.across_m)))
    bare = np.flatnonzero(found.hole[:, middle])
    # A place counts when all of its metre is covered.
    np.testing.assert_array_equal(found.at_m[bare], [12.5, 13.5])
    assert np.all(found.passes[bare] == 0)
    right_lane = (found.passes == 1)[20] & (found.across_m < -0.7)
    dead = (found.across_m > -0.5) & (found.across_m < -0.1)
    assert right_lane.any()
    np.testing.assert_array_equal(found.passes[20, dead], sound.passes[20, dead] - 1)


def survey_with(beside: np.ndarray) -> MapSurvey:
    """A survey that knows nothing but the likeness of neighbouring channels."""
    return MapSurvey(None, None, None, None, beside)  # type: ignore[arg-type]


def test_likeness_falls_to_half_where_its_curve_does() -> None:
    for length_m in (0.1, 0.3):
        alike = np.full((2, 10), np.exp(-(PITCH_M**2) / (2.0 * length_m**2)))
        alike[1, 4:6] = 0.02  # a channel that is not well
        found = half_like_m(survey_with(alike), PITCH_M)
        assert found is not None
        assert np.exp(-(found**2) / (2.0 * length_m**2)) == pytest.approx(0.5)
    assert half_like_m(survey_with(np.zeros((1, 0))), PITCH_M) is None
    assert half_like_m(survey_with(np.full((1, 3), -0.1)), PITCH_M) is None
