"""Headings along measured paths, and straight tracks."""

import numpy as np
import pyproj
import pytest

from lgprjax.formats.survey_track import SurveyOrigin, distances_m, path_headings_deg, straight_track

_GEOD = pyproj.Geod(ellps="WGS84")


def _circle(degrees: np.ndarray, radius_m: float = 20.0) -> tuple[np.ndarray, np.ndarray]:
    """Latitude and longitude on a circle, by azimuth from its centre."""
    count = len(degrees)
    longitude, latitude, _ = _GEOD.fwd(np.full(count, 25.0), np.full(count, 65.0), degrees, np.full(count, radius_m))
    return latitude, longitude


def test_headings_of_a_circle_driven_ahead_and_backwards() -> None:
    azimuth = np.concatenate([np.linspace(0, 90, 200), np.full(30, 90.0), np.linspace(90, 40, 100)])
    latitude, longitude = _circle(azimuth)
    travel_m = 20.0 * np.deg2rad(azimuth)
    headings = path_headings_deg(latitude, longitude, travel_m)
    # Clockwise about the centre the vehicle looks 90 degrees right of the azimuth, also while it reverses or stands.
    # Where it turns back the chord is folded open: half of it leads past the turning point.
    off = (headings - (azimuth + 90.0) + 180.0) % 360.0 - 180.0
    near = np.abs(travel_m - travel_m.max()) < 0.51
    ends = np.abs(azimuth) < 1.5
    last = np.arange(len(azimuth)) > len(azimuth) - 10
    assert np.abs(off[~near & ~ends & ~last]).max() < 0.05
    assert np.abs(off).max() < 2.0


def test_noise_of_centimetres_turns_headings_by_little() -> None:
    rng = np.random.default_rng(7)
    along = np.arange(0, 30, 0.02)
    longitude, latitude, _ = _GEOD.fwd(
        np.full(len(along), 11.0), np.full(len(along), 48.0), np.full(len(along), 135.0), along
    )
    noisy = np.asarray(latitude) + rng.normal(0, 0.01 / 111e3, len(along))
    headings = path_headings_deg(noisy, np.asarray(longitude), along)
    assert np.abs(headings - 135.0).max() < 2.5


def test_meridians_converge_along_a_long_line() -> None:
    # A parallel of latitude runs east everywhere, although in the plane of its first point it bends by 0.9 degrees.
    longitude = 25.0 + np.linspace(0, 1, 5000)
    latitude = np.full(5000, 65.0)
    headings = path_headings_deg(latitude, longitude, distances_m(latitude, longitude))
    np.testing.assert_allclose(headings, 90.0, atol=0.02)


def test_path_that_never_moves() -> None:
    with pytest.raises(ValueError, match="path"):
        path_headings_deg(np.full(4, 48.0), np.full(4, 11.0), np.zeros(4))


def test_straight_track_goes_both_ways() -> None:
    place = SurveyOrigin(48.0, 11.0, 200.0)
    along = np.array([-50.0, 0.0, 80.0])
    track = straight_track(along, place, np.arange(3.0))
    for index, distance in enumerate(along):
        longitude, latitude, _ = _GEOD.fwd(11.0, 48.0, 200.0 if distance > 0 else 20.0, abs(distance))
        assert track.latitude_deg[index] == pytest.approx(latitude, abs=1e-10)
        assert track.longitude_deg[index] == pytest.approx(longitude, abs=1e-10)
    np.testing.assert_allclose(track.heading_deg, 200.0, atol=1e-3)
    ahead = place.ahead(80.0)
    assert (ahead.latitude_deg, ahead.longitude_deg) == (track.latitude_deg[2], track.longitude_deg[2])
