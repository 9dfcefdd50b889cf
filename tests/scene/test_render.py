"""Echoes against searched paths and hand formulae: times, polarity, strength, sums, and the same far down the road."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from lgprjax.scene import GroundConfig, make_ground
from lgprjax.scene.ground import constant_field
from scene.bare_ground import (
    INDEX,
    LIGHT_M_PER_NS,
    RADAR,
    Point,
    fermat,
    ground_of,
    one_layer,
    peak_of,
    pipes,
    render,
    wavelets_at,
)

THROUGH = 1 - ((INDEX - 1) / (INDEX + 1)) ** 2  # the surface, twice, straight down


def stone_echo(antenna: Point, stone: Point, strength: float) -> tuple[float, float]:
    """Time and field of a stone by a searched ray, a traced fan and Fresnel's sines."""
    aside = float(np.hypot(antenna[0] - stone[0], antenna[1] - stone[1]))
    time_ns, air_m, ground_m = fermat(aside, antenna[2], stone[2])
    air_rad, ground_rad = np.arccos(antenna[2] / air_m), np.arccos(stone[2] / ground_m)
    out_of_plane = air_m + ground_m / INDEX
    slant = np.cos(air_rad) / (INDEX * np.cos(ground_rad))
    in_plane = (antenna[2] / np.cos(air_rad) ** 2 + stone[2] * slant / np.cos(ground_rad) ** 2) * np.cos(ground_rad)
    reflected = np.sin(air_rad - ground_rad) / np.sin(air_rad + ground_rad) if aside > 1e-3 else 1 - 2 / (1 + 1 / INDEX)
    edge = np.clip(4 * (1 - aside / RADAR.aperture_m), 0, 1)
    pattern = np.cos(air_rad) ** 2 * edge**2 * (3 - 2 * edge)
    loss = pattern * (1 - reflected**2) * np.exp(-1.4 * ground_m)
    return 2 * time_ns, strength * loss / (out_of_plane * in_plane)


@pytest.mark.parametrize(
    ("antenna", "stone", "strength"),
    [
        ((0.0, 0.0, 0.3), (0.0, 0.0, 1.0), 0.02),
        ((0.7, -0.4, 0.32), (0.1, 0.2, 0.6), -0.02),
        ((-0.5, 1.0, 0.15), (0.0, 0.0, 2.0), 0.02),
    ],
)
def test_a_stone_arrives_in_time_with_its_polarity_and_loss(antenna: Point, stone: Point, strength: float) -> None:
    time_ns, field = stone_echo(antenna, stone, strength)
    place, value = peak_of(render(ground_of([stone], [strength]), [antenna])[0])
    assert place == pytest.approx(time_ns, abs=0.01)
    assert value == pytest.approx(field, rel=0.02)


def test_stones_add_up_as_exact_wavelets() -> None:
    rng = np.random.default_rng(5)
    stones = np.column_stack([np.sort(rng.uniform(-1, 1, 12)), rng.uniform(-1, 1, 12), rng.uniform(0.3, 2, 12)])
    strengths = rng.normal(size=12) * 0.01
    trace = render(ground_of([tuple(s) for s in stones], list(strengths)), [(0.0, 0.0, 0.3)])[0]
    echoes = [stone_echo((0.0, 0.0, 0.3), tuple(s), float(size)) for s, size in zip(stones, strengths, strict=True)]
    expected = wavelets_at(*np.array(echoes).T)
    assert np.abs(trace - expected).max() < 0.02 * np.abs(expected).max()


def test_a_flat_interface_arrives_in_time_with_its_polarity_and_strength() -> None:
    for reflectivity in (0.05, -0.05):
        ground = ground_of(layer=one_layer(0.8, reflectivity))
        for trace, height in zip(render(ground, [(0.0, 0.0, 0.3), (0.0, 0.5, 0.4)]), (0.3, 0.4), strict=True):
            place, value = peak_of(trace)
            assert place == pytest.approx(2 * height / LIGHT_M_PER_NS + 2 * 0.8 / 0.1, abs=0.01)
            expected = reflectivity * THROUGH * np.exp(-1.4 * 0.8) / (2 * (height + 0.8 / INDEX))
            assert value == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("slope", [0.15, -0.25])
def test_a_tilted_interface_is_heard_on_the_quickest_way(slope: float) -> None:
    """Searched over where the ray enters the ground; in there it runs down the interface's normal."""
    along, height, depth = 0.2, 0.3, 1.0

    def path_m(entry: float) -> float:
        in_ground = (depth + slope * entry) * np.cos(np.arctan(slope))
        return float(np.hypot(along - entry, height) + INDEX * in_ground)

    quickest = minimize_scalar(path_m, bounds=(-1.0, 1.0), method="bounded", options={"xatol": 1e-9})
    trace = render(ground_of(layer=one_layer(depth, 0.05, slope)), [(along, 0.0, height)])[0]
    place = peak_of(trace)[0]
    assert place == pytest.approx(2 * quickest.fun / LIGHT_M_PER_NS, abs=0.02)
    below = 2 * (height + INDEX * (depth + slope * along)) / LIGHT_M_PER_NS
    assert abs(place - below) > 0.3  # the point straight below is later


