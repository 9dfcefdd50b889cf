"""Frames against the geodesic of PROJ and against hand calculation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Geod

from lgprjax.frames import LocalFrame, body_to_local, wrap_angle

GEOD = Geod(ellps="WGS84")
ANCHOR = LocalFrame(60.17, 24.94, 31.0)


def one(*values: float) -> tuple[np.ndarray, ...]:
    return tuple(np.array([value], dtype=np.float64) for value in values)


@settings(max_examples=30, deadline=None)
@given(
    latitude=st.floats(-70.0, 70.0),
    longitude=st.floats(-179.9, 179.9),
    azimuth=st.floats(-180.0, 180.0),
    distance_m=st.floats(0.0, 100e3),
    height_m=st.floats(-100.0, 3000.0),
)
def test_there_and_back_is_the_same_point(
    latitude: float, longitude: float, azimuth: float, distance_m: float, height_m: float
) -> None:
    frame = LocalFrame(latitude, longitude, 120.0)
    far_longitude, far_latitude, _ = GEOD.fwd(longitude, latitude, azimuth, distance_m)
    back = frame.to_geodetic(*frame.to_local(*one(far_latitude, far_longitude, height_m)))
    assert abs(back[0][0] - far_latitude) < 1e-9
    assert abs((back[1][0] - far_longitude + 180.0) % 360.0 - 180.0) < 1e-9
    assert abs(back[2][0] - height_m) < 1e-4


def test_the_anchor_is_the_origin_and_up_is_up() -> None:
    east, north, up = ANCHOR.to_local(*one(60.17, 24.94, 36.5))
    np.testing.assert_allclose([east[0], north[0], up[0]], [0.0, 0.0, 5.5], atol=1e-8)


def test_near_the_anchor_local_metres_are_the_geodesic() -> None:
    frame = LocalFrame(60.17, 24.94, 0.0)
    for azimuth in (0.0, 37.0, 143.0, -90.0):
        longitude, latitude, _ = GEOD.fwd(24.94, 60.17, azimuth, 1000.0)
        east, north, up = frame.to_local(*one(latitude, longitude, 0.0))
        assert np.hypot(east[0], north[0]) == pytest.approx(1000.0, abs=1e-4)
        assert np.degrees(np.arctan2(east[0], north[0])) == pytest.approx(azimuth, abs=1e-6)
        assert up[0] == pytest.approx(-(1000.0**2) / (2 * 6.38e6), rel=0.01)


def test_far_away_the_straight_line_is_the_chord_of_the_geodesic() -> None:
    frame = LocalFrame(45.0, 7.0, 0.0)
    distance_m = 100e3
    # The chord of an arc is short by s^3/(24 R^2), 1.03 m here; R lies between 6.36 and 6.40 million metres.
    chord_m = distance_m - distance_m**3 / (24 * 6.38e6**2)
    for azimuth in (10.0, 100.0, 280.0):
        longitude, latitude, _ = GEOD.fwd(7.0, 45.0, azimuth, distance_m)
        east, north, up = frame.to_local(*one(latitude, longitude, 0.0))
        assert np.sqrt(east[0] ** 2 + north[0] ** 2 + up[0] ** 2) == pytest.approx(chord_m, abs=0.01)
        assert np.degrees(np.arctan2(east[0], north[0])) % 360.0 == pytest.approx(azimuth, abs=1e-4)


@pytest.mark.parametrize("bearing", [90.0, 270.0, 45.0])
def test_a_step_along_the_yaw_has_the_heading_that_the_geodesic_says(bearing: float) -> None:
    """50 km from the anchor meridians have turned by up to 0.8 degrees."""
    far_longitude, far_latitude, _ = GEOD.fwd(24.94, 60.17, bearing, 50e3)
    east, north, up = ANCHOR.to_local(*one(far_latitude, far_longitude, 31.0))
    for yaw in (-3.0, -1.2, 0.0, 2.6):
        latitude, longitude, _ = ANCHOR.to_geodetic(east + np.cos(yaw), north + np.sin(yaw), up)
        azimuth = GEOD.inv(far_longitude, far_latitude, longitude[0], latitude[0])[0]
        heading = ANCHOR.heading_of_yaw(np.array([yaw]), np.array([far_longitude]))[0]
        # The local plane is tilted 0.45 degrees against the ground there: 2e-5 rad in a direction.
        assert abs((heading - azimuth + 180.0) % 360.0 - 180.0) < 2e-3


@settings(max_examples=30, deadline=None)
@given(heading=st.floats(0.0, 359.999), longitude=st.floats(24.0, 26.0))
def test_heading_to_yaw_and_back(heading: float, longitude: float) -> None:
    yaw = ANCHOR.yaw_of_heading(*one(heading, longitude))
    assert -np.pi <= yaw[0] < np.pi
    back = ANCHOR.heading_of_yaw(yaw, np.array([longitude]))[0]
    assert abs((back - heading + 180.0) % 360.0 - 180.0) < 1e-9


def test_at_the_anchor_east_is_heading_90_and_yaw_0() -> None:
    here = np.full(4, 24.94)
    yaw = ANCHOR.yaw_of_heading(np.array([90.0, 0.0, 180.0, 45.0]), here)
    np.testing.assert_allclose(yaw, np.radians([0.0, 90.0, -90.0, 45.0]), atol=1e-12)


def test_the_ends_of_the_ranges_are_open() -> None:
    yaw = ANCHOR.yaw_of_heading(*one(0.0, 25.0))
    assert ANCHOR.heading_of_yaw(yaw, np.array([25.0]))[0] < 360.0
    assert wrap_angle(np.array([np.nextafter(-np.pi, -4.0)]))[0] < np.pi


def test_wrapping() -> None:
    angles = np.array([0.0, np.pi, -np.pi, 3.5, -3.5, 7 * np.pi + 0.1])
    wrapped = wrap_angle(angles)
    np.testing.assert_allclose(
        wrapped, [0.0, -np.pi, -np.pi, 3.5 - 2 * np.pi, 2 * np.pi - 3.5, 0.1 - np.pi], atol=1e-12
    )


def test_a_point_of_the_body_by_hand() -> None:
    """Facing north, forward is north and left is west."""
    east, north = body_to_local(np.array([10.0]), np.array([20.0]), np.array([np.pi / 2]), 3.0, 1.0)
    np.testing.assert_allclose([east[0], north[0]], [9.0, 23.0], atol=1e-12)
    east, north = body_to_local(np.array([10.0]), np.array([20.0]), np.zeros(1), 3.0, 1.0)
    np.testing.assert_allclose([east[0], north[0]], [13.0, 21.0], atol=1e-12)
    east, north = body_to_local(np.zeros(1), np.zeros(1), np.radians([30.0]), 2.0, 0.0)
    np.testing.assert_allclose([east[0], north[0]], [np.sqrt(3.0), 1.0], atol=1e-12)
