"""Roads against closed forms, plain integration and a search over every place of the centreline."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lgprjax.scene.road import (
    Road,
    RoadConfig,
    follow_centre,
    local_to_road,
    make_road,
    road_to_local,
    roughness_value,
    surface_up,
)

CURVY = RoadConfig(length_m=400.0, curvature_rms_per_m=1 / 100, heading_deg=-40.0)
ROADS = [make_road(seed, CURVY) for seed in range(6)]


def test_the_default_is_straight_without_rounding_and_one_arc_is_a_circle() -> None:
    along, cross = np.linspace(-12.0, 212.0, 999), np.linspace(-3.0, 3.0, 999)
    straight = make_road(3, RoadConfig())
    for found, due in zip(road_to_local(straight, along, cross), (along, cross, 0.0), strict=True):
        np.testing.assert_array_equal(found, due)
    np.testing.assert_array_equal(follow_centre(straight, along).yaw_rad, 0.0)
    for radius_m in (80.0, -80.0):
        road = make_road(1, RoadConfig(arcs=((200.0, 1 / radius_m),)))
        east, north, _ = road_to_local(road, along, cross)
        angle = along / radius_m
        np.testing.assert_allclose(east, (radius_m - cross) * np.sin(angle), atol=1e-10)
        np.testing.assert_allclose(north, radius_m - (radius_m - cross) * np.cos(angle), atol=1e-10)
        np.testing.assert_allclose(follow_centre(road, along).curvature_per_m, 1 / radius_m, rtol=1e-12)


def test_between_arcs_the_curvature_passes_linearly_over_the_transition() -> None:
    road = make_road(1, RoadConfig(arcs=((60.0, 0.0), (80.0, 0.01), (60.0, -0.008)), transition_m=20.0))
    corners = np.array([-12.0, 50.0, 70.0, 130.0, 150.0, 212.0])
    values = np.array([0.0, 0.0, 0.01, 0.01, -0.008, -0.008])
    along = np.linspace(-12.0, 212.0, 2241)
    centre = follow_centre(road, along)
    np.testing.assert_allclose(centre.curvature_per_m, np.interp(along, corners, values), atol=1e-14)
    assert centre.yaw_rad[-1] - centre.yaw_rad[0] == pytest.approx(80.0 * 0.01 - 72.0 * 0.008, abs=1e-12)


@pytest.mark.parametrize("heading_deg", [0.0, 250.0])
def test_a_road_starts_at_the_origin_in_its_compass_heading(heading_deg: float) -> None:
    road = make_road(2, replace(CURVY, heading_deg=heading_deg))
    east, north, _ = road_to_local(road, np.array([0.0, 1e-4]), np.zeros(2))
    assert (east[0], north[0]) == (0.0, 0.0)
    compass = np.radians(heading_deg)
    np.testing.assert_allclose([east[1], north[1]], [1e-4 * np.sin(compass), 1e-4 * np.cos(compass)], atol=1e-9)


def test_the_centreline_is_the_integral_of_its_yaw_and_that_of_the_curvature() -> None:
    along = np.linspace(0.0, 400.0, 400_001)
    middle = 0.5 * (along[1:] + along[:-1])
    for road in ROADS[:2]:
        fine = follow_centre(road, middle)
        centre = follow_centre(road, along)
        for value, rate in ((centre.east_m, np.cos(fine.yaw_rad)), (centre.north_m, np.sin(fine.yaw_rad))):
            np.testing.assert_allclose(value, np.append(0.0, np.cumsum(rate) * 1e-3), atol=1e-8)
        turned = np.append(0.0, np.cumsum(fine.curvature_per_m) * 1e-3)
        np.testing.assert_allclose(centre.yaw_rad - centre.yaw_rad[0], turned, atol=1e-10)
        assert np.ptp(centre.yaw_rad) > 0.5


@settings(max_examples=25, deadline=None)
@given(
    road=st.sampled_from(ROADS),
    along=st.floats(-10.0, 410.0),
    cross=st.floats(-8.0, 8.0),
    wrong=st.floats(-12.0, 12.0),
)
def test_there_and_back_is_the_same_place(road: Road, along: float, cross: float, wrong: float) -> None:
    east, north, _ = road_to_local(road, np.array([along]), np.array([cross]))
    found = local_to_road(road, east, north, np.array([along + wrong]))
    np.testing.assert_allclose(np.ravel(found), [along, cross], atol=1e-9)


def test_the_place_found_is_the_closest_of_the_centreline() -> None:
    rng = np.random.default_rng(4)
    road = ROADS[3]
    guess = rng.uniform(10.0, 390.0, 20)
    near = follow_centre(road, guess)
    east, north = near.east_m + rng.uniform(-4.0, 4.0, 20), near.north_m + rng.uniform(-4.0, 4.0, 20)
    along, cross = local_to_road(road, east, north, guess)
    for i in range(20):
        every = np.arange(guess[i] - 10.0, guess[i] + 10.0, 1e-3)
        centre = follow_centre(road, every)
        distance = np.hypot(centre.east_m - east[i], centre.north_m - north[i])
        assert along[i] == pytest.approx(every[np.argmin(distance)], abs=1.1e-3)
        assert abs(cross[i]) == pytest.approx(distance.min(), abs=1e-6)


def test_a_point_beyond_a_curves_centre_has_no_place_on_the_road() -> None:
    road = make_road(1, RoadConfig(arcs=((200.0, 1 / 60),)))
    with pytest.raises(ValueError, match="closest"):
        local_to_road(road, np.array([0.0]), np.array([61.0]), np.array([0.5]))


def test_drawn_roads_have_the_size_asked_for_and_no_tighter_curve() -> None:
    config = RoadConfig(
        length_m=40_000.0,
        curvature_rms_per_m=1 / 300,
        transition_m=10.0,
        grade_rms=0.03,
        bank_rms_rad=0.02,
        roughness_rms_m=0.002,
    )
    road = make_road(1, config)
    assert road.curvature_per_m.std() == pytest.approx(1 / 300, rel=0.15)
    assert np.abs(make_road(1, replace(config, curvature_rms_per_m=1 / 80)).curvature_per_m).max() <= 1 / 60 + 1e-15
    along = np.arange(0.0, 40_000.0, 0.7)
    middle = surface_up(road, along, np.zeros(along.size))
    assert (np.diff(middle) / 0.7).std() == pytest.approx(0.03, rel=0.05)
    assert middle[0] == 0.0
    across = np.arctan(surface_up(road, along, np.ones(along.size)) - middle)
    assert across.std() == pytest.approx(0.02, rel=0.05)
    rough = roughness_value(road.roughness, along, np.zeros(along.size))
    assert rough.std() == pytest.approx(0.002, rel=0.05)


def test_roughness_falls_with_the_square_of_the_spatial_frequency() -> None:
    """Power between two wavelengths of a spectrum n**-2 is proportional to their difference."""
    shares = []
    for seed in range(20):
        rough = make_road(seed, RoadConfig(roughness_rms_m=0.002, roughness_wavelength_m=(0.3, 4.0))).roughness
        wavelength = 2 * np.pi / np.linalg.norm(rough.wave_rad_per_m, axis=1)
        assert 0.3 <= wavelength.min() < wavelength.max() <= 4.0
        power = rough.amplitude_m**2 / 2
        assert power.sum() == pytest.approx(0.002**2)
        shares.append([power[wavelength < cut].sum() / power.sum() for cut in (0.6, 1.2, 2.4)])
    np.testing.assert_allclose(np.mean(shares, axis=0), (np.array([0.6, 1.2, 2.4]) - 0.3) / 3.7, rtol=0.1)


def test_a_longer_road_of_the_same_seed_begins_alike_and_each_property_has_its_own_stream() -> None:
    along = np.linspace(-12.0, 200.0, 500)
    short, long = (make_road(8, replace(CURVY, length_m=m)) for m in (250.0, 900.0))
    hilly = make_road(8, replace(CURVY, grade_rms=0.02, bank_rms_rad=0.02, roughness_rms_m=0.001))
    for other in (long, hilly):
        for a, b in zip(follow_centre(short, along), follow_centre(other, along), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-10)
    flat = make_road(8, RoadConfig(grade_rms=0.02, bank_rms_rad=0.02))
    np.testing.assert_array_equal(surface_up(flat, along, along), surface_up(hilly, along, along))
    assert np.ptp(make_road(9, CURVY).curvature_per_m - ROADS[0].curvature_per_m) > 1e-3


@pytest.mark.parametrize(
    ("config", "word"),
    [
        (RoadConfig(length_m=0.0), "length"),
        (RoadConfig(min_radius_m=-1.0), "radius"),
        (RoadConfig(transition_m=0.0), "transition"),
        (RoadConfig(arcs=((50.0, 1 / 40),)), "60.0"),
        (RoadConfig(arcs=((0.0, 1 / 400),)), "60.0"),
    ],
)
def test_a_road_that_cannot_be_built_is_refused(config: RoadConfig, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        make_road(1, config)