@pytest.mark.parametrize("angle_rad", [0.0, 1.1])
def test_a_pipe_is_heard_from_the_quickest_point_of_its_wall(angle_rad: float) -> None:
    depth, radius, across = 0.7, 0.08, np.array([-np.sin(angle_rad), np.cos(angle_rad)])
    places = [(*(a * across + [0.1, -0.05]), 0.3) for a in (0.0, 0.3, 0.7, 1.2)]
    ground = ground_of(utilities=pipes((0.1, -0.05, angle_rad, depth, radius, -1.0)))
    turn = np.linspace(-np.pi / 2, np.pi / 2, 721)
    for trace, aside in zip(render(ground, places), (0.0, 0.3, 0.7, 1.2), strict=True):
        wall_m = (aside - radius * np.sin(turn), depth - radius * np.cos(turn))
        time_ns = min(fermat(abs(float(a)), 0.3, float(d))[0] for a, d in zip(*wall_m, strict=True))
        place, value = peak_of(trace)
        assert place == pytest.approx(2 * time_ns, abs=0.01)
        assert value < 0


def test_a_pipe_straight_below_is_as_loud_as_wavefronts_say() -> None:
    """Oracle: the two radii of curvature of the wavefront, followed down, over the mirror and up again."""
    height, depth, radius = 0.3, 0.7, 0.08
    way = depth - radius
    amplitude = THROUGH * np.exp(-1.4 * way)
    curvatures = []
    for mirror in (0.0, 2 / radius):  # along the pipe, around it
        front = INDEX * height  # just under the surface
        falls = [np.sqrt(front / (front + way))]
        front = 1 / (1 / (front + way) + mirror)
        falls.append(np.sqrt(front / (front + way)))
        front = (front + way) / INDEX
        falls.append(np.sqrt(front / (front + height)))
        curvatures.append(np.prod(falls))
    amplitude *= np.prod(curvatures) / height  # a field of 1 / h reaches the surface
    ground = ground_of(utilities=pipes((0.0, 0.0, np.pi / 2, depth, radius, -1.0)))
    assert peak_of(render(ground, [(0.0, 0.3, height)])[0])[1] == pytest.approx(-amplitude, rel=0.01)


def test_a_pipe_is_silent_beyond_its_end() -> None:
    there, end, beyond = np.abs(
        render(
            ground_of(utilities=pipes((0.0, 0.0, np.pi / 2, 0.7, 0.05, 0.35))),
            [(0.0, 9.0, 0.3), (0.0, 10.0, 0.3), (0.0, 10.3, 0.3)],
        )
    ).max(axis=1)
    assert end == pytest.approx(0.5 * there, rel=1e-3)
    assert beyond == 0


def test_echoes_outside_the_trace_and_padding_are_silent() -> None:
    assert not render(ground_of([(0.0, 0.0, 4.5)], [1.0]), [(0.0, 0.0, 0.3)]).any()
    assert not render(ground_of([(0.0, 2.1, 1.0)], [1.0]), [(0.0, 0.0, 0.3)]).any()


def test_wetter_ground_is_slower_by_as_much() -> None:
    stone, layer = [(0.0, 0.0, 0.9)], one_layer(1.8, 0.02)
    pipe = pipes((0.0, 0.0, np.pi / 2, 0.9, 0.05, -1.0))
    for dry_ground in (ground_of(stone, [0.02]), ground_of(layer=layer), ground_of(utilities=pipe)):
        wet_ground = dry_ground._replace(moisture=constant_field(0.03, 2))
        dry, wet = (peak_of(render(ground, [(0.0, 0.0, 0.3)])[0])[0] for ground in (dry_ground, wet_ground))
        air_ns = 0.6 / LIGHT_M_PER_NS
        assert wet - air_ns == pytest.approx(1.03 * (dry - air_ns), abs=0.01)


def test_self_similar_ground_sounds_the_same_a_length_on_and_far_down_the_road() -> None:
    """Seven kilometres: float32 places would be 0.5 mm apart, phases of the layers 0.01 rad off."""
    ground = make_ground(4, GroundConfig(length_m=7_000.0, stones_per_m2=0.05, repeat_m=5.0, utilities_along=2))
    antenna_m = [(0.4, 0.1, 0.3), (1.7, -0.2, 0.31)]
    here, *others, between = (render(ground, antenna_m, origin_m=at) for at in (0.0, 5.0, 6_990.0, 2.5))
    assert np.abs(here).max() > 1e-3
    for other in others:
        np.testing.assert_allclose(other, here, atol=2e-4 * np.abs(here).max())
    assert np.abs(between - here).max() > 0.1 * np.abs(here).max()
